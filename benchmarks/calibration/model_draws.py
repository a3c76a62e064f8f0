"""Recordings drawn from the estimator's own model: what simulation-based calibration stands on.

The wheels' readings are given, from some drive; the car, the noise and everything else are drawn
from the prior, and then the chassis' readings from the model as ``filters/kalman.py`` states
it.  This is a second, readable form of that model, with matrix exponentials in place of series
and no Kalman filter: states and noise are simply simulated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from benchmarks.calibration.cells import Cell
from benchmarks.calibration.dense import suspension
from benchmarks.calibration.rig_runs import drive_cell
from tests.posterior.cases import prepared

__all__ = ["Drawn", "chassis_readings", "draw_run", "driven_states", "noisy_states"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drawn:
    """A recording from the model and the truth behind it.

    Parameters
    ----------
    recording : Recording
        Wheels as they were read, chassis as drawn.
    vehicle : Vehicle
        Gives the priors.
    names : tuple of str
        Coordinates of the estimator.
    z : (D,) array
        Their true values.
    car : (8,) array
        True car, SI.
    """

    recording: Recording
    vehicle: Vehicle
    names: tuple[str, ...]
    z: Array
    car: Array


def draw_run(cell: Cell, seed: int, run: int) -> Drawn:
    """Draw the truth from the prior and a recording from the model.

    Parameters
    ----------
    cell : Cell
        Its drives give the wheels' readings.
    seed, run : int
        Of the bench, and which run.

    Returns
    -------
    Drawn
        Sensors have no rails: a reading at one is no part of what is drawn here.
    """
    case = drive_cell(cell, seed, run)
    boundless = {
        name: replace(s, low=-np.inf, high=np.inf) for name, s in case.vehicle.sensors.items()
    }
    vehicle = replace(case.vehicle, sensors=boundless)
    line = prepared(case.recording, vehicle)
    where = make_parameter_space(vehicle, (line,))
    rng = np.random.default_rng([seed, run, 2018])
    z = rng.normal(size=(1, where.dimension))
    unseen = rng.normal(size=(1, where.prior.unidentified.shape[1]))
    car = where.cars(z, unseen)[0]
    readings = chassis_readings(line, car, np.concatenate([x[0] for x in where.noises(z, 0)]), rng)
    return Drawn(_as_recording(case.recording, line, readings), vehicle, where.names, z[0], car)


def _as_recording(recording: Recording, line: PreparedRecording, readings: Array) -> Recording:
    """Put drawn readings (E, 2) into their rows; rows that no step reaches stay as they are."""
    values = recording.values.copy()
    for axle, c in enumerate((1, 3)):
        place = np.abs(line.instants[:, None] - line.times[c][None, :]).argmin(axis=1)
        read = line.kind[:, axle] != 0
        values[c, place[read]] = readings[read, axle]
    return Recording(recording.time, values, recording.units, recording.metadata, recording.source)


def chassis_readings(
    recording: PreparedRecording, car: Array, noise: Array, rng: np.random.Generator
) -> Array:
    """Draw both chassis readings (E, 2), m/s², at every instant of a timeline.

    Parameters
    ----------
    line : PreparedRecording
        Gives instants, wheel motion, intensities and what the state may be at first; its own
        readings are not looked at.
    car, noise : (8,) and (12,) arrays
        As the kernel takes them.
    rng : numpy.random.Generator
        Where chance comes from.
    """
    _, C = suspension(car)
    x = driven_states(recording, car) + noisy_states(recording, car, noise, rng)
    bias = np.sqrt(np.diag(recording.initial_covariance)[4:]) * rng.standard_normal(2)
    y = x @ C.T + bias
    for axle in range(2):
        white = np.sqrt(noise[2 + axle] + recording.extra_variance[:, axle]) * rng.standard_normal(
            len(y)
        )
        y[:, axle] += white + _remembered(noise[6 + axle], noise[10 + axle], recording.step, rng)
    return np.asarray(y)


def driven_states(recording: PreparedRecording, car: Array) -> Array:
    """States (E, 4) of a car that starts at rest and follows the wheels' splines, exactly.

    On each piece of the splines the input is a cubic; with its derivatives as further states the
    whole is one matrix exponential.
    """
    A, _ = suspension(car)
    big = np.zeros((12, 12))
    big[:4, :4] = A
    big[1, 4] = big[3, 5] = -1.0
    big[4:10, 6:12] = np.eye(6)  # u, u', u'', u''' of both wheels
    inside = [w.knots[(w.knots > recording.instants[0]) & (w.knots < recording.instants[-1])]
              for w in recording.wheels]  # fmt: skip
    edges = np.union1d(recording.instants, np.concatenate(inside))
    middle = 0.5 * (edges[:-1] + edges[1:])
    # derivatives at a piece's beginning, from within the piece: the third one jumps at knots
    taylor = np.zeros((len(middle), 4, 2))
    for axle, wheel in enumerate(recording.wheels):
        back = edges[:-1] - middle
        value = [np.asarray(wheel.spline(middle, order)) for order in range(4)]
        for order in range(4):
            for j in range(order, 4):
                taylor[:, order, axle] += value[j] * back ** (j - order) / factorial(j - order)
    out = np.zeros((len(recording.instants), 4))
    wanted = np.searchsorted(edges, recording.instants)
    x = np.zeros(4)
    flows: dict[int, Array] = {}
    states = np.zeros((len(edges), 4))
    for k in range(len(middle)):
        h = float(edges[k + 1] - edges[k])
        key = round(h * 1e12)
        if key not in flows:
            flows[key] = expm(big * h)[:4]
        x = flows[key] @ np.concatenate([x, taylor[k].ravel()])
        states[k + 1] = x
    out[:] = states[wanted]
    return out


def noisy_states(
    recording: PreparedRecording, car: Array, noise: Array, rng: np.random.Generator
) -> Array:
    """States (E, 4) that initial state and the wheels' noise add.

    Over a step filtered noise is held and white noise has the intensity that the timeline
    states; its covariance over the step is Van Loan's (1978).
    """
    A, _ = suspension(car)
    held = np.zeros((6, 6))
    held[:4, :4] = A
    held[1, 4] = held[3, 5] = 1.0
    w = np.stack(
        [_remembered(noise[4 + a], noise[8 + a], recording.step, rng) for a in range(2)], axis=1
    )
    intensity = noise[:2] * recording.process_noise[:, :2] + recording.process_noise[:, 2:]
    x = np.sqrt(np.diag(recording.initial_covariance)[:4]) * rng.standard_normal(4)
    out = np.empty((len(recording.step), 4))
    flows: dict[int, tuple[Array, tuple[Array, Array]]] = {}
    for k, h in enumerate(recording.step):
        if h > 0.0:
            key = round(h * 1e12)
            if key not in flows:
                flows[key] = expm(held * h)[:4], (_root(A, h, 1), _root(A, h, 3))
            flow, roots = flows[key]
            x = flow @ np.concatenate([x, w[k - 1]])
            for axle in range(2):
                x = x + np.sqrt(intensity[k, axle]) * (roots[axle] @ rng.standard_normal(4))
        out[k] = x
    return out


def _root(A: Array, h: float, driven: int) -> Array:
    """Root (4, 4) of ∫ Φ(s) e eᵀ Φ(s)ᵀ ds, e the unit vector of one state."""
    block = np.zeros((8, 8))
    block[:4, :4], block[4:, 4:] = -A, A.T
    block[driven, 4 + driven] = 1.0
    flow = expm(block * h)
    Q = flow[4:, 4:].T @ flow[:4, 4:]
    value, vectors = np.linalg.eigh(0.5 * (Q + Q.T))
    return np.asarray(vectors * np.sqrt(np.maximum(value, 0.0)))


def _remembered(variance: float, pole: float, step: Array, rng: np.random.Generator) -> Array:
    """Stationary noise (E,) that passed a one-pole filter, at the ends of the steps."""
    fresh = rng.standard_normal(len(step))
    keep = np.exp(-pole * step)
    out = np.empty(len(step))
    out[0] = fresh[0]
    for k in range(1, len(step)):
        out[k] = keep[k] * out[k - 1] + np.sqrt(1.0 - keep[k] ** 2) * fresh[k]
    return np.asarray(np.sqrt(variance) * out)
