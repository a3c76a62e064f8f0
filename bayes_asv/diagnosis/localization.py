"""Where simulation and measurement disagree: channel, time, frequency, axle, state.

All maps stand on innovations, which are white with variance one where the model is right, so that
the energy of a window or band is χ² and a mean is normal; Bonferroni over the cells of each map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.fitted_model import Dataset, FittedModel

__all__ = ["Cell", "Disagreement", "disagreement"]

Array = NDArray[np.float64]

_WINDOW = 0.1  # s
_LEVEL = 0.01  # family-wise, over the cells of one map
_CELLS = (5, 5)  # deflection, its rate
_FEWEST = 8  # readings in a cell


@dataclass(frozen=True)
class Cell:
    """A region of an axle's deflection–velocity plane.

    Parameters
    ----------
    delta, rate : (low, high)
        Its edges, m and m/s, extension positive.
    force : float
        Mean force that the model lacks there, N, upward on the chassis.
    t : float
        That mean over its deviation.
    """

    delta: tuple[float, float]
    rate: tuple[float, float]
    force: float
    t: float


@dataclass(frozen=True)
class Disagreement:
    """Where innovations are not what they should be.

    Parameters
    ----------
    channel : str
        Chassis channel with the most excess energy.
    axle : str
        Axle whose missing force is most regular over its plane.
    time : tuple of (run, begin, end)
        Windows with too much energy, s from each recording's own clock.
    frequency : tuple of (low, high)
        Third octaves with too much energy, Hz.
    planes : dict of str to tuple of Cell
        The map of each axle.
    state : Cell or None
        The cell of that axle with the largest t, when it is more than chance.
    """

    channel: str
    axle: str
    time: tuple[tuple[int, float, float], ...]
    frequency: tuple[tuple[float, float], ...]
    planes: dict[str, tuple[Cell, ...]]
    state: Cell | None


def disagreement(where: Dataset, stage: FittedModel) -> Disagreement:
    """Look where a stage's innovations are too large or too regular."""
    passes = [stage.target.scored(stage.mode.z, run) for run in range(len(where.lines))]
    energy, count = np.zeros(2), np.zeros(2)
    windows: list[tuple[int, float, float]] = []
    for run, (line, (nu, logs, _)) in enumerate(zip(where.lines, passes, strict=True)):
        there = logs != 0.0
        energy += np.where(there, nu**2, 0.0).sum(axis=0)
        count += there.sum(axis=0)
        windows += [(run, a, b) for a, b in _windows(line.instants, nu, there)]
    channel = ("front_chassis", "rear_chassis")[int(np.argmax(energy / np.maximum(count, 1)))]
    planes = _planes(where, stage, passes)
    strongest = {
        axle: max((abs(c.t) for c in cells), default=0.0) for axle, cells in planes.items()
    }
    axle = max(strongest, key=lambda name: strongest[name])
    least = norm.isf(_LEVEL / 2.0 / (2 * _CELLS[0] * _CELLS[1]))
    best = max(planes[axle], key=lambda c: abs(c.t), default=None)
    state = best if best is not None and abs(best.t) > least else None
    return Disagreement(channel, axle, tuple(windows), _bands(where, passes), planes, state)


