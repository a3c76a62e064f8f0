"""Selection of the informative stretches of long logs.

An hour of driving has some forty bumps in it.  Standing, cruising, braking and cornering hardly
move a damper; where the wheels leave the ground or a sensor reaches its rail, no linear car holds.

**Information.**  For outputs y with noise of density S, the Fisher information about the logarithms
of the unknowns t is J = ∫ (∂y/∂t)ᵀ S⁻¹ (∂y/∂t) dt.  The derivatives come from the nominal car,
driven by the wheels over the whole log in bins, at least 24 a period of its fastest mode.  Braking
and cornering push the body and not the wheels, so they have no part in J.

**Events.**  An event is a stretch in which the information per second, averaged over one period of
the slowest nominal mode, is at least 1 % of the most that the log has: of anything less, a hundred
times as much would be needed for the same answer.  It must also be 25 times what the noise of the
wheel sensors alone would feign, five times in amplitude, as :mod:`.data_checks` asks of a whole
recording.  An event begins one period of the slowest mode earlier, so that the filter starts from a
car at rest or nearly so, and ends when the slowest decay has brought the oscillation down to the
noise.  What lasts longer than ten periods is a rough stretch and is divided.

**Choice.**  Events are taken one by one, always the one whose information adds most a row to the
log determinant of the posterior precision, until the next would shrink no interval by 2 %, but no
fewer than six, whose scatter says how much the car changes from one to the next (the standard
deviation of six is known to 1/√10), and no more than fit into :data:`MOST_ROWS`.
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
"""Rows of which an estimate takes about a minute: some 4 ms a row on one core, for the fits of
every event, the draws and the checks, and as much memory as a hundred thousand numbers a row.
A recording with more of them is searched for events, and no more are taken from it."""

IN_THE_AIR = "the wheels left the ground"
AT_RAIL = "readings were at a rail"
"""Reason for which an event is left out unless there is no other."""
LOST = "rows were missing"
PUSHED = "braking or cornering moved the body"
NO_TIME = "there was no time for more"

_FEWEST = 6
_SHRINK = 0.02
NOT_NEEDED = f"it would shrink no interval by {100.0 * _SHRINK:g} %"
_WORTH = 0.01  # of the most information a second
_BINS = 2.0  # times the least rate of the data checks
PART_PERIODS = 10.0  # periods of the slowest mode, as the parts of a recording in a band
FEWEST_PARTS = 5  # of that length, which a recording in a band needs
_FALL = 0.15  # of gravity: scale errors and a car that is not level
_STEP = 0.01  # of a logarithm, for central differences
_FORGETS = 0.005  # of the fastest motion
_MOST_DELAY = 1.0  # s that the metadata of a recording may declare
_POINTS = 600  # of the timeline


@dataclass(frozen=True, repr=False)
class Event:
    """A stretch of a log that moves the suspension.

    Parameters
    ----------
    kind : {'bump', 'rough stretch'}
        A rough stretch is a piece of something longer.
    recording : Recording
        Its rows, with the stamps of the log and a source such as ``run.csv, 312.4 – 318.1 s``.
    information : (nT, nT) array
        About the unknowns of the car, in units of their prior standard deviations.
    reason : str
        Why it was left out; empty where it was used or may be.
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
    """What was found in one log.

    Parameters
    ----------
    recording : Recording
        The log.
    events : tuple of Event
        In order of time.
    estimands : (na, nT) array
        Derivatives of the logarithms of what is asked for by the unknowns.
    states : dict of str to float
        Seconds of what is no event: ``standing``, and ``little motion`` of the wheels, as in
        cruising, braking and cornering.
    time, level : (P,) arrays
        Information per second over time (s, as in the log), relative to the most there is.
    """

    recording: Recording
    events: tuple[Event, ...]
    estimands: Array
    states: dict[str, float]
    time: Array
    level: Array


