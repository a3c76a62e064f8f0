"""Free-running simulation: measured inputs drive the fitted car, outputs are not fed back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.free_response import free_response
from bayes_asv.filters.kalman import VALUE, Laws, Measurements, StateSpace
from bayes_asv.models.car_model import state_space
from bayes_asv.posterior.effects import NominalReadings, law_table
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "FreeRun",
    "free_run",
    "initial_state",
    "simulate_free",
    "simulate_from",
    "unexplained_in_band",
]  # fmt: skip

Array = NDArray[np.float64]

_ROUNDS = 4  # Gauss–Newton iterations if forces are nonlinear
# Noise power relative to that of the motion, which sets the weight of the readings against the
# prior of the initial state.
_NOISE_POWER = 1e-3


class FreeRun(NamedTuple):
    """A simulation of one recording.

    Parameters
    ----------
    output : (E, ny) array
        Simulated sensor readings, with the fitted biases.
    states : (E, nx + ne) array
        Deflections (m) and their rates (m/s) element by element, body rates, and excess forces (N).
    initial_state : (nx + nd + ny,) array
        States at the first instant, input biases, and biases of the outputs.
    """

    output: Array
    states: Array
    initial_state: Array


def free_run(posterior: Posterior, z: Array, run: int) -> FreeRun:
    """Simulate one recording from its measured inputs.

    Initial state and biases are fitted to the outputs under their priors; nothing else is.

    Parameters
    ----------
    posterior : Posterior
        Posterior; with sensor corrections if it has effects.
    z : (D,) array
        Coordinates; those of noise are not used.
    run : int
        Which recording.
    """
    recording = posterior.space.recordings[run]
    nominal = posterior.as_declared(z, run)
    simulated, _ = _simulate_posterior(posterior, z, run, nominal)
    # the simulation has sensors as declared: add the sensor effects again
    return simulated._replace(output=simulated.output + (recording.reading - nominal.reading))


def initial_state(posterior: Posterior, z: Array, run: int) -> tuple[Array, Array]:
    """Estimate the initial state of a recording and its standard deviation, (nx + nd + ny,) each.

    The residuals are assumed to be white.
    """
    simulated, deviation = _simulate_posterior(posterior, z, run, posterior.as_declared(z, run))
    return simulated.initial_state, deviation


def _simulate_posterior(
    posterior: Posterior, z: Array, run: int, nominal: NominalReadings
) -> tuple[FreeRun, Array]:
    recording = posterior.space.recordings[run]
    return _fit_initial_state(
        recording,
        posterior.space.state_space(z[None], run),
        recording.measurements._replace(moments=nominal.moments, reading=nominal.reading),
        _laws(posterior, z, run, nominal),
    )


def simulate_free(recording: PreparedRecording, car: Array) -> FreeRun:
    """Simulate one recording with the linear car.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    car : (P,) array
        Parameters of its car, in their order, SI units.
    """
    values = {name: np.array([float(x)]) for name, x in zip(recording.car.names, car, strict=True)}
    system = state_space(
        recording.car, values, recording.output_models,
        bias_directions=recording.bias_directions,
    )  # fmt: skip
    return _fit_initial_state(recording, system, recording.measurements, None)[0]


def simulate_from(
    posterior: Posterior, z: Array, run: int, inputs: NominalReadings, begin: Array
) -> tuple[Array, Array]:
    """Simulate one recording from given inputs and a given initial state.

    Parameters
    ----------
    posterior, z, run
        As for :func:`free_run`.
    inputs : NominalReadings
        Readings of sensors as declared.
    begin : (nx + nd + ny,) array
        Initial state, as in :class:`FreeRun`.

    Returns
    -------
    output, states : (E, ny) and (E, nx + ne) arrays
        As in :class:`FreeRun`, with the output of sensors as declared.
    """
    data = posterior.space.recordings[run].measurements._replace(moments=inputs.moments)
    system = posterior.space.state_space(z[None], run)
    output, states = _responses(system, data, begin[None], _laws(posterior, z, run, inputs))
    return output[0], states[0]


def _laws(posterior: Posterior, z: Array, run: int, nominal: NominalReadings) -> Laws | None:
    table = law_table(posterior.space.car, posterior.space.effects(z), run)[None]
    known = posterior.known_force(run)
    if table.shape[1] == 0 and not np.any(known):
        return None
    recording = posterior.space.recordings[run]
    return Laws(
        table, posterior.sensor_corrections[run].pole, nominal.wheel, recording.elapsed, known
    )


def _responses(
    system: StateSpace, data: Measurements, begin: Array, laws: Laws | None
) -> tuple[Array, Array]:
    """Return outputs (W, E, ny) and states (W, E, nx + ne) for initial states (W, …)."""
    output, states = free_response(system, data, begin, laws)
    if laws is None:
        none = np.zeros((*states.shape[:2], system.E.shape[2]))
        states = np.concatenate([states, none], axis=2)
    return output, states


def _fit_initial_state(
    recording: PreparedRecording, system: StateSpace, data: Measurements, laws: Laws | None
) -> tuple[FreeRun, Array]:
    """Fit the initial state by Gauss–Newton; return the simulation and its standard deviation."""
    use = data.kind == VALUE
    reading = data.reading
    unknown = len(data.initial_covariance)
    nx, nd = system.A.shape[1], system.N.shape[1]
    steps = np.full(unknown, 1e-3)
    steps[0 : 2 * system.E.shape[2] : 2] = 1e-4  # m
    weight = _weights(recording, reading, use)
    ridge = np.linalg.inv(data.initial_covariance)
    initial = np.zeros(unknown)
    moves = np.concatenate([np.zeros((1, unknown)), np.diag(steps)[: nx + nd]])
    outputs, states = _responses(system, data, initial + moves, laws)
    if not np.all(np.isfinite(outputs)):  # a car far outside the prior diverges
        nothing = FreeRun(np.zeros_like(outputs[0]), np.zeros_like(states[0]), initial)
        return nothing, np.sqrt(np.diag(data.initial_covariance))
    normal = np.eye(unknown)
    for _ in range(_ROUNDS if laws is not None else 1):
        slopes = np.zeros((*outputs.shape[1:], unknown))
        by_state = (outputs[1:] - outputs[0]) / steps[: nx + nd, None, None]
        slopes[:, :, : nx + nd] = np.moveaxis(by_state, 0, 2)
        for y in range(outputs.shape[2]):
            slopes[:, y, nx + nd + y] = 1.0
        design = slopes[use] * weight[use, None]
        residuals = ((reading - outputs[0]) * weight)[use]
        normal = design.T @ design + ridge
        step = np.linalg.solve(normal, design.T @ residuals - ridge @ initial)
        initial = initial + step
        outputs, states = _responses(system, data, initial + moves, laws)
        if np.all(np.abs(step) < steps):
            break
    residuals = ((reading - outputs[0]) * weight)[use]
    # The weights assume a noise power; the residuals give the actual one.
    deviation = np.sqrt(np.diag(np.linalg.inv(normal)) * np.mean(residuals**2))
    return FreeRun(outputs[0], states[0], initial), deviation


def _weights(recording: PreparedRecording, reading: Array, use: NDArray[np.bool_]) -> Array:
    """Inverse standard deviation that is assumed for each output's residuals (E, ny)."""
    quantities = [recording.channels[c].quantity for c in recording.outputs]
    out = np.empty(reading.shape)
    for y, quantity in enumerate(quantities):
        alike = [z for z, other in enumerate(quantities) if other == quantity]
        power = float(np.var(reading[:, alike][use[:, alike]]))
        out[:, y] = 1.0 / np.sqrt(max(_NOISE_POWER * power, 1e-12))
    return out


def unexplained_in_band(recording: PreparedRecording, free: FreeRun, top: float) -> Array:
    """Share of the outputs below a frequency that a simulation leaves unexplained.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    free : FreeRun
        Its simulation.
    top : float
        Upper end of the band, Hz.

    Returns
    -------
    (ny,) array
        Square root of the ratio of powers: 0 if everything is explained, 1 if nothing is.
    """
    from scipy.signal import welch

    out = np.zeros(len(recording.outputs))
    for y in range(len(out)):
        use = recording.kind[:, y] == VALUE
        time = recording.instants[use]
        rate = 1.0 / float(np.median(np.diff(time)))
        even = np.arange(time[0], time[-1], 1.0 / rate)
        measured = np.interp(even, time, recording.reading[use, y])
        residuals = measured - np.interp(even, time, free.output[use, y])
        n = min(len(even), int(2.0 * rate))
        frequency, power = welch(measured, rate, nperseg=n)
        _, residual_power = welch(residuals, rate, nperseg=n)
        band = (frequency > 0.0) & (frequency <= top)
        whole = float(power[band].sum())
        out[y] = np.sqrt(residual_power[band].sum() / whole) if whole > 0.0 else 1.0
    return out
