"""Selection of the informative stretches of long logs.

An hour of driving contains some forty bumps.  Standing, cruising, braking and cornering hardly move
a damper; where the wheels leave the ground or a sensor reaches its rail, no linear model is valid.

**Information.**  For outputs y with noise of density S, the Fisher information about the logarithms
of the unknowns t is J = ∫ (∂y/∂t)ᵀ S⁻¹ (∂y/∂t) dt.  The derivatives are those of the nominal car,
driven by the wheels over the whole log, in bins of which there are at least 24 in a period of its
fastest mode.  Braking and cornering move the body but not the wheels, so they have no part in J.

**Events.**  An event is a stretch in which the information per second, averaged over one period of
the slowest nominal mode, is at least 1 % of the largest value in the log: anything less would have
to last a hundred times as long.  It must also be 25 times (in amplitude five times) the information
that the noise of the wheel sensors alone would appear to give, as :mod:`.data_checks` requires of a
whole recording.  An event begins one period of the slowest mode earlier, so that the filter starts
close to rest, and ends when the slowest decay has brought the oscillation down to the noise.  A
stretch longer than ten periods is a rough stretch and is divided.

**Choice.**  Events are chosen one by one, each time the one that adds most per row to the log
determinant of the posterior precision, until the next would shrink no interval by 2 %.  At least
six are chosen, because six events show the standard deviation from run to run to within 1/√10, and
no more than fit into :data:`MOST_ROWS`.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import (
    Recording,
    accelerations,
    nominal_rate,
    timing,
)
from bayes_asv.domain.units import STANDARD_GRAVITY
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.free_response import free_response
from bayes_asv.filters.kalman import ORDER, Measurements
from bayes_asv.models.car_model import CarModel, Output, state_space
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.band import STEPS_IN_PERIOD
from bayes_asv.preprocessing.data_checks import MAX_UNEXPLAINED, MIN_EXCITATION, min_sampling_rate
from bayes_asv.preprocessing.faulty_channels import clipping_limit
from bayes_asv.preprocessing.prepare import LONGEST_GAP, rails, used_channels, used_readings
from bayes_asv.preprocessing.quantization import quiet_level

__all__ = [
    "AT_RAIL",
    "FEWEST_PARTS",
    "IN_THE_AIR",
    "LOST",
    "MOST_ROWS",
    "NOT_NEEDED",
    "NO_TIME",
    "PART_PERIODS",
    "PUSHED",
    "Event",
    "LogEvents",
    "choose_events",
    "find_events",
    "is_long",
]  # fmt: skip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_ROWS = 16_000
"""Number of rows of an estimate that takes about a minute: some 4 ms per row on one core, for the
fits of all events, the draws and the checks, and the memory of a hundred thousand numbers per row.
A longer recording is searched for events, and no more rows are taken from it."""

IN_THE_AIR = "the wheels left the ground"
AT_RAIL = "readings were at a rail"
"""Reason to leave an event out, unless all other events are left out as well."""
LOST = "rows were missing"
PUSHED = "braking or cornering moved the body"
NO_TIME = "there was no time for more"

_FEWEST = 6  # least number of events
_SHRINK = 0.02  # least relative reduction of an interval by a further event
NOT_NEEDED = f"it would shrink no interval by {100.0 * _SHRINK:g} %"
_WORTH = 0.01  # least information per second, relative to the largest in the log
_BINS = 2.0  # number of bins per second, relative to the least rate of the data checks
PART_PERIODS = 10.0  # length of the parts of a recording, in periods of the slowest mode
FEWEST_PARTS = 5  # least number of such parts of a recording in a band
# Deviation from free fall, relative to gravity, by scale errors and a car that is not level.
_FALL = 0.15
_STEP = 0.01  # step of central differences of the logarithms
_DECAY = 0.005  # decay rate added to the motion, relative to the fastest rate
_MOST_DELAY = 1.0  # largest delay that the metadata of a recording may declare, s
_POINTS = 600  # number of points of the timeline


@dataclass(frozen=True, repr=False)
class Event:
    """A stretch of a log that moves the suspension.

    Parameters
    ----------
    kind : {'bump', 'rough stretch'}
        A rough stretch is a part of a longer one.
    recording : Recording
        Its rows, with the stamps of the log and a source such as ``run.csv, 312.4 – 318.1 s``.
    information : (nT, nT) array
        Information about the unknowns of the car, in units of their prior standard deviations.
    reason : str
        Reason why it was left out; empty if it was used or may be.
    used : bool
        Whether it was chosen.
    """

    kind: str
    recording: Recording
    information: Array
    reason: str = ""
    used: bool = False

    @property
    def begin(self) -> float:
        """Stamp of its first row, s."""
        return float(self.recording.time[0])

    @property
    def end(self) -> float:
        """Stamp of its last row, s."""
        return float(self.recording.time[-1])

    def __repr__(self) -> str:
        fate = "used" if self.used else f"left out as {self.reason}" if self.reason else "found"
        return f"<{self.kind}, {self.begin:.1f} – {self.end:.1f} s, {fate}>"


@dataclass(frozen=True)
class LogEvents:
    """Events of one log.

    Parameters
    ----------
    recording : Recording
        The log.
    events : tuple of Event
        Events in order of time.
    estimands : (na, nT) array
        Derivatives of the logarithms of the parameters of interest by the unknowns.
    states : dict of str to float
        Seconds outside events: ``standing``, and ``little motion`` of the wheels, as in cruising,
        braking and cornering.
    time, level : (P,) arrays
        Information per second, relative to its maximum, over time (s, as in the log).
    """

    recording: Recording
    events: tuple[Event, ...]
    estimands: Array
    states: dict[str, float]
    time: Array
    level: Array


class _Binned(NamedTuple):
    """A log in n bins, with nu inputs and ny outputs, SI units, relative to their medians."""

    start: float  # time of the first bin, s
    step: float  # length of a bin, s
    rows: float  # rows per bin
    inputs: Array  # (n, nu)
    outputs: Array  # (n, ny)
    input_sd: Array  # (nu,) noise of the mean of a bin
    output_sd: Array  # (ny,) noise of the mean of a bin
    accelerations: tuple[tuple[int, int], ...]  # pairs of an output and the input below it
    edges: NDArray[np.int64]  # (n + 1,) first row of each bin, and the one after the last
    gap: Flags  # (n,) whether some channel has no reading
    rail: Flags  # (n,) whether a reading is at a rail


class _Sensitivity(NamedTuple):
    """Derivatives of the outputs by the P unknowns of a car, per prior standard deviation."""

    slopes: Array  # (P, n, ny)
    output: Array  # (n, ny) outputs of the nominal car


def is_long(recording: Recording, below: float | None = None) -> bool:
    """Whether a recording is too long to be used whole; see :data:`MOST_ROWS`."""
    return len(recording.time) * _cost(recording, below) > MOST_ROWS


def _cost(recording: Recording, below: float | None) -> float:
    """Return the filter steps per row: in a band, 16 per period of its edge."""
    return 1.0 if below is None else min(1.0, STEPS_IN_PERIOD * below / nominal_rate(recording))


def find_events(
    recording: Recording, vehicle: Vehicle, car: CarModel, below: float | None = None
) -> LogEvents:
    """Find the stretches of a log that have information about a car.

    Parameters
    ----------
    recording : Recording
        A recording of any length.
    vehicle : Vehicle
        Gives calibration, ranges, noise and delays.
    car : CarModel
        Its nominal modes determine the length of an event.
    below : float, optional
        Upper edge of the band that will be used, Hz; its filter makes events longer.

    Returns
    -------
    LogEvents
        None of the events is chosen yet; those with a reason cannot be.

    Raises
    ------
    InputError
        If a channel that the car needs is missing, or cannot be calibrated.
    """
    modes = nominal_modes(car)
    period = 1.0 / modes[0].natural
    channels = [
        vehicle.channel(recording.channels[c]) for c in used_channels(recording, vehicle, car)
    ]
    ys = tuple(Output(one) for one in channels if not one.is_input)
    log = _bin_log(recording, vehicle, car, _BINS * min_sampling_rate(modes))
    unknowns = _unknowns(car)
    estimands = np.array([unknowns[name] for name in car.estimated])
    sensitivity = _sensitivity(car, ys, unknowns, log.inputs, log.step)
    # the effect of the noise of the wheel sensors, from the responses to single bins
    pulses = [_pulse(car, u, log.step, period) for u in range(log.inputs.shape[1])]
    responses = [_sensitivity(car, ys, unknowns, pulse, log.step) for pulse in pulses]
    band = max(int(len(pulses[0]) * log.step * modes[-1].natural), 1)
    noise = (
        log.output_sd** 2
        + sum(  # in the band of the car's own motion
            sd**2 * np.mean(np.abs(np.fft.rfft(one.output, axis=0)[:band]) ** 2, axis=0)
            for sd, one in zip(log.input_sd, responses, strict=True)
        )
    )
    unknowns_per_estimand = np.linalg.pinv(
        estimands
    )  # (P, na): unknowns per logarithm of a parameter of interest

    def density(slopes: Array) -> Array:
        by_estimand = np.tensordot(unknowns_per_estimand.T, slopes, 1)
        return np.asarray(np.sum(by_estimand**2 / noise, axis=(0, 2)) / log.step)

    from_noise = sum(
        sd**2 * float(np.sum(density(one.slopes)))
        for sd, one in zip(log.input_sd, responses, strict=True)
    )
    information_rate = density(sensitivity.slopes)
    window = max(round(period / log.step), 1)
    level = uniform_filter1d(information_rate, window)
    fall = _find_free_fall(log, modes[0].natural)
    lost = _widen(fall | log.gap, 2 * window)
    railed = _widen(log.rail, 2 * window)
    most = float(np.max(level[~lost & ~railed], initial=0.0))
    bounded = float(np.max(level[~lost & railed], initial=0.0))
    if most < _WORTH * bounded:  # all significant motion reaches a rail
        most = bounded
    worth = max(_WORTH * most, MIN_EXCITATION**2 * from_noise)
    decay = 1.0 / min(2.0 * math.pi * mode.natural * mode.ratio for mode in modes)
    settling = decay * math.log(max(math.sqrt(worth / max(from_noise, 1e-300)), 1.0))
    tail = max(math.ceil(settling / log.step), window)
    # other motion of the body is slow; the wheels explain all of a bump below the slowest mode
    residuals = uniform_filter1d(log.outputs - sensitivity.output, 2 * window, axis=0)
    residuals -= uniform_filter1d(residuals, 200 * window, axis=0)
    size = PART_PERIODS * period
    extra = 0.0
    if below is not None:  # the filter of a band needs two periods of its edge at either end
        extra, size = 2.0 / below, FEWEST_PARTS * size + 4.0 / below
    cores = _runs(level >= worth) if worth > 0.0 else []
    extra_bins = round(extra / log.step)
    spans = _merge_spans(
        [(a - window - extra_bins, b + tail + extra_bins) for a, b in cores], len(level)
    )
    if below is not None:
        spans = _merge_spans(
            [_lengthen(span, round(size / log.step)) for span in spans], len(level)
        )
    sha256 = recording.sha256 or _hash(recording)
    events = []
    for a, b in spans:
        pieces = max(math.ceil((b - a) * log.step / size - 0.1), 1)
        for first, last in zip(*_ends(a, b, pieces), strict=True):
            inside = slice(first, last)
            slopes = sensitivity.slopes[:, inside] / np.sqrt(noise)
            flat = slopes.reshape(len(slopes), -1)
            reason = ""
            if log.gap[inside].any():
                reason = LOST
            elif fall[inside].any():
                reason = IN_THE_AIR
            elif log.rail[inside].any():
                reason = AT_RAIL
            elif _is_pushed(residuals[inside], log.outputs[inside]):
                reason = PUSHED
            piece = _cut_piece(recording, vehicle, slice(*log.edges[[first, last]]), sha256)
            if piece is not None:
                kind = "bump" if pieces == 1 else "rough stretch"
                events.append(Event(kind, piece, flat @ flat.T, reason))
    points = np.linspace(0, len(level), min(_POINTS, len(level)) + 1).astype(int)
    return LogEvents(
        recording=recording,
        events=_allow_bounds(events, vehicle),
        estimands=estimands,
        states=_seconds_by_state(log, spans, window),
        time=log.start + log.step * points[:-1],
        level=np.maximum.reduceat(level, points[:-1]) / (most or 1.0),
    )


def choose_events(
    logs: Sequence[LogEvents], rows: float = 0.0, below: float | None = None
) -> tuple[LogEvents, ...]:
    """Choose the most informative events of one or several logs of a car.

    Parameters
    ----------
    logs : sequence of LogEvents
        From :func:`find_events`.
    rows : float
        Number of rows of recordings that are used whole.
    below : float, optional
        As in :func:`find_events`.

    Returns
    -------
    tuple of LogEvents
        The same logs; every event is either used, or has a reason why it was left out.
    """
    events = [event for log in logs for event in log.events]
    cost = [
        _cost(log.recording, below) * len(event.recording.time)
        for log in logs
        for event in log.events
    ]
    available = [k for k, event in enumerate(events) if not event.reason]
    reasons = {k: event.reason for k, event in enumerate(events)}
    chosen: list[int] = []
    if available:
        estimands = logs[0].estimands
        precision = np.eye(estimands.shape[1])
        while available:
            before = _variances(precision[None], estimands)[0]
            information = np.stack([events[k].information for k in available])
            after = _variances(precision + information, estimands)
            shrunk = 1.0 - np.sqrt(after / before)
            if len(chosen) >= _FEWEST and shrunk.max() < _SHRINK:
                reasons |= dict.fromkeys(available, NOT_NEEDED)
                break
            gain = np.linalg.slogdet(precision + information)[1] - np.linalg.slogdet(precision)[1]
            gain /= np.array([cost[k] for k in available])
            best = available.pop(int(np.argmax(gain)))
            if rows + cost[best] > MOST_ROWS and chosen:
                reasons[best] = NO_TIME
                continue
            chosen.append(best)
            rows += cost[best]
            precision = precision + events[best].information
    decided = iter(
        replace(event, reason=reasons[k], used=k in chosen) for k, event in enumerate(events)
    )
    return tuple(replace(log, events=tuple(next(decided) for _ in log.events)) for log in logs)


def _variances(precision: Array, estimands: Array) -> Array:
    """Variances (K, na) of the logarithms of parameters of interest, for precisions (K, P, P)."""
    covariance = np.linalg.inv(precision)
    return np.asarray(np.einsum("ap,kpq,aq->ka", estimands, covariance, estimands))


def _bin_log(recording: Recording, vehicle: Vehicle, car: CarModel, rate: float) -> _Binned:
    """Average the readings of every channel over bins of one grid in true time."""
    channels, values, times = used_readings(recording, vehicle, car)
    low, high = rails(values, vehicle, channels)
    start, rate_of_rows = float(times[:, 0].max()), nominal_rate(recording)
    rows = max(math.floor(rate_of_rows / rate), 1)
    step = rows / rate_of_rows
    n = max(int((float(times[:, -1].min()) - start) / step), 1)
    means = np.empty((n, len(channels)))
    gap, rail = np.zeros(n, bool), np.zeros(n, bool)
    sd = np.empty(len(channels))
    longest = LONGEST_GAP / nominal_modes(car)[-1].natural
    for c, channel in enumerate(channels):
        sensor = vehicle.sensor(channel.name)
        at = np.floor((times[c] - start) / step).astype(np.int64)
        usable = np.isfinite(values[c]) & (at >= 0) & (at < n)
        count = np.bincount(at[usable], minlength=n)
        total = np.bincount(at[usable], values[c, usable], n)
        filled = np.flatnonzero(count)
        if len(filled) < 2:
            raise InputError(
                recording.source, f"channel {channel.name} has no readings", "check the wiring"
            )
        empty = [(a, b) for a, b in _runs(count == 0) if (b - a) * step > longest]
        for a, b in empty:
            gap[a:b] = True
        means[:, c] = np.interp(np.arange(n), filled, total[filled] / count[filled])
        means[:, c] -= np.median(means[:, c])
        bound = low[c] | high[c] | _stuck(values[c])
        rail |= np.bincount(at[usable & bound], minlength=n) > 0
        quantum = sensor.resolution or 0.0
        noise = quiet_level(values[c], quantum) if sensor.noise is None else sensor.noise
        # noise behind the sensor's filter is autocorrelated, which increases the noise of a mean
        correlation = (
            0.0
            if sensor.bandwidth is None
            else math.exp(-2.0 * math.pi * sensor.bandwidth / rate_of_rows)
        )
        variance = noise**2 * (1.0 + correlation) / (1.0 - correlation) + quantum**2 / 12.0
        sd[c] = math.sqrt(variance / rows)
    places = {car.element_of(x): c for c, x in enumerate(channels) if x.is_input}
    inputs = [places[e] for e in range(len(car.elements))]
    outputs = [c for c, x in enumerate(channels) if not x.is_input]
    above = [
        (y, e)
        for y, c in enumerate(outputs)
        if channels[c].quantity == "acceleration"
        for e, element in enumerate(car.elements)
        if channels[c].axle in (None, element.axle) and channels[c].side in (None, element.side)
    ]
    return _Binned(
        start, step, rows, means[:, inputs], means[:, outputs], sd[inputs], sd[outputs],
        tuple(above), np.searchsorted(times.mean(axis=0), start + step * np.arange(n + 1)),
        gap, rail,
    )  # fmt: skip


def _unknowns(car: CarModel) -> dict[str, Array]:
    """Return derivatives (P,) of each parameter's logarithm by the unknowns, in prior sds."""
    terms = list(dict.fromkeys(name for p in car.parameters for name, _, sd in p.terms if sd > 0.0))
    out = {p.name: np.zeros(len(terms)) for p in car.parameters}
    for p in car.parameters:
        for name, coefficient, sd in p.terms:
            if sd > 0.0:
                relative = sd / p.nominal if p.kind == "fraction" else sd
                out[p.name][terms.index(name)] += coefficient * relative
    return out