class _Binned(NamedTuple):
    """A log in bins: n of them, nu inputs and ny outputs, SI units, medians taken off."""

    start: float
    step: float
    rows: float  # in a bin
    inputs: Array  # (n, nu)
    outputs: Array  # (n, ny)
    input_sd: Array  # (nu,) noise of the mean of a bin
    output_sd: Array  # (ny,)
    accelerations: tuple[tuple[int, int], ...]  # output beside the input below it
    edges: NDArray[np.int64]  # (n + 1,) first row of each bin, and the one after the last
    gap: Flags  # (n,) no reading of some channel
    rail: Flags  # (n,) a reading at a rail


class _Sensitivity(NamedTuple):
    """Derivatives of the outputs by the unknowns of a car, P of them, in their prior deviations."""

    slopes: Array  # (P, n, ny)
    output: Array  # (n, ny) of the nominal car


def is_long(recording: Recording, below: float | None = None) -> bool:
    """Whether a recording has more rows than are worth taking whole; see :data:`MOST_ROWS`."""
    return len(recording.time) * _cost(recording, below) > MOST_ROWS


def _cost(recording: Recording, below: float | None) -> float:
    """Return the steps of the filter for one row: in a band 16 a period of its edge."""
    return 1.0 if below is None else min(1.0, STEPS_IN_PERIOD * below / nominal_rate(recording))


def find_events(
    recording: Recording, vehicle: Vehicle, car: CarModel, below: float | None = None
) -> LogEvents:
    """Find the stretches of a log that carry information about a car.

    Parameters
    ----------
    recording : Recording
        Of any length.
    vehicle : Vehicle
        Gives calibration, ranges, noise and delays.
    car : CarModel
        Its nominal modes say how long an event lasts.
    below : float, optional
        Upper edge of the band that will be used, Hz: events are longer by what its filter needs.

    Returns
    -------
    LogEvents
        None of the events is chosen yet; those with a reason cannot be.

    Raises
    ------
    InputError
        When a channel that the car needs is missing, or cannot be calibrated.
    """
    modes = nominal_modes(car)
    period = 1.0 / modes[0].natural
    channels = [
        vehicle.channel(recording.channels[c]) for c in used_channels(recording, vehicle, car)
    ]
    ys = tuple(Output(one) for one in channels if not one.is_input)
    log = _binned(recording, vehicle, car, _BINS * min_sampling_rate(modes))
    unknowns = _unknowns(car)
    answers = np.array([unknowns[name] for name in car.estimated])
    found = _sensitivity(car, ys, unknowns, log.inputs, log.step)
    # What the noise of the wheel sensors makes of it, from the responses to single bins.
    pulses = [_pulse(car, u, log.step, period) for u in range(log.inputs.shape[1])]
    responses = [_sensitivity(car, ys, unknowns, pulse, log.step) for pulse in pulses]
    band = max(int(len(pulses[0]) * log.step * modes[-1].natural), 1)
    noise = (
        log.output_sd** 2
        + sum(  # where the car's own motion is
            sd**2 * np.mean(np.abs(np.fft.rfft(one.output, axis=0)[:band]) ** 2, axis=0)
            for sd, one in zip(log.input_sd, responses, strict=True)
        )
    )
    asked = np.linalg.pinv(answers)  # (P, na): unknowns per logarithm of what is asked for

    def density(slopes: Array) -> Array:
        by_answer = np.tensordot(asked.T, slopes, 1)
        return np.asarray(np.sum(by_answer**2 / noise, axis=(0, 2)) / log.step)

    feigned = sum(
        sd**2 * float(np.sum(density(one.slopes)))
        for sd, one in zip(log.input_sd, responses, strict=True)
    )
    whole = density(found.slopes)
    window = max(round(period / log.step), 1)
    level = uniform_filter1d(whole, window)
    fall = _falls(log, modes[0].natural)
    lost = _widened(fall | log.gap, 2 * window)
    railed = _widened(log.rail, 2 * window)
    most = float(np.max(level[~lost & ~railed], initial=0.0))
    bounded = float(np.max(level[~lost & railed], initial=0.0))
    if most < _WORTH * bounded:  # all that moves the car reaches a rail
        most = bounded
    worth = max(_WORTH * most, MIN_EXCITATION**2 * feigned)
    decay = 1.0 / min(2.0 * math.pi * mode.natural * mode.ratio for mode in modes)
    settling = decay * math.log(max(math.sqrt(worth / max(feigned, 1e-300)), 1.0))
    tail = max(math.ceil(settling / log.step), window)
    # What else moves the body is slow: of a bump, the wheels explain all below the slowest mode.
    left = uniform_filter1d(log.outputs - found.output, 2 * window, axis=0)
    left -= uniform_filter1d(left, 200 * window, axis=0)
    size = PART_PERIODS * period
    extra = 0.0
    if below is not None:  # the filter of a band needs two periods of its edge at either end
        extra, size = 2.0 / below, FEWEST_PARTS * size + 4.0 / below
    cores = _runs(level >= worth) if worth > 0.0 else []
    around = round(extra / log.step)
    spans = _merged([(a - window - around, b + tail + around) for a, b in cores], len(level))
    if below is not None:
        spans = _merged([_lengthened(span, round(size / log.step)) for span in spans], len(level))
    sha256 = recording.sha256 or _hash(recording)
    events = []
    for a, b in spans:
        pieces = max(math.ceil((b - a) * log.step / size - 0.1), 1)
        for first, last in zip(*_ends(a, b, pieces), strict=True):
            inside = slice(first, last)
            slopes = found.slopes[:, inside] / np.sqrt(noise)
            flat = slopes.reshape(len(slopes), -1)
            reason = ""
            if log.gap[inside].any():
                reason = LOST
            elif fall[inside].any():
                reason = IN_THE_AIR
            elif log.rail[inside].any():
                reason = AT_RAIL
            elif _pushed(left[inside], log.outputs[inside]):
                reason = PUSHED
            piece = _cut(recording, vehicle, slice(*log.edges[[first, last]]), sha256)
            if piece is not None:
                kind = "bump" if pieces == 1 else "rough stretch"
                events.append(Event(kind, piece, flat @ flat.T, reason))
    points = np.linspace(0, len(level), min(_POINTS, len(level)) + 1).astype(int)
    return LogEvents(
        recording=recording,
        events=_with_bounds(events, vehicle),
        estimands=answers,
        states=_states(log, spans, window),
        time=log.start + log.step * points[:-1],
        level=np.maximum.reduceat(level, points[:-1]) / (most or 1.0),
    )


