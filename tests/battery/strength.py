"""How much the best linear half car loses through an effect: the noncentrality of a case.

With no noise at all in the readings, but with the covariance that the noise would have had,

    Q = min over the car, start and biases of |L (y - G(car) u)|^2 + |given values in deviations|^2,

where L whitens by S_y + G S_u G^T.  A likelihood-ratio test that knew the effect would be a
noncentral chi-square with Q less what the same car leaves without the effect.  Nothing of the
diagnosis is used: Q comes from the innovations of the plain linear car, and a test holds them
against whole covariance matrices.
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
from bayes_asv.posterior.parameters import ParameterSpace, space
from bayes_asv.preprocessing.timeline import prepare

__all__ = ["Scaled", "carried", "left_over", "scaled", "without_rails"]

Array = NDArray[np.float64]

_ALL_FILTERED = 3.0  # probit of the share of a sensor's noise that passed its own filter
_TOLERANCE = 0.1  # of the noncentrality
_ROUNDS = 14
_FAR = 40.0  # prior deviations; a spring given within 5 % that is twice as stiff is 14 away


@dataclass(frozen=True)
class Scaled:
    """An effect brought to a strength.

    Parameters
    ----------
    size : float
        Of the effect, in its own measure.
    noncentrality : float
        What was reached; below what was asked where the largest size did not suffice.
    """

    size: float
    noncentrality: float


def without_rails(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with sensors that never clip: readings without noise may go beyond."""
    a, b, c, d = (replace(s, low=-math.inf, high=math.inf) for s in vehicle.sensors)
    return replace(vehicle, sensors=(a, b, c, d))


def left_over(
    recordings: Sequence[Recording], vehicle: Vehicle, start: Array | None = None
) -> tuple[float, Array]:
    """Whitened distance that the best linear half car leaves.

    Parameters
    ----------
    recordings : sequence of Recording
        Readings without noise and without steps, of runs that share the car.
    vehicle : Vehicle
        Gives priors and noise levels.
    start : (n,) array, optional
        Where to begin.

    Returns
    -------
    float
        Q as above.
    (n,) array
        Coordinates of the best car, to begin from the next time.
    """
    target = _target(recordings, vehicle)
    n = target.space.lasting_dimension

    def residual(car: Array) -> Array:
        every = np.append(_innovations(target, car), car)
        return np.asarray(np.nan_to_num(every, nan=1e6, posinf=1e6, neginf=-1e6))

    begin = np.zeros(n) if start is None else start
    fit = least_squares(residual, begin, bounds=(-_FAR, _FAR), xtol=1e-7, ftol=1e-9, max_nfev=60)
    return 2.0 * float(fit.cost), np.asarray(fit.x)


def carried(recordings: Sequence[Recording], vehicle: Vehicle, car: Array) -> float:
    """Whitened distance that a car found on other runs leaves here; start and biases are free.

    Parameters
    ----------
    recordings, vehicle
        As :func:`left_over` takes them.
    car : (n,) array
        Coordinates of the best car there, as that returns them.
    """
    return float(np.sum(_innovations(_target(recordings, vehicle), car) ** 2))


def _target(recordings: Sequence[Recording], vehicle: Vehicle) -> Posterior:
    plain = without_rails(vehicle)
    car = car_model("half", plain)
    where = space(plain, tuple(prepare(recording, plain, car) for recording in recordings))
    return Posterior(where, (WHITE,) * len(recordings))


def _innovations(target: Posterior, car: Array) -> Array:
    """Innovations of a car, (N,), in deviations; noise is as given."""
    z = np.concatenate([car, _levels(target.space)])
    runs = range(len(target.space.timelines))
    return np.concatenate([target.innovations(z, run).ravel() for run in runs])


def _levels(where: ParameterSpace) -> Array:
    """Noise coordinates: levels as given, all of it behind the sensor's filter."""
    names = where.names[where.lasting_dimension :]
    return np.array([_ALL_FILTERED if name.startswith("filtered") else 0.0 for name in names])


def scaled(loss: Callable[[float], float], target: float, first: float, largest: float) -> Scaled:
    """Find the size of an effect that reaches a noncentrality.

    Parameters
    ----------
    loss : callable
        Noncentrality of a size; grows with it, about as its square while small.
    target : float
        What to reach, within a tenth.
    first : float
        Size to try first.
    largest : float
        Size that no car has more of.

    Returns
    -------
    Scaled
    """
    low, high = (0.0, 0.0), (largest, math.inf)  # size and what it reaches
    size = min(first, 0.9 * largest)
    best: Scaled | None = None
    for _ in range(_ROUNDS):
        reached = max(loss(size), 1e-6)
        if best is None or _apart(reached, target) < _apart(best.noncentrality, target):
            best = Scaled(size, reached)
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
