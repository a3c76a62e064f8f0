"""Whether the 95 % intervals hold the truth of cars that the model simplifies.

A real car is not quite the half car.  Each car here has friction, a knee and unequal sides in its
dampers, an elastic mount behind each, springs that stiffen, a motion ratio that changes with
travel, fading, gains, lags, corners and places of sensors that are a little off, a driver on a
seat, a road that differs from side to side, an engine, and panels that ring under the chassis
sensors, all at once, at some share of the size that is usual.  The rig drives each over one of
three terrains.  The true rate of a damper is the power that it took over the mean square of its
rate of deflection.  ``python -m benchmarks.real_cars --size 0.25`` writes
``benchmarks/results/real_cars.json`` and resumes where it was stopped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimation import estimate
from benchmarks.provenance import current_commit, keep, share
from tests.battery.world import Axle, World, minus_damper, with_terms_at
from tests.posterior.cases import as_recording, vehicle
from tests.rig import (
    DECLARED_SDS,
    DEFAULT_SPEEDS,
    TERRAINS,
    AsymmetricDamper,
    Coulomb,
    DigressiveDamper,
    Engine,
    FadingDamper,
    LinearSpring,
    MaxwellMount,
    Mounting,
    OneSided,
    Panel,
    PositionDamper,
    RigCar,
    RigRun,
    Seat,
    SensorSpec,
    SinhSpring,
    Term,
    baja,
    draw,
    draw_biases,
    drive,
)

__all__ = ["driven", "main", "usual"]

Array = NDArray[np.float64]
Answer = Callable[[Recording, Vehicle, int], dict[str, Any]]

RESULTS = Path(__file__).parent / "results" / "real_cars.json"
TERRAIN_NAMES = ("bump", "stops", "rough")
SIZES = (0.0, 0.25, 0.5, 1.0)
NAMES = ("c_f", "c_r", "i")
SECONDS, RATE = 2.5, 400.0


def usual(world: World, rng: np.random.Generator, size: float, rate: Array, travel: Array) -> World:
    """Return a world with a share of everything that a car usually has.

    Parameters
    ----------
    world : World
        The exact half car with sensors as declared.
    rng : numpy.random.Generator
        Draws signs and sizes.
    size : float
        Share; at 1 friction is 2 to 6 % of an axle's load, a knee and a change of motion ratio
        take 4 to 12 % off at the largest speed and travel, sides differ by 20 % and a mount lags
        by up to 1 ms.
    rate, travel : (2,) arrays
        Largest rates of deflection (m/s) and deflections (m) of front and rear.
    """
    share = size * rng.uniform(0.5, 1.5, size=(8, 2))
    sign = rng.choice([-1.0, 1.0], size=(8, 2))

    def terms(car: RigCar, axle: Axle) -> tuple[Term, ...]:
        j = int(axle == "rear")
        c, k = (car.c_f, car.k_f) if axle == "front" else (car.c_r, car.k_r)
        load = 9.81 * car.m * (car.wdf if axle == "front" else 1.0 - car.wdf)
        return (
            Coulomb(0.04 * share[0, j] * load),
            DigressiveDamper(c, rate[j] / np.sqrt(0.24 * share[1, j])),
            minus_damper(c),
            AsymmetricDamper(c, float(np.exp(0.2 * sign[2, j] * share[2, j]))),
            minus_damper(c),
            MaxwellMount(c, c / max(7e-4 * share[3, j], 1e-4)),
            minus_damper(c),
            SinhSpring(k, 0.04 * share[4, j] / travel[j] ** 2 + 1e-9),
            LinearSpring(-k),
            PositionDamper(c, 0.06 * share[5, j] / travel[j] ** 2),
            minus_damper(c),
            FadingDamper(c, 0.06 * share[6, j], SECONDS),
            minus_damper(c),
        )

    within = size * rng.uniform(-1.0, 1.0, size=(4, 4))
    spec = world.sensors

    def four(values: Array) -> tuple[float, float, float, float]:
        a, b, c, d = values.tolist()
        return a, b, c, d

    sensors = replace(
        spec,
        gain=four(np.array(spec.gain) * (1.0 + 0.02 * within[0])),
        bandwidth=four(np.array(spec.bandwidth) * (1.0 + 0.08 * within[1])),
        delay=four(np.array(spec.delay) + 2e-4 * within[2]),
        chassis_offset=(0.03 * float(within[3, 0]), 0.03 * float(within[3, 1])),
    )
    mass = 0.08 * float(share[7, 0]) * world.car.m
    omega = 2.0 * np.pi * float(rng.uniform(4.0, 8.0))
    seat = Seat(mass, mass * omega**2, 0.5 * mass * omega, float(rng.uniform(-0.1, 0.1)))
    forces = (Engine(float(rng.uniform(25.0, 45.0)), 60.0 * size, seed=int(rng.integers(2**31))),)
    begin, behind = (float(x) for x in rng.uniform([0.4, 0.2], [1.2, 0.6]))
    mountings: tuple[Mounting, ...] = (
        OneSided(0.01 * size, begin, float(rng.uniform(0.12, 0.3)), behind),
        *(Panel(j, float(rng.uniform(25.0, 45.0)), 0.05 * size) for j in (1, 3)),
    )
    world = with_terms_at(replace(world, sensors=sensors), "both", terms)
    car = replace(world.car, seat=seat)
    return World(car=car, sensors=world.sensors, forces=forces, mountings=mountings)


def driven(seed: int, size: float) -> tuple[Recording, Vehicle, dict[str, float]]:
    """One drive of one car, what is declared, and the truth."""
    terrain = TERRAIN_NAMES[seed % len(TERRAIN_NAMES)]
    rng = np.random.default_rng([seed, 29])
    car = draw(baja(), rng, DECLARED_SDS)
    declared = draw_biases(SensorSpec(), rng)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    world = World(car, declared)

    def go(world: World) -> RigRun:
        return drive(
            world.car, TERRAINS[terrain](road), DEFAULT_SPEEDS[terrain], RATE, SECONDS,
            world.sensors, noise, forces=world.forces, mountings=world.mountings,
            keep_motion=True,
        )  # fmt: skip

    run = go(world)
    if size > 0.0:
        peaks = [np.abs(x).max(axis=1) for x in (run.deflection_rate, run.deflection)]
        run = go(usual(world, rng, size, *peaks))
    motion = run.motion
    assert motion is not None
    springs = np.array([[car.k_f], [car.k_r]])
    rates = motion.deflection_rate
    damping = motion.suspension_force + springs * motion.deflection
    c = -np.sum(damping * rates, axis=1) / np.sum(rates**2, axis=1)
    truth = {"c_f": float(c[0]), "c_r": float(c[1]), "i": car.i}
    return as_recording(run, f"{terrain}-{seed}.csv"), vehicle(dict(DECLARED_SDS)), truth


def one(seed: int, size: float) -> dict[str, Any]:
    """Estimate from one drive, and hold the intervals against the truth."""
    recording, given, truth = driven(seed, size)
    found = estimate([recording], given, seed=seed)
    out: dict[str, Any] = {"seed": seed, "size": size, "verdict": found.verdict}
    out["seconds"] = found.seconds
    if found.verdict == "refused":
        return {**out, "reasons": list(found.reasons)}
    out["doubted"] = found.input_check is not None
    out["warnings"] = list(found.warnings)
    for name in NAMES:
        low, middle, high = np.quantile(found.draws[name], [0.025, 0.5, 0.975]).tolist()
        out[name] = [truth[name], low, middle, high]
    return out


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage and width by size, and the share that is wrong by 3 % without a word."""
    out: dict[str, Any] = {}
    for size in sorted({row["size"] for row in rows}):
        cell = [row for row in rows if row["size"] == size]
        answered = [row for row in cell if row["verdict"] != "refused"]
        part: dict[str, Any] = {"runs": len(cell), "answered": len(answered)}
        if answered:
            inside: dict[str, list[bool]] = {name: [] for name in NAMES}
            for name in NAMES:
                values = [row[name] for row in answered]
                inside[name] = [low <= truth <= high for truth, low, _, high in values]
                part[name] = {
                    **share(inside[name]),
                    "relative_width": float(
                        np.median([(high - low) / t for t, low, _, high in values])
                    ),
                    "relative_error": float(np.median([abs(m / t - 1.0) for t, _, m, _ in values])),
                }
            part["doubted"] = share([row["doubted"] for row in answered])
            silent = [
                not row["doubted"]
                and any(abs(row[n][2] / row[n][0] - 1.0) > 0.03 and not inside[n][k] for n in NAMES)
                for k, row in enumerate(answered)
            ]
            part["silent_and_wrong"] = share(silent)
        out[str(size)] = part
    return out


def main() -> None:
    """Estimate from all drives that are not there yet."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--size", type=float, action="append")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if options.out.exists():
        rows = json.loads(options.out.read_text(encoding="utf-8"))["rows"]
    known = {(row["seed"], row["size"]) for row in rows}
    for seed in range(options.seed, options.seed + options.runs):
        for size in options.size or SIZES:
            if (seed, size) in known:
                continue
            rows.append(one(seed, size))
            keep(options.out, {"commit": current_commit(), "summary": summary(rows), "rows": rows})
            print(rows[-1], flush=True)
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
