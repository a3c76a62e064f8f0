"""Pictures of the gallery: the law of an effect, and what it does to a drive that shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from drawings import INK, WHEEL, drawing
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.signal import lfilter

import bayes_asv as asv
from bayes_asv.models.effects import EFFECTS
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate

__all__ = ["EXAMPLES", "effect"]

Array = NDArray[np.float64]

_SECONDS = 2.5
_STEP = 1e-3  # s


class Example(NamedTuple):
    """A drive, and an effect of a size that shows in a picture.

    Parameters
    ----------
    road : str
        Name of the road.
    speed : float
        m/s.
    values : mapping
        Parameters of the effect, SI units.
    over : {'rate', 'deflection', 'time', ''}
        What its force is drawn over; empty for an effect that is no force.
    """

    road: str
    speed: float
    values: Mapping[str, float]
    over: str = ""


# digressive: the slope falls by a factor of five from rest to 0.8 m/s
_STEPS = {p.name: -0.125 for p in EFFECTS["damper_curve"].parameters}
_SPRING = {  # a second spring of the same stiffness from 16 mm of compression on
    **{f"{side}_{k}": 0.0 for side in ("compression", "extension") for k in range(1, 11)},
    "compression_5": 0.7,
}
_STOP = {"rate": 1.2e5, "gap": 0.03, "onset": 0.004, "power": 1.0}
EXAMPLES = {
    "bound_rebound": Example("bump", 4.0, {"ratio": 2.5, "rounding": 0.015}, "rate"),
    "digressive_damper": Example("bump", 5.0, {"knee": 0.25, "drop": 10.0}, "rate"),
    "damper_curve": Example("bump", 4.0, _STEPS, "rate"),
    "damper_hysteresis": Example("stops", 3.0, {"stiffness": 6e4}, "rate"),
    "coulomb_friction": Example("rough", 3.0, {"force": 150.0, "slip": 0.005}, "rate"),
    "progressive_spring": Example("bump", 4.0, {"kappa": 120.0, "curl": 0.3}, "deflection"),
    "spring_curve": Example("stops", 3.0, _SPRING, "deflection"),
    "bump_stop": Example("stops", 3.0, _STOP, "deflection"),
    "droop_stop": Example("stops", 3.0, _STOP, "deflection"),
    "damper_fade": Example("rollers", 5.0, {"loss": 0.6, "bend": 0.0}, "time"),
    "external_force": Example(
        "bump", 4.0, {"force": 300.0, "start": 1.5, "duration": 0.4, "rise": 0.05}, "time"
    ),
    "spring_rate": Example("bump", 3.0, {"factor": 1.3}, "deflection"),
    "weight_distribution": Example("bump", 3.0, {"factor": 1.15}),
    "sensor_gain": Example("bump", 4.0, {"factor": 1.15}),
    "sensor_lag": Example("stops", 3.0, {"lag": 0.012}),
    "clock_offset": Example("stops", 3.0, {"offset": 0.012}),
    "sensor_bandwidth": Example("stops", 3.0, {"bandwidth": 0.15}),
    "sensor_drift": Example("bump", 4.0, {"slope": 2.0}),
}


@cache
def _car() -> asv.Vehicle:
    """Return the 2008 Baja car with ideal sensors."""
    return replace(asv.read_vehicle(asv.example("baja2008.toml")), sensors={})


@cache
def _hubs(name: str, speed: float) -> Array:
    """Hub accelerations (N, 2) every half step, m/s²."""
    course = road(name, np.random.default_rng(1), speed)
    drive = simulate(_car(), course, seconds=_SECONDS, channels=("front_wheel", "rear_wheel"))
    time = np.arange(0.0, _SECONDS, 0.5 * _STEP)
    return np.stack([np.interp(time, drive.time, x) for x in drive.truth], axis=1)


def _excess(name: str, values: Mapping[str, float], x: Array, time: float) -> float:
    """Force of the front axle beyond −kδ − cδ̇, N; ``x`` is a row of :class:`_Run`."""
    car = _car()
    if name == "damper_hysteresis":  # the lagging force m stands in for c δ̇
        return float(car.c_f.value * x[2] - x[4])
    if name == "external_force":
        up = np.clip((time - values["start"]) / values["rise"] + 0.5, 0.0, 1.0)
        down = np.clip(
            (time - values["start"] - values["duration"]) / values["rise"] + 0.5, 0.0, 1.0
        )
        return float(values["force"] * (up**2 * (3.0 - 2.0 * up) - down**2 * (3.0 - 2.0 * down)))
    if name == "spring_rate":
        return float(-(values["factor"] - 1.0) * car.k_f.value * x[0])
    force = EFFECTS[name].force
    if force is None:
        return 0.0
    delta, rate, share = np.asarray(x[0]), np.asarray(x[2]), np.asarray(time / _SECONDS)
    return float(force(values, car.c_f.value, car.k_f.value, delta, rate, share))


class _Run(NamedTuple):
    time: Array  # (N,), s
    states: Array  # (N, 5): δ of both axles, δ̇ of both, lagging force
    force: Array  # (N,), of the front axle, N
    body: Array  # (N, 2), acceleration of the chassis above the axles, m/s²


@cache
def _run(name: str, with_effect: bool) -> _Run:
    """Integrate the half car over the drive of an effect, with it at the front or without it."""
    car, example = _car(), EXAMPLES[name]
    share = car.wdf.value
    if name == "weight_distribution" and with_effect:
        share *= example.values["factor"]
    arms = car.l.value * np.array([1.0 - share, -share])
    inverse = 1.0 / car.m.value + np.outer(arms, arms) / car.i.value
    springs = np.array([car.k_f.value, car.k_r.value])
    damping = np.array([car.c_f.value, car.c_r.value])
    stiffness = example.values.get("stiffness", 0.0)
    hubs = _hubs(example.road, example.speed)

    def forces(x: Array, time: float) -> Array:
        total = -springs * x[:2] - damping * x[2:4]
        if with_effect:
            total[0] += _excess(name, example.values, x, time)
        return total

    def slope(x: Array, hub: Array, time: float) -> Array:
        lagging = stiffness * (x[2] - x[4] / damping[0])
        return np.array([*x[2:4], *(inverse @ forces(x, time) - hub), lagging])

    count = len(hubs) // 2 - 1
    states, force, body = np.zeros((count, 5)), np.zeros(count), np.zeros((count, 2))
    x = np.zeros(5)
    for n in range(count):
        time, h = n * _STEP, _STEP
        now = forces(x, time)
        states[n], force[n], body[n] = x, now[0], inverse @ now
        k1 = slope(x, hubs[2 * n], time)
        k2 = slope(x + 0.5 * h * k1, hubs[2 * n + 1], time + 0.5 * h)
        k3 = slope(x + 0.5 * h * k2, hubs[2 * n + 1], time + 0.5 * h)
        k4 = slope(x + h * k3, hubs[2 * n + 2], time + h)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return _Run(_STEP * np.arange(count), states, force, body)


def _reading(name: str, run: _Run) -> Array:
    """Return what the front chassis sensor reads with the effect, m/s²."""
    values, true = EXAMPLES[name].values, run.body[:, 0]
    if name == "sensor_gain":
        return np.asarray(values["factor"] * true)
    if name in ("sensor_lag", "clock_offset"):
        return np.interp(run.time + values.get("lag", values.get("offset", 0.0)), run.time, true)
    if name == "sensor_bandwidth":
        pole = np.exp(-2.0 * np.pi * 50.0 * values["bandwidth"] * _STEP)
        return np.asarray(lfilter([1.0 - pole], [1.0, -pole], true))
    if name == "sensor_drift":
        return np.asarray(true + values["slope"] * run.time)
    return true


def effect(name: str) -> None:
    """Draw the law of an effect, and what it does to a drive that shows it."""
    example = EXAMPLES[name]
    columns = {"ncols": 2, "width_ratios": [1.0, 2.0]} if example.over else {}
    alt = f"Chassis acceleration with and without {EFFECTS[name].title}"
    with drawing(name, alt, (8.4, 2.9), **columns) as axes:
        right = axes[1] if example.over else axes
        if example.over:
            _draw_law(axes[0], name)
        plain, faulty = _run(name, False), _run(name, True)
        right.plot(plain.time, plain.body[:, 0], color=INK, lw=1.2, alpha=0.55, label="linear car")
        reading = EFFECTS[name].acts == "reading"
        shown = _reading(name, plain) if reading else faulty.body[:, 0]
        right.plot(plain.time, shown, color=WHEEL, lw=1.6, label="with the effect")
        right.axhline(0.0, color=INK, lw=0.5, alpha=0.4)
        what = "reading" if reading else "front chassis"
        right.set(xlabel="time, s", ylabel=f"{what}, m/s²", xlim=(0.0, _SECONDS))
        right.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, fontsize=9)


def _draw_law(ax: Axes, name: str) -> None:
    """Draw the force of the front axle over what it depends on."""
    example, run, car = EXAMPLES[name], _run(name, True), _car()
    deflection, rate = run.states[:, 0], run.states[:, 2]
    spring = car.k_f.value * deflection
    if example.over == "rate":
        x, force, straight = rate, -(run.force + spring), car.c_f.value * rate
        ax.set(xlabel="extension rate, m/s", ylabel="damper force, N")
    elif example.over == "deflection":
        x, force, straight = 1e3 * deflection, -(run.force + car.c_f.value * rate), spring
        ax.set(xlabel="extension, mm", ylabel="spring force, N")
    elif name == "damper_fade":
        x = run.time
        straight = np.full_like(x, car.c_f.value)
        force = straight * (1.0 - example.values["loss"] * x / _SECONDS)
        ax.set(xlabel="time, s", ylabel="damping rate, N·s/m")
    else:
        x, force, straight = run.time, run.force + spring + car.c_f.value * rate, 0.0 * run.time
        ax.set(xlabel="time, s", ylabel="force, N")
    order = np.argsort(x) if name != "damper_hysteresis" else np.arange(len(x))
    ends = np.argsort(x)[[0, -1]]
    ax.plot(x[ends], straight[ends], color=INK, lw=1.2, alpha=0.55)
    ax.plot(x[order], force[order], color=WHEEL, lw=1.8)
    if name == "damper_fade":
        ax.set_ylim(bottom=0.0)
