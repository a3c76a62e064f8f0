"""The cells of the set, and how a case is drawn."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import numpy as np

from .blueprint import Blueprint, Spans, hull, point
from .disguise import left_by_each, told
from .kinds import (
    AXLES,
    CHANNELS,
    Drawn,
    Fault,
    Run,
    Span,
    Truth,
    UnreachableError,
    Vector,
)
from .listed import LISTED_FORMS, listed_fault
from .outside_car import CAR_FAULTS
from .outside_load import LOAD_FAULTS
from .outside_logging import LOGGING_FAULTS
from .outside_sensing import SENSING_FAULTS, crosstalk
from .scene import Scene, Wish, draw_scene
from .sizing import Built, Sized, build, sized
from .suspension import FORMS, suspension_fault
from .tolerance import tolerances

__all__ = ["CELLS", "PAIRS", "SEED", "make"]

SEED = 260_819_377
"""Seed of the whole set."""

ATTEMPTS = 80
LISTED: dict[str, tuple[str, ...]] = {**FORMS, **LISTED_FORMS}
OUTSIDE = {**CAR_FAULTS, **LOAD_FAULTS, **SENSING_FAULTS, **LOGGING_FAULTS}
LASTING = ("gravel", "stone field", "pump track", "patched lane")

LEAST_APART = 40.0
"""Squared distance of an unlisted fault from every listed effect, at least."""

PAIRS: tuple[tuple[tuple[str, str], tuple[str, str]], ...] = (
    (("bound_rebound", "rear"), ("digressive_damper", "front")),
    (("coulomb_friction", "rear"), ("progressive_spring", "front")),
    (("bump_stop", "rear"), ("coulomb_friction", "front")),
    (("damper_fade", "front"), ("bound_rebound", "rear")),
    (("sensor_gain", "front_chassis"), ("coulomb_friction", "rear")),
    (("external_force", "rear"), ("progressive_spring", "front")),
    (("engine_vibration", ""), ("bump_stop", "front")),
    (("droop_stop", "front"), ("bound_rebound", "rear")),
    (("spring_rate", "rear"), ("coulomb_friction", "front")),
    (("clock_offset", "front"), ("bound_rebound", "rear")),
    (("damper_hysteresis", "rear"), ("progressive_spring", "front")),
    (("weight_distribution", ""), ("coulomb_friction", "rear")),
    (("sensor_lag", "front_wheel"), ("damper_fade", "rear")),
    (("sensor_bandwidth", "rear_chassis"), ("progressive_spring", "front")),
    (("external_force", "front"), ("sensor_drift", "rear_wheel")),
    (("bump_stop", "front"), ("droop_stop", "rear")),
    (("digressive_damper", "both"), ("sensor_drift", "front_chassis")),
    (("clock_offset", "body"), ("coulomb_friction", "front")),
    (("sensor_lag", "rear_chassis"), ("sensor_gain", "front_wheel")),
    (("engine_vibration", ""), ("bound_rebound", "both")),
)
"""Two faults each that act at different places or in different ways."""

CELLS: dict[str, int] = {
    "null": 600,
    "null-ten-bits": 40,
    "null-noisier": 40,
    "null-quieter": 40,
    "tolerance": 60,
    **{f"single:{name}": 10 for name in LISTED},
    "pair": 40,
    **{f"outside:{name}": 5 for name in OUTSIDE},
    "crosstalk": 10,
}
"""Cells and the number of cases of each in the full set."""

FACTORS = {"null-noisier": 1.2, "null-quieter": 0.8}


def _place(name: str, number: int) -> str:
    """Place of a fault in the case of a number, such that each form is met at several places."""
    places: tuple[str, ...] = (*AXLES, *AXLES, "both")
    if name.startswith("sensor_"):
        places = CHANNELS
    elif name == "clock_offset":
        places = ("body", "front")
    elif name in ("bump_stop", "droop_stop", "spring_rate"):
        places = AXLES
    forms = len(LISTED[name])
    turn = number if math.gcd(forms, len(places)) == 1 else number + number // forms
    return places[turn % len(places)]


def _blueprint(
    name: str, scene: Scene, where: str, form: str, rng: np.random.Generator
) -> Blueprint:
    make_one = suspension_fault if name in FORMS else listed_fault
    return make_one(name, scene, where, form, rng)


def _wish(names: Sequence[str], bits: int | None = None) -> Wish:
    roads = LASTING if "damper_fade" in names else ()
    lively = any(name in LISTED for name in names)
    return Wish(roads, "sensor_bandwidth" in names, bits, lively)


def _pair(
    scene: Scene, number: int, rng: np.random.Generator
) -> tuple[list[Sized], Built, tuple[float, ...]]:
    """Two faults of sizes that are right alone, what they do together, and strengths alone."""
    found = []
    for name, where in PAIRS[number % len(PAIRS)]:
        form = LISTED[name][int(rng.integers(len(LISTED[name])))]
        part = _blueprint(name, scene, where, form, rng)
        one = sized(scene, part, (100.0, 4000.0), rng)
        if not told(scene, one.built, name, part.where):
            raise UnreachableError
        found.append(one)
    both = build(scene, [(s.blueprint, s.size) for s in found])
    alone = tuple(s.built.strength for s in found)
    if both.strength - max(alone) < 0.5 * min(alone):
        raise UnreachableError
    return [Sized(s.blueprint, s.size, both) for s in found], both, alone


def _draw_faults(
    cell: str, number: int, rng: np.random.Generator
) -> tuple[Scene, list[Sized], Built, tuple[float, ...]]:
    """Return a scene with the faults of a cell."""
    kind, _, name = cell.partition(":")
    if kind == "single":
        scene = draw_scene(rng, _wish([name]))
        form = LISTED[name][number % len(LISTED[name])]
        part = _blueprint(name, scene, _place(name, number), form, rng)
        one = sized(scene, part, (40.0, 4000.0), rng)
        if not told(scene, one.built, name, part.where):
            raise UnreachableError
        return scene, [one], one.built, (one.built.strength,)
    if kind == "outside":
        scene = draw_scene(rng, Wish())
        one = sized(scene, OUTSIDE[name](scene, rng), (100.0, 4000.0), rng)
        if left_by_each(scene, one.built)[0].left < LEAST_APART:
            raise UnreachableError
        return scene, [one], one.built, (one.built.strength,)
    if kind == "pair":
        names = [n for n, _ in PAIRS[number % len(PAIRS)]]
        scene = draw_scene(rng, _wish(names))
        return scene, *_pair(scene, number, rng)
    scene = draw_scene(rng, Wish(bits=10 if cell == "null-ten-bits" else None))
    if kind == "crosstalk":
        part, size = crosstalk(scene, rng)
    elif kind == "tolerance":
        part, size = tolerances(scene, rng), 1.0
    else:
        return scene, [], build(scene, []), ()
    built = build(scene, [(part, size)])
    return scene, [Sized(part, size, built)], built, (built.strength,)


def _joined(spans: Sequence[Span | None], value: float) -> Span:
    """Span of a damping rate: what the faults leave open, or its value."""
    known = [x for span in spans if span is not None for x in span]
    return hull(*known, value) if known else point(value)


def _recorded(
    scene: Scene, built: Built, rng: np.random.Generator, factor: float
) -> tuple[list[Run], list[Vector]]:
    """Return the three runs as the logger writes them; refuses readings beyond a sensor's range."""
    runs, pure = [], []
    for number, motion in enumerate(built.motions):
        pure.append(scene.pure(motion, number, built.sensing))
        for column, channel in enumerate(CHANNELS):
            sensor = scene.declared.sensors[channel]
            if float(np.max(np.abs(pure[-1][:, column]))) > 0.93 * sensor.limit - 0.5:
                raise UnreachableError
        rows = scene.noisy(motion, number, rng, factor, built.sensing)
        channels = {channel: rows[:, n].copy() for n, channel in enumerate(CHANNELS)}
        runs.append(Run(scene.times[number].copy(), channels))
    return runs, pure


