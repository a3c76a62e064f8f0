"""Cases of the battery: ``case(name, seed, number)`` gives recordings, vehicle and the answer.

A case is a car that nobody knows exactly, driven three times: twice over one terrain to fit, once
over another to hold out.  What is wrong with it, where and how strongly, stands in its truth; see
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
from tests.battery.clutter import cluttered
from tests.battery.courses import (
    TERRAIN_NAMES,
    Drive,
    as_recording,
    driven,
    fitting_drives,
    plan,
    seen,
)
from tests.battery.effects import EFFECTS, SECONDS, draw_effect, places
from tests.battery.meaning import equivalent, paths
from tests.battery.names import Name, parse
from tests.battery.outside import OUTSIDE
from tests.battery.strength import carried, left_over, scaled
from tests.battery.truth import TrueEffect, Truth
from tests.battery.vehicles import FAMILIES, Fleet, nominal_car
from tests.battery.world import Effect, Seen, World, axles
from tests.rig import DECLARED_SDS, Adc, RigCar, SensorSpec, draw, draw_biases, vehicle_toml

__all__ = ["Case", "TrueEffect", "Truth", "case", "declared", "make_case"]

_NOISE = (0.5, 1.0, 2.0)
_DATA_SHEET = 0.534  # times the usual noise, of the 2008 car's sensors
_TRULY = {"noisier": 1.2, "quieter": 0.8}  # true noise over what is declared
_GIVEN = {"spring_rate": ("k_f", "k_r"), "weight_distribution": ("wdf",)}
_CAR = ("c_f", "c_r", "i", "m", "l", "wdf", "k_f", "k_r")
_SENSOR_RANGE = 4.0  # times the usual one, where tyres are to leave the ground
_FINER = 4.0  # steps of a 12-bit converter in one of 10 bits
_HIGHER = 1.15  # from one look at a lifting tyre to the next


@dataclass(frozen=True)
class Case:
    """A case with its answer.

    Parameters
    ----------
    recordings, holdout : tuple of Recording
        Runs to fit, and runs that are held out.
    vehicle : Vehicle
        What the team says.
    truth : Truth
        What nobody but the judge may see.
    """

    recordings: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    vehicle: Vehicle
    truth: Truth


@dataclass(frozen=True)
class _Scene:
    """A drawn car on its drives, with nothing wrong yet."""

    world: World
    vehicle: Vehicle
    drives: tuple[Drive, ...]
    held_out: tuple[Drive, ...]
    seen: Seen
    family: str
    noise: float


@lru_cache(maxsize=64)
def case(name: str, seed: int = 1, number: int = 0, fleet: Fleet = "dev") -> Case:
    """Make a case, or give the one that was made; arguments as for :func:`make_case`."""
    return make_case(name, seed, number, fleet)


def make_case(
    name: str,
    seed: int = 1,
    number: int = 0,
    fleet: Fleet = "dev",
    sizes: tuple[TrueEffect, ...] | None = None,
) -> Case:
    """Make a case; the same arguments give the same one.

    Parameters
    ----------
    name : str
        See :mod:`tests.battery.names`.
    seed, number : int
        Of the battery, and which case of that name.
    fleet : {'dev', 'test'}
        Whose vehicles.
    sizes : tuple of TrueEffect, optional
        What an earlier call found; spares the search for the effects' sizes.

    Returns
    -------
    Case

    Raises
    ------
    ValueError
        When the name is none.
    """
    what = parse(name)
    rng = np.random.default_rng([seed, zlib.crc32(f"{fleet} {name}".encode()), number])
    wanted = _wanted(what, rng)
    scene = _scene(what, number, fleet, rng, [n for n, _ in wanted])
    effects = [_effect(n, where, rng, scene) for n, where in wanted]
    found = sizes or tuple(_found(effect, what.strength, scene) for effect in effects)
    world = scene.world
    if "clutter" in (what.kind, what.modifier):
        world = cluttered(world, rng, scene.seen.rate, scene.seen.travel, SECONDS)
    worlds = _worlds(world, effects, [one.size for one in found], len(scene.drives))
    meant = _meant(scene, worlds, found, what)
    loud = [replace(w, sensors=_louder(w.sensors, _TRULY.get(what.modifier, 1.0))) for w in worlds]
    runs = [
        driven(replace(w, sensors=draw_biases(w.sensors, rng)), how)
        for w, how in zip(loud, (*scene.drives, *scene.held_out), strict=True)
    ]
    fitted, held = runs[: len(scene.drives)], runs[len(scene.drives) :]
    truth = Truth(
        name=name,
        seed=seed,
        number=number,
        fleet=fleet,
        kind=_kind(what),
        modifier=what.modifier,
        strength=what.strength,
        effects=tuple(found),
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


def _kind(what: Name) -> str:
    if what.kind in EFFECTS:
        return "single"
    return "outside" if what.kind in OUTSIDE else what.kind


def _wanted(what: Name, rng: np.random.Generator) -> list[tuple[str, str]]:
    """Names and places of what is to be wrong."""

    def placed(kind: str) -> tuple[str, str]:
        return kind, what.where or str(rng.choice(places(kind)))

    if what.kind in EFFECTS:
        return [placed(what.kind)]
    if what.kind in OUTSIDE:
        return [(what.kind, "")]
    if what.kind == "single":
        return [placed(str(rng.choice(list(EFFECTS))))]
    if what.kind == "outside":
        return [(str(rng.choice(list(OUTSIDE))), "")]
    while what.kind == "pair":
        one, two = (placed(str(n)) for n in rng.choice(list(EFFECTS), 2, replace=False))
        if _apart(one, two):
            return [one, two]
    return []


_LAWS = (
    ("bound_rebound", "digressive_damper", "damper_fade"),
    ("progressive_spring", "spring_rate", "bump_stop", "droop_stop"),
)


def _apart(one: tuple[str, str], two: tuple[str, str]) -> bool:
    """Whether two effects keep the meaning of their parameters when both are there."""
    same_law = any(one[0] in law and two[0] in law for law in _LAWS)
    return not same_law or (one[1] != two[1] and "both" not in (one[1], two[1]))


def _scene(
    what: Name, number: int, fleet: Fleet, rng: np.random.Generator, wrong: Sequence[str]
) -> _Scene:
    families = FAMILIES[fleet]
    if what.family and what.family not in families:
        raise ValueError(f"'{what.family}' is none of {', '.join(families)}")
    family = what.family or str(rng.choice(list(families)))
    terrain = what.terrain or TERRAIN_NAMES[number % len(TERRAIN_NAMES)]
    held_out = str(rng.choice([t for t in TERRAIN_NAMES if t != terrain]))
    noise = float(rng.choice(_NOISE))
    nominal = nominal_car(families[family], rng)
    car = draw(nominal, rng)
    for name in wrong:  # a factor is meant on the given value
        car = replace(car, **{key: getattr(nominal, key) for key in _GIVEN.get(name, ())})
    noise = noise if what.kind != "coarse" else _DATA_SHEET
    world = World(car, _sensors(noise, coarse=what.kind == "coarse"))
    drives = plan(terrain, held_out, rng)
    lowered = fitting_drives(world, drives, families[family].travel, rng)
    if what.kind == "lifting":
        world, lowered = _lifting(world, lowered)
    return _Scene(
        world=world,
        vehicle=declared(nominal, world.sensors),
        drives=lowered[:2],
        held_out=lowered[2:],
        seen=seen(world, lowered[:2]),
        family=family,
        noise=noise,
    )


def _lifting(world: World, drives: Sequence[Drive]) -> tuple[World, tuple[Drive, ...]]:
    """Raise the ground until every run lifts a tyre, and give the sensors the range for it."""
    adc = world.sensors.adc
    assert adc is not None
    a, b, c, d = (_SENSOR_RANGE * scale for scale in adc.scale)
    world = replace(world, sensors=replace(world.sensors, adc=replace(adc, scale=(a, b, c, d))))
    out = []
    for how in drives:
        while not any(driven(world, how, quiet=True).truth["tyres_lifted"]):
            how = replace(how, height=_HIGHER * how.height)
        out.append(how)
    return world, tuple(out)


def declared(nominal: RigCar, sensors: SensorSpec) -> Vehicle:
    """Vehicle file of what the team believes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(vehicle_toml(nominal, sensors, DECLARED_SDS), encoding="utf-8")
        return replace(read_vehicle(path), source="car.toml")