def _sensitivity(
    car: CarModel, ys: Sequence[Output], unknowns: dict[str, Array], inputs: Array, step: float
) -> _Sensitivity:
    """Simulate the nominal car and its neighbours, driven by interpolated bins (n, nu)."""
    count = len(next(iter(unknowns.values())))
    n = len(inputs)
    order = np.arange(ORDER)
    factorial = np.array([math.factorial(j + 1) for j in order])
    increments = np.diff(inputs, axis=0)
    moments = np.zeros((n, inputs.shape[1], ORDER))
    moments[1:] = (
        inputs[:-1, :, None] + increments[:, :, None] / (order + 2)
    ) * step ** (order + 1) / factorial  # fmt: skip
    steps = np.full(n, step)
    steps[0] = 0.0
    empty = np.zeros((n, 0))
    # each unknown changes the parameter that depends most on it by one per cent
    changes = _STEP / np.max(np.abs(np.stack(list(unknowns.values()))), axis=0)
    sets = np.concatenate([np.zeros((1, count)), np.diag(changes), -np.diag(changes)])
    data = Measurements(
        steps, moments, empty, np.zeros((n, 0), np.int8), empty, empty, np.zeros((0, 0))
    )

    values = {p.name: p.nominal * np.exp(sets @ unknowns[p.name]) for p in car.parameters}
    system = state_space(car, values, ys)
    nx = system.A.shape[1]
    # motion of the wheels that no rigid body can follow would drift; damp it
    fade = np.abs(np.linalg.eigvals(system.A)).max(axis=1) * _DECAY
    system = system._replace(A=system.A - fade[:, None, None] * np.eye(nx))
    outputs, _ = free_response(system, data, np.zeros((len(sets), nx + len(ys))))
    slopes = (outputs[1 : 1 + count] - outputs[1 + count :]) / (2.0 * changes)[:, None, None]
    return _Sensitivity(slopes, outputs[0])


