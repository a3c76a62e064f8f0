"""A linear half car on tyres over a road, and the accelerometers that record it.

The car has heave and pitch of its body and the heave of two axles.  Its motion is integrated
exactly for a road that is linear between steps of 0.25 ms, by the modes of its matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from .cars import CHANNELS, Design, G, Sensors, Truth

Array = NDArray[np.float64]

STEP = 1 / 4000
LEAD = 3.0
"""Seconds that are simulated before a recording begins."""
GRID = 0.01
TERRAINS = ("bump", "rough", "ramp_potholes")


def _bump(x: Array, start: float, length: float, height: float) -> Array:
    """Return one smooth bump, or a hole if its height is negative."""
    inside = (x > start) & (x < start + length)
    return np.where(inside, height * np.sin(np.pi * (x - start) / length) ** 2, 0.0)


def _ramp(x: Array, start: float, length: float, height: float) -> Array:
    """Return a smooth ramp up to a height."""
    s = np.clip((x - start) / length, 0.0, 1.0)
    return height * (3 * s**2 - 2 * s**3)


def _random_road(x: Array, roughness: float, rng: np.random.Generator) -> Array:
    """Return a random road of waves from 0.15 to 15 m; roughness is the PSD at 0.1 cycles/m."""
    waves = np.linspace(1 / 15, 1 / 0.15, 400)
    heights = np.sqrt(2 * roughness * (waves / 0.1) ** -2 * (waves[1] - waves[0]))
    road = np.zeros_like(x)
    for wave, height, phase in zip(waves, heights, rng.uniform(0, 2 * np.pi, 400), strict=True):
        road += height * np.sin(2 * np.pi * wave * x + phase)
    return road


def draw_road(
    terrain: str, design: Design, speed: float, seconds: float, rng: np.random.Generator
) -> CubicSpline[np.float64]:
    """Draw a road profile over distance; the front axle is at 0 when the recording begins."""
    x = np.arange(-(LEAD + 1) * speed - 8.0, (seconds + 1) * speed + 8.0, GRID)
    road = _random_road(x, 16e-6 * rng.uniform(0.3, 1.0), rng)
    height = design.road_height
    end = speed * (seconds - 1.5)
    if terrain == "rough":
        road += _random_road(x, 1500e-6 * (height / 0.07) ** 2 * rng.uniform(0.4, 1.0), rng)
    elif terrain == "bump":
        kerb = rng.random() < 0.4
        at = speed * rng.uniform(0.8, 1.4)
        while at < end:
            size = height * rng.uniform(0.6, 1.0)
            length = rng.uniform(0.45, 1.3)
            if kerb:
                flat = rng.uniform(1.0, 3.0)
                road += _ramp(x, at, 0.5 * length, size)
                road -= _ramp(x, at + flat + length, 0.5 * length, size)
            else:
                road += _bump(x, at, length, size)
            at += speed * rng.uniform(1.8, 3.5) + 3.0
    else:
        at = speed * rng.uniform(0.6, 1.2)
        rise = 2.5 * height * rng.uniform(0.7, 1.0)
        road += _ramp(x, at, rng.uniform(1.2, 2.5), rise)
        road -= _ramp(x, at + rng.uniform(4.0, 8.0), rng.uniform(1.2, 2.5), rise)
        at += speed * rng.uniform(0.4, 0.8)
        while at < end:
            road += _bump(x, at, rng.uniform(0.35, 0.9), -height * rng.uniform(0.4, 0.9))
            at += speed * rng.uniform(0.5, 1.6) + 0.8
    patch = max(1, round(design.tyre_patch / GRID))
    kernel = np.convolve(np.ones(patch) / patch, np.ones(patch) / patch)
    return CubicSpline(x, np.convolve(road, kernel, mode="same"))


@dataclass(frozen=True)
class Ride:
    """True motion at steps of 0.25 ms from ``LEAD`` before the recording; upward is positive."""

    time: Array
    wheels: tuple[Array, Array]
    heave: Array
    pitch: Array
    arms: tuple[float, float]
    largest_travel: tuple[float, float]
    least_load: tuple[float, float]

    def chassis(self, position: float) -> Array:
        """Return the acceleration of the frame so far ahead of the centre of gravity."""
        return self.heave + position * self.pitch

    def scaled(self, factor: float) -> Ride:
        """Return the ride over the same road with its heights multiplied by a factor."""
        return Ride(
            self.time,
            (factor * self.wheels[0], factor * self.wheels[1]),
            factor * self.heave,
            factor * self.pitch,
            self.arms,
            (factor * self.largest_travel[0], factor * self.largest_travel[1]),
            (factor * self.least_load[0], factor * self.least_load[1]),
        )


def _integrate(A: Array, B: Array, inputs: Array) -> Array:
    """Return the states of x' = A x + B u from rest, exactly for u linear between the steps."""
    values, vectors = np.linalg.eig(A)
    drive = np.linalg.solve(vectors, B.astype(np.complex128)) @ inputs
    modes = np.empty_like(drive)
    for k, value in enumerate(values):
        s = value * STEP
        e = np.exp(s)
        later = (e - 1 - s) / s**2
        now = (e - 1) / s - later
        modes[k] = lfilter([STEP * later, STEP * now], [1.0, -e], drive[k])
    return np.real(vectors @ modes)


