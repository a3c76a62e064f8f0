"""Localisation: output, time, frequency, axle and state at which the model disagrees.

Under the model, the innovations are white with unit variance, so the energy in a time window or a
frequency band is χ² distributed and a mean is normal.  Each map has a family-wise level of 1 %
(Bonferroni over its cells).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.fitted_model import Dataset, FittedModel

__all__ = ["Cell", "Localization", "localize"]

Array = NDArray[np.float64]
Passes = list[tuple[Array, Array, Array]]
"""Innovations and their log variances (E, ny), and states (E, nx + ne), of each run."""

_WINDOW = 0.1  # length of a time window, s
_LEVEL = 0.01  # family-wise level over the cells of one map
_GRID = (5, 5)  # number of cells along deflection and velocity
_MIN_READINGS = 8  # least number of readings in a cell


@dataclass(frozen=True)
class Cell:
    """A cell of an axle's deflection–velocity plane.

    Parameters
    ----------
    deflection, velocity : (low, high)
        Its edges, m and m/s, extension positive.
    force : float
        Mean missing force in the cell, N, upward on the chassis.
    t : float
        t-value: the mean over its standard error.
    """

    deflection: tuple[float, float]
    velocity: tuple[float, float]
    force: float
    t: float


@dataclass(frozen=True)
class Localization:
    """Where innovations have excess energy, or the model lacks a force.

    Parameters
    ----------
    channel : str
        Output with the most excess energy.
    axle : str
        Axle whose missing force depends most significantly on deflection and velocity; empty if the
        outputs do not determine forces.
    windows : tuple of (run, begin, end)
        Windows with excess energy, s on each recording's own clock.
    bands : tuple of (low, high)
        Third octaves with excess energy, Hz.
    force_maps : dict of str to tuple of Cell
        Mean missing force over the deflection–velocity plane of each axle; empty if fewer
        accelerations are measured than there are axles.
    strongest : Cell or None
        The cell of that axle with the largest |t|, if it is significant.
    """

    channel: str
    axle: str
    windows: tuple[tuple[int, float, float], ...]
    bands: tuple[tuple[float, float], ...]
    force_maps: dict[str, tuple[Cell, ...]]
    strongest: Cell | None


def localize(dataset: Dataset, model: FittedModel) -> Localization:
    """Find where the innovations of a model have excess energy or a systematic mean."""
    passes = [
        model.posterior.innovations_and_variances(model.mode.z, run)
        for run in range(len(dataset.recordings))
    ]
    outputs = [channel.name for channel in dataset.channels if not channel.is_input]
    energy, count = np.zeros(len(outputs)), np.zeros(len(outputs))
    windows: list[tuple[int, float, float]] = []
    for run, (recording, (nu, logs, _)) in enumerate(zip(dataset.recordings, passes, strict=True)):
        valid = logs != 0.0
        output_indices = [outputs.index(recording.channels[c].name) for c in recording.outputs]
        energy[output_indices] += np.where(valid, nu**2, 0.0).sum(axis=0)
        count[output_indices] += valid.sum(axis=0)
        windows += [(run, a, b) for a, b in _windows(recording.instants, nu, valid)]
    channel = outputs[int(np.argmax(energy / np.maximum(count, 1)))]
    maps = _force_maps(dataset, model, passes)
    largest_t = {axle: max((abs(c.t) for c in cells), default=0.0) for axle, cells in maps.items()}
    axle = max(largest_t, key=lambda name: largest_t[name], default="")
    critical_t = norm.isf(_LEVEL / 2.0 / (max(len(maps), 1) * _GRID[0] * _GRID[1]))
    best = max(maps.get(axle, ()), key=lambda c: abs(c.t), default=None)
    strongest = best if best is not None and abs(best.t) > critical_t else None
    return Localization(channel, axle, tuple(windows), _bands(dataset, passes), maps, strongest)


def _windows(instants: Array, nu: Array, valid: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Windows of one run with significant excess energy; adjacent ones are joined."""
    edges = np.arange(instants[0], instants[-1] + _WINDOW, _WINDOW)
    window = np.clip(np.searchsorted(edges, instants, "right") - 1, 0, len(edges) - 2)
    energy = np.bincount(window, np.where(valid, nu**2, 0.0).sum(axis=1), len(edges) - 1)
    number = np.bincount(window, valid.sum(axis=1), len(edges) - 1)
    level = _LEVEL / (len(edges) - 1)
    out: list[tuple[float, float]] = []
    for k in np.flatnonzero(chi2.sf(energy, np.maximum(number, 1)) < level):
        begin, end = float(edges[k]), float(min(edges[k + 1], instants[-1]))
        if out and abs(out[-1][1] - begin) < 1e-9:
            out[-1] = (out[-1][0], end)
        else:
            out.append((begin, end))
    return out


