"""Unlisted faults of the car, of what it carries and of its driver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint
from .cars import GRAVITY, Car
from .forces import Plain, Pushed
from .kinds import AXLES, CHANNELS, Vector, Whole, rows_of
from .scene import Scene
from .sensors import Motion, Sensing
from .signals import LinearSystem
from .simulate import Drive, History, Mechanism, Now

__all__ = ["CAR_FAULTS", "Rocker"]

Maker = Callable[[Scene, np.random.Generator], Blueprint]


def _axle(rng: np.random.Generator) -> tuple[str, int, slice]:
    axle = int(rng.integers(2))
    return AXLES[axle], axle, rows_of(AXLES[axle])


class _Bending:
    """First bending of the frame: memory is its size at the axles (m) and rate (m/s)."""

    states = 2

    def __init__(self, car: Car, size: Vector, omega: float, loss: float, shape: Vector) -> None:
        self.size, self.omega, self.loss = size / car.m, omega, loss
        self.shape = shape[:, None]
        self.k, self.c = np.asarray(car.k)[:, None], np.asarray(car.c)[:, None]

    def act(self, now: Now) -> None:
        """Let the frame give way at the axles."""
        now.force[0:2] -= self.shape * (self.k * now.aux[0] + self.c * now.aux[1])
        drive = np.sum(self.shape * now.force[0:2], 0) * self.size
        now.flow[0] = now.aux[1]
        now.flow[1] = drive - 2.0 * self.loss * self.omega * now.aux[1] - self.omega**2 * now.aux[0]


def _frame_bending(scene: Scene, rng: np.random.Generator) -> Blueprint:
    omega = 2.0 * np.pi * float(rng.uniform(13.0, 24.0))
    loss, shape = float(rng.uniform(0.015, 0.04)), np.array([1.0, float(rng.uniform(0.6, 1.0))])

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Bending(scene.car, size, omega, loss, shape)

    def mounts(own: History, size: Vector) -> Vector:
        return np.asarray(own.flow[:, 1:2] * shape[None, :, None])

    form = "modal, linear"
    return Blueprint(
        "unlisted:frame_bending", None, form, (0.003, 2.5), mechanism=mechanism, mounts=mounts
    )


class _Loose:
    """A battery on foam between hard stops: memory is its way from rest (m) and rate (m/s)."""

    states = 2

    def __init__(self, car: Car, size: Vector, at: float, omega: float, gap: float) -> None:
        self.mass, self.omega, self.gap = size * car.m, omega, gap
        self.lever = np.array([1.0, at, 0.0, 0.0])
        self.share = np.array(
            [[(at + car.behind) / car.wheelbase], [(car.ahead - at) / car.wheelbase]]
        )
        self.local = 1.0 / car.m + at * at / car.i

    def act(self, now: Now) -> None:
        """Replace the rigid battery by the loose one."""
        way, speed = now.aux[0], now.aux[1]
        over = np.sign(way) * np.maximum(np.abs(way) - self.gap, 0.0)
        push = -(self.omega**2) * (way + 40.0 * over) - 0.2 * self.omega * speed
        push = push - np.where(over != 0.0, 1.2 * self.omega * speed, 0.0)
        floor = self.lever @ now.acceleration()
        reaction = self.mass * (floor - push) / (1.0 - self.mass * self.local)
        now.force[4:6] += self.share * reaction
        now.flow[0] = speed
        now.flow[1] = push - floor - reaction * self.local


def _loose_battery(scene: Scene, rng: np.random.Generator) -> Blueprint:
    at = float(rng.uniform(-0.35, 0.25)) * scene.car.wheelbase
    omega, gap = 2.0 * np.pi * float(rng.uniform(4.5, 8.0)), float(rng.uniform(0.0008, 0.002))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Loose(scene.car, size, at, omega, gap)

    form = "mass on foam between stops"
    return Blueprint("unlisted:loose_battery", None, form, (0.0005, 0.15), mechanism=mechanism)


class _Play:
    """A damper whose mount has play: memory is the shift of the mount (m)."""

    states = 1

    def __init__(self, rows: slice, c: float, stiff: float, size: Vector) -> None:
        self.rows, self.c, self.stiff, self.half = rows, c, stiff, 0.5 * size

    def act(self, now: Now) -> None:
        """Give the damper the rate that the mount leaves."""
        rate, shift = now.rate[self.rows], now.aux
        taut = np.sign(shift) * np.maximum(np.abs(shift) - self.half, 0.0)
        now.flow[:] = rate - self.stiff * taut / self.c
        now.force[self.rows] += self.c * rate - self.stiff * taut


def _mount_play(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    c, stiff = scene.car.c[axle], 70.0 * float(np.mean(scene.car.k))
    stiff = min(stiff, 4500.0 * c)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Play(rows, c, stiff, size)

    name = "unlisted:damper_mount_play"
    return Blueprint(name, where, "dead zone in series", (0.00001, 0.006), mechanism=mechanism)


class _Void:
    """A damper that cavitates in rebound: memory is the void (m) that compression has to close."""

    states = 1

    def __init__(self, rows: slice, c: float, size: Vector) -> None:
        self.rows, self.c, self.limit = rows, c, 1.0 / size

    def act(self, now: Now) -> None:
        """Take away the force while the void opens or closes."""
        rate, void = now.rate[self.rows], now.aux
        opens = np.maximum(rate - self.limit, 0.0)
        closes = np.minimum(rate, 0.0) * -np.expm1(-np.maximum(void, 0.0) / 0.0003)
        flow = opens + closes
        now.flow[:] = flow
        now.force[self.rows] += self.c * flow


def _cavitation(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    most = float(np.max(scene.history.rate[:, axle, :2]))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Void(rows, scene.car.c[axle], size)

    span = (1.02 / most, 12.0 / most)
    name = "unlisted:aerated_damper"
    return Blueprint(name, where, "void in rebound", span, mechanism=mechanism)


class _Gas:
    """Gas that stiffens the spring until its heat has gone: memory is the further force (N)."""

    states = 1

    def __init__(self, rows: slice, k: float, size: Vector, fades: float) -> None:
        self.rows, self.k, self.size, self.fades = rows, k, size, fades

    def act(self, now: Now) -> None:
        """Add the force of the warm gas."""
        now.flow[:] = self.k * self.size * now.rate[self.rows] - now.aux / self.fades
        now.force[self.rows] -= now.aux


def _gas_heat(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    fades = float(rng.uniform(0.05, 0.2))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Gas(rows, scene.car.k[axle], size, fades)

    name = "unlisted:air_spring_heat"
    return Blueprint(name, where, "relaxing stiffness", (0.005, 3.0), mechanism=mechanism)


class Rocker:
    """Inertia between wheel and body, as of a heavy rocker: force against δ̈.

    ``size`` is the inertia over the unsprung mass of the axle.
    """

    states = 0

    def __init__(self, car: Car, axle: int, size: Vector) -> None:
        lever = (car.ahead, -car.behind)[axle]
        self.pick = np.array([1.0, lever, 0.0, 0.0])
        self.pick[2 + axle] = -1.0
        self.axle, self.size = axle, size * car.unsprung[axle]
        self.local = 1.0 / car.m + lever**2 / car.i + 1.0 / car.unsprung[axle]

    def act(self, now: Now) -> None:
        """Resist the acceleration of the deflection."""
        bare = self.pick @ now.acceleration()
        now.force[self.axle] -= self.size * bare / (1.0 + self.size * self.local)


def _rocker_inertia(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, _ = _axle(rng)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return Rocker(scene.car, axle, size)

    name = "unlisted:rocker_inertia"
    return Blueprint(name, where, "inerter", (0.0005, 0.8), mechanism=mechanism)


class _Kick:
    """Slope of the road times wheel load, turned upwards by an inclined path of the wheel."""

    states = 0

    def __init__(self, axle: int, slope: Vector, load: float, size: Vector) -> None:
        self.axle, self.slope, self.load, self.size = axle, slope, load, size

    def act(self, now: Now) -> None:
        """Push the chassis up while the wheel climbs."""
        load = self.load + now.force[2 + self.axle]
        now.force[self.axle] += self.size * load * self.slope[now.half]


def _anti_dive(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, _ = _axle(rng)
    car, sign = scene.car, float(rng.choice([-1.0, 1.0]))
    share = (car.wdf, 1.0 - car.wdf)[axle]
    load = GRAVITY * (car.m * share + car.unsprung[axle])
    slopes = np.stack([d.slope[:, axle] for d in scene.drives], 1)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Kick(axle, slopes[:, runs], load, sign * size)

    name = "unlisted:anti_dive_kick"
    return Blueprint(name, where, "slope times load", (0.0003, 0.6), mechanism=mechanism)


def _bypass(scene: Scene, rng: np.random.Generator) -> Blueprint:
    where, axle, rows = _axle(rng)
    peak = float(np.max(-scene.history.delta[:, axle, :2]))
    c, begins, soft = scene.car.c[axle], float(rng.uniform(0.25, 0.5)) * peak, 0.08 * peak

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        def law(delta: Vector, rate: Vector) -> Vector:
            zone = 0.5 * (1.0 + np.tanh((-delta - begins) / soft))
            return np.asarray(-c * size * zone * rate)

        return Plain(rows, law)

    name = "unlisted:position_sensitive_damper"
    return Blueprint(name, where, "bypass ports", (0.004, 3.0), mechanism=mechanism)


def _cadence(scene: Scene, rng: np.random.Generator) -> Blueprint:
    waves = []
    for drive in scene.drives:
        t, wave = drive.half_times, np.zeros(len(drive.height))
        at = float(rng.uniform(0.2, 0.9))
        while at < drive.length - 0.3:
            length = float(rng.uniform(0.10, 0.22))
            u = np.clip((t - at) / length, 0.0, 1.0)
            wave += float(rng.uniform(0.6, 1.0)) * np.sin(np.pi * u) ** 2
            at += length + float(rng.uniform(0.06, 0.25))
        waves.append(wave)
    load, pair = scene.car.mean_load, np.array([-1.0, 1.0])

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        curve = np.stack(waves, 1)[:, runs] * size * load
        return Pushed(curve[:, None, :] * pair[None, :, None])

    name = "unlisted:cadence_braking"
    return Blueprint(name, None, "pulses of pitch moment", (0.0002, 0.4), mechanism=mechanism)


class _Bracing:
    """A rider who leans against pitch a moment late; keeps the pitch rate of all steps."""

    states = 0

    def __init__(self, car: Car, size: Vector, late: float, steps: int) -> None:
        self.gain, self.late = -size * 6.0 * car.i / car.wheelbase, late
        self.past = np.zeros((steps, len(size)))

    def act(self, now: Now) -> None:
        """Add the pair of forces of the late moment."""
        if now.first:
            self.past[now.half // 2] = now.state[5]
        at = 0.5 * now.half - self.late
        if at <= 0.0:
            return
        low = int(at)
        share = at - low
        rate = (1.0 - share) * self.past[low] + share * self.past[low + 1]
        now.force[4] += self.gain * rate
        now.force[5] -= self.gain * rate


def _rider(scene: Scene, rng: np.random.Generator) -> Blueprint:
    drive = scene.drives[0]
    late = float(rng.uniform(0.14, 0.24)) / drive.step

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Bracing(scene.car, size, late, len(drive.times))

    name = "unlisted:rider_bracing"
    return Blueprint(name, None, "late pitch damping", (0.0005, 1.2), mechanism=mechanism)


def _one_side(car: Car, drive: Drive) -> Vector:
    """Motion (steps, 4 by channel) that one side adds if the road under the other is as opposed.

    Half the difference of the sides moves an axle in roll, and the body in roll, m/s².
    """
    body = 0.35 * car.m
    a, b = np.zeros((6, 6)), np.zeros((6, 2))
    a[0:3, 3:6] = np.eye(3)
    for axle in range(2):
        k, c, m = car.k[axle], car.c[axle], car.unsprung[axle]
        pull = np.array([-k, k, -c, c])
        slots = [0, 1 + axle, 3, 4 + axle]
        a[3, slots] += pull / body
        a[4 + axle, slots] -= pull / m
        a[4 + axle, 1 + axle] -= car.tyre[axle] / m
        a[4 + axle, 4 + axle] -= car.tyre_damping[axle] / m
        b[4 + axle, axle] = 1.0 / m
    system = LinearSystem(a, b, a[3:6], b[3:6])
    u = np.asarray(car.tyre) * drive.height + np.asarray(car.tyre_damping) * drive.rate
    y = system.response(u[::2], drive.step)
    return np.stack([y[:, 1], 0.7 * y[:, 0], y[:, 2], 0.7 * y[:, 0]], 1)


def _one_sided(scene: Scene, rng: np.random.Generator) -> Blueprint:
    more = [_one_side(scene.car, drive) for drive in scene.drives]

    def sensing(size: float) -> Sensing:
        def mount(motion: Motion, run: int) -> Motion:
            changed = {
                c: motion.acceleration[c] + size * more[run][:, n] for n, c in enumerate(CHANNELS)
            }
            return Motion(motion.begin, motion.step, changed, motion.pitch, motion.pitching)

        return Sensing(mount=mount)

    name = "unlisted:one_sided_bump"
    return Blueprint(name, None, "roll beside heave and pitch", (0.0005, 1.0), sensing=sensing)


CAR_FAULTS: dict[str, Maker] = {
    "frame_bending": _frame_bending,
    "loose_battery": _loose_battery,
    "damper_mount_play": _mount_play,
    "aerated_damper": _cavitation,
    "air_spring_heat": _gas_heat,
    "rocker_inertia": _rocker_inertia,
    "anti_dive_kick": _anti_dive,
    "position_sensitive_damper": _bypass,
    "cadence_braking": _cadence,
    "rider_bracing": _rider,
    "one_sided_bump": _one_sided,
}