def _pulse(car: CarModel, u: int, step: float, period: float) -> Array:
    """Input (n, nu) of one in a single bin, followed by time to settle."""
    inputs = np.zeros((math.ceil(PART_PERIODS * period / step), len(car.elements)))
    inputs[1, u] = 1.0
    return inputs


def _find_free_fall(log: _Binned, slowest: float) -> Flags:
    """Find bins in which a wheel and the body above it fall freely.

    Both read −g to within 15 %.  An oscillation of the slowest mode does so for at most
    acos(0.85/1.15)/(π f); anything longer is not an oscillation.
    """
    falling = np.zeros(len(log.inputs), bool)
    shortest = math.acos((1.0 - _FALL) / (1.0 + _FALL)) / (math.pi * slowest)
    for y, e in log.accelerations:
        distance = np.abs(np.stack([log.outputs[:, y], log.inputs[:, e]]) + STANDARD_GRAVITY)
        for a, b in _runs(np.all(distance < _FALL * STANDARD_GRAVITY, axis=0)):
            falling[a:b] |= (b - a) * log.step > shortest
    return falling


def _is_pushed(residuals: Array, outputs: Array) -> bool:
    """Whether slow motion of the body that the wheels do not explain is a large share of it."""
    return bool(np.any(residuals.std(axis=0) > MAX_UNEXPLAINED * outputs.std(axis=0)))


