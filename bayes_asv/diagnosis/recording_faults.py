"""Faults of recordings that need no fit.

They are clipping, missing rows, an uneven clock, motion at the start, and missing bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.quantization import missing_bit, noise_level

__all__ = ["channels_with_missing_bits", "find_recording_faults"]

Fault = dict[str, object]

_GAP = 1.5  # step between rows, in median steps, above which rows are missing
# Standard deviation of the other steps, in median steps, above which the clock is uneven.
_UNEVEN_STEP = 0.02
_START_SECONDS = 0.1  # length of the start of a recording, s
_MIN_READINGS = 4  # least number of readings at the start
# Standard deviation of a channel at the start over its sensor's noise, above which the car moves.
# Behind a pole of 50 Hz, 40 readings at 400 Hz are worth 15 independent ones; of 4000 records of
# such noise none exceeded 1.6.
_MOVING = 4.0


def find_recording_faults(recordings: Sequence[PreparedRecording]) -> tuple[Fault, ...]:
    """List the faults of recordings.

    Parameters
    ----------
    recordings : sequence of PreparedRecording
        Recordings as read.

    Returns
    -------
    tuple of dict
        Keys are ``name``, ``where`` (None: the whole recording), ``source`` and the size:
        ``samples``, ``rms_seconds`` of the clock's steps, or ``times_noise``, the standard
        deviation of the most active channel in the first tenth of a second over its sensor's noise.
    """
    return tuple(fault for recording in recordings for fault in _faults(recording))


def channels_with_missing_bits(recordings: Sequence[PreparedRecording]) -> tuple[str, ...]:
    """Channels whose converter never sets, or never clears, one of its bits, in any recording."""
    found = [
        channel.name
        for recording in recordings
        for channel, values, step in zip(
            recording.channels, recording.values, recording.quantization_steps, strict=True
        )
        if missing_bit(values[np.isfinite(values)], float(step))
    ]
    return tuple(dict.fromkeys(found))


def _faults(recording: PreparedRecording) -> list[Fault]:
    steps = np.diff(recording.times[0])
    usual = float(np.median(steps))
    lost = float(np.sum(np.maximum(np.round(steps / usual) - 1.0, 0.0)))
    missing = int(lost) + int(np.count_nonzero(~np.isfinite(recording.values)))
    unevenness = float(np.std(steps[steps < _GAP * usual]))
    clipped = int(np.count_nonzero(recording.clipped))
    start = _start_over_noise(recording)

    def fault(name: str, size: Fault) -> Fault:
        return {"name": name, "where": None, "source": recording.source, **size}

    out = []
    if clipped:
        out.append(fault("sensor_clipping", {"samples": clipped}))
    if missing:
        out.append(fault("dropped_samples", {"samples": missing}))
    if unevenness > _UNEVEN_STEP * usual:
        out.append(fault("uneven_clock", {"rms_seconds": unevenness}))
    if start > _MOVING:
        out.append(fault("initial_state", {"times_noise": start}))
    return out


def _start_over_noise(recording: PreparedRecording) -> float:
    """Largest ratio of a channel's standard deviation at the start to its noise."""
    largest = 0.0
    for c, (time, signal) in enumerate(zip(recording.times, recording.values, strict=True)):
        start = signal[np.isfinite(signal) & (time < time[0] + _START_SECONDS)]
        if len(start) < _MIN_READINGS:
            continue
        given = recording.noise[c]
        noise = noise_level(recording, c) if given is None else given
        largest = max(
            largest, float(np.std(start)) / float(np.hypot(noise, recording.quantization_steps[c]))
        )
    return largest