def choose_events(
    logs: Sequence[LogEvents], rows: float = 0.0, below: float | None = None
) -> tuple[LogEvents, ...]:
    """Choose the events of one or several logs of a car that are worth their time.

    Parameters
    ----------
    logs : sequence of LogEvents
        From :func:`find_events`.
    rows : float
        Rows of recordings that are taken whole beside them.
    below : float, optional
        As there.

    Returns
    -------
    tuple of LogEvents
        The same, with every event either used or with the reason why it was left out.
    """
    events = [event for log in logs for event in log.events]
    cost = [
        _cost(log.recording, below) * len(event.recording.time)
        for log in logs
        for event in log.events
    ]
    left = [k for k, event in enumerate(events) if not event.reason]
    reasons = {k: event.reason for k, event in enumerate(events)}
    used: list[int] = []
    if left:
        answers = logs[0].estimands
        precision = np.eye(answers.shape[1])
        while left:
            before = _variances(precision[None], answers)[0]
            information = np.stack([events[k].information for k in left])
            after = _variances(precision + information, answers)
            shrunk = 1.0 - np.sqrt(after / before)
            if len(used) >= _FEWEST and shrunk.max() < _SHRINK:
                reasons |= dict.fromkeys(left, NOT_NEEDED)
                break
            gain = np.linalg.slogdet(precision + information)[1] - np.linalg.slogdet(precision)[1]
            gain /= np.array([cost[k] for k in left])
            best = left.pop(int(np.argmax(gain)))
            if rows + cost[best] > MOST_ROWS and used:
                reasons[best] = NO_TIME
                continue
            used.append(best)
            rows += cost[best]
            precision = precision + events[best].information
    decided = iter(
        replace(event, reason=reasons[k], used=k in used) for k, event in enumerate(events)
    )
    return tuple(replace(log, events=tuple(next(decided) for _ in log.events)) for log in logs)


def _variances(precision: Array, answers: Array) -> Array:
    """Variances (K, na) of the logarithms of what is asked for, of K precisions (K, P, P)."""
    covariance = np.linalg.inv(precision)
    return np.asarray(np.einsum("ap,kpq,aq->ka", answers, covariance, answers))