def _windows(instants: Array, nu: Array, there: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Windows of one run whose energy is beyond chance, neighbours joined."""
    edges = np.arange(instants[0], instants[-1] + _WINDOW, _WINDOW)
    place = np.clip(np.searchsorted(edges, instants, "right") - 1, 0, len(edges) - 2)
    energy = np.bincount(place, np.where(there, nu**2, 0.0).sum(axis=1), len(edges) - 1)
    number = np.bincount(place, there.sum(axis=1), len(edges) - 1)
    level = _LEVEL / (len(edges) - 1)
    out: list[tuple[float, float]] = []
    for k in np.flatnonzero(chi2.sf(energy, np.maximum(number, 1)) < level):
        begin, end = float(edges[k]), float(min(edges[k + 1], instants[-1]))
        if out and abs(out[-1][1] - begin) < 1e-9:
            out[-1] = (out[-1][0], end)
        else:
            out.append((begin, end))
    return out


def _bands(
    where: Dataset, passes: list[tuple[Array, Array, Array]]
) -> tuple[tuple[float, float], ...]:
    """Third octaves in which innovations have too much energy, all runs and channels together."""
    rate = 1.0 / where.lines[0].reading_step
    centres = 2.0 ** (np.arange(-3, 40) / 3.0)
    centres = centres[(centres < 0.42 * rate) & (centres > 1.0)]
    energy, number = np.zeros(len(centres)), np.zeros(len(centres))
    for line, (nu, _, _) in zip(where.lines, passes, strict=True):
        paired = np.nan_to_num(line.paired(nu))
        n = len(paired)
        power = np.abs(np.fft.rfft(paired, axis=0)) ** 2 / n
        f = np.fft.rfftfreq(n, line.reading_step)
        for k, centre in enumerate(centres):
            band = (f >= centre * 2.0 ** (-1 / 6)) & (f < centre * 2.0 ** (1 / 6))
            energy[k] += 2.0 * power[band].sum()
            number[k] += 4.0 * np.count_nonzero(band)
    beyond = (number > 0) & (chi2.sf(energy, np.maximum(number, 1)) < _LEVEL / len(centres))
    return tuple((float(c * 2.0 ** (-1 / 6)), float(c * 2.0 ** (1 / 6))) for c in centres[beyond])


def _planes(
    where: Dataset, stage: FittedModel, passes: list[tuple[Array, Array, Array]]
) -> dict[str, tuple[Cell, ...]]:
    """Mean force that the model lacks, over the deflection–velocity plane of each axle."""
    _, _, i, m, l, wdf, *_ = stage.space.cars(stage.mode.z[None])[0]
    l_f, l_r = l * (1.0 - wdf), l * wdf
    give = np.array([[1.0 / m + l_f**2 / i, 1.0 / m - l_f * l_r / i], [0.0, 1.0 / m + l_r**2 / i]])
    give[1, 0] = give[0, 1]
    forces, states = [], []
    for line, (nu, logs, state) in zip(where.lines, passes, strict=True):
        both = np.all(line.kind == VALUE, axis=1)
        forces.append(np.linalg.solve(give, (nu * np.exp(0.5 * logs))[both].T).T)
        states.append(state[both])
    if not any(len(f) for f in forces):
        return {"front": (), "rear": ()}
    force, state = np.concatenate(forces), np.concatenate(states)
    return {
        axle: _plane(state[:, 2 * k], state[:, 2 * k + 1], force[:, k])
        for k, axle in enumerate(("front", "rear"))
    }


def _plane(delta: Array, rate: Array, force: Array) -> tuple[Cell, ...]:
    """Cells of one axle; edges at shares of the range that was visited."""
    d, v = (
        np.linspace(float(np.quantile(x, 0.002)), float(np.quantile(x, 0.998)), cells + 1)
        for x, cells in ((delta, _CELLS[0]), (rate, _CELLS[1]))
    )
    out = []
    for a in range(_CELLS[0]):
        for b in range(_CELLS[1]):
            inside = (delta >= d[a]) & (delta < d[a + 1]) & (rate >= v[b]) & (rate < v[b + 1])
            n = int(np.count_nonzero(inside))
            if n < _FEWEST:
                continue
            mean = float(force[inside].mean())
            sd = float(force[inside].std(ddof=1)) / np.sqrt(n)
            out.append(
                Cell(
                    (float(d[a]), float(d[a + 1])),
                    (float(v[b]), float(v[b + 1])),
                    mean,
                    mean / sd if sd > 0.0 else 0.0,
                )
            )
    return tuple(out)
