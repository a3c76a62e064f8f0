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

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.filters.kalman import MISSING, VALUE
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.linear_simulation import simulate_free
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["Source", "found_again", "lost_readings", "sources"]

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
    for c, channel in enumerate(CHANNELS):
        names = [n for n in target.space.names if n.startswith(f"noise {channel} ")]
        if not names:
            continue  # the white-residual form knows no noise of the wheel sensors
        found.append(Source(f"noise {channel}", 0.25, _noise(names)))
        if any(line.steps[c] > 0.0 for line in lines):
            found.append(Source(f"steps {channel}", 0.0, _lines(_steps(c))))
    if any(np.any(line.spread[:, 2:] > 0.0) for line in lines):
        found.append(Source("between samples", 0.0, _lines(_between)))
    found.append(Source("start", None, _lines(_start)))
    return found


def _noise(names: list[str]) -> Scaled:
    def scaled(target: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        out = z.copy()
        for name in names:
            k = target.space.names.index(name)
            out[k] += 0.5 * math.log(factor) / target.space.scale[k]
        return target, out

    return scaled


def _lines(change: Callable[[PreparedRecording, float], PreparedRecording]) -> Scaled:
    def scaled(target: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        lines = tuple(change(line, factor) for line in target.space.timelines)
        return replace(target, space=replace(target.space, timelines=lines)), z

    return scaled


def _steps(c: int) -> Callable[[PreparedRecording, float], PreparedRecording]:
    def change(line: PreparedRecording, factor: float) -> PreparedRecording:
        steps = line.steps.copy()
        steps[c] *= math.sqrt(factor)
        return replace(line, steps=steps)

    return change


def _between(line: PreparedRecording, factor: float) -> PreparedRecording:
    spread = line.spread.copy()
    spread[:, 2:] *= factor
    return replace(line, spread=spread)


def _start(line: PreparedRecording, factor: float) -> PreparedRecording:
    return replace(line, start=factor * line.start)


def lost_readings(line: PreparedRecording) -> Flags:
    """Find chassis readings that were clipped, or missing beside one that was there.

    Parameters
    ----------
    line : PreparedRecording
        One recording.

    Returns
    -------
    (E, 2) bool array
        By instant and axle.  Rows that are missing as a whole are not counted.
    """
    lost: Flags = (line.kind != MISSING) & (line.kind != VALUE)
    for axle in range(2):
        alone = line.pairs[line.pairs[:, axle] < 0, 1 - axle]
        lost[alone, axle] = True
    return lost


def found_again(target: Posterior, z: Array) -> Posterior:
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
    car = target.space.cars(z[None])[0]
    lines = []
    for line in target.space.timelines:
        lost = lost_readings(line)
        output = simulate_free(line, car).output
        lines.append(
            replace(
                line,
                kind=np.where(lost, np.int8(VALUE), line.kind),
                reading=np.where(lost, output, line.reading),
            )
        )
    return replace(target, space=replace(target.space, timelines=tuple(lines)))
