"""Measured against simulated, with effects: the car follows its wheel accelerations alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters import ekf as extended
from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.effects import NominalReadings, rows
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["beginning", "free_run", "simulated"]

Array = NDArray[np.float64]

_ROUNDS = 4
_STEPS = np.array([1e-4, 1e-3, 1e-4, 1e-3, 1e-3, 1e-3])  # m, m/s, …, m/s²


def free_run(target: Posterior, z: Array, run: int) -> tuple[Array, Array, Array]:
    """Simulate one recording from its wheel accelerations.

    Initial state and biases are regressed on the chassis readings under their priors; nothing
    else is adjusted to them.

    Parameters
    ----------
    target : Posterior
        With patterns.
    z : (D,) array
        Coordinates; those of noise play no part.
    run : int
        Which recording.

    Returns
    -------
    output : (E, 2) array
        What the chassis sensors would have read, m/s².
    states : (E, 6) array
        δ_f, δ̇_f, δ_r, δ̇_r (m, m/s) and both filtered excess forces (N).
    begin : (6,) array
        The first four of these (m, m/s) where the recording begins, and the bias of each chassis
        against its wheel channel, m/s².
    """
    found = _regressed(target, z, run)
    line = target.space.timelines[run]
    # The simulation is of sensors as declared; what the real ones added is put back.
    return found.output + (line.reading - found.inputs.reading), found.states, found.begin


def beginning(target: Posterior, z: Array, run: int) -> tuple[Array, Array]:
    """Where a recording begins, and the deviation of that, (6,) each; as :func:`free_run` has it.

    What is left of the recording is taken for white noise.
    """
    found = _regressed(target, z, run)
    return found.begin, np.sqrt(np.diag(np.linalg.inv(found.normal)) * np.mean(found.left**2))


class _Regressed(NamedTuple):
    """A simulation whose beginning was regressed on the chassis readings.

    Parameters
    ----------
    inputs : NominalReadings
        What sensors as declared would have read.
    output, states, begin : arrays
        As :func:`simulated` and :func:`free_run` return them.
    normal : (6, 6) array
        Matrix of the regression's normal equations, priors in it.
    left : (N,) array
        What it left.
    """

    inputs: NominalReadings
    output: Array
    states: Array
    begin: Array
    normal: Array
    left: Array


def _regressed(target: Posterior, z: Array, run: int) -> _Regressed:
    line = target.space.timelines[run]
    inputs = target.as_declared(z, run)
    reading = inputs.reading
    use = line.kind == VALUE
    begin = np.zeros(6)
    # Next to the record the prior weighs as if noise were a thousandth of the motion's power.
    ridge = max(float(np.var(reading[use])) * 1e-3, 1e-12) / line.start
    output, states = simulated(target, z, run, inputs, begin)
    for _ in range(_ROUNDS if target.space.sites else 1):
        slope = np.stack(
            [
                (simulated(target, z, run, inputs, begin + step)[0] - output)[use] / step.max()
                for step in np.diag(_STEPS)
            ],
            axis=1,
        )
        left = (reading - output)[use]
        normal = slope.T @ slope + np.diag(ridge)
        step = np.linalg.solve(normal, slope.T @ left - ridge * begin)
        begin = begin + step
        output, states = simulated(target, z, run, inputs, begin)
        if np.all(np.abs(step) < _STEPS):
            break
    return _Regressed(inputs, output, states, begin, normal, (reading - output)[use])


def simulated(
    target: Posterior, z: Array, run: int, inputs: NominalReadings, begin: Array
) -> tuple[Array, Array]:
    """Simulate one recording from wheels and a beginning that are given.

    Parameters
    ----------
    target, z, run
        As for :func:`free_run`.
    inputs : NominalReadings
        What sensors as declared would have read.
    begin : (6,) array
        As :func:`free_run` returns it.

    Returns
    -------
    output, states : (E, 2) and (E, 6) arrays
        As there, the output of sensors as declared.
    """
    line, known = target.space.timelines[run], target.patterns[run]
    car, table = target.space.measured(z[None], run)[0], rows(target.space.effects(z), run)
    output, states = np.zeros((len(line.step), 2)), np.zeros((len(line.step), 6))
    extended.free_run(
        car, table, known.pole, line.step, inputs.moments, inputs.wheel, line.elapsed, begin,
        output, states,
    )  # fmt: skip
    return output, states
