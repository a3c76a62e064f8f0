"""A car, its sensors, and three drives of it: two to fit on one road, and one on another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .cars import FAMILIES, Car, draw_car, geometry
from .declared import Declared, declare
from .kinds import CHANNELS, UnreachableError, Vector, Whole
from .roads import ROADS, Profile, draw_road
from .sensors import KITS, Motion, Sensing, kit_sensors, motions, noisy_rows, pure_rows
from .signals import LinearSystem
from .simulate import Drive, History, Mechanism, integrate, motion_matrices
from .strength import Yardstick

__all__ = ["FINE_RATE", "Scene", "Wish", "draw_scene", "fine_fold"]

FINE_RATE = 2600.0
"""Least rate of the integration, steps a second."""

LEAD = 0.25
"""Time that is simulated before a recording begins, s."""

TAIL = 0.04
"""Time that is simulated after a recording has ended, s."""

APPROACH = 1.0
"""Time on even ground before the front wheels meet the obstacle, s."""

MOST_FLOOR = 0.3
"""Largest squared distance of readings without fault and noise from the true linear car."""

LONGEST = 5.0
"""Longest recording, s."""


@dataclass(frozen=True)
class Wish:
    """What a case needs of its scene.

    ``roads`` to fit, all if empty; ``corner``: sensors with a declared filter; ``bits`` of the
    converter; ``lively``: motion as large as the family allows; ``fine`` steps a second.
    """

    roads: tuple[str, ...] = ()
    corner: bool = False
    bits: int | None = None
    lively: bool = False
    fine: float = FINE_RATE


@dataclass(frozen=True)
class Scene:
    """All that a case has in common, with and without its fault."""

    family: str
    car: Car
    declared: Declared
    rate: float
    profiles: tuple[Profile, Profile]
    drives: tuple[Drive, Drive, Drive]
    times: tuple[Vector, Vector, Vector]
    history: History
    base: tuple[Vector, Vector, Vector]
    yardstick: Yardstick

    def integrated(self, runs: Whole, mechanisms: Sequence[Mechanism]) -> History:
        """Drive columns with mechanisms; ``runs`` says which drive each column is."""
        return integrate(self.car, self.drives, runs, mechanisms)

    def motions(self, history: History, extra: Vector | None = None) -> list[Motion]:
        """Return what the mounts of the sensors do in each column."""
        return motions(self.car, history, extra)

    def pure(self, motion: Motion, run: int, faults: Sequence[Sensing] = ()) -> Vector:
        """Rows (N, 4) of a run without noise."""
        return pure_rows(motion, self.times[run], run, self.declared.sensors, faults)

    def noisy(
        self,
        motion: Motion,
        run: int,
        rng: np.random.Generator,
        factor: float = 1.0,
        faults: Sequence[Sensing] = (),
    ) -> Vector:
        """Rows (N, 4) of a run as the logger writes them."""
        still = [fault.without_rows() for fault in faults]
        rows = self.pure(motion, run, still)
        return noisy_rows(rows, self.times[run], run, self.declared.sensors, rng, factor, faults)


def fine_fold(rate: float, fine: float) -> int:
    """Return steps of the integration in one row."""
    return max(1, int(np.ceil(fine / rate)))


def _drive(
    profile: Profile, speed: float, car: Car, scale: float, length: float, step: float
) -> Drive:
    """Return a drive at constant speed; the front wheels meet the road after a second."""
    halves = 2 * round((LEAD + length + TAIL) / step) + 1
    times = -LEAD + 0.5 * step * np.arange(halves)
    start = -speed * APPROACH
    height, slope = np.zeros((halves, 2)), np.zeros((halves, 2))
    for axle, back in enumerate((0.0, car.wheelbase)):
        h, d = profile.height_and_slope(start + speed * times - back)
        height[:, axle], slope[:, axle] = scale * h, scale * d
    return Drive(-LEAD, step, length, speed, height, speed * slope)


def _linear(car: Car, drive: Drive) -> tuple[Vector, Vector, Vector]:
    """Wheel and chassis accelerations and deflections of the car whose tyres never leave."""
    rows, into = motion_matrices(car)
    a = np.zeros((8, 8))
    a[:4, 4:] = np.eye(4)
    a[4:] = into[:, :4] @ rows[:4]
    b = np.zeros((8, 2))
    b[4:] = into[:, 2:4]
    body = geometry(car) @ a[4:6]
    c = np.vstack([a[6:8], body, rows[4:6]])
    d = np.zeros((6, 2))
    d[0:2] = b[6:8]
    drive_in = (np.asarray(car.tyre) * drive.height + np.asarray(car.tyre_damping) * drive.rate)[
        ::2
    ]
    y = LinearSystem(a, b, c, d).response(drive_in, drive.step)
    return y[:, 0:2], y[:, 2:4], y[:, 4:6]


def _scale(car: Car, drive: Drive, travel: float, rng: np.random.Generator, lively: bool) -> float:
    """Height of the road at which wheels, chassis and deflection stay in what such cars do."""
    wheels, chassis, stretch = _linear(car, drive)
    size = 1.0 if lively else float(rng.uniform(0.45, 1.0))
    most = min(
        50.0 / float(np.max(np.abs(wheels))),
        13.0 / float(np.max(np.abs(chassis))),
        travel / float(np.max(np.abs(stretch))),
    )
    return size * most


def _settling(car: Car) -> float:
    """Time in which the slower decay of the body falls to a tenth, s, from 0.7 to 1.2."""
    mass = np.array([car.m * car.wdf, car.m * (1.0 - car.wdf)])
    return float(np.clip(np.max(2.3 * 2.0 * mass / np.array(car.c)), 0.7, 1.2))


def _timed(
    profile: Profile, speed: float, car: Car, rng: np.random.Generator
) -> tuple[Profile, float]:
    """Return the road up to its end, and the length of a recording until the car is still, s."""
    rest = _settling(car)
    if profile.lasting:
        length = float(rng.choice([3.5, 4.0, 4.5]))
        driven = length - APPROACH - rest - car.wheelbase / speed
        return profile.faded(max(speed * driven, 3.0)), length
    needed = APPROACH + (profile.reach + car.wheelbase) / speed + rest
    return profile, float(np.clip(np.ceil(needed * 4.0) / 4.0, 2.0, LONGEST))


def _speed(profile: Profile, car: Car, calm: float) -> float:
    """Speed of the first drive, m/s, such that a drive a fifth slower is not too long."""
    if profile.lasting:
        return profile.speed * calm
    driving = LONGEST - APPROACH - _settling(car)
    return max(profile.speed * calm, 1.26 * (profile.reach + car.wheelbase) / driving)


def draw_scene(rng: np.random.Generator, wish: Wish) -> Scene:
    """Draw a family, a car, a kit of sensors, two roads and three drives."""
    family = FAMILIES[str(rng.choice(sorted(FAMILIES)))]
    car = draw_car(family, rng)
    kits = [kit for kit in KITS if kit.corner is not None or not wish.corner]
    kit = kits[int(rng.integers(len(kits)))]
    rate = float(rng.choice(kit.rates))
    step = 1.0 / (rate * fine_fold(rate, wish.fine))
    kinds = [kind for kind in sorted(ROADS) if not wish.roads or kind in wish.roads]
    kind = str(rng.choice(kinds))
    other = str(rng.choice([k for k in sorted(ROADS) if k != kind]))
    travel = float(rng.uniform(*family.travel))
    profiles = (draw_road(kind, rng), draw_road(other, rng))
    calm = 0.8 if rate <= 250.0 else 1.0
    speeds = [_speed(profiles[0], car, calm), 0.0, _speed(profiles[1], car, calm)]
    speeds[1] = speeds[0] * float(rng.choice([0.8, 0.9, 1.12, 1.25]))
    drives = []
    for number, (whole, speed) in enumerate(
        zip((profiles[0], profiles[0], profiles[1]), speeds, strict=True)
    ):
        profile, length = _timed(whole, speed, car, rng)
        flat = _drive(profile, speed, car, 1.0, length, step)
        if number != 1:
            scale = _scale(car, flat, travel, rng, wish.lively)
        else:
            scale = min(scale, _scale(car, flat, travel, rng, True))
        drives.append(_drive(profile, speed, car, scale, length, step))
    longest = max(len(d.height) for d in drives)
    even = [_stretched(d, longest) for d in drives]
    history = integrate(car, even, np.arange(3))
    found = motions(car, history)
    peaks = {
        c: max(float(np.max(np.abs(motion.acceleration[c]))) for motion in found) for c in CHANNELS
    }
    sensors = kit_sensors(kit, peaks, rng, wish.bits)
    declared = declare(car, family, sensors, rng)
    times = [np.arange(round(d.length * rate) + 1) / rate for d in drives]
    base = [pure_rows(m, t, n, sensors) for n, (m, t) in enumerate(zip(found, times, strict=True))]
    yardstick = Yardstick(car, declared, times[:2], base[:2])
    if yardstick.floor > MOST_FLOOR:
        raise UnreachableError
    return Scene(
        family.name,
        car,
        declared,
        rate,
        profiles,
        (even[0], even[1], even[2]),
        (times[0], times[1], times[2]),
        history,
        (base[0], base[1], base[2]),
        yardstick,
    )


def _stretched(drive: Drive, halves: int) -> Drive:
    """Return the drive with a road that goes on evenly for so many half steps."""
    more = halves - len(drive.height)
    height = np.vstack([drive.height, np.repeat(drive.height[-1:], more, 0)])
    rate = np.vstack([drive.rate, np.zeros((more, 2))])
    return Drive(drive.begin, drive.step, drive.length, drive.speed, height, rate)