def _binned(recording: Recording, vehicle: Vehicle, car: CarModel, rate: float) -> _Binned:
    """Average the readings of every channel over bins of one grid in true time."""
    channels, values, times = used_readings(recording, vehicle, car)
    low, high = rails(values, vehicle, channels)
    start, own = float(times[:, 0].max()), nominal_rate(recording)
    rows = max(math.floor(own / rate), 1)
    step = rows / own
    n = max(int((float(times[:, -1].min()) - start) / step), 1)
    means = np.empty((n, len(channels)))
    gap, rail = np.zeros(n, bool), np.zeros(n, bool)
    sd = np.empty(len(channels))
    longest = LONGEST_GAP / nominal_modes(car)[-1].natural
    for c, channel in enumerate(channels):
        sensor = vehicle.sensor(channel.name)
        at = np.floor((times[c] - start) / step).astype(np.int64)
        there = np.isfinite(values[c]) & (at >= 0) & (at < n)
        count = np.bincount(at[there], minlength=n)
        total = np.bincount(at[there], values[c, there], n)
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
        rail |= np.bincount(at[there & bound], minlength=n) > 0
        quantum = sensor.resolution or 0.0
        noise = quiet_level(values[c], quantum) if sensor.noise is None else sensor.noise
        # Noise that passed the sensor's filter repeats itself: its mean is worse by as much.
        keep = (
            0.0 if sensor.bandwidth is None else math.exp(-2.0 * math.pi * sensor.bandwidth / own)
        )
        variance = noise**2 * (1.0 + keep) / (1.0 - keep) + quantum**2 / 12.0
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
    """Return the derivatives (P,) of every parameter's logarithm by the unknowns, in prior sds."""
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
    """Simulate the nominal car and its neighbours, driven by lines between bins (n, nu)."""
    count = len(next(iter(unknowns.values())))
    n = len(inputs)
    order = np.arange(ORDER)
    factorial = np.array([math.factorial(j + 1) for j in order])
    rise = np.diff(inputs, axis=0)
    moments = np.zeros((n, inputs.shape[1], ORDER))
    moments[1:] = (
        inputs[:-1, :, None] + rise[:, :, None] / (order + 2)
    ) * step ** (order + 1) / factorial  # fmt: skip
    steps = np.full(n, step)
    steps[0] = 0.0
    nothing = np.zeros((n, 0))
    # An unknown moves the parameter that it moves most by one percent.
    away = _STEP / np.max(np.abs(np.stack(list(unknowns.values()))), axis=0)
    sets = np.concatenate([np.zeros((1, count)), np.diag(away), -np.diag(away)])
    data = Measurements(
        steps, moments, nothing, np.zeros((n, 0), np.int8), nothing, nothing, np.zeros((0, 0))
    )

    values = {p.name: p.nominal * np.exp(sets @ unknowns[p.name]) for p in car.parameters}
    system = state_space(car, values, ys)
    nx = system.A.shape[1]
    # Wheels that no rigid body follows drift without end; forgetting them is no loss here.
    fade = np.abs(np.linalg.eigvals(system.A)).max(axis=1) * _FORGETS
    system = system._replace(A=system.A - fade[:, None, None] * np.eye(nx))
    found, _ = free_response(system, data, np.zeros((len(sets), nx + len(ys))))
    slopes = (found[1 : 1 + count] - found[1 + count :]) / (2.0 * away)[:, None, None]
    return _Sensitivity(slopes, found[0])


def _pulse(car: CarModel, u: int, step: float, period: float) -> Array:
    """One at one bin of an input, and time to settle (n, nu)."""
    inputs = np.zeros((math.ceil(PART_PERIODS * period / step), len(car.elements)))
    inputs[1, u] = 1.0
    return inputs


