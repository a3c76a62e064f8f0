"""Preparation of a recording: the steps and readings that a filter takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations, sample_times
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING, ORDER, VALUE
from bayes_asv.models.car_model import (
    CarModel,
    Output,
    bias_directions,
    fastest_rate,
    initial_covariance,
    state_space,
)  # fmt: skip
from bayes_asv.models.cars import cars_with
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.prepared_recording import (
    PreparedRecording,
)
from bayes_asv.preprocessing.wheel_spline import (
    WheelSignal,
    match_bandwidths,
    moments,
    wheel_signal,
)

__all__ = [
    "FEWEST_READINGS",
    "LONGEST_GAP",
    "LONGEST_PHASE",
    "LONGEST_STEP",
    "SAME_INSTANT",
    "MeasurementSchedule",
    "common_bandwidth",
    "prepare",
    "rails",
    "schedule",
    "used_channels",
    "used_readings",
]  # fmt: skip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FEWEST_READINGS = 8
"""Least number of readings of a channel inside its range, for a spline."""
LONGEST_GAP = 0.25
"""Longest gap between readings of a wheel, in periods of the car's fastest mode."""
# Longest step of the filter, s, and largest λh.  The truncation error of its power series is
# (λh)⁸/8! per step: below 1e-9 for λh of at most 1/4 in the nominal car, and 1e-5 for a car whose
# rates are three times as large.
LONGEST_STEP = 0.005
LONGEST_PHASE = 0.25
SAME_INSTANT = 1e-8  # difference of times below which they are the same instant, s
# Tolerance of the longest step, relative: a step at 200 Hz is just the longest one, and a clock
# drift of some ppm must not change the number of steps.
_OVER = 1e-3


class MeasurementSchedule(NamedTuple):
    """Steps and readings of a :class:`PreparedRecording`, with its field names."""

    step: Array
    moments: Array
    process_noise: Array
    kind: NDArray[np.int8]
    ends_group: Flags
    reading: Array
    extra_variance: Array
    instants: Array
    group_instants: NDArray[np.int64]


def rails(readings: Array, vehicle: Vehicle, channels: Sequence[Channel]) -> tuple[Flags, Flags]:
    """Find readings at the lower and at the upper rail of their sensor.

    Parameters
    ----------
    readings : (C, N) array
        Readings, SI units.
    vehicle : Vehicle
        Gives each channel's range; a channel without one has no rails.
    channels : sequence of C Channel
        The channels.

    Returns
    -------
    low, high : (C, N) bool arrays
        Whether a reading is at the rail, to within half a quantisation step.
    """
    low = np.zeros(readings.shape, bool)
    high = np.zeros(readings.shape, bool)
    for c, channel in enumerate(channels):
        sensor = vehicle.sensor(channel.name)
        margin = 0.5 * abs(sensor.resolution or sensor.counts_scale or 0.0)
        if np.isfinite(sensor.low):
            low[c] = readings[c] <= sensor.low + margin
        if np.isfinite(sensor.high):
            high[c] = readings[c] >= sensor.high - margin
    return low, high


def used_channels(recording: Recording, vehicle: Vehicle, car: CarModel) -> tuple[int, ...]:
    """Return the indices of the channels of a recording that a car model uses.

    Raises
    ------
    InputError
        If a measured input of the car is missing, or if there is no output that it models.
    """
    channels = [vehicle.channel(name) for name in recording.channels]
    where = recording.source or "recording"
    for element in car.elements:
        name = f"{element.name}_wheel"
        if name not in recording.channels:
            fitting = " or ".join(f"--car {other}" for other in cars_with(recording.channels))
            raise InputError(
                where,
                f"lacks the channel {name}, which the {car.name} car needs",
                f"choose the car that fits these channels: {fitting}"
                if fitting
                else "record the acceleration of every wheel hub of the car",
            )
    used = tuple(c for c, channel in enumerate(channels) if car.has_channel(channel))
    if all(channels[c].is_input for c in used):
        raise InputError(
            where,
            f"measures nothing that the {car.name} car explains",
            "record the acceleration of the body, its pitch rate or the suspension travel",
        )
    return used


def used_readings(
    recording: Recording, vehicle: Vehicle, car: CarModel
) -> tuple[tuple[Channel, ...], Array, Array]:
    """Return the channels that a car uses, their readings (C, N) in SI units, and times (C, N), s.

    Raises
    ------
    InputError
        As :func:`used_channels`; and if a channel is in counts without a calibration.
    """
    used = list(used_channels(recording, vehicle, car))
    channels = tuple(vehicle.channel(recording.channels[c]) for c in used)
    return channels, accelerations(recording, vehicle)[used], sample_times(recording, vehicle)[used]


