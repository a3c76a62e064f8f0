"""Strength of an effect: its noncentrality against the best linear half car.

For readings without noise, weighted with the covariance that the noise would have,

    Q = min over the car, start and biases of |L (y - G(car) u)|^2 + |given values in deviations|^2,

where L whitens by S_y + G S_u G^T.  The likelihood-ratio test for the known effect is a noncentral
chi-square, whose noncentrality is Q minus its value for the same car without the effect.  Q comes
from the innovations of the linear car, without the diagnosis, and is tested against complete
covariance matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from bayes_asv.preprocessing.prepare import prepare

__all__ = ["ScaledEffect", "find_size", "frozen_distance", "whitened_distance", "without_rails"]

Array = NDArray[np.float64]

_ALL_FILTERED = 3.0  # probit of the share of noise that passes the sensor's own filter
_TOLERANCE = 0.1  # relative, of the noncentrality
_ROUNDS = 14
_BOUND = 40.0  # in prior deviations; a spring given within 5 % and twice as stiff is at 14


@dataclass(frozen=True)
class ScaledEffect:
    """Size of an effect for a strength.

    Parameters
    ----------
    size : float
        In the effect's own measure.
    noncentrality : float
        Reached by it; less than intended where the largest size does not suffice.
    """

    size: float
    noncentrality: float


def without_rails(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with sensors that never clip."""
    sensors = {n: replace(s, low=-math.inf, high=math.inf) for n, s in vehicle.sensors.items()}
    return replace(vehicle, sensors=sensors)


def whitened_distance(
    recordings: Sequence[Recording], vehicle: Vehicle, start: Array | None = None
) -> tuple[float, Array]:
    """Whitened distance Q of recordings from the best linear half car.

    Parameters
    ----------
    recordings : sequence of Recording
        Of one car, without noise and quantization.
    vehicle : Vehicle
        With priors and noise levels.
    start : (n,) array, optional
        Starting coordinates.

    Returns
    -------
    float
        Q.
    (n,) array
        Coordinates of the best car.
    """
    posterior = _posterior(recordings, vehicle)
    n = posterior.space.shared_dimension

    def residual(car: Array) -> Array:
        joint = np.append(_innovations(posterior, car), car)
        return np.asarray(np.nan_to_num(joint, nan=1e6, posinf=1e6, neginf=-1e6))

    begin = np.zeros(n) if start is None else start
    fit = least_squares(
        residual, begin, bounds=(-_BOUND, _BOUND), xtol=1e-7, ftol=1e-9, max_nfev=60
    )
    return 2.0 * float(fit.cost), np.asarray(fit.x)


def frozen_distance(recordings: Sequence[Recording], vehicle: Vehicle, car: Array) -> float:
    """Whitened distance of recordings from a given car; only start and biases are free.

    Parameters
    ----------
    recordings, vehicle
        As :func:`left_over` takes them.
    car : (n,) array
        Coordinates, as :func:`whitened_distance` returns them for other runs.
    """
    return float(np.sum(_innovations(_posterior(recordings, vehicle), car) ** 2))


def _posterior(recordings: Sequence[Recording], vehicle: Vehicle) -> Posterior:
    plain = without_rails(vehicle)
    car = car_model("half", plain)
    parameters = make_parameter_space(
        plain, tuple(prepare(recording, plain, car) for recording in recordings)
    )
    return Posterior(parameters, (WHITE,) * len(recordings))


def _innovations(posterior: Posterior, car: Array) -> Array:
    """Normalised innovations (N,) of a car, with noise as given."""
    z = np.concatenate([car, _levels(posterior.space)])
    runs = range(len(posterior.space.recordings))
    return np.concatenate([posterior.innovations(z, run).ravel() for run in runs])


def _levels(parameters: ParameterSpace) -> Array:
    """Noise coordinates for the given levels, all noise behind the sensor's filter."""
    names = parameters.names[parameters.shared_dimension :]
    return np.array([_ALL_FILTERED if name.startswith("filtered") else 0.0 for name in names])


def find_size(
    loss: Callable[[float], float], target: float, first: float, largest: float
) -> ScaledEffect:
    """Find the size of an effect for a noncentrality.

    Parameters
    ----------
    loss : callable
        From a size to its noncentrality, which grows about as its square while small.
    target : float
        Intended noncentrality, within a tenth.
    first : float
        First size to try.
    largest : float
        Largest size.

    Returns
    -------
    Scaled
    """
    low, high = (0.0, 0.0), (largest, math.inf)  # size and its noncentrality
    size = min(first, 0.9 * largest)
    best: ScaledEffect | None = None
    for _ in range(_ROUNDS):
        reached = max(loss(size), 1e-6)
        if best is None or _apart(reached, target) < _apart(best.noncentrality, target):
            best = ScaledEffect(size, reached)
        if abs(reached / target - 1.0) < _TOLERANCE or (reached < target and size >= largest):
            break
        slope = 2.0
        if reached < target:
            low = (size, reached)
        else:
            high = (size, reached)
        if low[0] > 0.0 and math.isfinite(high[1]):
            slope = math.log(high[1] / low[1]) / math.log(high[0] / low[0])
        guess = size * (target / reached) ** (1.0 / max(slope, 0.5))
        if guess >= largest and math.isinf(high[1]):
            size = largest
        elif not low[0] < guess < high[0]:
            size = math.sqrt(max(low[0], 0.05 * high[0]) * high[0])
        else:
            size = guess
    assert best is not None
    return best


def _apart(reached: float, target: float) -> float:
    return abs(math.log(reached / target))
