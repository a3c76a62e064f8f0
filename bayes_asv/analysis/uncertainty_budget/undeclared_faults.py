"""Biases by undeclared faults, and whether residuals would reveal them.

A fault changes the innovations by Δν; to first order the parameters compensate by Δθ = −Σ Jᵀ Δν.
The rest increases the noise levels, which set the weights of the channels.  Therefore the noise
levels are updated by Newton steps, and then the parameters again.

Every fault changes the readings of a channel by a small amount that is computed from the readings;
the innovations are linear in them, so one filter pass gives Δν.  The same fault in all four
channels only filters both sides of a linear relation: the biases add up to almost zero, which a
test checks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.analysis.uncertainty_budget.budget import (
    Budget,
    information,
    jacobian,
    moved,
    parameters,
)
from bayes_asv.domain.units import INCH
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import MISSING, ORDER, VALUE
from bayes_asv.filters.one_pole import low_passed
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = [
    "DETECTABLE_NONCENTRALITY",
    "Fault",
    "LinearizedPosterior",
    "Shift",
    "faults",
    "find_biases",
    "with_fault",
]

# Sizes that a careful team may overlook: the tolerances of scale and corner frequency on a data
# sheet, a tenth of a millisecond by the order of conversion, a mount an inch off its axle.
_GAIN, _DELAY, _BANDWIDTH, _PLACE = 0.01, 1e-4, 0.10, INCH


@dataclass(frozen=True)
class Fault:
    """A sensor that differs from what is declared.

    Parameters
    ----------
    kind : {'gain', 'delay', 'bandwidth', 'place'}
        The gain is too large; it samples later than declared; its corner is higher than declared;
        it is mounted ahead of its axle.
    channel : str
        Which sensor.
    size : float
        Relative change (gain, bandwidth), s (delay) or m (place).
    """

    kind: str
    channel: str
    size: float

    @property
    def name(self) -> str:
        """Kind and channel in one."""
        return f"{self.kind} {self.channel}"


def faults(recording: PreparedRecording, vehicle: Vehicle) -> list[Fault]:
    """List the faults that the sensors of a recording may have."""
    names = [channel.name for channel in recording.channels]
    possible = [Fault("gain", name, _GAIN) for name in names]
    possible += [Fault("delay", name, _DELAY) for name in names]
    possible += [
        Fault("bandwidth", name, _BANDWIDTH)
        for name in names
        if vehicle.sensor(name).bandwidth is not None
    ]
    placed = [channel for channel in recording.channels if channel.part == "body"]
    return possible + [
        Fault("place", channel.name, _PLACE)
        for channel in placed
        if channel.quantity == "acceleration" and _pitch_weights(recording) is not None
    ]


def with_fault(recording: PreparedRecording, fault: Fault, vehicle: Vehicle) -> PreparedRecording:
    """Return a recording as the faulty sensor would have taken it.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    fault : Fault
        Fault of one sensor.
    vehicle : Vehicle
        Gives declared bandwidths.

    Returns
    -------
    PreparedRecording
        Recording with other readings of one channel, to first order in the size of the fault.
    """
    c = [channel.name for channel in recording.channels].index(fault.channel)
    corner = vehicle.sensor(fault.channel).bandwidth
    if c in recording.inputs:
        u = recording.inputs.index(c)
        wheel = recording.wheels[u]
        change = _change_by(fault, wheel.knots, wheel.spline(wheel.knots), corner)
        signal = WheelSignal(CubicSpline(wheel.knots, change), wheel.knots, wheel.sd)
        input_moments = recording.moments.copy()
        input_moments[:, u] += moments(signal, recording.instants, ORDER)
        return replace(recording, moments=input_moments)
    y = recording.outputs.index(c)
    has_reading = recording.kind[:, y] != MISSING
    time, reading = recording.instants[has_reading], recording.reading[has_reading, y]
    if fault.kind == "place":
        change = fault.size * _pitch_acceleration(recording, y, time)
    else:
        change = _change_by(fault, time, reading, corner)
    readings = recording.reading.copy()
    readings[has_reading, y] += change
    return replace(recording, reading=readings)


def _pitch_weights(recording: PreparedRecording) -> Array | None:
    """Weights (ny,) of outputs that give the pitch acceleration; None if it is not determined."""
    if "pitch" not in recording.car.coordinates:
        return None
    nominal = recording.car.nominal
    rows = np.zeros((len(recording.outputs), len(recording.car.coordinates)))
    for y, c in enumerate(recording.outputs):
        if recording.channels[c].quantity == "acceleration":
            rows[y] = recording.car.point(nominal, recording.channels[c])[0]
    axis = recording.car.coordinates.index("pitch")
    weights = np.linalg.pinv(rows)[axis]
    return weights if abs(float(weights @ rows[:, axis]) - 1.0) < 1e-6 else None


def _pitch_acceleration(recording: PreparedRecording, output: int, time: Array) -> Array:
    """Pitch acceleration (rad/s²) from all outputs at the times of one of them."""
    weights = _pitch_weights(recording)
    assert weights is not None
    out = np.zeros(len(time))
    for y, weight in enumerate(weights):
        if weight == 0.0:
            continue
        use = recording.kind[:, y] != MISSING if y == output else recording.kind[:, y] == VALUE
        at, reading = recording.instants[use], recording.reading[use, y]
        out += weight * (reading if y == output else CubicSpline(at, reading)(time))
    return out


def _change_by(fault: Fault, time: Array, signal: Array, corner: float | None) -> Array:
    """Change of a channel's samples (N,) by a fault."""
    if fault.kind == "gain":
        return fault.size * signal
    if fault.kind == "delay":
        return np.asarray(fault.size * CubicSpline(time, signal)(time, 1))
    # ∂/∂log ω of ω/(s + ω) is s/(s + ω) of the signal that has passed the pole
    assert corner is not None
    slow = low_passed(time, CubicSpline(time, signal).c, 2.0 * math.pi * corner)
    return np.asarray(fault.size * (signal - slow))