def make(cell: str, number: int) -> Drawn:
    """Draw a case; the same cell and number always give the same case."""
    if cell not in CELLS:
        message = f"no such cell: {cell}"
        raise KeyError(message)
    key = zlib.crc32(cell.encode())
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([SEED, key, number, attempt])
        try:
            scene, found, built, alone = _draw_faults(cell, number, rng)
            factor = FACTORS.get(cell, 1.0)
            runs, _ = _recorded(scene, built, rng, factor)
        except UnreachableError:
            continue
        spans: list[Spans] = [s.blueprint.spans(s.outcome) for s in found]
        faults = tuple(
            Fault(s.blueprint.name, s.blueprint.where, span.parameters)
            for s, span in zip(found, spans, strict=True)
            if s.blueprint.name != "tolerance"
        )
        car = scene.car
        truth = Truth(
            cell,
            number,
            scene.family,
            scene.profiles[0].kind,
            faults,
            _joined([s.c_f for s in spans], car.c[0]),
            _joined([s.c_r for s in spans], car.c[1]),
            point(car.i),
            factor,
            built.strength if found else 0.0,
            " + ".join(s.blueprint.form for s in found),
            alone,
            scene.profiles[1].kind,
        )
        return Drawn(tuple(runs[:2]), (runs[2],), built.declared.toml(), truth)
    message = f"{cell} {number}: no scene shows this fault in {ATTEMPTS} attempts"
    raise RuntimeError(message)
