"""Cases of the battery: ``case(name, seed, number)`` makes recordings, vehicle and truth.

A case is a car whose parameters are known only approximately, on three drives: two over one terrain
to fit, one over another to hold out.  Its truth says which fault it has, where and how large; see
:mod:`tests.battery.names` for the names.
"""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from tests.battery.drives import (
    TERRAIN_NAMES,
    Drive,
    as_recording,
    draw_drives,
    motion_range,
    scale_drives,
    simulate_drive,
)
from tests.battery.effects import EFFECTS, SECONDS, draw_effect, places
from tests.battery.equivalent_damping import equivalent, paths
from tests.battery.names import Name, parse
from tests.battery.strength import find_size, frozen_distance, whitened_distance
from tests.battery.tolerances import with_tolerances
from tests.battery.truth import TrueEffect, Truth
from tests.battery.unlisted_faults import UNLISTED_FAULTS
from tests.battery.vehicles import FAMILIES, Fleet, nominal_car
from tests.battery.world import Effect, MotionRange, World, axles
from tests.rig import DECLARED_SDS, Adc, RigCar, SensorSpec, draw, draw_biases, vehicle_toml

__all__ = ["Case", "TrueEffect", "Truth", "case", "declared", "make_case"]

_NOISE = (0.5, 1.0, 2.0)
_DATA_SHEET = 0.534  # noise of the 2008 car's sensors over the usual one
_TRUE_NOISE = {"noisier": 1.2, "quieter": 0.8}  # true over declared noise
_GIVEN = {"spring_rate": ("k_f", "k_r"), "weight_distribution": ("wdf",)}
_CAR = ("c_f", "c_r", "i", "m", "l", "wdf", "k_f", "k_r")
_LIFTING_RANGE = 4.0  # sensor range over the usual one, for tyres that leave the ground
_BITS_12_OVER_10 = 4.0  # steps of a 12-bit converter in one of a 10-bit one
_HEIGHT_STEP = 1.15  # factor between two trials to lift a tyre


@dataclass(frozen=True)
class Case:
    """A case with its truth.

    Parameters
    ----------
    recordings, holdout : tuple of Recording
        Runs to fit, and held-out runs.
    vehicle : Vehicle
        As the team declares it.
    truth : Truth
        For the judge only.
    """

    recordings: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    vehicle: Vehicle
    truth: Truth


@dataclass(frozen=True)
class _Scene:
    """A drawn car on its drives, without a fault."""

    world: World
    vehicle: Vehicle
    drives: tuple[Drive, ...]
    held_out: tuple[Drive, ...]
    motion_range: MotionRange
    family: str
    noise: float


@lru_cache(maxsize=64)
def case(name: str, seed: int = 1, number: int = 0, fleet: Fleet = "dev") -> Case:
    """Return a case from the cache or from :func:`make_case`, with the same arguments."""
    return make_case(name, seed, number, fleet)


def make_case(
    name: str,
    seed: int = 1,
    number: int = 0,
    fleet: Fleet = "dev",
    sizes: tuple[TrueEffect, ...] | None = None,
) -> Case:
    """Make a case; reproducible from its arguments.

    Parameters
    ----------
    name : str
        See :mod:`tests.battery.names`.
    seed, number : int
        Seed of the battery, and number of the case of that name.
    fleet : {'dev', 'test'}
        Set of vehicle families.
    sizes : tuple of TrueEffect, optional
        Effects of an earlier call, which spare the search for their sizes.

    Returns
    -------
    Case

    Raises
    ------
    ValueError
        If the name is invalid.
    """
    parsed = parse(name)
    rng = np.random.default_rng([seed, zlib.crc32(f"{fleet} {name}".encode()), number])
    wanted = _draw_places(parsed, rng)
    scene = _scene(parsed, number, fleet, rng, [n for n, _ in wanted])
    effects = [_effect(n, where, rng, scene) for n, where in wanted]
    true = sizes or tuple(_at_strength(effect, parsed.strength, scene) for effect in effects)
    world = scene.world
    if "clutter" in (parsed.kind, parsed.modifier):
        world = with_tolerances(
            world, rng, scene.motion_range.rate, scene.motion_range.travel, SECONDS
        )
    worlds = _worlds(world, effects, [one.size for one in true], len(scene.drives))
    meant = _equivalent_rates(scene, worlds, true, parsed)
    with_noise = [
        replace(w, sensors=_with_noise(w.sensors, _TRUE_NOISE.get(parsed.modifier, 1.0)))
        for w in worlds
    ]
    runs = [
        simulate_drive(replace(w, sensors=draw_biases(w.sensors, rng)), planned)
        for w, planned in zip(with_noise, (*scene.drives, *scene.held_out), strict=True)
    ]
    fitted, held = runs[: len(scene.drives)], runs[len(scene.drives) :]
    truth = Truth(
        name=name,
        seed=seed,
        number=number,
        fleet=fleet,
        kind=_kind(parsed),
        modifier=parsed.modifier,
        strength=parsed.strength,
        effects=tuple(true),
        car={key: getattr(scene.world.car, key) for key in _CAR},
        meant=meant,
        terrain=scene.drives[0].terrain,
        held_out=scene.held_out[0].terrain,
        family=scene.family,
        noise=scene.noise,
        clipped=sum(int(run.clipped.sum()) for run in runs),
        lifted=any(any(run.truth["tyres_lifted"]) for run in runs),
    )
    return Case(
        recordings=tuple(as_recording(run, f"run-{k + 1}.csv") for k, run in enumerate(fitted)),
        holdout=tuple(as_recording(run, f"held-out-{k + 1}.csv") for k, run in enumerate(held)),
        vehicle=scene.vehicle,
        truth=truth,
    )