Array = NDArray[np.float64]

DETECTABLE_NONCENTRALITY = 40.0
"""Noncentrality in the residuals above which a fault is detectable.

The predictions are also accurate up to it: on 16 drives of the rig, 95 % of 1088 predictions (272
faults, four parameters) were within 0.05 standard deviations of the mode that was estimated with
the fault in the data, and all within 0.2 (``benchmarks/predicted_biases.py``, seed 31).  With 100
instead of 40, these were 0.16 and 0.7 on eight of the drives.
"""

_OFF = 0.01  # relative error of a value that is given as exact
_NOTICED = 1.0  # noncentrality below which noise levels are not updated
_ROUNDS = 2  # alternations between noise and parameters; one leaves errors of half an sd
_REACH = 0.5  # step of finite differences of a noise level, in its sd
_STILL = 0.05  # step of a noise level below which the iteration stops, in its sd


@dataclass(frozen=True)
class Shift:
    """Bias of the parameters by an undeclared fault.

    Parameters
    ----------
    kind : str
        ``gain``, ``delay``, ``bandwidth``, ``place`` (see :class:`Fault`) or ``given``: the true
        value is larger than the one that is given as exact.
    where : str
        Channel or given value.
    size : float
        As in :class:`Fault`; a relative change for ``given``.
    shows : bool
        The size was limited to what the residuals cannot detect: a noncentrality of
        :data:`DETECTABLE_NONCENTRALITY`.
    moved : (P,) array
        Relative changes of the estimated parameters by the fault.
    """

    kind: str
    where: str
    size: float
    shows: bool
    moved: Array


@dataclass(frozen=True)
class LinearizedPosterior:
    """A posterior linearised at its mode.

    Parameters
    ----------
    posterior, z : Posterior, (D,) array
        From :func:`~bayes_asv.analysis.uncertainty_budget.budget.in_logs`.
    slopes : list of (ny E, P) arrays
        Jacobians of the runs at the mode.
    budget : Budget
        Prior standard deviations and information.
    noise_precision : (D − P, D − P) array
        Curvature of minus the log-posterior in the noise coordinates.
    """

    posterior: Posterior
    z: Array
    slopes: list[Array]
    budget: Budget
    noise_precision: Array

    @cached_property
    def score_at_mode(self) -> tuple[Array, Array]:
        """Gradient of the log-likelihood at the mode by parameters (P,), and by noise (D − P,).

        The first balances the gradient of the prior.  The second includes the prior's, and would be
        zero at the exact mode.
        """
        score = np.zeros(len(self.budget.sd))
        for run, j in enumerate(self.slopes):
            score += j.T @ self.posterior.innovations(self.z, run).ravel()
        return score, _noise_slope(self, self.posterior, self.z)[0]


def find_biases(there: LinearizedPosterior, vehicle: Vehicle) -> list[Shift]:
    """Predict the biases by undeclared faults, one at a time.

    Parameters
    ----------
    there : LinearizedPosterior
        The posterior.
    vehicle : Vehicle
        Declared vehicle and sensors.

    Returns
    -------
    list of Shift
        Values that are given as exact first, then faults of sensors.
    """
    recordings = there.posterior.space.recordings
    shifts = []
    for k, name in enumerate(parameters(there.posterior)):
        if there.budget.sd[k] == 0.0:
            error = -_OFF * np.eye(len(there.budget.sd))[k]  # held that much below the truth
            shifts.append(_shift(there, Fault("given", name, _OFF), recordings, error))
    declared = parameters(there.posterior)
    for fault in faults(recordings[0], vehicle):
        if fault.name in declared:
            continue  # declared: it is among the parameters
        faulty = tuple(with_fault(recording, fault, vehicle) for recording in recordings)
        shifts.append(_shift(there, fault, faulty, np.zeros(len(there.budget.sd))))
    return shifts


