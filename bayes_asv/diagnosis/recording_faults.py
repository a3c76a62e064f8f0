"""What a recording shows before anything is fitted: readings at a rail, gaps, clock, beginning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_asv.preprocessing.noise_level import noise_level
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["found_before"]

Found = dict[str, object]

_LOST = 1.5  # steps from row to row beyond which rows are missing in between
_UNEVEN = 0.02  # of a step: deviation of those that are left
_BEGINNING = 0.1  # s
_FEWEST = 4  # readings that say whether a channel is at rest
# Standard deviation of a beginning over its sensor's noise.  Behind a pole of 50 Hz 40 readings at
# 400 Hz are worth 15, and of 4000 records of such noise alone none had more than 1.6.
_MOVING = 4.0


def found_before(lines: Sequence[PreparedRecording]) -> tuple[Found, ...]:
    """List what recordings show before any fit.

    Parameters
    ----------
    lines : sequence of PreparedRecording
        As they were read.

    Returns
    -------
    tuple of dict
        ``name``, ``where`` (None: it concerns the whole recording), ``source`` and how much:
        ``samples``, ``rms_seconds`` of the clock's steps, or ``times_noise``, the deviation of the
        loudest channel in its first tenth of a second over its sensor's noise.
    """
    return tuple(found for line in lines for found in _one(line))


def _one(line: PreparedRecording) -> list[Found]:
    steps = np.diff(line.times[0])
    usual = float(np.median(steps))
    lost = float(np.sum(np.maximum(np.round(steps / usual) - 1.0, 0.0)))
    missing = int(lost) + int(np.count_nonzero(~np.isfinite(line.values)))
    uneven = float(np.std(steps[steps < _LOST * usual]))
    clipped = int(np.count_nonzero(line.clipped))
    begins = _times_noise(line)

    def told(name: str, size: Found) -> Found:
        return {"name": name, "where": None, "source": line.source, **size}

    out = []
    if clipped:
        out.append(told("sensor_clipping", {"samples": clipped}))
    if missing:
        out.append(told("dropped_samples", {"samples": missing}))
    if uneven > _UNEVEN * usual:
        out.append(told("uneven_clock", {"rms_seconds": uneven}))
    if begins > _MOVING:
        out.append(told("initial_state", {"times_noise": begins}))
    return out


def _times_noise(line: PreparedRecording) -> float:
    """How loud the loudest channel begins, in deviations of its noise."""
    largest = 0.0
    for c, (time, signal) in enumerate(zip(line.times, line.values, strict=True)):
        begins = signal[np.isfinite(signal) & (time < time[0] + _BEGINNING)]
        if len(begins) < _FEWEST:
            continue
        given = line.noise[c]
        noise = noise_level(line, c) if given is None else given
        largest = max(largest, float(np.std(begins)) / float(np.hypot(noise, line.steps[c])))
    return largest
