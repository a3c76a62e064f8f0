"""Where a case is driven: two runs to fit over one terrain, one held out over another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from tests.battery.effects import SECONDS
from tests.battery.world import Seen, World
from tests.rig import (
    DEFAULT_SPEEDS,
    RigRun,
    SensorSpec,
    Terrain,
    bump,
    drive,
    parking_stops,
    rollers,
    rough_road,
)
from tests.rig.units import INCH

__all__ = [
    "RATE",
    "TERRAIN_NAMES",
    "Drive",
    "as_recording",
    "driven",
    "fitting_drives",
    "plan",
    "seen",
]

Reals = NDArray[np.float64]

RATE: Final = 400.0
TERRAIN_NAMES: Final = ("bump", "stops", "rough", "rollers")

_ROOM: Final = 0.8  # share of a sensor's range that counts as room
_FILL: Final = (0.65, 1.0)  # share of the room that a run uses
_HIGHEST: Final = 2.0  # times the usual height
_LOOKS: Final = 5
_FARTHER: Final = 1.2  # travel of the held-out run over that of the others
_SPEEDS: Final = ((0.8, 0.95), (0.95, 1.15))  # over the usual speed, the two fitted runs


@dataclass(frozen=True)
class Drive:
    """One run before it is driven.

    Parameters
    ----------
    terrain : str
        One of :data:`TERRAIN_NAMES`.
    height : float
        Factor on the terrain's usual height.
    speed : float
        m/s.
    road_seed, run_seed : int
        Of a random road, and of the noise.
    """

    terrain: str
    height: float
    speed: float
    road_seed: int
    run_seed: int

    def ground(self) -> Terrain:
        """Return what is driven over."""
        f = self.height
        if self.terrain == "bump":
            return bump(f * 3.5 * INCH)
        if self.terrain == "stops":
            return parking_stops(f * 3.25 * INCH)
        if self.terrain == "rollers":
            return rollers(f * 2.25 * INCH)
        return rough_road(self.road_seed, factor=f**2)


def plan(terrain: str, held_out: str, rng: np.random.Generator) -> tuple[Drive, Drive, Drive]:
    """Draw speeds and seeds of two runs over a terrain, and of one over another."""

    def one(name: str, low: float, high: float) -> Drive:
        speed = DEFAULT_SPEEDS[name] * float(rng.uniform(low, high))
        road, noise = (int(v) for v in rng.integers(2**31, size=2))
        return Drive(name, 1.0, speed, road, noise)

    slow, fast = (one(terrain, *span) for span in _SPEEDS)
    return slow, fast, one(held_out, 0.85, 1.1)


def driven(world: World, how: Drive, quiet: bool = False, keep: bool = False) -> RigRun:
    """Drive one run; ``quiet`` leaves noise, converter and biases out, ``keep`` the motion in."""
    sensors = world.sensors
    if quiet:
        none = (0.0, 0.0, 0.0, 0.0)
        sensors = replace(sensors, noise=none, bias=none, adc=None)
    return drive(
        world.car, how.ground(), how.speed, RATE, SECONDS, sensors, how.run_seed,
        forces=world.forces, mountings=world.mountings, keep_motion=keep,
    )  # fmt: skip


def fitting_drives(
    world: World, drives: Sequence[Drive], travel: float, rng: np.random.Generator
) -> tuple[Drive, ...]:
    """Raise or lower the ground until a drawn share of the room is used, run by run.

    Room is what the suspension's travel or the sensors' range leaves, whichever is less.  The
    last run, which is held out, goes at most a fifth farther than the others on either axle:
    what a suspension does beyond its fitted travel cannot be known from the fitted runs.
    """
    out: list[Drive] = []
    farthest = np.zeros(2)
    for how in drives:
        fill = float(rng.uniform(*_FILL))
        limits = np.full(2, travel)
        if how is drives[-1]:
            limits = np.minimum(limits, _FARTHER * farthest / fill)
        for look in range(_LOOKS):
            use, far = _room_used(driven(world, how, quiet=True), world.sensors, limits)
            # all but linear in the height; what a lifting tyre adds is found by a later look
            if look and use <= 1.0:
                break
            how = replace(how, height=min(how.height * fill / use, _HIGHEST))
        farthest = np.maximum(farthest, far)
        out.append(how)
    return tuple(out)


def _room_used(run: RigRun, sensors: SensorSpec, limits: Reals) -> tuple[float, Reals]:
    """Share of the room that a run takes, and how far it goes on either axle, m."""
    adc = sensors.adc
    assert adc is not None
    zero, scale = np.array(adc.zero), np.array(adc.scale)
    above = run.clean.max(axis=1) / (_ROOM * (adc.top - zero) * scale)
    below = -run.clean.min(axis=1) / (_ROOM * zero * scale)
    far = np.abs(run.deflection).max(axis=1)
    return float(max(above.max(), below.max(), (far / limits).max())), far


def seen(world: World, drives: Sequence[Drive]) -> Seen:
    """Look at what some drives reach."""
    runs = [driven(world, how, quiet=True) for how in drives]

    def largest(values: list[Reals]) -> tuple[float, float]:
        front, rear = np.max([v.max(axis=1) for v in values], axis=0).tolist()
        return front, rear

    return Seen(
        bump=largest([-run.deflection for run in runs]),
        droop=largest([run.deflection for run in runs]),
        rate=largest([np.abs(run.deflection_rate) for run in runs]),
    )


def as_recording(run: RigRun, name: str) -> Recording:
    """What a logger would have written; the name says nothing about what was driven."""
    return Recording(run.time, run.channels, ("m/s^2",) * 4, (), name)