def _falls(log: _Binned, slowest: float) -> Flags:
    """Find bins in which a wheel and the body above it fall freely.

    Both read −g to within 15 %.  An oscillation of the slowest mode, of the amplitude that stays
    there longest, does so for acos(0.85/1.15)/(π f): what lasts longer is no oscillation.
    """
    falling = np.zeros(len(log.inputs), bool)
    shortest = math.acos((1.0 - _FALL) / (1.0 + _FALL)) / (math.pi * slowest)
    for y, e in log.accelerations:
        near = np.abs(np.stack([log.outputs[:, y], log.inputs[:, e]]) + STANDARD_GRAVITY)
        for a, b in _runs(np.all(near < _FALL * STANDARD_GRAVITY, axis=0)):
            falling[a:b] |= (b - a) * log.step > shortest
    return falling


def _pushed(left: Array, outputs: Array) -> bool:
    """Whether slow motion of the body that the wheels do not explain is a share of its motion."""
    return bool(np.any(left.std(axis=0) > MAX_UNEXPLAINED * outputs.std(axis=0)))


def _states(log: _Binned, spans: Sequence[tuple[int, int]], window: int) -> dict[str, float]:
    """Seconds of what is no event."""
    free = np.ones(len(log.gap), bool)
    for a, b in spans:
        free[a:b] = False
    power = uniform_filter1d(log.inputs**2, window, axis=0)
    still = np.all(power < (MIN_EXCITATION * log.input_sd) ** 2, axis=1)
    named = {"standing": free & still, "little motion": free & ~still}
    return {name: float(np.count_nonzero(bins) * log.step) for name, bins in named.items()}


def _stuck(values: Array) -> Flags:
    """Find readings that repeat the extreme of their channel three times or more in a row."""
    out = np.zeros(len(values), bool)
    for extreme in (np.nanmax(values), np.nanmin(values)):
        for a, b in _runs(values == extreme):
            out[a:b] |= b - a >= 3
    return out


def _with_bounds(events: Sequence[Event], vehicle: Vehicle) -> tuple[Event, ...]:
    """Allow a few readings at a rail, which a filter takes as bounds, where there is no choice."""
    if not any(event.reason == AT_RAIL for event in events) or not all(e.reason for e in events):
        return tuple(events)
    out = []
    for event in events:
        channels = [vehicle.channel(name) for name in event.recording.channels]
        low, high = rails(accelerations(event.recording, vehicle), vehicle, channels)
        few = (low | high).sum(axis=1).max() <= clipping_limit(len(event.recording.time))
        out.append(replace(event, reason="") if event.reason == AT_RAIL and few else event)
    return tuple(out)


def _cut(recording: Recording, vehicle: Vehicle, rows: slice, sha256: str) -> Recording | None:
    """Return some rows; None where there are none, or clocks have drifted too far for a piece.

    The clocks of a log run from its first stamp: a piece begins with what they have gained by
    then, as a delay of its channels.
    """
    time = recording.time[rows]
    if len(time) < 2:
        return None
    declared = timing(recording)
    delays = []
    for name, clock, own in zip(recording.channels, declared.clock, declared.delay, strict=True):
        if clock != 0.0:
            gained = (time[0] - recording.time[0]) * (1.0 / (1.0 + clock) - 1.0)
            delay = gained + (vehicle.sensor(name).delay if own is None else own)
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
    """First and one past the last of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _merged(spans: Sequence[tuple[int, int]], n: int) -> list[tuple[int, int]]:
    """Spans within n bins, those that overlap made one."""
    out: list[tuple[int, int]] = []
    for a, b in spans:
        a, b = max(a, 0), min(b, n)
        if out and a <= out[-1][1]:
            out[-1] = (out[-1][0], max(out[-1][1], b))
        else:
            out.append((a, b))
    return out


def _lengthened(span: tuple[int, int], least: int) -> tuple[int, int]:
    """Lengthen a span at both ends to a least length."""
    more = max(least - (span[1] - span[0]), 0)
    return span[0] - more // 2, span[1] + more - more // 2


def _ends(a: int, b: int, pieces: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and one past the last of equal pieces of a span."""
    edges = np.linspace(a, b, pieces + 1).astype(np.int64)
    return edges[:-1], edges[1:]


def _widened(flags: Flags, by: int) -> Flags:
    """Return flags, and those as near as ``by`` bins."""
    return np.asarray(uniform_filter1d(flags.astype(float), 2 * by + 1) > 0.0)