def _seconds_by_state(
    log: _Binned, spans: Sequence[tuple[int, int]], window: int
) -> dict[str, float]:
    """Seconds outside events, by state."""
    outside = np.ones(len(log.gap), bool)
    for a, b in spans:
        outside[a:b] = False
    power = uniform_filter1d(log.inputs**2, window, axis=0)
    at_rest = np.all(power < (MIN_EXCITATION * log.input_sd) ** 2, axis=1)
    masks = {"standing": outside & at_rest, "little motion": outside & ~at_rest}
    return {name: float(np.count_nonzero(bins) * log.step) for name, bins in masks.items()}


def _stuck(values: Array) -> Flags:
    """Find readings at an extreme of their channel, at least three times in a row."""
    out = np.zeros(len(values), bool)
    for extreme in (np.nanmax(values), np.nanmin(values)):
        for a, b in _runs(values == extreme):
            out[a:b] |= b - a >= 3
    return out


def _allow_bounds(events: Sequence[Event], vehicle: Vehicle) -> tuple[Event, ...]:
    """Allow events with a few readings at a rail, used as bounds, if there are no others."""
    if not any(event.reason == AT_RAIL for event in events) or not all(e.reason for e in events):
        return tuple(events)
    out = []
    for event in events:
        channels = [vehicle.channel(name) for name in event.recording.channels]
        low, high = rails(accelerations(event.recording, vehicle), vehicle, channels)
        few = (low | high).sum(axis=1).max() <= clipping_limit(len(event.recording.time))
        out.append(replace(event, reason="") if event.reason == AT_RAIL and few else event)
    return tuple(out)


