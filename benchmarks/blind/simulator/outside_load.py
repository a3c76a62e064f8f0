"""Unlisted faults of what a car carries, tows and is driven by."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .blueprint import Blueprint
from .cars import GRAVITY, Car
from .forces import Pushed
from .kinds import Vector, Whole
from .scene import Scene
from .signals import LinearSystem
from .simulate import Drive, Mechanism, Now

__all__ = ["LOAD_FAULTS"]

Maker = Callable[[Scene, np.random.Generator], Blueprint]


class _Slosh:
    """Water that moves fore and aft in a tank: memory is its way forward (m) and its rate.

    The first wave is a mass on a spring. ``above`` is the height of the tank over the centre of
    gravity, m.
    """

    states = 2

    def __init__(self, car: Car, size: Vector, above: float, omega: float, loss: float) -> None:
        self.mass, self.above = size * car.m, above
        self.omega, self.loss, self.i, self.length = omega, loss, car.i, car.wheelbase

    def act(self, now: Now) -> None:
        """Replace water that stands still by water that moves."""
        way, speed = now.aux
        free = -(self.omega**2) * way - 2.0 * self.loss * self.omega * speed
        free = free - GRAVITY * now.state[1]
        bare = now.acceleration()[1]
        # way'' = above θ'' + free, and the moment on the body is m (above way'' − g way)
        pitching = bare + self.mass / self.i * (self.above * free - GRAVITY * way)
        pitching = pitching / (1.0 - self.mass * self.above**2 / self.i)
        now.flow[0] = speed
        now.flow[1] = self.above * pitching + free
        moment = self.mass * (self.above * now.flow[1] - GRAVITY * way)
        now.force[4] += moment / self.length
        now.force[5] -= moment / self.length


def _slosh(scene: Scene, rng: np.random.Generator) -> Blueprint:
    above = float(rng.uniform(0.1, 0.35))
    omega, loss = 2.0 * np.pi * float(rng.uniform(0.9, 1.7)), float(rng.uniform(0.02, 0.06))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Slosh(scene.car, size, above, omega, loss)

    name = "unlisted:sloshing_tank"
    return Blueprint(name, None, "first wave fore and aft", (0.002, 0.4), mechanism=mechanism)


def _pushing(waves: Sequence[Vector], pair: Vector) -> Callable[[Vector, Whole], Mechanism]:
    """Return forces front and rear (``pair`` times N of size one) that follow waves of each run."""

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        curve = np.stack(waves, 1)[:, runs] * size
        return Pushed(curve[:, None, :] * pair[None, :, None])

    return mechanism


def _moments(drive: Drive, rng: np.random.Generator, count: int, first: float) -> Vector:
    """Return times of events of a run, in order and some way apart, s."""
    ends = np.linspace(first, drive.length - 0.5, count + 1)
    return np.asarray(ends[:-1] + rng.uniform(0.1, 0.7, count) * np.diff(ends))


def _shuffle(scene: Scene, rng: np.random.Generator) -> Blueprint:
    omega, loss = 2.0 * np.pi * float(rng.uniform(3.2, 6.5)), float(rng.uniform(0.06, 0.12))
    waves = []
    for drive in scene.drives:
        t, wave = drive.half_times, np.zeros(len(drive.height))
        for at in _moments(drive, rng, int(rng.integers(3, 5)), 0.4):
            u = np.maximum(t - at, 0.0)
            kick = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0))
            wave += kick * np.exp(-loss * omega * u) * np.sin(omega * u)
        waves.append(wave * scene.car.mean_load)
    squat = float(rng.uniform(0.2, 0.6))
    name = "unlisted:driveline_shuffle"
    mechanism = _pushing(waves, np.array([1.0, -squat]))
    return Blueprint(name, None, "decaying pitch moments", (0.0003, 0.3), mechanism=mechanism)


def _tramp(scene: Scene, rng: np.random.Generator) -> Blueprint:
    tone, drop = float(rng.uniform(8.5, 13.5)), float(rng.uniform(1.0, 2.5))
    waves = []
    for drive in scene.drives:
        t, wave = drive.half_times, np.zeros(len(drive.height))
        for at in _moments(drive, rng, int(rng.integers(2, 4)), 0.6):
            length = float(rng.uniform(0.25, 0.5))
            u = np.clip((t - at) / length, 0.0, 1.0)
            grown = np.exp(6.0 * u) / (np.exp(6.0 * u) + 12.0) * np.sqrt(np.maximum(1.0 - u, 0.0))
            turn = 2.0 * np.pi * length * u * (tone - drop * u)
            inside = (t > at) & (t < at + length)
            wave += np.where(inside, grown * (np.sin(turn) + 0.25 * np.sin(3.0 * turn)), 0.0)
        waves.append(wave * scene.car.mean_load)
    name = "unlisted:axle_tramp"
    pair = np.array([float(rng.uniform(-0.6, -0.2)), 1.0])
    return Blueprint(
        name, None, "bursts of axle wind-up", (0.0005, 0.4), mechanism=_pushing(waves, pair)
    )


def _trailer(scene: Scene, rng: np.random.Generator) -> Blueprint:
    car = scene.car
    behind, hitch = float(rng.uniform(1.6, 2.4)), float(rng.uniform(0.35, 0.6))
    omega, loss = 2.0 * np.pi * float(rng.uniform(2.2, 3.6)), float(rng.uniform(0.08, 0.2))
    a = np.array([[0.0, 1.0], [-(omega**2), -2.0 * loss * omega]])
    b = np.array([[0.0, 0.0], [omega**2, 2.0 * loss * omega]])
    system = LinearSystem(a, b, a[1:], b[1:])
    waves = []
    for drive in scene.drives:
        late = drive.half_times - behind / drive.speed
        under = [
            np.interp(late, drive.half_times, x[:, 1], left=float(x[0, 1]))
            for x in (drive.height, drive.rate)
        ]
        heave = system.response(np.stack(under, 1), 0.5 * drive.step)[:, 0]
        waves.append(-0.25 * car.m * heave)
    lever = hitch / car.wheelbase
    mechanism = _pushing(waves, np.array([-lever, 1.0 + lever]))
    name = "unlisted:trailer"
    return Blueprint(name, None, "drawbar of a trailer", (0.005, 1.0), mechanism=mechanism)


LOAD_FAULTS: dict[str, Maker] = {
    "sloshing_tank": _slosh,
    "driveline_shuffle": _shuffle,
    "axle_tramp": _tramp,
    "trailer": _trailer,
}
