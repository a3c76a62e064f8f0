"""Answers about recordings with a broken channel: 200 broken and 200 sound ones of three cars.

A Baja, a Formula and a small passenger car are drawn within what their vehicle files state and
driven on the rig over a bump, parking stops or a rough road; one recording in two has a channel
that is dead, frozen, drifting, inverted, late, duplicated, exchanged, clipped, wrongly scaled,
noisy or intermittent.  ``estimate`` (up to the best fit; nothing after that changes the answer to
the question here), ``track``, ``watch`` and ``diagnose`` are asked about each.  A command has
noticed a fault where it refuses, doubts its input or says that its figures cannot be relied on.

``python -m benchmarks.broken_channels`` writes ``benchmarks/results/broken_channels.json``; it
resumes where it was stopped.  ``--cases 20 --commands track,watch`` asks less, and ``--quick`` asks
whether anything is doubted without the search for the mistake, which takes most of the time and
never takes a doubt away.  A noisy channel contradicts a vehicle file that states its noise only.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from bayes_asv.analysis import input_mistakes
from bayes_asv.analysis.input_mistakes import check_input
from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.library.live import watch
from bayes_asv.library.tracks import track
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.mistaken_inputs import cars
from benchmarks.mistaken_inputs.cars import Design, Sensors, Truth
from benchmarks.provenance import current_commit
from tests.rig import (
    CHANNELS,
    RigCar,
    RigRun,
    SensorSpec,
    Terrain,
    bump,
    drive,
    parking_stops,
    rough_road,
)

__all__ = ["ASK", "KINDS", "Case", "draw_case", "main"]

Array = NDArray[np.float64]
Generator = np.random.Generator

RESULTS = Path(__file__).parent / "results" / "broken_channels.json"
COMMANDS = ("estimate", "track", "watch", "diagnose")
TERRAINS = ("bump", "stops", "rough")
WHEELS, CHASSIS = (0, 2), (1, 3)
_RATES = (250.0, 400.0, 400.0, 500.0, 800.0)
_SPEEDS = {"bump": (3.0, 6.0), "stops": (2.0, 4.0), "rough": (4.0, 9.0)}
_PEAK = 60.0  # m/s² of a wheel, to which the road is lowered: 6 g
_SPARSE = 0.25  # share of vehicle files that say nothing of noise and steps of the sensors
_OF_SENSORS = ("noise", "resolution", "range")
_TRAVEL = 0.8  # share of the travel to the stops that a drive uses at most


class Case(NamedTuple):
    """One recording, its vehicle file, and what is broken.

    Attributes
    ----------
    number : int
        Even numbers are sound, odd ones broken.
    kind : str or None
        A key of `KINDS`; None where nothing is broken.
    words : str
        What is broken, with its size.
    car, terrain : str
        Of the drive.
    recording : Recording
        As a logger would have written it.
    vehicle : Vehicle
        What its team states.
    shares : dict of str to float
        True damping rate of each axle over the nominal one.
    """

    number: int
    kind: str | None
    words: str
    car: str
    terrain: str
    recording: Recording
    vehicle: Vehicle
    shares: dict[str, float]


Broken = tuple[Array, str]
"""Readings (4, n), m/s², and what was done to them."""
Breaker = Callable[[Callable[[Array], Array], Array, Array, Generator], Broken]
"""From the sensors (delays (4,), s, to readings), stamps, noise levels and a generator."""


def _one(rng: Generator, channels: tuple[int, ...] = (0, 1, 2, 3)) -> int:
    return int(rng.choice(channels))


def _active(readings: Array, rng: Generator, low: float = 0.2, high: float = 0.6) -> int:
    """Row at which a share of all motion of the wheels is over."""
    wheels = readings[list(WHEELS)]
    power = np.sum((wheels - np.median(wheels, axis=1, keepdims=True)) ** 2, axis=0)
    return int(np.searchsorted(np.cumsum(power), rng.uniform(low, high) * power.sum()))


def _dead(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    level = noise[c] if rng.random() < 0.5 else 0.0
    readings[c] = rng.normal() * 0.1 + level * rng.normal(size=len(time))
    return readings, f"{CHANNELS[c]} is dead, {'noise' if level else 'a constant'}"


def _frozen(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    first = _active(readings, rng)
    readings[c, first:] = readings[c, first]
    return readings, f"{CHANNELS[c]} is frozen from {time[first]:.2f} s on"


def _drifting(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    size = float(rng.uniform(1.0, 5.0) * rng.choice([-1.0, 1.0]))
    readings[c] += size * (time - time[0]) / (time[-1] - time[0])
    return readings, f"{CHANNELS[c]} drifts by {size:.1f} m/s²"


def _inverted(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    readings[c] *= -1.0
    return readings, f"{CHANNELS[c]} is inverted"


def _late(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    groups = (*((c,) for c in range(4)), WHEELS, CHASSIS)
    group = groups[int(rng.integers(len(groups)))]
    lag, delays = float(rng.uniform(0.005, 0.020)), np.zeros(4)
    delays[list(group)] = -lag
    return sense(delays), f"{' and '.join(CHANNELS[c] for c in group)} {1e3 * lag:.0f} ms late"


def _duplicated(
    sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator
) -> Broken:
    readings = sense(np.zeros(4))
    one, other = (int(c) for c in rng.choice(4, 2, replace=False))
    readings[one] = readings[other]
    return readings, f"{CHANNELS[one]} is a copy of {CHANNELS[other]}"


_ORDERS = {
    "the wheels": (2, 1, 0, 3),
    "the chassis channels": (0, 3, 2, 1),
    "wheel and chassis at the front": (1, 0, 2, 3),
    "wheel and chassis at the rear": (0, 1, 3, 2),
    "wheels and chassis": (1, 0, 3, 2),
    "front and rear": (2, 3, 0, 1),
}


def _exchanged(
    sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator
) -> Broken:
    what = str(rng.choice(list(_ORDERS)))
    return sense(np.zeros(4))[list(_ORDERS[what])], f"{what} exchanged"


def _clipped(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    level = float(rng.uniform(0.25, 0.55)) * float(np.abs(readings[c]).max())
    readings[c] = np.clip(readings[c], -level, level)
    return readings, f"{CHANNELS[c]} is clipped at {level:.1f} m/s² by its amplifier"


def _scaled(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    gain = float(rng.choice([0.1, 0.5, 0.8, 1.25, 2.0, 9.80665, 1.0 / 9.80665]))
    readings[c] *= gain
    return readings, f"{CHANNELS[c]} reads {gain:.2g} times what it should"


def _noisy(sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    level = float(rng.uniform(0.1, 0.5)) * float(np.std(readings[c]))
    readings[c] += level * rng.normal(size=len(time))
    return readings, f"{CHANNELS[c]} has {level:.2f} m/s² of noise, {level / noise[c]:.0f} times"


def _intermittent(
    sense: Callable[[Array], Array], time: Array, noise: Array, rng: Generator
) -> Broken:
    readings, c = sense(np.zeros(4)), _one(rng)
    count, held = int(rng.integers(4, 20)), bool(rng.random() < 0.5)
    for _ in range(count):
        first = _active(readings, rng, 0.02, 0.98)
        last = first + max(2, int(rng.uniform(0.01, 0.06) / (time[1] - time[0])))
        readings[c, first:last] = readings[c, first] if held else 0.0
    how = "holds its value" if held else "falls to zero"
    return readings, f"{CHANNELS[c]} {how} {count} times for up to 60 ms"


KINDS: Final[dict[str, Breaker]] = {
    "dead": _dead, "frozen": _frozen, "drifting": _drifting, "inverted": _inverted, "late": _late,
    "duplicated": _duplicated, "exchanged": _exchanged, "clipped": _clipped, "scaled": _scaled,
    "noisy": _noisy, "intermittent": _intermittent,
}  # fmt: skip
"""What breaks; late and exchanged channels are drawn twice as often, as they come in more forms."""
_ORDER = (*KINDS, "late", "exchanged")


def draw_case(seed: int, number: int) -> Case:
    """Draw a case; the same numbers give the same one."""
    rng = np.random.default_rng([seed, number, 3141])
    design = cars.draw_design(list(cars.CARS.values())[number // 2 % 3], rng)
    sds = cars.draw_sds(rng)
    truth = cars.draw_truth(design, sds, rng)
    rate = float(rng.choice(_RATES))
    sensors = cars.draw_sensors(rate, rng)
    spec = _spec(sensors, rng)
    terrain = TERRAINS[number // 6 % 3]
    speed, seconds = float(rng.uniform(*_SPEEDS[terrain])), float(rng.uniform(2.5, 6.0))
    car = _rig_car(design, truth)
    road = _road(terrain, design, car, speed, seconds, rng)
    noise_seed = int(rng.integers(2**31))

    def sense(later: Array) -> Array:
        delay = np.add(spec.delay, later)
        shifted = replace(spec, delay=(delay[0], delay[1], delay[2], delay[3]))
        return drive(car, road, speed, rate, seconds, shifted, noise_seed).channels

    time = np.arange(round(rate * seconds)) / rate
    kind = _ORDER[number // 2 % len(_ORDER)] if number % 2 else None
    noise = np.array(sensors.noise)[[0, 1, 0, 1]]
    readings, words = (
        (sense(np.zeros(4)), "sound") if kind is None else KINDS[kind](sense, time, noise, rng)
    )
    step = np.array(sensors.resolution)[[0, 1, 0, 1], None]
    limit = np.array(sensors.limits)[[0, 1, 0, 1], None]
    readings = np.clip(np.rint(readings / step) * step, -limit, limit)
    recording = Recording(time, readings, ("m/s^2",) * 4, (), f"case{number}.csv")
    units = cars.SI_UNITS
    text = cars.vehicle_file(design.name, "SI", design.values, units, sds, sensors, design.travel)
    if rng.random() < _SPARSE and kind != "noisy":
        text = "\n".join(line for line in text.splitlines() if not line.startswith(_OF_SENSORS))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.toml"
        path.write_text(text, encoding="utf-8")
        vehicle = replace(read_vehicle(path), source="car.toml")
    shares = {
        axle: truth.values[f"{axle}_damping"] / c.value
        for axle, c in (("front", vehicle.c_f), ("rear", vehicle.c_r))
    }
    return Case(number, kind, words, design.name, terrain, recording, vehicle, shares)


def _spec(sensors: Sensors, rng: Generator) -> SensorSpec:
    """Sensors of the rig as a vehicle file declares them, with biases; steps come later."""
    wheel, body = sensors.noise
    pass_wheel, pass_body = sensors.bandwidth or (np.inf, np.inf)
    biases = np.array([0.08, 0.05, 0.08, 0.05]) * rng.normal(size=4)
    return SensorSpec(
        bandwidth=(pass_wheel, pass_body) * 2,
        delay=(0.0, sensors.chassis_delay) * 2,
        bias=(biases[0], biases[1], biases[2], biases[3]),
        noise=(wheel, body) * 2,
        adc=None,
    )


def _rig_car(design: Design, truth: Truth) -> RigCar:
    """Return the car with linear springs and dampers on tyres damped to 2 %."""
    values, (front, rear) = truth.values, design.unsprung
    tyres = design.tyre_rates
    return RigCar(
        name=design.name, m=values["sprung_mass"], wdf=values["front_weight_fraction"],
        l=values["wheelbase"], k_f=values["front_spring_rate"], k_r=values["rear_spring_rate"],
        c_f=values["front_damping"], c_r=values["rear_damping"], i=values["pitch_inertia"],
        m_uf=front, m_ur=rear, k_tf=tyres[0], k_tr=tyres[1],
        c_tf=0.04 * float(np.sqrt(tyres[0] * front)), c_tr=0.04 * float(np.sqrt(tyres[1] * rear)),
        contact_patch=design.tyre_patch,
    )  # fmt: skip


def _road(
    terrain: str, design: Design, car: RigCar, speed: float, seconds: float, rng: Generator
) -> Terrain:
    """Draw a road, lowered until the car keeps off its stops and its sensors in their range."""
    seed, length = int(rng.integers(2**31)), float(rng.uniform(0.6, 1.5))
    height = design.road_height * float(rng.uniform(0.2, 1.0))
    while True:
        road = {
            "bump": lambda: bump(height, length),  # noqa: B023 # called in this turn
            "stops": lambda: parking_stops(height),  # noqa: B023
            "rough": lambda: rough_road(seed, "E", (height / 0.09) ** 2),  # noqa: B023
        }[terrain]()
        run = drive(car, road, speed, 400.0, seconds, SensorSpec.ideal(), 0)
        if _bearable(run, design):
            return road
        height *= 0.8


def _bearable(run: RigRun, design: Design) -> bool:
    deflection = np.abs(run.deflection).max(axis=1)
    return bool(
        np.all(deflection < _TRAVEL * np.array(design.travel))
        and np.abs(run.channels[list(WHEELS)]).max() < _PEAK
    )


Answer = tuple[str, str]
"""How a command said that something is wrong, or one of `FINE`; and its words."""
FINE = ("ok", "true alarm")
"""Answers without a doubt.  ``watch`` ends with its alarm: where that is true, nothing that a
channel did until then has misled it, and what breaks later it does not see."""


def _estimate(case: Case) -> Answer:
    lines, reasons, _ = prepare_runs([case.recording], case.vehicle)
    doubt = check_input([case.recording], case.vehicle, refused=bool(reasons))
    if not reasons and doubt is None:
        reasons = best_fit(lines, case.vehicle).reasons
    words = " | ".join([*([] if doubt is None else [doubt.sentence]), *reasons])
    return ("refused" if reasons else "ok" if doubt is None else "doubt"), words


def _track(case: Case) -> Answer:
    result = track(case.recording, case.vehicle, progress=False)
    document = result.document
    if document.verdict == "refused":
        return "refused", " | ".join(document.reasons)
    if getattr(document, "doubt", ""):
        return "doubt", document.doubt
    if result.consistency == "inconsistent":
        return "inconsistent", " | ".join(result.lines())
    return "ok", " | ".join(document.consistency.words)


def _watch(case: Case) -> Answer:
    result = watch(case.recording, case.vehicle)
    assert result is not None
    document = result.document
    if document.verdict == "refused":
        return "refused", " | ".join(document.reasons)
    if getattr(document, "doubt", ""):
        return "doubt", document.doubt
    alarm, words = document.alarm, " | ".join(result.lines())
    if alarm is not None and alarm.eti95[0] < case.shares[alarm.axle] < alarm.eti95[1]:
        return "true alarm", words
    return "ok", words


def _diagnose(case: Case) -> Answer:
    result = diagnose([case.recording], [], case.vehicle, seed=1)
    doubt = getattr(result, "doubt", None)
    if result.verdict == "refused":
        return "refused", " | ".join(result.reasons)
    if doubt is not None:
        return "doubt", doubt.sentence
    names = [f"{effect.placed}" for effect in result.named]
    return ("ok" if result.verdict == "agreement" else result.verdict), " | ".join(names)


ASK: Final[dict[str, Callable[[Case], Answer]]] = {
    "estimate": _estimate, "track": _track, "watch": _watch, "diagnose": _diagnose,
}  # fmt: skip
"""The commands."""


def ask(command: str, case: Case) -> dict[str, Any]:
    """Ask one command about one case."""
    try:
        answer, words = ASK[command](case)
    except InputError as error:
        answer, words = "refused", str(error)
    return {
        "number": case.number, "kind": case.kind, "what": case.words, "car": case.car,
        "terrain": case.terrain, "answer": answer, "words": words[:400],
    }  # fmt: skip


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Count broken recordings that were answered with ok, and sound ones that were not."""
    out: dict[str, Any] = {}
    for name, sound in (("broken", False), ("sound", True)):
        mine = [row for row in rows if (row["kind"] is None) == sound]
        wrong = [r for r in mine if (r["answer"] not in FINE if sound else r["answer"] == "ok")]
        if mine:
            ends = binomtest(len(wrong), len(mine)).proportion_ci(method="exact")
            out[name] = {
                "cases": len(mine),
                "answered_ok" if not sound else "doubted": len(wrong),
                "interval95": [float(ends.low), float(ends.high)],
                "by_kind": dict(Counter(row["kind"] or row["terrain"] for row in wrong)),
                "true_alarms": sum(row["answer"] == "true alarm" for row in mine),
            }
    return out