def ride(
    design: Design, truth: Truth, road: CubicSpline[np.float64], speed: float, seconds: float
) -> Ride:
    """Drive the car over the road at constant speed."""
    car = truth.values
    m, i, l = car["sprung_mass"], car["pitch_inertia"], car["wheelbase"]
    ahead = (1 - car["front_weight_fraction"]) * l
    arms = (ahead, ahead - l)
    k = np.array([car["front_spring_rate"], car["rear_spring_rate"]])
    c = np.array([car["front_damping"], car["rear_damping"]])
    mu, kt = np.array(design.unsprung), np.array(design.tyre_rates)
    ct = 0.02 * 2 * np.sqrt(kt * mu)
    # Extension of both suspensions from heave, pitch, front and rear axle.
    D = np.array([[1.0, arms[0], -1.0, 0.0], [1.0, arms[1], 0.0, -1.0]])
    mass = np.array([m, i, *mu])
    K, C = D.T @ (k[:, None] * D), D.T @ (c[:, None] * D)
    K[2:, 2:] += np.diag(kt)
    C[2:, 2:] += np.diag(ct)
    A = np.zeros((8, 8))
    A[:4, 4:] = np.eye(4)
    A[4:, :4], A[4:, 4:] = -K / mass[:, None], -C / mass[:, None]
    B = np.zeros((8, 4))
    B[6:, :2], B[6:, 2:] = np.diag(kt / mu), np.diag(ct / mu)
    time = np.arange(-LEAD, seconds + 0.2, STEP)
    x = np.array([speed * time, speed * time - l])
    height, slope = road(x), speed * road(x, 1)
    height = height - height[:, :1]
    inputs = np.concatenate([height, slope])
    states = _integrate(A, B, inputs)
    accelerations = A[4:] @ states + B[4:] @ inputs
    travel = D @ states[:4]
    load = kt[:, None] * (height - states[2:4]) + ct[:, None] * (slope - states[6:])
    return Ride(
        time,
        (accelerations[2], accelerations[3]),
        accelerations[0],
        accelerations[1],
        arms,
        (float(np.abs(travel[0]).max()), float(np.abs(travel[1]).max())),
        (float(load[0].min()), float(load[1].min())),
    )


def fit_to_car(motion: Ride, design: Design, truth: Truth, wanted: float) -> Ride:
    """Lower the road until the car keeps its wheels on it and its suspension off the stops."""
    car = truth.values
    share = car["front_weight_fraction"]
    static = (
        G * (car["sprung_mass"] * share + design.unsprung[0]),
        G * (car["sprung_mass"] * (1 - share) + design.unsprung[1]),
    )
    limits = [1.0]
    for axle in (0, 1):
        limits.append(0.8 * design.travel[axle] / motion.largest_travel[axle])
        limits.append(0.97 * static[axle] / max(-motion.least_load[axle], 1e-9))
        limits.append(45.0 / float(np.abs(motion.wheels[axle]).max()))
        limits.append(25.0 / float(np.abs(motion.chassis(motion.arms[axle])).max()))
    return motion.scaled(wanted * min(limits))


