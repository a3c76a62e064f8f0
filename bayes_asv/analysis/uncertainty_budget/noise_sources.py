"""The noises of a recording, each of which can be made another without touching the data.

A covariance of the innovations is linear in the variances of its noises, and their derivatives
by the car depend on those only through the filter's gain.  So the information that a recording
*would* hold with a better sensor follows from the recording as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import MISSING, VALUE
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["Source", "impute_lost_readings", "lost_readings", "sources"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Scaled = Callable[[Posterior, Array, float], tuple[Posterior, Array]]


@dataclass(frozen=True)
class Source:
    """One noise of every run.

    Parameters
    ----------
    name : str
        ``noise <channel>``, ``steps <channel>``, ``between samples`` or ``start``.
    better : float or None
        Factor on its variance for the question what a better one would give; None where
        nobody can better it.
    scaled : callable
        From a target, coordinates and a factor to the same with that variance multiplied.
    """

    name: str
    better: float | None
    scaled: Scaled


def sources(target: Posterior) -> list[Source]:
    """List every noise that a target knows of.

    Parameters
    ----------
    target : Posterior
        In any coordinates.

    Returns
    -------
    list of Source
        Multiplying all of them by one factor divides the information by it.
    """
    lines = target.space.timelines
    found = []
    names = list(dict.fromkeys(channel.name for line in lines for channel in line.channels))
    for name in names:
        levels = [
            c.name for c in target.space.coordinates if c.kind == "noise" and c.channel == name
        ]
        if not levels:
            continue  # with white residuals an input has no noise
        found.append(Source(f"noise {name}", 0.25, _noise(levels)))
        if any(line.steps[c] > 0.0 for line in lines for c in _numbers(line, name)):
            found.append(Source(f"steps {name}", 0.0, _lines(_steps(name))))
    if any(np.any(line.spread[:, len(line.wheels) :] > 0.0) for line in lines):
        found.append(Source("between samples", 0.0, _lines(_between)))
    found.append(Source("start", None, _lines(_start)))
    return found


def _noise(names: list[str]) -> Scaled:
    def scaled(target: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        out = z.copy()
        for name in names:
            k = target.space.index[name]
            out[k] += 0.5 * math.log(factor) / target.space.coordinates[k].scale
        return target, out

    return scaled


def _lines(change: Callable[[PreparedRecording, float], PreparedRecording]) -> Scaled:
    def scaled(target: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        lines = tuple(change(line, factor) for line in target.space.timelines)
        return replace(target, space=replace(target.space, timelines=lines)), z

    return scaled


def _numbers(line: PreparedRecording, name: str) -> list[int]:
    return [c for c, channel in enumerate(line.channels) if channel.name == name]


def _steps(name: str) -> Callable[[PreparedRecording, float], PreparedRecording]:
    def change(line: PreparedRecording, factor: float) -> PreparedRecording:
        steps = line.steps.copy()
        steps[_numbers(line, name)] *= math.sqrt(factor)
        return replace(line, steps=steps)

    return change


def _between(line: PreparedRecording, factor: float) -> PreparedRecording:
    spread = line.spread.copy()
    spread[:, len(line.wheels) :] *= factor
    return replace(line, spread=spread)


def _start(line: PreparedRecording, factor: float) -> PreparedRecording:
    return replace(line, start=factor * line.start)


def lost_readings(line: PreparedRecording) -> Flags:
    """Find output readings that were clipped, or missing beside one that was there.

    Parameters
    ----------
    line : PreparedRecording
        One recording.

    Returns
    -------
    (E, ny) bool array
        By instant and output.  Rows that are missing as a whole are not counted.
    """
    lost: Flags = (line.kind != MISSING) & (line.kind != VALUE)
    for y in range(line.pairs.shape[1]):
        beside = line.pairs[line.pairs[:, y] < 0].max(axis=1)
        lost[beside, y] = True
    return lost


def impute_lost_readings(target: Posterior, z: Array) -> Posterior:
    """Return the target with every lost chassis reading read as the car would have moved.

    Parameters
    ----------
    target, z : Posterior, (D,) array
        In any coordinates, at the mode.

    Returns
    -------
    Posterior
        Only its information means anything: the new readings are simulated.
    """
    lines = []
    for run, line in enumerate(target.space.timelines):
        lost = lost_readings(line)
        output = free_run(target, z, run).output
        lines.append(
            replace(
                line,
                kind=np.where(lost, np.int8(VALUE), line.kind),
                reading=np.where(lost, output, line.reading),
            )
        )
    return replace(target, space=replace(target.space, timelines=tuple(lines)))