def prepare(recording: Recording, vehicle: Vehicle, car: CarModel) -> PreparedRecording:
    """Prepare a recording for the filter.

    Parameters
    ----------
    recording : Recording
        Recording as read.
    vehicle : Vehicle
        Gives calibration, delays, ranges and bandwidths.
    car : CarModel
        Defines inputs and outputs.

    Returns
    -------
    PreparedRecording

    Raises
    ------
    InputError
        If a channel has fewer than :data:`FEWEST_READINGS` readings inside its range, or if
        channels that the car needs are missing.
    """
    channels, values, times = used_readings(recording, vehicle, car)
    units = dict(zip(recording.channels, recording.units, strict=True))
    in_counts = [units[channel.name] == "counts" for channel in channels]
    low, high = rails(values, vehicle, channels)
    for c, channel in enumerate(channels):
        if np.count_nonzero(np.isfinite(values[c]) & ~(low[c] | high[c])) < FEWEST_READINGS:
            raise InputError(
                recording.source,
                f"channel {channel.name} has fewer than {FEWEST_READINGS} readings inside its "
                "range",
                "check the wiring, the column and the vehicle's range for that sensor",
            )
    sensors = [vehicle.sensor(channel.name) for channel in channels]
    values, poles = common_bandwidth(values, times, channels, [s.bandwidth for s in sensors])
    scale_sd = np.array(
        [
            s.counts_scale_sd / abs(s.counts_scale) if counts and s.counts_scale else 0.0
            for s, counts in zip(sensors, in_counts, strict=True)
        ]
    )
    steps = np.array(
        [
            s.resolution or (abs(s.counts_scale or 0.0) if counts else 0.0)
            for s, counts in zip(sensors, in_counts, strict=True)
        ]
    )
    by_element = {car.element_of(x): c for c, x in enumerate(channels) if x.is_input}
    inputs = tuple(by_element[e] for e in range(len(car.elements)))
    outputs = tuple(c for c, channel in enumerate(channels) if not channel.is_input)
    wheels = tuple(wheel_signal(times[c], values[c], low[c], high[c]) for c in inputs)
    plan = schedule(values, times, (low, high), wheels, outputs, car)
    models = tuple(Output(channels[c]) for c in outputs)
    system = state_space(car, car.nominal, models)
    directions = bias_directions(system)
    return PreparedRecording(
        car=car,
        channels=channels,
        inputs=inputs,
        outputs=outputs,
        **plan._asdict(),
        initial_covariance=initial_covariance(system._replace(N=directions), models),
        wheels=wheels,
        values=values,
        times=times,
        clipped=low | high,
        noise=tuple(s.noise for s in sensors),
        quantization_steps=steps,
        poles=poles,
        bias_directions=directions,
        start_time=float(recording.time[0]),
        source=Path(recording.source).name,
        log_sha256=recording.sha256,
        scale_sd=scale_sd,
    )


def schedule(
    values: Array,
    times: Array,
    rails: tuple[Flags, Flags],
    wheels: Sequence[WheelSignal],
    outputs: Sequence[int],
    car: CarModel,
    longest: float = LONGEST_STEP,
) -> MeasurementSchedule:
    """Arrange output readings and input signals in filter steps.

    Parameters
    ----------
    values, times : (C, N) arrays
        Readings (SI units), NaN where missing, and their times (s).
    rails : pair of (C, N) bool arrays
        Readings at the lower and at the upper rail.
    wheels : sequence of WheelSignal
        Measured inputs.
    outputs : sequence of int
        Numbers of the output channels.
    car : CarModel
        Its fastest nominal motion limits the step.
    longest : float
        Longest step for any car, s.

    Returns
    -------
    MeasurementSchedule
    """
    longest = min(longest, LONGEST_PHASE / fastest_rate(state_space(car, car.nominal, ())))
    # Most steps between two samples of a wheel: a longer gap is not usable, and a wrong time stamp
    # must not use memory for every millisecond.
    most = math.ceil(LONGEST_GAP / nominal_modes(car)[-1].natural / longest) + 1
    instants, kind, reading, group_instants = _schedule_instants(
        values, times, rails, wheels, outputs, longest, most
    )
    ends_group = np.zeros(len(instants), bool)
    ends_group[group_instants.max(axis=1)] = True
    return MeasurementSchedule(
        step=np.diff(instants, prepend=instants[0]),
        moments=np.ascontiguousarray(
            np.stack([moments(w, instants, ORDER) for w in wheels], axis=1)
        ),
        process_noise=_process_noise(wheels, instants),
        kind=kind,
        ends_group=ends_group,
        reading=reading,
        extra_variance=np.zeros_like(reading),
        instants=instants,
        group_instants=group_instants,
    )