@dataclass
class Faults:
    """What is wrong with the sensors or the logger; all empty means nothing."""

    gain: dict[str, float] = field(default_factory=dict)
    late: dict[str, float] = field(default_factory=dict)
    """Seconds by which the signal of a channel appears too late."""
    low_pass: dict[str, float] = field(default_factory=dict)
    tilt: dict[str, float] = field(default_factory=dict)
    dead: dict[str, str] = field(default_factory=dict)
    inboard: dict[str, float] = field(default_factory=dict)
    """Metres between a chassis sensor and its axle, towards the middle of the car."""
    columns: dict[str, str] = field(default_factory=dict)
    """The sensor whose signal stands in the column of a channel."""
    time_factor: float = 1.0
    """Stated time over true time."""
    time_in_ms: bool = False


def _one_pole(signal: Array, corner: float) -> Array:
    """Filter by a pole, exactly for a signal linear between the steps."""
    s = -2 * np.pi * corner * STEP
    e = np.exp(s)
    later = -((e - 1 - s) / s)
    now = (1 - e) - later
    return cast(Array, lfilter([later, now], [1.0, -e], signal))


def _reading(
    channel: str, motion: Ride, sensors: Sensors, faults: Faults, rng: np.random.Generator
) -> CubicSpline[np.float64]:
    """Return the signal of one sensor over time, before it is sampled."""
    axle = 0 if channel.startswith("front") else 1
    which = 0 if channel.endswith("wheel") else 1
    if which == 0:
        signal = motion.wheels[axle]
    else:
        inward = faults.inboard.get(channel, 0.0) * (-1 if axle == 0 else 1)
        signal = motion.chassis(motion.arms[axle] + inward)
    if channel in faults.tilt:
        angle = np.radians(faults.tilt[channel])
        along = _one_pole(rng.normal(size=signal.size), 2.0)
        along *= 0.4 / along.std()
        signal = np.cos(angle) * signal + np.sin(angle) * along
    if channel in faults.dead:
        signal = 0 * signal
    noise = rng.normal(size=signal.size)
    if sensors.bandwidth is not None:
        corner = sensors.bandwidth[which]
        signal, noise = _one_pole(signal, corner), _one_pole(noise, corner)
        noise *= sensors.noise[which] * np.exp(0.08 * rng.normal()) / noise.std()
        signal = signal + noise
    if channel in faults.low_pass:
        signal = _one_pole(signal, faults.low_pass[channel])
    return CubicSpline(motion.time, signal)


def record(
    motion: Ride,
    sensors: Sensors,
    rate: float,
    seconds: float,
    faults: Faults,
    rng: np.random.Generator,
) -> tuple[Array, dict[str, Array]]:
    """Return stated times and the columns of a recording, in m/s²."""
    time = np.arange(round(rate * seconds)) / rate
    readings: dict[str, Array] = {}
    for channel in CHANNELS:
        which = 0 if channel.endswith("wheel") else 1
        delay = sensors.chassis_delay if which == 1 else 0.0
        delay -= faults.late.get(channel, 0.0)
        signal = _reading(channel, motion, sensors, faults, rng)(time + delay)
        if sensors.bandwidth is None:
            level = sensors.noise[which] * np.exp(0.08 * rng.normal())
            signal = signal + level * rng.normal(size=time.size)
        signal = signal + rng.normal() * (0.08, 0.05)[which]
        if faults.dead.get(channel) == "constant":
            signal = np.full_like(signal, signal[0])
        step, limit = sensors.resolution[which], sensors.limits[which]
        signal = np.clip(np.round(signal / step) * step, -limit, limit)
        readings[channel] = faults.gain.get(channel, 1.0) * signal
    columns = {channel: readings[faults.columns.get(channel, channel)] for channel in CHANNELS}
    return time * faults.time_factor, columns


def csv_text(
    time: Array, columns: Mapping[str, Array], unit: str, scale: float, in_ms: bool
) -> str:
    """Write a recording; ``scale`` is the unit in m/s²."""
    decimals = {"g": 5, "m/s^2": 4, "in/s^2": 3}[unit]
    header = ",".join(["time [s]", *(f"{channel} [{unit}]" for channel in CHANNELS)])
    row = "%.3f" if in_ms else "%.6f"
    row += f",%.{decimals}f" * len(CHANNELS)
    stamps = 1000 * time if in_ms else time
    table = np.column_stack([stamps, *(columns[channel] / scale for channel in CHANNELS)])
    return "\n".join([header, *(row % tuple(line) for line in table.tolist())]) + "\n"
