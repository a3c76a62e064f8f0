"""Can these data answer at all?  Reasons in words, before anything is fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording, accelerations, sample_times
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.modes import Mode, modes
from bayes_asv.preprocessing.timeline import FEWEST_READINGS, PreparedRecording, rails

__all__ = [
    "DOUBTFUL", "PLAIN", "clipping_limit", "dead_channels", "least_rate", "nominal_modes",
    "preflight",
]  # fmt: skip

PLAIN = {
    "front_wheel": "front wheel",
    "front_chassis": "front chassis",
    "rear_wheel": "rear wheel",
    "rear_chassis": "rear chassis",
}

_PERIODS = 1.0  # of the slowest mode that a record must last
_SAMPLES_A_PERIOD = 12.0  # of the fastest mode
_REAL = 0.5  # of that for a mode that does not oscillate: 5 were enough for poles of 18 to 32 Hz
_FEWEST = 100  # rows
DOUBTFUL = 0.3
"""Share left over (rms) beyond which the intervals are too good to be true."""
_RATTLED = 300.0  # m/s² rms of a wheel: 30 g for as long as the drive lasts
_SHAKEN = 5.0  # wheel rms in units of its noise, below which nothing was driven over


def clipping_limit(samples: int) -> int:
    """Clipped samples of one channel that are still treated as bounds: ten, or 2 %."""
    return max(10, int(0.02 * samples))


def dead_channels(recording: Recording, vehicle: Vehicle) -> list[str]:
    """Name channels that have nothing to lay out in time.

    Parameters
    ----------
    recording, vehicle : Recording and Vehicle
        As read.

    Returns
    -------
    list of str
        One reason a channel without enough readings inside its range.
    """
    acc = accelerations(recording, vehicle)
    low, high = rails(acc, vehicle)
    good = np.count_nonzero(np.isfinite(acc) & ~(low | high), axis=1)
    source = Path(recording.source).name
    reasons = [
        f"the {PLAIN[name]} sensor of {source} has {count} readings inside its range; check its "
        "wiring, its column and the range in the vehicle file"
        for name, count in zip(CHANNELS, good, strict=True)
        if count < FEWEST_READINGS
    ]
    if reasons:
        return reasons
    times = sample_times(recording, vehicle)
    plain = np.isfinite(acc)
    first = max(times[c, plain[c]][0] for c in (0, 2))
    last = min(times[c, plain[c]][-1] for c in (0, 2))
    for c in (1, 3):
        inside = plain[c] & (times[c] >= first) & (times[c] <= last)
        if np.count_nonzero(inside) < FEWEST_READINGS:
            reasons.append(
                f"only {np.count_nonzero(inside)} readings of the {PLAIN[CHANNELS[c]]} sensor of "
                f"{source} were taken while both wheels were measured; "
                "check delays, clocks and missing cells, or record longer"
            )
    return reasons


def preflight(vehicle: Vehicle, line: PreparedRecording) -> tuple[list[str], list[str]]:
    """Look for what would make an answer worthless.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal car: its modes say how long and how fast one must measure.
    line : PreparedRecording
        One recording.

    Returns
    -------
    reasons, warnings : lists of str
        Sentences; any reason means that the recording is refused.
    """
    reasons: list[str] = []
    warnings: list[str] = []
    found = nominal_modes(vehicle)
    slowest, fastest = found[0].natural, found[-1].natural
    times = line.times[0]
    rows = len(times)
    duration = float(times[-1] - times[0])
    rate = 1.0 / float(np.median(np.diff(times)))
    needed = max(_PERIODS / slowest, 0.3)
    if duration < needed or rows < _FEWEST:
        reasons.append(
            f"{line.source} is too short: {duration:.2f} s in {rows} rows, and this car needs at "
            f"least {needed:.2f} s and {_FEWEST} rows; start the recording a second before the "
            "bump and let it run until the car has stopped bouncing"
        )
    if rate < least_rate(found):
        reasons.append(
            f"{line.source} was taken at {rate:.0f} Hz, too slow for this car, which moves at up "
            f"to {fastest:.1f} Hz; record at {_round_rate(least_rate(found))} Hz or more"
        )
    limit = clipping_limit(rows)
    for c, name in enumerate(CHANNELS):
        clipped = int(np.count_nonzero(line.clipped[c]))
        if clipped > limit:
            reasons.append(
                f"the {PLAIN[name]} sensor of {line.source} was at the end of its range in "
                f"{clipped} of {rows} samples; drive slower, take a lower bump or use a sensor "
                "with a wider range"
            )
        elif clipped:
            warnings.append(
                f"{clipped} samples of the {PLAIN[name]} sensor of {line.source} were at the end "
                "of its range and are used as bounds"
            )
        missing = int(np.count_nonzero(~np.isfinite(line.acceleration[c])))
        if missing > 0.2 * rows:
            reasons.append(
                f"{missing} of {rows} readings of the {PLAIN[name]} sensor of {line.source} are "
                "missing; check its wiring and the transfer"
            )
        elif missing:
            warnings.append(
                f"{missing} readings of the {PLAIN[name]} sensor of {line.source} are missing"
            )
    for axle, c in (("front", 0), ("rear", 2)):
        signal = line.acceleration[c][np.isfinite(line.acceleration[c])]
        shaken = float(np.std(signal))
        floor = max(line.noise[c] or 0.0, line.steps[c] / np.sqrt(12.0))
        if shaken < _SHAKEN * floor or shaken < 0.05:
            reasons.append(
                f"the {axle} wheel hardly moved in {line.source} ({shaken:.2f} m/s² rms); drive "
                "over a bump, a parking stop or a rough road"
            )
        elif shaken > _RATTLED:
            reasons.append(
                f"the {axle} wheel moves at {shaken:.0f} m/s² rms in {line.source}, which no car "
                "takes; check the unit of the column and the scale of the sensor"
            )
    for wheel, name in zip(line.wheels, ("front", "rear"), strict=True):
        largest = float(np.diff(wheel.knots).max())
        if largest > 0.25 / fastest:
            reasons.append(
                f"the {name} wheel of {line.source} has a gap of {largest * 1e3:.0f} ms, longer "
                "than this car's motion can be followed across; cut the recording there and give "
                "both parts"
            )
    given = [vehicle.sensor(name).bandwidth for name in CHANNELS]
    if any(b is None for b in given) and any(b is not None for b in given):
        warnings.append(
            "the vehicle file gives a bandwidth for some sensors only; the others are taken to "
            "be like the slowest of those"
        )
    for c, name in enumerate(CHANNELS):
        if not np.isfinite([vehicle.sensor(name).low, vehicle.sensor(name).high]).any():
            stuck = _stuck_at_extreme(line.acceleration[c])
            if stuck:
                warnings.append(
                    f"the {PLAIN[name]} sensor of {line.source} stays at its extreme for {stuck} "
                    "samples in a row, as a sensor at the end of its range does; give its range "
                    "in the vehicle file"
                )
        if vehicle.sensor(name).counts_scale_sd > 0.0 and line.scale_sd[c] == 0.0:
            warnings.append(
                f"the deviation given for the scale of the {PLAIN[name]} sensor is not used: "
                f"{line.source} is not in counts, and the intervals take its scale as exact"
            )
    return reasons, warnings


def least_rate(found: list[Mode]) -> float:
    """Rows a second below which a car of these modes moves between the samples."""
    return _SAMPLES_A_PERIOD * max(m.natural * (1.0 if m.damped else _REAL) for m in found)


def nominal_modes(vehicle: Vehicle) -> list[Mode]:
    """Modes of a vehicle as it is given, slowest first."""
    return modes(HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields)))


def _stuck_at_extreme(signal: NDArray[np.float64]) -> int:
    """Longest run of samples that repeat the largest or smallest value, if three or more."""
    longest = 0
    for extreme in (np.nanmax(signal), np.nanmin(signal)):
        run = 0
        for same in signal == extreme:
            run = run + 1 if same else 0
            longest = max(longest, run)
    return longest if longest >= 3 else 0


def _round_rate(least: float) -> int:
    """Round up to the next rate a logger offers."""
    for rate in (50, 100, 200, 400, 800):
        if rate >= least:
            return rate
    return int(np.ceil(least / 100.0) * 100)