def _cut_piece(
    recording: Recording, vehicle: Vehicle, rows: slice, sha256: str
) -> Recording | None:
    """Return some rows; None if there are none, or if clocks have drifted too far.

    The clocks of a log run from its first stamp: the time that they have gained by the start of a
    piece becomes a delay of its channels.
    """
    time = recording.time[rows]
    if len(time) < 2:
        return None
    declared = timing(recording)
    delays = []
    for name, clock, declared_delay in zip(
        recording.channels, declared.clock, declared.delay, strict=True
    ):
        if clock != 0.0:
            gained = (time[0] - recording.time[0]) * (1.0 / (1.0 + clock) - 1.0)
            delay = gained + (
                vehicle.sensor(name).delay if declared_delay is None else declared_delay
            )
            if abs(delay) > _MOST_DELAY:
                return None
            delays.append((f"delay {name}", f"{delay:.9f} s"))
    name = recording.source or "recording"
    return replace(
        recording,
        time=time,
        values=recording.values[:, rows],
        metadata=(*recording.metadata, *delays),
        source=f"{name}, {time[0]:.1f} – {time[-1]:.1f} s",
        sha256=sha256,
        warnings=(),
    )


def _hash(recording: Recording) -> str:
    """Hash of the readings of a recording that was not read from a file."""
    digest = hashlib.sha256(recording.time.tobytes())
    digest.update(recording.values.tobytes())
    return digest.hexdigest()


def _runs(flags: Flags) -> list[tuple[int, int]]:
    """First index, and one past the last, of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _merge_spans(spans: Sequence[tuple[int, int]], n: int) -> list[tuple[int, int]]:
    """Clip spans to n bins, and merge those that overlap."""
    out: list[tuple[int, int]] = []
    for a, b in spans:
        a, b = max(a, 0), min(b, n)
        if out and a <= out[-1][1]:
            out[-1] = (out[-1][0], max(out[-1][1], b))
        else:
            out.append((a, b))
    return out


def _lengthen(span: tuple[int, int], least: int) -> tuple[int, int]:
    """Lengthen a span at both ends to a least length."""
    missing = max(least - (span[1] - span[0]), 0)
    return span[0] - missing // 2, span[1] + missing - missing // 2


def _ends(a: int, b: int, pieces: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index, and one past the last, of equal pieces of a span."""
    edges = np.linspace(a, b, pieces + 1).astype(np.int64)
    return edges[:-1], edges[1:]


def _widen(flags: Flags, by: int) -> Flags:
    """Return flags that are also true within ``by`` bins of a true one."""
    return np.asarray(uniform_filter1d(flags.astype(float), 2 * by + 1) > 0.0)