def _kind(parsed: Name) -> str:
    if parsed.kind in EFFECTS:
        return "single"
    return "outside" if parsed.kind in UNLISTED_FAULTS else parsed.kind


def _draw_places(parsed: Name, rng: np.random.Generator) -> list[tuple[str, str]]:
    """Names and places of the faults."""

    def placed(kind: str) -> tuple[str, str]:
        return kind, parsed.where or str(rng.choice(places(kind)))

    if parsed.kind in EFFECTS:
        return [placed(parsed.kind)]
    if parsed.kind in UNLISTED_FAULTS:
        return [(parsed.kind, "")]
    if parsed.kind == "single":
        return [placed(str(rng.choice(list(EFFECTS))))]
    if parsed.kind == "outside":
        return [(str(rng.choice(list(UNLISTED_FAULTS))), "")]
    while parsed.kind == "pair":
        one, two = (placed(str(n)) for n in rng.choice(list(EFFECTS), 2, replace=False))
        if _apart(one, two):
            return [one, two]
    return []


_LAWS = (
    ("bound_rebound", "digressive_damper", "damper_fade"),
    ("progressive_spring", "spring_rate", "bump_stop", "droop_stop"),
)


def _apart(one: tuple[str, str], two: tuple[str, str]) -> bool:
    """Whether the parameters of two effects keep their meaning when both are present."""
    same_law = any(one[0] in law and two[0] in law for law in _LAWS)
    return not same_law or (one[1] != two[1] and "both" not in (one[1], two[1]))


def _scene(
    parsed: Name, number: int, fleet: Fleet, rng: np.random.Generator, wrong: Sequence[str]
) -> _Scene:
    families = FAMILIES[fleet]
    if parsed.family and parsed.family not in families:
        raise ValueError(f"'{parsed.family}' is none of {', '.join(families)}")
    family = parsed.family or str(rng.choice(list(families)))
    terrain = parsed.terrain or TERRAIN_NAMES[number % len(TERRAIN_NAMES)]
    held_out = str(rng.choice([t for t in TERRAIN_NAMES if t != terrain]))
    noise = float(rng.choice(_NOISE))
    nominal = nominal_car(families[family], rng)
    car = draw(nominal, rng)
    for name in wrong:  # a factor refers to the given value
        car = replace(car, **{key: getattr(nominal, key) for key in _GIVEN.get(name, ())})
    noise = noise if parsed.kind != "coarse" else _DATA_SHEET
    world = World(car, _sensors(noise, coarse=parsed.kind == "coarse"))
    drives = draw_drives(terrain, held_out, rng)
    lowered = scale_drives(world, drives, families[family].travel, rng)
    if parsed.kind == "lifting":
        world, lowered = _lifting(world, lowered)
    return _Scene(
        world=world,
        vehicle=declared(nominal, world.sensors),
        drives=lowered[:2],
        held_out=lowered[2:],
        motion_range=motion_range(world, lowered[:2]),
        family=family,
        noise=noise,
    )


def _lifting(world: World, drives: Sequence[Drive]) -> tuple[World, tuple[Drive, ...]]:
    """Raise the terrain until every run lifts a tyre, with sensors of sufficient range."""
    adc = world.sensors.adc
    assert adc is not None
    a, b, c, d = (_LIFTING_RANGE * scale for scale in adc.scale)
    world = replace(world, sensors=replace(world.sensors, adc=replace(adc, scale=(a, b, c, d))))
    out = []
    for planned in drives:
        while not any(simulate_drive(world, planned, noise_free=True).truth["tyres_lifted"]):
            planned = replace(planned, height=_HEIGHT_STEP * planned.height)
        out.append(planned)
    return world, tuple(out)


