"""How narrow an interval can be: the Bayesian Cramér–Rao bound at the truth.

An ideal estimator knows what no real one does: the noise of every sensor exactly (its variance,
the filter it passed, a step q as q²/12) and what the wheels did between their samples.  It does
not know the car, the initial state or the biases, and believes of them beforehand what the
estimator believes.  Its precision is the information in the readings,

    J = Σ_k (∂ŷ_k/∂θ) S_k⁻¹ (∂ŷ_k/∂θ)ᵀ ,

at the true car on the true wheel motion, with the wheel sensors' noise in S, plus that of the
prior (van Trees 1968, Part I, section 2.4).  What S itself tells about the car is left out: see
:mod:`benchmarks.calibration.dense`, which computes both with matrices and shares no code with
this.  An engine, and readings lost at a rail, are left out too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.signal import lfilter

from bayes_asv.filters.kalman import SensorNoise
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments
from benchmarks.calibration.dense import suspension
from benchmarks.calibration.quantities import coordinates, log_spread
from benchmarks.calibration.rig_runs import Case
from tests.posterior.cases import prepared
from tests.rig import Motion, SensorSpec
from tests.rig.sensors import low_pass

__all__ = ["bounds", "information", "true_noise", "true_wheels"]

Array = NDArray[np.float64]

_EVERY = 4  # of the rig's 16 000 steps a second: a spline through 4 000 Hz misses nothing
_STEP = 1e-3  # of a prior deviation
_WHEELS_THEN_CHASSIS = (0, 2, 1, 3)


@dataclass(frozen=True)
class _KnownNoise(ParameterSpace):
    """The estimator's coordinates with the noise as it truly is, whatever they say of it.

    Parameters
    ----------
    known : (12,) array
        Noise arguments of the kernel.
    """

    known: Array = field(default_factory=lambda: np.zeros(12))

    def noises(self, z: Array, run: int) -> SensorNoise:
        """Return the true noise for every row of z."""
        every = np.tile(self.known, (len(z), 1))
        return SensorNoise(every[:, :4], every[:, 4:8], every[:, 8:])


def bounds(case: Case, space: ParameterSpace, names: tuple[str, ...]) -> dict[str, float]:
    """Least deviation of the logarithm of each quantity.

    Parameters
    ----------
    case : Case
        A drive and its truth.
    space : ParameterSpace
        Coordinates and priors of the estimator for this drive.
    names : tuple of str
        Quantities.

    Returns
    -------
    dict of str to float
    """
    precision = information(case, space)
    covariance = np.asarray(np.linalg.inv(precision + np.eye(len(precision))))
    r = space.prior.identified.shape[1]
    return {name: log_spread(space, covariance[:r, :r], name) for name in names}


def information(case: Case, space: ParameterSpace) -> Array:
    """Information (n, n) in the readings about the n coordinates of the car, prior left out."""
    own = {entry.name: getattr(space, entry.name) for entry in fields(ParameterSpace)}
    own["recordings"] = (_ideal(case),)
    posterior = Posterior(_KnownNoise(**own, known=true_noise(case.sensors)), (WHITE,))
    z = coordinates(space, case.car)
    columns = []
    for k in range(space.car_dimension):
        step = np.zeros(len(z))
        step[k] = _STEP
        ahead, behind = (posterior.innovations(z + s, 0, WHITE) for s in (step, -step))
        columns.append((ahead - behind).ravel() / (2.0 * _STEP))
    sensitivity = np.stack(columns, axis=1)
    return np.asarray(sensitivity.T @ sensitivity)


def true_noise(sensors: SensorSpec) -> Array:
    """Noise arguments (12,) of the kernel as they truly are."""
    out = np.zeros(12)
    for column, c in enumerate(_WHEELS_THEN_CHASSIS):
        variance = sensors.noise[c] ** 2
        filtered = sensors.noise_kind == "filtered" and math.isfinite(sensors.bandwidth[c])
        step = 0.0 if sensors.adc is None else sensors.adc.scale[c]
        out[column] = (0.0 if filtered else variance) + step**2 / 12.0
        if filtered:
            out[4 + column] = variance
            out[8 + column] = 2.0 * math.pi * sensors.bandwidth[c]
    return out


def true_wheels(motion: Motion, sensors: SensorSpec) -> tuple[Array, Array]:
    """Return times (K,) and wheel accelerations (2, K) behind the sensors' filters."""
    passed = [low_pass(motion.acceleration[c], motion.step, sensors.bandwidth[c]) for c in (0, 2)]
    return motion.time[::_EVERY], np.stack(passed)[:, ::_EVERY]


def _ideal(case: Case) -> PreparedRecording:
    """Lay out the true wheel motion at the recording's instants, with readings that fit it."""
    boundless = {
        name: replace(s, low=-math.inf, high=math.inf) for name, s in case.vehicle.sensors.items()
    }
    vehicle = replace(case.vehicle, sensors=boundless)
    line = prepared(case.recording, vehicle)
    time, wheels = true_wheels(case.motion, case.sensors)
    front, rear = (WheelSignal(CubicSpline(time, u), time, np.zeros(len(time) - 1)) for u in wheels)
    order = line.moments.shape[2]
    drive = np.stack([moments(w, line.instants, order) for w in (front, rear)], axis=1)
    spread = line.process_noise.copy()
    spread[:, 2:] = 0.0  # nothing is unknown between the samples
    line = replace(
        line, wheels=(front, rear), moments=np.ascontiguousarray(drive), process_noise=spread
    )
    fitting = CubicSpline(time, _response(case.car, time, wheels), axis=1)
    return replace(line, reading=np.ascontiguousarray(fitting(line.instants).T))


def _response(car: Array, time: Array, wheels: Array) -> Array:
    """Chassis accelerations (2, K) of a car at rest at first, at even times, mode by mode."""
    A, C = suspension(car)
    h = float(time[1] - time[0])
    big = np.zeros((8, 8))
    big[:4, :4] = A
    big[1, 4] = big[3, 5] = -1.0  # the wheels' accelerations, and
    big[4, 6] = big[5, 7] = 1.0  # their slopes
    flow = expm(big * h)[:4]
    fresh = flow[:, 4:6] @ wheels[:, :-1] + flow[:, 6:] @ np.diff(wheels, axis=1) / h
    rate, modes = np.linalg.eig(A)
    driven = np.linalg.solve(modes, fresh)
    states = [
        lfilter([1.0], [1.0, -np.exp(r * h)], row) for r, row in zip(rate, driven, strict=True)
    ]
    out = np.zeros(wheels.shape)
    out[:, 1:] = (C @ modes @ np.stack(states)).real
    return out
