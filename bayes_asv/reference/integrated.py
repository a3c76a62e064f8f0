"""The reference's data processing: accelerations integrated twice (sections 5.4 and 8.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations, nominal_rate, sample_times
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.discretization import Step, exact_step
from bayes_asv.models.half_car_equations import HalfCar, LinearSystem, position_form

__all__ = ["DETRENDINGS", "REST_TIME", "Integrated", "integrate", "simulate_states"]

Array = NDArray[np.float64]

REST_TIME = 0.1  # s at rest before a motion

DETRENDINGS: Final = ("none", "rest", "trend", "constant")
"""Detrending of the accelerations before integration: none; the mean of the first tenth of a
second; a linear trend over the whole record (the reference's 400 Hz data); the constant for which
the second integral ends at zero (its 800 Hz data)."""

_TERMS = 17  # of the exponential series


@dataclass(frozen=True)
class Integrated:
    """Inputs and outputs of the reference's grey box (eq. 5.3, 5.4).

    Parameters
    ----------
    time : (N,) array
        Times, s.
    acceleration, velocity, displacement : (4, N) arrays
        Of the four channels after detrending, SI units, initially at rest.
    u : (N, 4) array
        u_f, u̇_f, u_r, u̇_r.
    y : (N, 4) array
        θ, θ̇, x, ẋ.
    """

    time: Array
    acceleration: Array
    velocity: Array
    displacement: Array
    u: Array
    y: Array

    @property
    def travel(self) -> Array:
        """Suspension deflection (2, N), front and rear, extension positive, m (Fig. 8.5)."""
        return np.asarray(self.displacement[[1, 3]] - self.displacement[[0, 2]])


def integrate(recording: Recording, vehicle: Vehicle, detrending: str) -> Integrated:
    """Integrate a recording to states and inputs.

    Linear interpolation puts all channels on one grid, as the reference does to correct the delay
    of its chassis channels.  Eq. 6.2 is used without its division by l.

    Parameters
    ----------
    recording, vehicle : Recording, Vehicle
        As read; missing readings are interpolated linearly.
    detrending : str
        One of :data:`DETRENDINGS`.

    Returns
    -------
    Integrated

    Raises
    ------
    InputError
        If a channel has no readings or the channels hardly overlap.
    ValueError
        If the kind of detrending is unknown.
    """
    if detrending not in DETRENDINGS:
        raise ValueError(f"detrending must be one of {', '.join(DETRENDINGS)}")
    readings, times = accelerations(recording, vehicle), sample_times(recording, vehicle)
    valid = np.isfinite(readings)
    if np.any(np.count_nonzero(valid, axis=1) < 2):
        raise InputError(recording.source, "has a channel without readings", "check the wiring")
    first = max(float(t[ok][0]) for t, ok in zip(times, valid, strict=True))
    last = min(float(t[ok][-1]) for t, ok in zip(times, valid, strict=True))
    h = 1.0 / nominal_rate(recording)
    if last - first < 10.0 * h:
        raise InputError(
            recording.source, "has channels that overlap in less than ten rows", "check the delays"
        )
    time: Array = first + h * np.arange(int((last - first) / h + 1e-6) + 1, dtype=np.float64)
    a = np.stack(
        [np.interp(time, t[ok], r[ok]) for t, r, ok in zip(times, readings, valid, strict=True)]
    )
    if detrending == "rest":
        a = a - a[:, time - time[0] < REST_TIME].mean(axis=1, keepdims=True)
    elif detrending == "trend":
        a = detrend(a, axis=1)
    elif detrending == "constant":
        span = time[-1] - time[0]
        a = a - 2.0 * _integrate_twice(a, time)[1][:, -1:] / span**2
    v, x = _integrate_twice(a, time)
    heave = np.array([vehicle.wdf.value, 1.0 - vehicle.wdf.value])
    pitch = np.array([1.0, -1.0]) / vehicle.l.value
    chassis, wheel = [1, 3], [0, 2]
    y = np.stack([pitch @ x[chassis], pitch @ v[chassis], heave @ x[chassis], heave @ v[chassis]])
    u = np.stack([x[wheel[0]], v[wheel[0]], x[wheel[1]], v[wheel[1]]])
    return Integrated(time, a, v, x, np.ascontiguousarray(u.T), np.ascontiguousarray(y.T))


def _integrate_twice(a: Array, time: Array) -> tuple[Array, Array]:
    """Integrate once and twice from rest, exactly for piecewise linear accelerations."""
    h = np.diff(time)
    start = np.zeros((len(a), 1))
    v = np.concatenate([start, np.cumsum(0.5 * h * (a[:, :-1] + a[:, 1:]), axis=1)], axis=1)
    increment = v[:, :-1] * h + h**2 * (2.0 * a[:, :-1] + a[:, 1:]) / 6.0
    x = np.concatenate([start, np.cumsum(increment, axis=1)], axis=1)
    return v, x


def simulate_states(
    car: HalfCar, h: float, u: Array, *, held: bool, free: bool
) -> tuple[Array, Array]:
    """Simulate the model of eq. 5.5 with inputs sampled every ``h`` seconds.

    Parameters
    ----------
    car : HalfCar
        SI units.
    h : float
        Sampling interval, s.
    u : (N, 4) array
        Inputs as of :class:`Integrated`.
    held : bool
        Zero-order hold of the inputs, the default of ``idgrey`` in the reference; otherwise
        first-order hold.
    free : bool
        Whether the initial state is estimated.

    Returns
    -------
    base : (N, 4) array
        States from rest.
    design : (N, 4, 4) or (N, 4, 0) array
        Response to a unit of each initial state.
    """
    Phi, Gamma0, Gamma1 = _step(position_form(car), h)
    increments = u[:-1] @ (Gamma0 + Gamma1).T if held else u[:-1] @ Gamma0.T + u[1:] @ Gamma1.T
    base = _recursion(Phi, np.concatenate([np.zeros((1, 4)), increments]))
    if not free:
        return base, np.zeros((len(u), 4, 0))
    design = np.empty((len(u), 4, 4))
    for j, unit in enumerate(np.eye(4)):
        first = np.zeros((len(u), 4))
        first[0] = unit
        design[:, :, j] = _recursion(Phi, first)
    return base, design


def _step(system: LinearSystem, h: float) -> Step:
    """Discretise like :func:`exact_step`, by a power series if the step is short.

    The optimisation calls this thousands of times.  For ‖A‖ h up to one, 16 terms have an error
    below 1e-14; a longer step uses the matrix exponential.
    """
    A, B = system.A * h, system.B * h
    if float(np.abs(A).sum(axis=1).max()) > 1.0:
        return exact_step(system, h)
    term = np.eye(len(A))
    Phi, held, ramp = term.copy(), term.copy(), 0.5 * term
    for k in range(1, _TERMS):
        term = term @ A / k
        Phi += term
        held += term / (k + 1)
        ramp += term / ((k + 1) * (k + 2))
    return Step(Phi, (held - ramp) @ B, ramp @ B)


def _recursion(Phi: Array, increments: Array) -> Array:
    """Compute x_k = Φ x_{k−1} + p_k from x_{−1} = 0, by doubling sums over 2, 4, 8 … samples."""
    x, reach, power = increments.copy(), 1, Phi
    while reach < len(x):
        x[reach:] = x[reach:] + x[:-reach] @ power.T
        reach, power = 2 * reach, power @ power
    return x