def declared(nominal: RigCar, sensors: SensorSpec) -> Vehicle:
    """Vehicle as the team declares it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(vehicle_toml(nominal, sensors, DECLARED_SDS), encoding="utf-8")
        return replace(read_vehicle(path), source="car.toml")


def _effect(name: str, where: str, rng: np.random.Generator, scene: _Scene) -> Effect:
    if name in EFFECTS:
        return draw_effect(name, where, rng, scene.motion_range, scene.world.car)
    return UNLISTED_FAULTS[name](where, rng, scene.motion_range, scene.world.car)


def _worlds(
    world: World, effects: Sequence[Effect], sizes: Sequence[float], fitted: int
) -> list[World]:
    """World of each fitted run and of the held-out one; effects of one run are in that only."""
    out = []
    for run in range(fitted + 1):
        own = world
        for effect, size in zip(effects, sizes, strict=True):
            if effect.run is None or effect.run == run:
                own = effect.change(own, size)
        out.append(own)
    return out


def _at_strength(effect: Effect, strength: float, scene: _Scene) -> TrueEffect:
    """Find the size at which an effect has its strength, alone on a car without other faults."""
    where = (*scene.drives, *scene.held_out)
    fitted = len(scene.drives)
    plain = [scene.world] * len(where)

    def noise_free(worlds: Sequence[World], runs: slice) -> list[Recording]:
        pairs = zip(worlds[runs], where[runs], strict=True)
        return [
            as_recording(simulate_drive(w, planned, noise_free=True), "") for w, planned in pairs
        ]

    to_fit, to_hold = slice(0, fitted), slice(fitted, None)
    clean, start = whitened_distance(noise_free(plain, to_fit), scene.vehicle)

    def loss(size: float) -> float:
        worlds = _worlds(scene.world, [effect], [size], fitted)
        return whitened_distance(noise_free(worlds, to_fit), scene.vehicle, start)[0] - clean

    reached = find_size(loss, strength, effect.first * (strength / 10.0) ** 0.5, effect.largest)
    worlds = _worlds(scene.world, [effect], [reached.size], fitted)
    linear = whitened_distance(noise_free(worlds, to_fit), scene.vehicle, start)[1]
    before = frozen_distance(noise_free(plain, to_hold), scene.vehicle, start)
    after = frozen_distance(noise_free(worlds, to_hold), scene.vehicle, linear)
    return TrueEffect(
        name=effect.name,
        where=effect.where,
        parameters=effect.parameters(reached.size),
        size=reached.size,
        tolerance=effect.tolerance,
        noncentrality=reached.noncentrality,
        held_out=max(after - before, 0.0),
        run=effect.run,
    )


def _equivalent_rates(
    scene: _Scene, worlds: Sequence[World], true: Sequence[TrueEffect], parsed: Name
) -> dict[str, tuple[float, float]]:
    """True c_f, c_r and i as spans; see :mod:`tests.battery.equivalent_damping`."""
    car = scene.world.car
    out = {key: (getattr(car, key),) * 2 for key in ("c_f", "c_r", "i")}
    cluttering = "clutter" in (parsed.kind, parsed.modifier)
    if _kind(parsed) == "outside" or not (cluttering or true):
        return out
    pairs = zip(worlds, scene.drives, strict=False)
    both = paths(
        [
            simulate_drive(world, planned, noise_free=True, keep_motion=True)
            for world, planned in pairs
        ],
        SECONDS,
    )
    for key, path, axle in zip(("c_f", "c_r"), both, axles("both"), strict=True):
        on_axle = [one for one in true if axle in one.where or one.where == "both"]
        k = car.k_f if axle == "front" else car.k_r
        for one in on_axle:
            if one.name == "spring_rate":
                k *= one.parameters["factor"]
        c = getattr(car, key)
        written = equivalent([one.name for one in on_axle], path, c, k)
        out[key] = (min(c, written), max(c, written))
    return out


def _sensors(noise: float, *, coarse: bool = False) -> SensorSpec:
    """Sensors as declared; with less than the usual noise a 12-bit converter, unless coarse.

    The steps of 10 bits exceed half of the usual noise, and a parked car may read a constant count:
    an error that is not noise.
    """
    spec = _with_noise(SensorSpec(), noise)
    if coarse or noise >= 1.0 or spec.adc is None:
        return spec
    ten = spec.adc
    a, b, c, d = (_BITS_12_OVER_10 * zero for zero in ten.zero)
    e, f, g, h = (scale / _BITS_12_OVER_10 for scale in ten.scale)
    return replace(
        spec, adc=Adc((a, b, c, d), (e, f, g, h), int(_BITS_12_OVER_10) * (ten.top + 1) - 1)
    )


def _with_noise(spec: SensorSpec, factor: float) -> SensorSpec:
    a, b, c, d = (factor * level for level in spec.noise)
    return replace(spec, noise=(a, b, c, d))