def common_bandwidth(
    values: Array,
    times: Array,
    channels: Sequence[Channel],
    bandwidth: Sequence[float | None],
) -> tuple[Array, Array]:
    """Filter the readings of faster sensors so that all channels have the same pole.

    An accelerometer without a declared bandwidth is assumed to be like the slowest of the others;
    any other sensor without one is assumed to have no filter, which the car model accounts for.

    Returns
    -------
    values : (C, N) array
        Readings after the common pole.
    poles : (C,) array
        That pole, rad/s; 0 for channels without a filter.
    """
    given = [b for b in bandwidth if b is not None]
    if not given:
        return values, np.zeros(len(values))
    target = min(given)
    out = values.copy()
    poles = np.full(len(values), 2.0 * np.pi * target)
    for c, b in enumerate(bandwidth):
        finite = np.isfinite(values[c])
        if b is not None:
            out[c, finite] = match_bandwidths(times[c, finite], values[c, finite], b, target)
        elif channels[c].quantity != "acceleration":
            poles[c] = 0.0
    return out, poles


def _schedule_instants(
    values: Array,
    times: Array,
    rails: tuple[Flags, Flags],
    wheels: Sequence[WheelSignal],
    outputs: Sequence[int],
    longest: float,
    most: int,
) -> tuple[Array, NDArray[np.int8], Array, NDArray[np.int64]]:
    """Instants of readings in order, with additional ones where a step would be too long."""
    low, high = rails
    n = values.shape[1]
    first = max(w.knots[0] for w in wheels)
    last = min(w.knots[-1] for w in wheels)
    when, which, rows = [], [], []
    for y, c in enumerate(outputs):
        use = np.isfinite(values[c]) & (times[c] >= first) & (times[c] <= last)
        when.append(times[c, use])
        which.append(np.full(np.count_nonzero(use), y))
        rows.append(np.arange(n)[use])
    t = np.concatenate(when)
    if len(t) < 2:
        raise InputError(
            "recording", "wheels and body were not measured at the same time", "check delays"
        )
    order = np.argsort(t, kind="stable")
    t, output_of, row_of = t[order], np.concatenate(which)[order], np.concatenate(rows)[order]
    new = np.append(True, np.diff(t) > SAME_INSTANT)
    place = np.cumsum(new) - 1
    observed = t[new]
    samples = np.min([np.diff(np.searchsorted(w.knots, observed)) for w in wheels], axis=0)
    pieces = np.ceil(np.diff(observed) / longest - _OVER)
    pieces = np.clip(pieces, 1, most * (samples + 1)).astype(int)
    position = np.concatenate([[0], np.cumsum(pieces)])
    total = int(position[-1]) + 1
    instants = np.interp(np.arange(total), position, observed)
    instants[position] = observed
    kind = np.full((total, len(outputs)), MISSING, np.int8)
    reading = np.zeros((total, len(outputs)))
    for y, c in enumerate(outputs):
        of_output = output_of == y
        at, r = position[place[of_output]], row_of[of_output]
        kind[at, y] = np.where(high[c, r], AT_LEAST, np.where(low[c, r], AT_MOST, VALUE))
        reading[at, y] = values[c, r]
    return instants, kind, reading, _groups(kind)


def _groups(kind: NDArray[np.int8]) -> NDArray[np.int64]:
    """Group readings of all outputs that are adjacent in time.

    A board reads all its channels at one instant, but two boards with separate clocks may differ by
    a row after a minute; therefore readings are not grouped by the rows of the file.
    """
    groups: list[list[int]] = []
    current = [-1] * kind.shape[1]
    for k in np.flatnonzero(np.any(kind != MISSING, axis=1)):
        outputs_here = np.flatnonzero(kind[k] != MISSING)
        if any(current[y] >= 0 for y in outputs_here):
            groups.append(current)
            current = [-1] * kind.shape[1]
        for y in outputs_here:
            current[y] = int(k)
    groups.append(current)
    return np.array(groups, np.int64)


def _process_noise(wheels: Sequence[WheelSignal], instants: Array) -> Array:
    """Process noise of each step (E, 2 nu): by a sample's noise, and by interpolation errors."""
    middle = 0.5 * (instants + np.append(instants[0], instants[:-1]))
    out = np.zeros((len(instants), 2 * len(wheels)))
    for u, wheel in enumerate(wheels):
        at = np.clip(np.searchsorted(wheel.knots, middle) - 1, 0, len(wheel.knots) - 2)
        spacing = np.diff(wheel.knots)[at]
        out[:, u] = spacing
        out[:, len(wheels) + u] = wheel.sd[at] ** 2 * spacing
    return out
