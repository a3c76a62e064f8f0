"""Measured against simulated: the free-running car from the wheel accelerations alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.free_response import free_run
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.half_car import HalfCar, deflection_form
from bayes_asv.posterior.free_simulation import free_run as run_freely
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["FreeRun", "freely", "left_in_band", "simulate_free"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FreeRun:
    """A simulation of one recording.

    Parameters
    ----------
    states : (E, 4) array
        δ_f, δ̇_f, δ_r, δ̇_r at the timeline's instants, m and m/s.
    output : (E, 2) array
        Chassis accelerations with the fitted bias, m/s².
    bias : (2,) array
        Bias of each chassis against its wheel channel, m/s².
    """

    states: Array
    output: Array
    bias: Array


def simulate_free(line: PreparedRecording, car: Array) -> FreeRun:
    """Run the car over the measured wheel accelerations.

    Initial state and biases are the ridge-regressed ones under their priors; nothing else is
    adjusted to the chassis readings.

    Parameters
    ----------
    line : PreparedRecording
        The recording.
    car : (8,) array
        c_f, c_r, i, m, l, wdf, k_f, k_r in SI units.

    Returns
    -------
    FreeRun
    """
    system = deflection_form(HalfCar(*(float(v) for v in car)))
    n = len(line.step)
    start = np.zeros((4, 5))
    start[:, 1:] = np.eye(4)
    states = np.empty((n, 4, 5))
    driven = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    free_run(system.A, line.step, line.moments, start, driven, states)
    outputs = np.einsum("oa,nac->noc", system.C, states)  # (E, 2, 5)
    design = np.zeros((n, 2, 6))
    design[:, :, :4] = outputs[:, :, 1:]
    design[:, 0, 4] = design[:, 1, 5] = 1.0
    use = line.kind == VALUE
    X, y = design[use], (line.reading - outputs[:, :, 0])[use]
    # Next to the record the prior weighs as if noise were a thousandth of the motion's power.
    scale = max(float(np.var(y)) * 1e-3, 1e-12)
    weights = np.linalg.solve(X.T @ X + np.diag(scale / line.start), X.T @ y)
    full = states[:, :, 0] + states[:, :, 1:] @ weights[:4]
    return FreeRun(full, outputs[:, :, 0] + design @ weights, weights[4:])


def freely(target: Posterior, z: Array, run: int) -> FreeRun:
    """Run a car with effects over one recording; ``z`` (D,) are its coordinates."""
    output, states, bias = run_freely(target, z, run)
    return FreeRun(states[:, :4], output, bias)


def left_in_band(line: PreparedRecording, free: FreeRun, top: float) -> Array:
    """Share of the chassis' motion below a frequency that the simulation leaves unexplained.

    Parameters
    ----------
    line : PreparedRecording
        The recording.
    free : FreeRun
        Its simulation.
    top : float
        Upper end of the band, Hz: where the car's own modes live, not the engine's.

    Returns
    -------
    (2,) array
        Root of the ratio of powers, front and rear: 0 when all is explained, 1 when nothing is.
    """
    from scipy.signal import welch

    out = np.zeros(2)
    for axle in range(2):
        use = line.kind[:, axle] == VALUE
        time = line.instants[use]
        rate = 1.0 / float(np.median(np.diff(time)))
        even = np.arange(time[0], time[-1], 1.0 / rate)
        measured = np.interp(even, time, line.reading[use, axle])
        left = measured - np.interp(even, time, free.output[use, axle])
        n = min(len(even), int(2.0 * rate))
        frequency, power = welch(measured, rate, nperseg=n)
        _, residual = welch(left, rate, nperseg=n)
        band = (frequency > 0.0) & (frequency <= top)
        whole = float(power[band].sum())
        out[axle] = np.sqrt(residual[band].sum() / whole) if whole > 0.0 else 1.0
    return out