def _effect(name: str, where: str, rng: np.random.Generator, scene: _Scene) -> Effect:
    if name in EFFECTS:
        return draw_effect(name, where, rng, scene.seen, scene.world.car)
    return OUTSIDE[name](where, rng, scene.seen, scene.world.car)


def _worlds(
    world: World, effects: Sequence[Effect], sizes: Sequence[float], fitted: int
) -> list[World]:
    """Each run's world, those to fit and one held out; a single event is in its run alone."""
    out = []
    for run in range(fitted + 1):
        own = world
        for effect, size in zip(effects, sizes, strict=True):
            if effect.run is None or effect.run == run:
                own = effect.change(own, size)
        out.append(own)
    return out


def _found(effect: Effect, strength: float, scene: _Scene) -> TrueEffect:
    """Bring an effect to its strength, alone on an otherwise perfect car."""
    where = (*scene.drives, *scene.held_out)
    fitted = len(scene.drives)
    plain = [scene.world] * len(where)

    def quiet(worlds: Sequence[World], runs: slice) -> list[Recording]:
        pairs = zip(worlds[runs], where[runs], strict=True)
        return [as_recording(driven(w, how, quiet=True), "") for w, how in pairs]

    to_fit, to_hold = slice(0, fitted), slice(fitted, None)
    clean, start = left_over(quiet(plain, to_fit), scene.vehicle)

    def loss(size: float) -> float:
        worlds = _worlds(scene.world, [effect], [size], fitted)
        return left_over(quiet(worlds, to_fit), scene.vehicle, start)[0] - clean

    reached = scaled(loss, strength, effect.first * (strength / 10.0) ** 0.5, effect.largest)
    worlds = _worlds(scene.world, [effect], [reached.size], fitted)
    told = left_over(quiet(worlds, to_fit), scene.vehicle, start)[1]
    before = carried(quiet(plain, to_hold), scene.vehicle, start)
    after = carried(quiet(worlds, to_hold), scene.vehicle, told)
    return TrueEffect(
        name=effect.name,
        where=effect.where,
        parameters=effect.told(reached.size),
        size=reached.size,
        tolerance=effect.tolerance,
        noncentrality=reached.noncentrality,
        held_out=max(after - before, 0.0),
        run=effect.run,
    )