def _shift(
    linearized: LinearizedPosterior,
    fault: Fault,
    faulty: tuple[PreparedRecording, ...],
    error: Array,
) -> Shift:
    """Predict the bias by faulty recordings, or by wrong values of fixed parameters (P,)."""
    posterior = _with_recordings(linearized.posterior, faulty)
    score, power = np.zeros(len(linearized.budget.sd)), 0.0
    for run, j in enumerate(linearized.slopes):
        change = posterior.innovations(linearized.z, run) - linearized.posterior.innovations(
            linearized.z, run
        )
        change = change.ravel() + j @ error
        score += j.T @ change
        power += float(change @ change)
    covariance = linearized.budget.covariance()
    remaining = power - float(score @ covariance @ score)
    scale = min(1.0, math.sqrt(DETECTABLE_NONCENTRALITY / remaining)) if remaining > 0.0 else 1.0
    recordings = tuple(
        map(_blend, linearized.posterior.space.recordings, faulty, [scale] * len(faulty))
    )
    shift = -scale * covariance @ score
    if scale**2 * remaining > _NOTICED:
        shift = _update_noise(
            linearized, _with_recordings(linearized.posterior, recordings), scale * error, shift
        )
    shift = scale * error + shift
    return Shift(fault.kind, fault.channel, scale * fault.size, scale < 1.0, shift)


def _with_recordings(posterior: Posterior, recordings: tuple[PreparedRecording, ...]) -> Posterior:
    return replace(posterior, space=replace(posterior.space, recordings=recordings))


def _blend(sound: PreparedRecording, faulty: PreparedRecording, share: float) -> PreparedRecording:
    """Scale the change by a fault; readings and moments are linear in it."""
    return replace(
        sound,
        moments=sound.moments + share * (faulty.moments - sound.moments),
        reading=sound.reading + share * (faulty.reading - sound.reading),
    )


def _update_noise(
    linearized: LinearizedPosterior, posterior: Posterior, error: Array, shift: Array
) -> Array:
    """Update noise levels and parameters in turn; return the shift of the parameters (P,)."""
    runs, sd = range(len(linearized.slopes)), linearized.budget.sd
    z = linearized.z.copy()
    for _ in range(_ROUNDS):
        slope, curvature = _noise_slope(linearized, posterior, moved(posterior, z, error + shift))
        step = np.linalg.solve(curvature, slope - linearized.score_at_mode[1])
        if not np.all(np.isfinite(step)):
            break
        z[len(sd) :] += step
        at = moved(posterior, z, error + shift)
        slopes = [jacobian(posterior, at, run) for run in runs]
        score = (
            np.divide(shift, sd**2, out=np.zeros(len(linearized.budget.sd)), where=sd > 0.0)
            - linearized.score_at_mode[0]
        )
        for run, j in enumerate(slopes):
            score += j.T @ posterior.innovations(at, run).ravel()
        shift = shift - Budget(sd, information(slopes)).covariance() @ score
        if np.all(np.abs(step) * np.sqrt(np.diag(linearized.noise_precision)) < _STILL):
            break
    return shift


def _noise_slope(
    linearized: LinearizedPosterior, posterior: Posterior, z: Array
) -> tuple[Array, Array]:
    """Gradient (D − P,) and curvature of the log-posterior in the noise coordinates.

    The curvature is at least that at the mode, so that a step never overshoots by much.
    """
    car = len(linearized.budget.sd)
    step_sizes = _REACH / np.sqrt(np.diag(linearized.noise_precision))
    slope, curvature = -z[car:], linearized.noise_precision.copy()
    for run in range(len(linearized.slopes)):
        coordinates = posterior.space.coordinates_of_run(run)[car:]
        h = step_sizes[coordinates - car]
        steps = np.zeros((len(coordinates), len(z)))
        steps[np.arange(len(coordinates)), coordinates] = h
        values = posterior.run_log_likelihood(np.concatenate([z[None], z + steps, z - steps]), run)
        middle, (above, below) = values[0], np.split(values[1:], 2)
        slope[coordinates - car] += (above - below) / (2.0 * h)
        bend = 1.0 - (above - 2.0 * middle + below) / h**2
        curvature[coordinates - car, coordinates - car] = np.maximum(
            bend, curvature[coordinates - car, coordinates - car]
        )
    return slope, curvature
