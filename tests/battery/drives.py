"""Drives of a case: two over one terrain to fit, one over another to hold out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from tests.battery.effects import SECONDS
from tests.battery.world import MotionRange, World
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
    "draw_drives",
    "motion_range",
    "scale_drives",
    "simulate_drive",
]

Reals = NDArray[np.float64]

RATE: Final = 400.0
TERRAIN_NAMES: Final = ("bump", "stops", "rough", "rollers")

_USABLE_RANGE: Final = 0.8  # share of a sensor's range that a drive may use
_FILL: Final = (0.65, 1.0)  # share of the usable range that a run is scaled to
_MAX_HEIGHT: Final = 2.0  # over the usual height
_ROUNDS: Final = 5
_HOLDOUT_TRAVEL: Final = 1.2  # largest, over that of the fitted runs
_SPEEDS: Final = ((0.8, 0.95), (0.95, 1.15))  # of the fitted runs, over the usual speed


@dataclass(frozen=True)
class Drive:
    """Plan of one run.

    Parameters
    ----------
    terrain : str
        One of :data:`TERRAIN_NAMES`.
    height : float
        Over the terrain's usual height.
    speed : float
        m/s.
    road_seed, run_seed : int
        Seeds of a random road and of the noise.
    """

    terrain: str
    height: float
    speed: float
    road_seed: int
    run_seed: int

    def ground(self) -> Terrain:
        """Return the terrain."""
        f = self.height
        if self.terrain == "bump":
            return bump(f * 3.5 * INCH)
        if self.terrain == "stops":
            return parking_stops(f * 3.25 * INCH)
        if self.terrain == "rollers":
            return rollers(f * 2.25 * INCH)
        return rough_road(self.road_seed, factor=f**2)


def draw_drives(
    terrain: str, held_out: str, rng: np.random.Generator
) -> tuple[Drive, Drive, Drive]:
    """Draw speeds and seeds of two runs over one terrain and of one over another."""

    def one(name: str, low: float, high: float) -> Drive:
        speed = DEFAULT_SPEEDS[name] * float(rng.uniform(low, high))
        road, noise = (int(v) for v in rng.integers(2**31, size=2))
        return Drive(name, 1.0, speed, road, noise)

    slow, fast = (one(terrain, *span) for span in _SPEEDS)
    return slow, fast, one(held_out, 0.85, 1.1)


def simulate_drive(
    world: World, planned: Drive, noise_free: bool = False, keep_motion: bool = False
) -> RigRun:
    """Simulate one run, optionally without noise, converter and biases, or with its motion."""
    sensors = world.sensors
    if noise_free:
        none = (0.0, 0.0, 0.0, 0.0)
        sensors = replace(sensors, noise=none, bias=none, adc=None)
    return drive(
        world.car, planned.ground(), planned.speed, RATE, SECONDS, sensors, planned.run_seed,
        forces=world.forces, mountings=world.mountings, keep_motion=keep_motion,
    )  # fmt: skip


def scale_drives(
    world: World, drives: Sequence[Drive], travel: float, rng: np.random.Generator
) -> tuple[Drive, ...]:
    """Scale the height of each run until a drawn share of the usable range is used.

    The range is that of the suspension's travel or of the sensors, whichever is smaller.  The last
    run, which is held out, travels at most a fifth farther than the others on either axle: the
    fitted runs do not determine what a suspension does beyond their travel.
    """
    out: list[Drive] = []
    farthest = np.zeros(2)
    for planned in drives:
        fill = float(rng.uniform(*_FILL))
        limits = np.full(2, travel)
        if planned is drives[-1]:
            limits = np.minimum(limits, _HOLDOUT_TRAVEL * farthest / fill)
        for look in range(_ROUNDS):
            use, far = _room_used(
                simulate_drive(world, planned, noise_free=True), world.sensors, limits
            )
            # nearly linear in the height; a lifting tyre needs further rounds
            if look and use <= 1.0:
                break
            planned = replace(planned, height=min(planned.height * fill / use, _MAX_HEIGHT))
        farthest = np.maximum(farthest, far)
        out.append(planned)
    return tuple(out)


def _room_used(run: RigRun, sensors: SensorSpec, limits: Reals) -> tuple[float, Reals]:
    """Share of the usable range that a run takes, and its travel on either axle, m."""
    adc = sensors.adc
    assert adc is not None
    zero, scale = np.array(adc.zero), np.array(adc.scale)
    above = run.clean.max(axis=1) / (_USABLE_RANGE * (adc.top - zero) * scale)
    below = -run.clean.min(axis=1) / (_USABLE_RANGE * zero * scale)
    far = np.abs(run.deflection).max(axis=1)
    return float(max(above.max(), below.max(), (far / limits).max())), far


def motion_range(world: World, drives: Sequence[Drive]) -> MotionRange:
    """Return the range of motion of some drives."""
    runs = [simulate_drive(world, planned, noise_free=True) for planned in drives]

    def largest(values: list[Reals]) -> tuple[float, float]:
        front, rear = np.max([v.max(axis=1) for v in values], axis=0).tolist()
        return front, rear

    return MotionRange(
        bump=largest([-run.deflection for run in runs]),
        droop=largest([run.deflection for run in runs]),
        rate=largest([np.abs(run.deflection_rate) for run in runs]),
    )


def as_recording(run: RigRun, name: str) -> Recording:
    """Return a recording as a logger writes it; its name does not reveal the drive."""
    return Recording(run.time, run.channels, ("m/s^2",) * 4, (), name)