def main() -> int:
    """Ask what has not been asked yet and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=400, help="half of them are broken")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--commands", default=",".join(COMMANDS))
    parser.add_argument("--quick", action="store_true", help="do not look for the mistake's name")
    parser.add_argument("--out", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    if arguments.quick:
        input_mistakes.likely_mistakes = lambda *_, **__: []
    commit = current_commit()
    done = json.loads(arguments.out.read_text("utf-8")) if arguments.out.exists() else {}
    if done.get("commit") != commit or done.get("seed") != arguments.seed:
        done = {"commit": commit, "seed": arguments.seed}
    done["named"] = not arguments.quick
    rows: dict[str, list[dict[str, Any]]] = done.setdefault("each", {})
    for number in range(arguments.first, arguments.first + arguments.cases):
        case: Case | None = None
        for command in arguments.commands.split(","):
            mine = rows.setdefault(command, [])
            if any(row["number"] == number for row in mine):
                continue
            case = case or draw_case(arguments.seed, number)
            mine.append(ask(command, case))
            done[command] = summary(mine)
            arguments.out.write_text(json.dumps(done, indent=1) + "\n", encoding="utf-8")
            if (mine[-1]["answer"] in FINE) != (case.kind is None):
                print(number, command, case.car, case.terrain, case.words, mine[-1]["answer"],
                      mine[-1]["words"], sep=" · ", flush=True)  # fmt: skip
    for command in arguments.commands.split(","):
        print(command, json.dumps(done[command]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
