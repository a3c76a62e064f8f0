"""Accelerometers, their filters, the converter and the logger.

The chain is: motion of the mount, filter, sampling at the row's time plus the delay, noise, zero
offset, steps of the converter, and what the logger does to rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .cars import GRAVITY, Car, geometry
from .kinds import CHANNELS, Vector, Whole
from .signals import filtered, interpolated
from .simulate import History

__all__ = [
    "KITS",
    "Kit",
    "Motion",
    "Sensing",
    "Sensor",
    "kit_sensors",
    "motions",
    "noisy_rows",
    "pure_rows",
]


@dataclass(frozen=True)
class Sensor:
    """What is declared of a channel: ``noise`` rms, ``step`` of the converter and ``limit``, m/s².

    ``corner`` of the one-pole filter, Hz, or none; ``delay`` after the row's time, s.
    """

    noise: float
    step: float
    limit: float
    corner: float | None
    delay: float

    @property
    def poles(self) -> tuple[complex, ...]:
        """Pole of the declared filter, rad/s."""
        return () if self.corner is None else (complex(-2.0 * np.pi * self.corner),)


@dataclass(frozen=True)
class Kit:
    """Four sensors with a logger: rates, bits, ranges of noise (wheel, chassis; m/s²), corners.

    ``corner`` (Hz) of wheels and chassis, or none; ``spacing`` between the conversions of
    neighbouring channels, s.
    """

    name: str
    rates: tuple[int, ...]
    bits: int
    noise: tuple[tuple[float, float], tuple[float, float]]
    corner: tuple[float, float] | None
    spacing: float


KITS = (
    Kit("industrial", (400, 500), 15, ((0.06, 0.18), (0.03, 0.08)), (120.0, 80.0), 0.00005),
    Kit("bus sensors", (250, 320), 14, ((0.07, 0.16), (0.02, 0.06)), (90.0, 55.0), 0.00025),
    Kit("race logger", (500,), 16, ((0.10, 0.28), (0.04, 0.10)), (100.0, 100.0), 0.0),
    Kit("school logger", (200,), 12, ((0.05, 0.11), (0.02, 0.05)), (45.0, 45.0), 0.0004),
    Kit("digital chips", (200, 400), 14, ((0.08, 0.20), (0.03, 0.07)), None, 0.0),
    Kit("hobby board", (250, 300), 13, ((0.05, 0.14), (0.025, 0.06)), None, 0.00015),
    Kit("instrument amplifier", (300,), 16, ((0.03, 0.09), (0.015, 0.04)), (70.0, 50.0), 0.0001),
)


def kit_sensors(
    kit: Kit, peaks: Mapping[str, float], rng: np.random.Generator, bits: int | None = None
) -> dict[str, Sensor]:
    """Sensors of a kit whose ranges hold the peaks (m/s², by channel) with a margin."""
    sensors = {}
    for number, channel in enumerate(CHANNELS):
        chassis = int(channel.endswith("chassis"))
        need = 1.5 * peaks[channel] / GRAVITY + 0.1
        ranges = (2.0, 3.0, 5.0, 10.0) if chassis else (5.0, 10.0, 18.0, 24.0)
        limit = next((x for x in ranges if x >= need), 50.0) * GRAVITY
        low, high = kit.noise[chassis]
        noise = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        corner = None if kit.corner is None else kit.corner[chassis]
        step = 2.0 * limit / 2 ** (bits or kit.bits)
        sensors[channel] = Sensor(noise, step, limit, corner, number * kit.spacing)
    return sensors


@dataclass(frozen=True)
class Motion:
    """What the mounts of the sensors do in one run, on the grid of the simulation.

    ``acceleration`` by channel, m/s².
    """

    begin: float
    step: float
    acceleration: dict[str, Vector]

    @property
    def times(self) -> Vector:
        """Times of the grid, s."""
        return self.begin + self.step * np.arange(len(self.acceleration[CHANNELS[0]]))

    def reading(self, channel: str, felt: Vector) -> Motion:
        """Return the same motion with what the sensor of one channel feels instead, m/s²."""
        return replace(self, acceleration={**self.acceleration, channel: felt})


def motions(car: Car, history: History, extra: Vector | None = None) -> list[Motion]:
    """Motion of the mounts for each column; ``extra`` (steps, 2, B) is added to the chassis."""
    body = np.einsum("rs,nsb->nrb", geometry(car), history.flow[:, 4:6])
    if extra is not None:
        body = body + extra
    step = float(history.times[1] - history.times[0])
    found = []
    for column in range(history.state.shape[2]):
        acceleration = {
            "front_wheel": history.flow[:, 6, column],
            "front_chassis": body[:, 0, column],
            "rear_wheel": history.flow[:, 7, column],
            "rear_chassis": body[:, 1, column],
        }
        found.append(Motion(float(history.times[0]), step, acceleration))
    return found


Rows = Callable[[Vector, Vector, int], Vector]
"""From rows (N, 4), their times (N,) and the number of the run to what the logger writes."""

Mount = Callable[[Motion, int], Motion]
Late = Callable[[Vector, int], Vector]
"""From times of rows, s, and the number of the run to a further delay or an offset."""


@dataclass(frozen=True)
class Sensing:
    """What is wrong with mounts, sensors and logger. The default is nothing.

    ``mount`` changes the motion before the filter; ``poles`` replace the declared ones (rad/s);
    ``beside`` mixes in the outputs of further filters by shares that may change in time; ``late``
    adds to the delay (s) and ``shift`` to the readings (m/s²), by channel; ``spread`` samples a
    channel as the mean over delays (s) with weights; ``rows`` changes the rows.
    """

    mount: Mount | None = None
    poles: dict[str, tuple[complex, ...]] = field(default_factory=dict)
    beside: dict[str, tuple[tuple[complex, ...], Late]] = field(default_factory=dict)
    late: dict[str, Late] = field(default_factory=dict)
    shift: dict[str, Late] = field(default_factory=dict)
    spread: dict[str, tuple[Vector, Vector]] = field(default_factory=dict)
    rows: Rows | None = None

    def without_rows(self) -> Sensing:
        """Return the same without what the logger does to rows."""
        return replace(self, rows=None)


def pure_rows(
    motion: Motion,
    times: Vector,
    run: int,
    sensors: Mapping[str, Sensor],
    faults: Sequence[Sensing] = (),
) -> Vector:
    """Rows (N, 4) without noise, offset or steps, but with faults, at the times of rows, s."""
    for fault in faults:
        if fault.mount is not None:
            motion = fault.mount(motion, run)
    rows: Vector = np.zeros((len(times), 4))
    for column, channel in enumerate(CHANNELS):
        sensor = sensors[channel]
        at = times + sensor.delay
        poles, delays, weights = _path(channel, sensor, faults)
        for fault in faults:
            if channel in fault.late:
                at = at + fault.late[channel](times, run)
        branches: list[tuple[tuple[complex, ...], Vector]] = [(poles, np.ones(len(times)))]
        for fault in faults:
            if channel in fault.beside:
                other, share_of = fault.beside[channel]
                share = share_of(times, run)
                branches = [(poles, 1.0 - share), (other, share)]
        for branch, share in branches:
            signal = filtered(motion.acceleration[channel], motion.step, branch)
            for delay, weight in zip(delays, weights, strict=True):
                read = interpolated(signal, motion.begin, motion.step, at - delay)
                rows[:, column] += share * weight * read
        for fault in faults:
            if channel in fault.shift:
                rows[:, column] += fault.shift[channel](times, run)
    for fault in faults:
        if fault.rows is not None:
            rows = fault.rows(rows, times, run)
    return rows


def _path(
    channel: str, sensor: Sensor, faults: Sequence[Sensing]
) -> tuple[tuple[complex, ...], Vector, Vector]:
    """Poles (rad/s) that a channel really has, and delays (s) and weights of its sampling."""
    poles = sensor.poles
    delays: Vector = np.zeros(1)
    weights: Vector = np.ones(1)
    for fault in faults:
        poles = fault.poles.get(channel, poles)
        delays, weights = fault.spread.get(channel, (delays, weights))
    return poles, delays, weights


def _noise(
    sensor: Sensor,
    path: tuple[tuple[complex, ...], Vector, Vector],
    count: int,
    step: float,
    rng: np.random.Generator,
) -> Vector:
    """Noise of unit rms that was white before the filter, at rows ``step`` (s) apart."""
    poles, delays, weights = path
    if poles == sensor.poles and len(delays) == 1:
        noise: Vector = rng.standard_normal(count)
        if sensor.corner is not None:
            keep = float(np.exp(-2.0 * np.pi * sensor.corner * step))
            new = float(np.sqrt(1.0 - keep**2))
            for n in range(1, count):
                noise[n] = keep * noise[n - 1] + new * noise[n]
        return noise
    fold, lead = 16, 40
    fine = step / fold
    hit: Vector = np.zeros(fold * (2 * lead + 1))
    hit[fold * lead] = 1.0
    white: Vector = rng.standard_normal(fold * (count + 2 * lead))
    found = []
    for source in (hit, white):
        signal = filtered(source, fine, poles)
        times = np.arange(len(source) - fold * lead if source is white else len(source)) * fine
        times = times + (lead * step if source is white else 0.0)
        mixed = sum(
            float(w) * interpolated(signal, 0.0, fine, times - float(d))
            for d, w in zip(delays, weights, strict=True)
        )
        found.append(np.asarray(mixed))
    rms = float(np.sqrt(np.sum(found[0] ** 2)))
    return np.asarray(found[1][::fold][:count] / rms)


def noisy_rows(
    rows: Vector,
    times: Vector,
    run: int,
    sensors: Mapping[str, Sensor],
    rng: np.random.Generator,
    factor: float = 1.0,
    faults: Sequence[Sensing] = (),
) -> Vector:
    """Add noise that has passed the filter, a zero offset and the steps of the converter.

    ``rows`` (N, 4) come from :func:`pure_rows` with faults that leave rows as they are; what the
    logger does to rows is done at the end.
    """
    step = float(times[1] - times[0])
    out: Vector = np.array(rows)
    for column, channel in enumerate(CHANNELS):
        sensor = sensors[channel]
        noise = _noise(sensor, _path(channel, sensor, faults), len(times), step, rng)
        zero = float(rng.uniform(-0.35, 0.35))
        reading = out[:, column] + factor * sensor.noise * noise + zero
        steps: Whole = np.asarray(np.rint(reading / sensor.step), np.int64)
        out[:, column] = np.clip(steps * sensor.step, -sensor.limit, sensor.limit)
    for fault in faults:
        if fault.rows is not None:
            out = np.asarray(fault.rows(out, times, run))
    return out
