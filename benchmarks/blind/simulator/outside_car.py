"""Unlisted faults of valves, springs, oil and links between the axles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint
from .cars import Car
from .forces import Plain
from .kinds import AXLES, Vector, Whole, rows_of
from .scene import Scene
from .simulate import Mechanism, Now

__all__ = ["CAR_FAULTS"]

Maker = Callable[[Scene, np.random.Generator], Blueprint]


def _axle(rng: np.random.Generator) -> tuple[str, int, slice]:
    axle = int(rng.integers(2))
    return AXLES[axle], axle, rows_of(AXLES[axle])


class _Snap:
    """A valve that snaps open at one speed and shut at a lower one: memory is its lift, 0 to 1."""

    states = 1

    def __init__(self, rows: slice, c: float, size: Vector, opens: float, shuts: float) -> None:
        self.rows, self.c, self.size = rows, c, size
        self.middle, self.half = 0.5 * (opens + shuts), 0.5 * (opens - shuts)

    def act(self, now: Now) -> None:
        """Take away what the open valve lets through."""
        rate, lift = now.rate[self.rows], now.aux
        drive = (np.abs(rate) - self.middle) / self.half
        # cubic with two stable lifts where the drive is within one of zero
        x = 2.0 * lift - 1.0
        fold = 0.3849
        now.flow[:] = 0.5 * (x - x**3 + fold * drive) / 0.004
        open_share = np.clip(lift, 0.0, 1.0)
        now.force[self.rows] += self.c * self.size * open_share * rate


def _snap_valve(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    fast = float(np.quantile(np.abs(scene.history.rate[:, axle, :2]), 0.97))
    opens, shuts = 0.6 * fast, 0.12 * fast

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Snap(rows, scene.car.c[axle], size, opens, shuts)

    name = "unlisted:snapping_valve"
    return Blueprint(name, where, "relay with hysteresis", (0.01, 0.75), mechanism=mechanism)


class _InertiaValve:
    """A slug that a rising wheel throws open: memory is its opening, 0 to 1."""

    states = 1

    def __init__(self, axle: int, c: float, size: Vector, threshold: float, shuts: float) -> None:
        self.axle, self.rows = axle, slice(axle, axle + 1)
        self.c, self.size, self.threshold, self.shuts = c, size, threshold, shuts

    def act(self, now: Now) -> None:
        """Take away damping in compression while the slug is off its seat."""
        wheel = now.acceleration()[2 + self.axle]
        thrown = 0.5 + 0.5 * np.tanh((wheel - self.threshold) / (0.1 * self.threshold))
        now.flow[:] = thrown * (1.0 - now.aux) / 0.004 - now.aux / self.shuts
        squeezed = np.minimum(now.rate[self.rows], 0.0)
        now.force[self.rows] += self.c * self.size * now.aux * squeezed


def _inertia_valve(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, _ = _axle(rng)
    peak = float(np.max(scene.history.flow[:, 6 + axle, :2]))
    threshold, shuts = float(rng.uniform(0.25, 0.4)) * peak, float(rng.uniform(0.05, 0.12))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _InertiaValve(axle, scene.car.c[axle], size, threshold, shuts)

    name = "unlisted:inertia_valve"
    return Blueprint(name, where, "slug on a spring", (0.01, 0.9), mechanism=mechanism)


class _Pipe:
    """A pipe between front and rear units: memory is the volume that went through it, as travel.

    Fluid that one axle squeezes out lifts the other, through a throttle.
    """

    states = 1

    def __init__(self, k: float, size: Vector, fills: float) -> None:
        self.firm, self.fills = k * size, fills

    def act(self, now: Now) -> None:
        """Push both axles by the pressures of their units."""
        front = now.delta[0:1] + now.aux
        rear = now.delta[1:2] - now.aux
        now.flow[:] = (rear - front) / self.fills
        now.force[0:1] -= self.firm * front
        now.force[1:2] -= self.firm * rear


def _linked_axles(scene: Scene, rng: np.random.Generator) -> Blueprint:
    k, fills = float(np.mean(scene.car.k)), float(rng.uniform(0.01, 0.04))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Pipe(k, size, fills)

    name = "unlisted:linked_axles"
    return Blueprint(name, None, "fluid between the axles", (0.005, 1.2), mechanism=mechanism)


def _bent_rod(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    delta = scene.history.delta[:, axle, :2]
    side = np.min(delta) if rng.random() < 0.6 else np.max(delta)
    at, breadth = float(rng.uniform(0.35, 0.55) * side), 0.2 * abs(float(side))
    load = scene.car.mean_load

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        def law(delta: Vector, rate: Vector) -> Vector:
            near = np.exp(-(((delta - at) / breadth) ** 2))
            return np.asarray(-load * size * near * np.tanh(rate / 0.01))

        return Plain(rows, law)

    name = "unlisted:bent_rod"
    return Blueprint(name, where, "friction at one place", (0.0005, 0.4), mechanism=mechanism)


class _Skyhook:
    """Dampers that a controller hardens where they can slow the body, a moment late.

    Memory is the setting of each axle, from −1 to 1.
    """

    states = 2

    def __init__(self, car: Car, size: Vector, late: float) -> None:
        self.c, self.size, self.late = np.array(car.c)[:, None], size, late
        self.arms = np.array([[1.0, car.ahead], [1.0, -car.behind]])

    def act(self, now: Now) -> None:
        """Change the dampers by their settings."""
        body = self.arms @ now.state[4:6]
        wanted = np.tanh(body * now.rate / 0.0004)
        now.flow[:] = (wanted - now.aux) / self.late
        now.force[0:2] -= self.c * self.size * now.aux * now.rate


def _skyhook(scene: Scene, rng: np.random.Generator) -> Blueprint:
    late = float(rng.uniform(0.008, 0.02))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Skyhook(scene.car, size, late)

    name = "unlisted:switching_dampers"
    return Blueprint(name, None, "on-off by body motion", (0.005, 0.8), mechanism=mechanism)


class _Surge:
    """A coil spring with a mass in its middle: memory is its way from the mean of the ends."""

    states = 2

    def __init__(self, axle: int, k: float, mass: Vector, car: Car, loss: float) -> None:
        self.axle, self.k, self.mass, self.loss = axle, k, mass, loss
        arm = (car.ahead, -car.behind)[axle]
        self.ends = np.zeros(4)
        self.ends[0], self.ends[1], self.ends[2 + axle] = 0.5, 0.5 * arm, 0.5

    def act(self, now: Now) -> None:
        """Let both halves of the spring pull at chassis and axle.

        Half of the pull of the mass acts on either end.
        """
        way, speed = now.aux
        omega = np.sqrt(4.0 * self.k / self.mass)
        pull = 4.0 * self.k * way + 2.0 * self.loss * omega * self.mass * speed
        now.force[4 + self.axle] += 0.5 * pull
        now.force[2 + self.axle] += 0.5 * pull
        now.flow[0] = speed
        now.flow[1] = -pull / self.mass - self.ends @ now.acceleration()


def _surge(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, _ = _axle(rng)
    k, loss = scene.car.k[axle], float(rng.uniform(0.01, 0.03))
    most = min(4.0 * k / (2.0 * np.pi * 13.0) ** 2, 0.3 * scene.car.unsprung[axle])
    least = min(4.0 * k / (2.0 * np.pi * 45.0) ** 2, 0.5 * most)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Surge(axle, k, size, scene.car, loss)

    name = "unlisted:coil_surge"
    return Blueprint(name, where, "spring with a mass", (least, most), mechanism=mechanism)


class _Thixotropic:
    """Oil that thins while it is worked and recovers at rest: memory is what is left of its gel."""

    states = 1

    def __init__(self, rows: slice, c: float, size: Vector, way: float, heals: float) -> None:
        self.rows, self.c, self.size, self.way, self.heals = rows, c, size, way, heals

    def act(self, now: Now) -> None:
        """Take away what the oil has lost; memory counts the loss, from 0 to 1."""
        rate = now.rate[self.rows]
        now.flow[:] = np.abs(rate) / self.way * (1.0 - now.aux) - now.aux / self.heals
        now.force[self.rows] += self.c * self.size * now.aux * rate


def _thixotropic(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    usual = float(np.std(scene.history.rate[:, axle, :2]))
    heals = float(rng.uniform(0.25, 0.6))
    way = usual * 0.5 * heals

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Thixotropic(rows, scene.car.c[axle], size, way, heals)

    name = "unlisted:thixotropic_oil"
    return Blueprint(name, where, "gel that breaks and heals", (0.01, 0.95), mechanism=mechanism)


CAR_FAULTS: dict[str, Maker] = {
    "snapping_valve": _snap_valve,
    "inertia_valve": _inertia_valve,
    "linked_axles": _linked_axles,
    "bent_rod": _bent_rod,
    "switching_dampers": _skyhook,
    "coil_surge": _surge,
    "thixotropic_oil": _thixotropic,
}
