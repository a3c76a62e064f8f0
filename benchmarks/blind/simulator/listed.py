"""Listed faults of sensors, clocks, given values and outside forces, ready to be sized."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint, Outcome, Spans, hull, point
from .declared import Declared
from .forces import Pushed
from .kinds import AXLES, CHANNELS, Vector, Whole, rows_of
from .memories import Seat
from .pulses import PULSES, page_pulse
from .scene import Scene
from .sensors import Motion, Sensing
from .simulate import Mechanism
from .spans import SPRING, fitted, records

__all__ = ["LISTED_FORMS", "listed_fault"]

LISTED_FORMS: dict[str, tuple[str, ...]] = {
    "external_force": tuple(PULSES),
    "spring_rate": ("motion ratio not squared", "seat in series", "warm air bellows"),
    "weight_distribution": (
        "scales on a slope",
        "front scale reads wrong",
        "driver sits elsewhere",
    ),
    "sensor_gain": ("rippling reference", "sagging reference", "cubic bow"),
    "sensor_lag": ("mean of a block", "fourth-order Butterworth", "late with jitter"),
    "clock_offset": ("own start each run", "fast crystal", "beating ticks"),
    "sensor_bandwidth": ("absorbing capacitor", "resistive capacitor", "warming corner"),
    "sensor_drift": ("logarithmic creep", "root of time", "run-away"),
    "engine_vibration": ("slider crank", "firing pulses", "swelling tone"),
}


def _external_force(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    run, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    shape = PULSES[form]
    drive = scene.drives[run]
    length = float(rng.uniform(0.25, 0.8))
    start = float(rng.uniform(0.25, 0.7)) * (drive.length - length)
    rows, load = rows_of(where), scene.car.mean_load
    curve = sign * load * shape((drive.half_times - start) / length)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        pushed = np.zeros((len(curve), 2, len(runs)))
        pushed[:, rows] = curve[:, None, None] * (size * (runs == run))
        return Pushed(pushed)

    def spans(outcome: Outcome) -> Spans:
        found = page_pulse(shape, start, length)
        total = sign * load * outcome.size * (2 if where == "both" else 1)
        force = hull(*(total * x for x in found["force"]))
        return Spans(
            {"force": force, "start": hull(*found["start"]), "duration": hull(*found["duration"])}
        )

    return Blueprint("external_force", where, form, (0.0005, 0.5), mechanism=mechanism, spans=spans)


def _spring_rate(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, axle = rows_of(where), AXLES.index(where)
    k, given = scene.car.k[axle], scene.declared.k[axle]
    # which of the two an owner forgets: the square of the ratio, or that the spring is inboard
    sign = 1.0 if rng.random() < 0.5 else -1.0

    def written(size: float) -> Declared:
        factor = (1.0 + size) ** sign * k / given
        return scene.declared.changed(**{f"k_{where[0]}": factor}).rounded()

    def spans_written(outcome: Outcome) -> Spans:
        return Spans({"factor": point(k / written(outcome.size).k[axle])})

    if form == "motion ratio not squared":
        return Blueprint(
            "spring_rate", where, form, (0.02, 1.2), declare=written, spans=spans_written
        )

    series = form == "seat in series"
    relaxes = 0.0 if series else float(rng.uniform(2.0, 4.0))
    lag = float(rng.uniform(0.002, 0.004))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return Seat(rows, k, size, relaxes, lag)

    def spans(outcome: Outcome) -> Spans:
        values = [1.0 / (1.0 + outcome.size) if series else 1.0 + outcome.size]
        record = records(outcome.histories, scene.drives, [axle])
        values += [
            float(np.exp(x[0])) for _, x, _ in fitted(SPRING, record, scene.car, axle, False)
        ]
        return Spans({"factor": hull(*(x * k / given for x in values))})

    # air that keeps its heat is at most 1.4 times as stiff as air that does not
    span = (0.02, 1.0 if series else 0.4)
    return Blueprint("spring_rate", where, form, span, mechanism=mechanism, spans=spans)


def _weight(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign = float(rng.choice([-1.0, 1.0]))
    true, car = scene.car.wdf, scene.car
    usual = scene.declared.wdf / true

    def weighed(size: float) -> float:
        """Front weight fraction that the scales would show."""
        if form == "scales on a slope":
            return true + sign * size * car.height / car.wheelbase
        if form == "front scale reads wrong":
            front = (1.0 + sign * 0.4 * size) * true
            return front / (front + 1.0 - true)
        # a driver of this share of the mass, who sits a third of the wheelbase elsewhere
        return true + sign * 0.33 * size

    def written(size: float) -> Declared:
        return scene.declared.changed(wdf=usual * weighed(size) / scene.declared.wdf).rounded()

    def spans(outcome: Outcome) -> Spans:
        return Spans({"factor": point(true / written(outcome.size).wdf)})

    return Blueprint("weight_distribution", None, form, (0.02, 0.6), declare=written, spans=spans)


def _gain(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign, pace = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.8, 1.6))
    peak = max(float(np.max(np.abs(rows[:, CHANNELS.index(where)]))) for rows in scene.base[:2])
    ends = [float(times[-1]) for times in scene.times]

    def sensing(size: float) -> Sensing:
        def mount(motion: Motion, run: int) -> Motion:
            a = motion.acceleration[where]
            if form == "sagging reference":
                bent = 0.9 + 0.2 * np.clip(motion.times / ends[run], 0.0, 1.0)
            elif form == "rippling reference":
                bent = 1.0 + 0.12 * np.sin(2.0 * np.pi * pace * motion.times + run)
            else:
                bent = 1.0 - 0.12 * (a / peak) ** 2
            return motion.reading(where, a * (1.0 + sign * size * bent))

        return Sensing(mount=mount)

    def spans(outcome: Outcome) -> Spans:
        changes = (sign * outcome.size * x for x in (0.9, 1.1))
        return Spans({"factor": hull(*(1.0 + x for x in changes))})

    return Blueprint("sensor_gain", where, form, (0.001, 0.4), sensing=sensing, spans=spans)


def _butterworth(delay: float) -> tuple[complex, ...]:
    """Poles (rad/s) of a low-pass of fourth order with this delay at rest, s."""
    angles = np.pi * np.array([0.625, 0.875, 1.125, 1.375])
    poles = np.exp(1j * angles)
    whole = -float(np.sum(np.real(1.0 / poles)))
    return tuple(complex(p) * whole / delay for p in poles)


def _lag(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    # positive: sampled later than declared; a filter makes readings of what was earlier
    sign = 1.0 if form == "late with jitter" and rng.random() < 0.6 else -1.0
    jitter = [rng.uniform(-1.0, 1.0, len(times)) for times in scene.times]
    nodes, weights = np.polynomial.legendre.leggauss(8)

    def sensing(size: float) -> Sensing:
        if form == "late with jitter":
            return Sensing(late={where: lambda t, run: size * (sign + 0.08 * jitter[run])})
        if form == "mean of a block":
            return Sensing(spread={where: (size * (1.0 + nodes), 0.5 * weights)})
        own = scene.declared.sensors[where].poles
        return Sensing(poles={where: (*own, *_butterworth(size))})

    def spans(outcome: Outcome) -> Spans:
        lag = sign * outcome.size
        if form == "fourth-order Butterworth":
            return Spans({"lag": hull(lag, 1.06 * lag)})
        return Spans({"lag": hull(0.985 * lag, 1.015 * lag)})

    least = 0.0003 if form == "fourth-order Butterworth" else 0.00001
    return Blueprint("sensor_lag", where, form, (least, 0.008), sensing=sensing, spans=spans)


def _clock(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign = float(rng.choice([-1.0, 1.0]))
    group = [c for c in CHANNELS if where in c or (where == "body" and c.endswith("chassis"))]
    drift = float(rng.choice([-1.0, 1.0]) * rng.uniform(6e-5, 11e-5))
    drift = drift if form == "fast crystal" else 0.0
    between, beat = np.ones(3), float(rng.uniform(1.5, 4.0))
    if form == "own start each run":
        between = np.array([1.0, *rng.uniform(0.78, 1.22, 2)])

    def sensing(size: float) -> Sensing:
        def late(times: Vector, run: int) -> Vector:
            offset = sign * size * between[run] + drift * times
            if form == "beating ticks":
                offset = offset + 0.12 * size * (2.0 * np.mod(beat * times, 1.0) - 1.0)
            return np.asarray(offset)

        return Sensing(late=dict.fromkeys(group, late))

    def spans(outcome: Outcome) -> Spans:
        ends = [sign * outcome.size * x for x in between[:2]]
        longest = max(d.length for d in scene.drives[:2])
        slack = 0.04 if form == "beating ticks" else 0.0
        ends = [x * y for x in ends for y in (1.0 - slack, 1.0 + slack)]
        return Spans({"offset": hull(*ends, *(x + drift * longest for x in ends))})

    return Blueprint("clock_offset", where, form, (0.00001, 0.02), sensing=sensing, spans=spans)


def _bandwidth(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    corner = scene.declared.sensors[where].corner
    if corner is None:
        message = "needs a declared filter"
        raise ValueError(message)
    sign = 1.0 if rng.random() < 0.35 else -1.0
    ends = [float(times[-1]) for times in scene.times]

    def pole(size: float) -> complex:
        return complex(-2.0 * np.pi * corner * float(np.exp(sign * size)))

    def branch(size: float) -> tuple[complex, ...]:
        """Poles of what works beside the filter."""
        if form == "absorbing capacitor":
            return (pole(size) / 6.0,)
        return () if form == "resistive capacitor" else (pole(0.6 * size),)

    def sensing(size: float) -> Sensing:
        def share(times: Vector, run: int) -> Vector:
            if form == "warming corner":
                return np.asarray(np.clip(times / ends[run], 0.0, 1.0))
            return np.full(len(times), 0.1 * min(size, 1.0))

        return Sensing(poles={where: (pole(size),)}, beside={where: (branch(size), share)})

    def spans(outcome: Outcome) -> Spans:
        s = 2j * np.pi * np.array([3.0, 8.0, 15.0])
        found = []
        shares = (0.0, 1.0) if form == "warming corner" else (0.1 * min(outcome.size, 1.0),)
        for share in shares:
            other = np.prod([1.0 / (1.0 - s / p) for p in branch(outcome.size)], 0)
            answer = (1.0 - share) / (1.0 - s / pole(outcome.size)) + share * other
            turns = s.imag / (2.0 * np.pi)
            found += list(turns / np.sqrt(np.maximum(np.abs(answer) ** -2 - 1.0, 1e-4)))
            found += list(turns / np.tan(-np.angle(answer)))
        kept = [x for x in found if 0.0 < x < 5.0 * corner]
        return Spans({"bandwidth": hull(pole(outcome.size).real / (-2.0 * np.pi), *kept)})

    return Blueprint("sensor_bandwidth", where, form, (0.01, 1.2), sensing=sensing, spans=spans)


def _drift(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign, pace = float(rng.choice([-1.0, 1.0])), float(rng.uniform(2.0, 4.0))

    def shape(times: Vector) -> Vector:
        if form == "logarithmic creep":
            return np.asarray(pace * np.log1p(times / pace))
        if form == "root of time":
            return np.asarray(2.0 * pace * (np.sqrt(1.0 + times / pace) - 1.0))
        return np.asarray(pace * np.expm1(times / (2.0 * pace)))

    def sensing(size: float) -> Sensing:
        return Sensing(shift={where: lambda t, run: sign * size * shape(t)})

    def spans(outcome: Outcome) -> Spans:
        slopes = []
        for times in scene.times[:2]:
            line = np.polyfit(times, shape(times), 1)[0]
            slopes += [float(line), float(shape(times)[-1] / times[-1])]
        return Spans({"slope": hull(*(sign * outcome.size * x for x in slopes))})

    return Blueprint("sensor_drift", where, form, (0.0005, 4.0), sensing=sensing, spans=spans)


def _engine(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    high = {"slider crank": 0.2, "firing pulses": 0.14}.get(form, 0.3) * scene.rate
    tone, load = float(rng.uniform(20.0, min(52.0, high))), scene.car.mean_load
    front = float(rng.uniform(0.1, 0.9))
    share = np.array([front, 1.0 - front])
    pace, swell = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.1, 0.2))
    waves = []
    for drive in scene.drives:
        t = drive.half_times
        turn = 2.0 * np.pi * tone * t + float(rng.uniform(0.0, 6.28))
        wave = np.cos(turn)
        if form == "slider crank":
            wave = wave + 0.28 * np.cos(2.0 * turn)
        elif form == "firing pulses":
            wave = wave + 0.45 * np.cos(2.0 * turn + 0.4) + 0.15 * np.cos(3.0 * turn + 0.8)
        else:
            wave = wave * (1.0 + swell * np.sin(2.0 * np.pi * pace * t))
        waves.append(wave * np.clip((t - t[0]) / 0.15, 0.0, 1.0))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        curve = np.stack(waves, 1)[:, runs] * size * load
        return Pushed(curve[:, None, :] * share[None, :, None])

    def spans(outcome: Outcome) -> Spans:
        peak = load * outcome.size
        slack = swell if form == "swelling tone" else 0.0
        return Spans(
            {
                "frequency": point(tone),
                "amplitude": hull(peak * (1.0 - slack), peak * (1.0 + slack)),
            }
        )

    return Blueprint(
        "engine_vibration", None, form, (0.0005, 0.4), mechanism=mechanism, spans=spans
    )


_MAKERS: dict[str, Callable[[Scene, str, str, np.random.Generator], Blueprint]] = {
    "external_force": _external_force,
    "spring_rate": _spring_rate,
    "weight_distribution": _weight,
    "sensor_gain": _gain,
    "sensor_lag": _lag,
    "clock_offset": _clock,
    "sensor_bandwidth": _bandwidth,
    "sensor_drift": _drift,
    "engine_vibration": _engine,
}


def listed_fault(
    name: str, scene: Scene, where: str, form: str, rng: np.random.Generator
) -> Blueprint:
    """Return a listed fault outside the suspension's laws in one of its forms."""
    return _MAKERS[name](scene, where, form, rng)
