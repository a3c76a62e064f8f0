"""Drives of the rig, and trackers that have processed them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.tracking.frames import Frames, concatenate
from bayes_asv.tracking.tracker import Tracker, tracker_for
from tests.posterior.cases import DECLARED, as_recording, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    FadingDamper,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
    with_terms,
)

Array = NDArray[np.float64]


@lru_cache(maxsize=8)
def long_drive(
    seconds: float,
    seed: int,
    loss: float = 0.0,
    fade: float = 20.0,
    terrain: str = "rough",
    rate: float = 400.0,
) -> tuple[RigCar, Recording]:
    """A drive of a car drawn around the baja; its front damper may lose a share of its rate."""
    rng = np.random.default_rng([seed, 91])
    car = draw(baja(), rng, DECLARED)
    driven = car
    if loss:
        driven = with_terms(car, "front", FadingDamper(car.c_f, loss, fade), damper=False)
    sensors = draw_biases(SensorSpec(), rng)
    run = drive(
        driven, TERRAINS[terrain](seed), DEFAULT_SPEEDS[terrain], rate, seconds, sensors, seed
    )
    return car, as_recording(run, f"{terrain}-{seed}.csv")


def faded(time: Array, loss: float, fade: float) -> Array:
    """Share of its rate that a fading damper of the rig has left at times (s)."""
    through = np.clip(time / fade, 0.0, 1.0)
    return np.asarray(1.0 - loss * (1.0 - np.exp(-3.0 * through)) / (1.0 - np.exp(-3.0)))


def tracked(
    recording: Recording,
    car: Vehicle | None = None,
    *,
    chunk: int = 2048,
    forget: float | None = None,
    engine: str = "compiled",
) -> tuple[Tracker, Frames]:
    """A tracker that has processed a recording, and its frames."""
    car = vehicle(DECLARED) if car is None else car
    tracker = tracker_for(recording, car, forget=forget, engine=engine)
    acc = accelerations(recording, car).T
    parts = [
        tracker.feed(recording.time[k : k + chunk], acc[k : k + chunk])
        for k in range(0, len(recording.time), chunk)
    ]
    return tracker, concatenate([*parts, tracker.finish()])


def with_values(recording: Recording, values: Array) -> Recording:
    """The same recording with other readings, in its units."""
    return replace(recording, values=values)


def true_parameters(car: RigCar) -> Array:
    """True c_f, c_r and i, SI units."""
    return np.array([car.c_f, car.c_r, car.i])


def z_scores(frames: Frames, car: RigCar, row: int = -1) -> Array:
    """Errors of the logarithms in stated standard deviations, (3,)."""
    return np.asarray(np.log(frames.median[row] / true_parameters(car)) / frames.log_sd[row])