def _meant(
    scene: _Scene, worlds: Sequence[World], found: Sequence[TrueEffect], what: Name
) -> dict[str, tuple[float, float]]:
    """What c_f, c_r and i mean; see :mod:`tests.battery.meaning`."""
    car = scene.world.car
    out = {key: (getattr(car, key),) * 2 for key in ("c_f", "c_r", "i")}
    cluttering = "clutter" in (what.kind, what.modifier)
    if _kind(what) == "outside" or not (cluttering or found):
        return out
    pairs = zip(worlds, scene.drives, strict=False)
    both = paths([driven(world, how, quiet=True, keep=True) for world, how in pairs], SECONDS)
    for key, path, axle in zip(("c_f", "c_r"), both, axles("both"), strict=True):
        on_axle = [one for one in found if axle in one.where or one.where == "both"]
        k = car.k_f if axle == "front" else car.k_r
        for one in on_axle:
            if one.name == "spring_rate":
                k *= one.parameters["factor"]
        c = getattr(car, key)
        written = equivalent([one.name for one in on_axle], path, c, k)
        out[key] = (min(c, written), max(c, written))
    return out


def _sensors(noise: float, *, coarse: bool = False) -> SensorSpec:
    """Sensors as declared.  Less noise comes with a converter of 12 bits, unless it is coarse.

    Steps of 10 bits drown half the usual noise, and a parked car may read the same count for
    ever: an error that is no noise at all.
    """
    spec = _louder(SensorSpec(), noise)
    if coarse or noise >= 1.0 or spec.adc is None:
        return spec
    ten = spec.adc
    a, b, c, d = (_FINER * zero for zero in ten.zero)
    e, f, g, h = (scale / _FINER for scale in ten.scale)
    return replace(spec, adc=Adc((a, b, c, d), (e, f, g, h), int(_FINER) * (ten.top + 1) - 1))


def _louder(spec: SensorSpec, factor: float) -> SensorSpec:
    a, b, c, d = (factor * level for level in spec.noise)
    return replace(spec, noise=(a, b, c, d))