def _bands(dataset: Dataset, passes: Passes) -> tuple[tuple[float, float], ...]:
    """Third octaves with significant excess energy over all runs and channels."""
    rate = 1.0 / dataset.recordings[0].reading_step
    centres = 2.0 ** (np.arange(-3, 40) / 3.0)
    centres = centres[(centres < 0.42 * rate) & (centres > 1.0)]
    energy, number = np.zeros(len(centres)), np.zeros(len(centres))
    for recording, (nu, _, _) in zip(dataset.recordings, passes, strict=True):
        paired = np.nan_to_num(recording.paired(nu))
        n = len(paired)
        power = np.abs(np.fft.rfft(paired, axis=0)) ** 2 / n
        f = np.fft.rfftfreq(n, recording.reading_step)
        for k, centre in enumerate(centres):
            band = (f >= centre * 2.0 ** (-1 / 6)) & (f < centre * 2.0 ** (1 / 6))
            energy[k] += 2.0 * power[band].sum()
            number[k] += 2.0 * paired.shape[1] * np.count_nonzero(band)
    significant = (number > 0) & (chi2.sf(energy, np.maximum(number, 1)) < _LEVEL / len(centres))
    return tuple(
        (float(c * 2.0 ** (-1 / 6)), float(c * 2.0 ** (1 / 6))) for c in centres[significant]
    )


def _force_maps(
    dataset: Dataset, model: FittedModel, passes: Passes
) -> dict[str, tuple[Cell, ...]]:
    """Mean missing force over the deflection–velocity plane of each axle.

    Accelerations respond to a force without delay, so as many of them as there are axles determine
    the missing force at each axle, which its elements share.
    """
    car = model.space.car
    shares = np.array([car.shares(axle) for axle in car.axles])
    forces, states = [], []
    for run, (recording, (nu, logs, state)) in enumerate(
        zip(dataset.recordings, passes, strict=True)
    ):
        accelerations = list(recording.accelerations)
        by_forces = model.space.state_space(model.mode.z[None], run).G[0][accelerations] @ shares.T
        if np.linalg.matrix_rank(by_forces) < len(car.axles):
            continue
        has_readings = np.all(recording.kind[:, accelerations] == VALUE, axis=1)
        missing = (nu * np.exp(0.5 * logs))[has_readings][:, accelerations]
        forces.append(np.linalg.lstsq(by_forces, missing.T, rcond=None)[0].T)
        deflections = state[has_readings, 0 : 2 * len(car.elements) : 2]
        velocities = state[has_readings, 1 : 2 * len(car.elements) : 2]
        states.append(np.stack([deflections @ shares.T, velocities @ shares.T], axis=2))
    if not any(len(f) for f in forces):
        return dict.fromkeys(car.axles, ()) if forces else {}
    force, motion = np.concatenate(forces), np.concatenate(states)
    return {
        axle: _force_map(motion[:, a, 0], motion[:, a, 1], force[:, a])
        for a, axle in enumerate(car.axles)
    }


def _force_map(deflection: Array, velocity: Array, force: Array) -> tuple[Cell, ...]:
    """Cells of one axle, between the 0.2 % and 99.8 % quantiles of deflection and velocity."""
    d, v = (
        np.linspace(float(np.quantile(x, 0.002)), float(np.quantile(x, 0.998)), cells + 1)
        for x, cells in ((deflection, _GRID[0]), (velocity, _GRID[1]))
    )
    out = []
    for a in range(_GRID[0]):
        for b in range(_GRID[1]):
            inside = (deflection >= d[a]) & (deflection < d[a + 1])
            inside &= (velocity >= v[b]) & (velocity < v[b + 1])
            n = int(np.count_nonzero(inside))
            if n < _MIN_READINGS:
                continue
            mean = float(force[inside].mean())
            se = float(force[inside].std(ddof=1)) / np.sqrt(n)
            out.append(
                Cell(
                    (float(d[a]), float(d[a + 1])),
                    (float(v[b]), float(v[b + 1])),
                    mean,
                    mean / se if se > 0.0 else 0.0,
                )
            )
    return tuple(out)
