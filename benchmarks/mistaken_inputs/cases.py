"""Write the blind set: 300 cases with right and 300 with mistaken inputs.

``python -m benchmarks.mistaken_inputs.cases OUTDIR [--seed 7]`` writes ``case000`` to ``case599``,
each with ``vehicle.toml``, ``run1.csv`` and sometimes ``run2.csv``, and ``truth.json``:

- ``seed``, ``counts`` (cases by kind) and ``cases``, an object by name of the case.  Each case has
- ``kind`` (null if nothing is mistaken), ``details``, ``shows`` (``file``, ``fit`` or ``answer``;
  see ``mistakes.Kind``) and ``like`` (kinds that recordings can hardly tell from this one),
- ``recognise``: a right answer holds one of ``names`` (key or channel) and one of ``words``;
  ``factors`` are written over right, ``late_s`` is by how much a channel appears late,
- ``runs_mistaken`` (files with a mistake of the recording; empty if it is in the vehicle file),
- ``car``, ``terrain``, ``rate_hz``, ``units``, ``runs`` (speed, duration, largest motion),
- ``dampers``: for front and rear ``deviation`` (true over right nominal, minus one) and ``worn``,
- ``true``: ``c_f``, ``c_r``, ``i``, ``m``, ``l``, ``w``, ``k_f``, ``k_r`` of the car, in SI,
- ``right``: what the vehicle file should say, and ``written``: what it says, both in SI.

Right cases draw the true values of mass, wheelbase, share and springs with the stated deviations,
inertia with 10 %, and dampers that are within 2 % of nominal or worn by 10 to 40 % either way.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import cars, ride
from .cars import CARS, CHANNELS, UNITS, Design
from .mistakes import KINDS, ONE_RUN, Mistake, Setting
from .ride import TERRAINS, Faults

RIGHT = 300
SYMBOLS = {
    "c_f": "front_damping",
    "c_r": "rear_damping",
    "i": "pitch_inertia",
    "m": "sprung_mass",
    "l": "wheelbase",
    "w": "front_weight_fraction",
    "k_f": "front_spring_rate",
    "k_r": "rear_spring_rate",
}
TITLES = {"baja": "Baja", "formula": "Formula", "passenger": "Small car"}


def plan(seed: int) -> list[tuple[str | None, str, str]]:
    """Return kind, car and terrain of every case, in random order."""
    rng = np.random.default_rng([seed, 10_000])
    kinds: list[str | None] = [None] * RIGHT
    for name, kind in KINDS.items():
        kinds += [name] * kind.count
    if len(kinds) != 2 * RIGHT:
        raise ValueError(f"{len(kinds) - RIGHT} mistaken cases for {RIGHT}")
    places = [(car, terrain) for car in CARS for terrain in TERRAINS]
    start = int(rng.integers(len(places)))
    cases = [(kind, *places[(start + n) % len(places)]) for n, kind in enumerate(kinds)]
    return [cases[n] for n in rng.permutation(len(cases))]


def _settle(
    kind: str | None, car: str, rng: np.random.Generator
) -> tuple[Setting, dict[str, float], Mistake | None]:
    """Draw a car, and the mistake if this car permits it; otherwise draw again."""
    while True:
        design = cars.draw_design(CARS[car], rng)
        sds = cars.draw_sds(rng)
        truth = cars.draw_truth(design, sds, rng)
        us = bool(rng.random() < design.us_share)
        units = dict(cars.US_UNITS if us else cars.SI_UNITS)
        if not us and rng.random() < 0.4:
            units["wheelbase"] = "mm"
        rate = float(rng.choice([250.0, 400.0, 400.0, 500.0, 800.0, 1000.0]))
        unit = str(rng.choice(["m/s^2", "m/s^2", "g", "in/s^2" if us else "g"]))
        setting = Setting(design, truth, units, rate, unit)
        if kind is None:
            return setting, sds, None
        mistake = KINDS[kind].make(setting, rng)
        if mistake is not None:
            return setting, sds, mistake


def _stranger(car: str, rng: np.random.Generator) -> Design:
    """Draw the file of another car, of another kind."""
    others = [name for name in CARS if name != car]
    return cars.draw_design(CARS[others[int(rng.integers(len(others)))]], rng)


def write_case(
    folder: Path, kind: str | None, car: str, terrain: str, rng: np.random.Generator
) -> dict[str, Any]:
    """Write one case and return its truth."""
    setting, sds, mistake = _settle(kind, car, rng)
    design, truth = setting.design, setting.truth
    sensors = cars.draw_sensors(setting.rate, rng)
    factors = mistake.factors if mistake else {}
    units = {**setting.units, **(mistake.units if mistake else {})}
    written = {key: value * factors.get(key, 1.0) for key, value in design.values.items()}
    stranger: Design | None = None
    if kind == "other_car":
        stranger = _stranger(car, rng)
        written = dict(stranger.values)
    folder.mkdir(parents=True, exist_ok=True)
    title = f"{TITLES[stranger.name if stranger else car]} {int(rng.integers(2019, 2027))}"
    style = "US" if setting.units["wheelbase"] == "in" else "SI"
    travel = (stranger or design).travel
    text = cars.vehicle_file(title, style, written, units, sds, sensors, travel)
    (folder / "vehicle.toml").write_text(text, encoding="utf-8")

    faults = mistake.faults if mistake else Faults()
    count = 2 if rng.random() < 0.25 else 1
    only_second = count == 2 and kind in ONE_RUN and bool(rng.random() < 0.4)
    unit = (mistake.recording_unit if mistake else None) or setting.recording_unit
    runs, mistaken = [], []
    for number in range(1, count + 1):
        here = Faults() if only_second and number == 1 else faults
        name = f"run{number}.csv"
        if here != Faults():
            mistaken.append(name)
        speed = round(float(rng.uniform(*design.speeds)), 1)
        seconds = round(float(rng.uniform(5.0, 12.0)), 1)
        road = ride.draw_road(terrain, design, speed, seconds, rng)
        motion = ride.ride(design, truth, road, speed, seconds)
        motion = ride.fit_to_car(motion, design, truth, float(rng.uniform(0.7, 1.0)))
        time, columns = ride.record(motion, sensors, setting.rate, seconds, here, rng)
        text = ride.csv_text(time, columns, unit, UNITS[unit], here.time_in_ms)
        (folder / name).write_text(text, encoding="utf-8")
        runs.append(
            {
                "file": name,
                "speed_m_s": speed,
                "seconds": seconds,
                "peak_m_s2": _peaks(motion),
                "peak_travel_m": [round(x, 4) for x in motion.largest_travel],
            }
        )
    return {
        "kind": kind,
        "details": mistake.details if mistake else "nothing is mistaken",
        "shows": KINDS[kind].shows if kind else None,
        "like": list(KINDS[kind].like) if kind else [],
        "recognise": {
            "names": list(mistake.names),
            "words": list(mistake.words),
            "factors": mistake.factors,
            "late_s": mistake.faults.late,
        }
        if mistake
        else None,
        "runs_mistaken": mistaken,
        "car": car,
        "terrain": terrain,
        "rate_hz": setting.rate,
        "units": {**units, "recording": unit},
        "runs": runs,
        "dampers": {
            axle: {"deviation": round(truth.deviation[n], 4), "worn": truth.worn[n]}
            for n, axle in enumerate(("front", "rear"))
        },
        "true": {symbol: truth.values[key] for symbol, key in SYMBOLS.items()},
        "right": dict(design.values),
        "written": written,
    }


def _peaks(motion: ride.Ride) -> dict[str, float]:
    """Return the largest true acceleration at each sensor."""
    signals = (
        motion.wheels[0],
        motion.chassis(motion.arms[0]),
        motion.wheels[1],
        motion.chassis(motion.arms[1]),
    )
    return {
        channel: round(float(np.abs(signal).max()), 2)
        for channel, signal in zip(CHANNELS, signals, strict=True)
    }


def write_set(folder: Path, seed: int) -> None:
    """Write all cases and their truth."""
    cases: dict[str, dict[str, Any]] = {}
    for number, (kind, car, terrain) in enumerate(plan(seed)):
        name = f"case{number:03d}"
        rng = np.random.default_rng([seed, number])
        cases[name] = write_case(folder / name, kind, car, terrain, rng)
    counts = Counter(case["kind"] or "right" for case in cases.values())
    document = {"seed": seed, "counts": dict(sorted(counts.items())), "cases": cases}
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    (folder / "truth.json").write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and write the set."""
    parser = argparse.ArgumentParser(description="Write the blind set of mistaken inputs.")
    parser.add_argument("folder", type=Path, metavar="OUTDIR")
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args(arguments)
    write_set(options.folder, options.seed)


if __name__ == "__main__":
    main()
