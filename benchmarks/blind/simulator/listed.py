"""Listed faults of sensors, clocks, given values and outside forces, ready to be sized."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint, Outcome, Spans, hull, point
from .declared import Declared
from .forces import Pushed
from .kinds import AXLES, CHANNELS, Span, Vector, Whole, rows_of
from .pulses import PULSES, page_pulse
from .scene import Scene
from .sensors import Motion, Sensing
from .simulate import Mechanism, Now

__all__ = ["LISTED_FORMS", "listed_fault"]

LISTED_FORMS: dict[str, tuple[str, ...]] = {
    "external_force": tuple(PULSES),
    "spring_rate": ("typing mistake", "parasitic bushings", "cracked leaf"),
    "weight_distribution": ("typing mistake", "luggage moved", "ballast added"),
    "sensor_gain": ("scale", "uneven halves", "curved scale"),
    "sensor_lag": ("pure delay", "sinc³ decimation", "Bessel filter"),
    "clock_offset": ("constant", "constant and drifting", "varying between runs"),
    "sensor_bandwidth": ("one pole", "second pole", "Sallen-Key"),
    "sensor_drift": ("linear", "warming up", "parabola"),
    "engine_vibration": ("one order", "two orders", "hunting idle"),
}


def _external_force(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    run, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    shape = PULSES[form]
    drive = scene.drives[run]
    length = float(rng.uniform(0.15, 0.5))
    start = float(rng.uniform(0.25, 0.6)) * (drive.length - length)
    rows, load = rows_of(where), scene.car.mean_load
    curve = sign * load * shape((drive.half_times - start) / length)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        pushed = np.zeros((len(curve), 2, len(runs)))
        pushed[:, rows] = curve[:, None, None] * (size * (runs == run))
        return Pushed(pushed)

    def spans(outcome: Outcome) -> Spans:
        found = page_pulse(shape, start, length)
        force = hull(*(sign * load * outcome.size * x for x in found["force"]))
        return Spans(
            {"force": force, "start": hull(*found["start"]), "duration": hull(*found["duration"])}
        )

    return Blueprint("external_force", where, form, (0.0005, 0.5), mechanism=mechanism, spans=spans)


def _spring_rate(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, axle = rows_of(where), AXLES.index(where)
    k, given = scene.car.k[axle], scene.declared.k[axle]
    sign = {"parasitic bushings": 1.0, "cracked leaf": -1.0}.get(form, 0.0)
    sign = sign or float(rng.choice([-1.0, 1.0]))
    if form == "typing mistake":

        def written(size: float) -> Declared:
            factor = float(np.exp(-sign * size)) * k / given
            return scene.declared.changed(**{f"k_{where[0]}": factor}).rounded()

        def spans_written(outcome: Outcome) -> Spans:
            return Spans({"factor": point(k / written(outcome.size).k[axle])})

        return Blueprint(
            "spring_rate", where, form, (0.02, 0.9), declare=written, spans=spans_written
        )

    lazy = 0.15 if form == "parasitic bushings" else 0.0
    most = 0.9 if sign > 0 else 0.5

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Beside(rows, k, sign * size, lazy)

    def spans(outcome: Outcome) -> Spans:
        whole = 1.0 + sign * outcome.size
        rested = 1.0 + sign * outcome.size * (1.0 - lazy)
        return Spans({"factor": hull(whole * k / given, rested * k / given)})

    return Blueprint("spring_rate", where, form, (0.02, most), mechanism=mechanism, spans=spans)


class _Beside:
    """A spring of share ``size`` beside the suspension's, of which ``lazy`` creeps in 0.4 s."""

    def __init__(self, rows: slice, k: float, size: Vector, lazy: float) -> None:
        self.rows, self.k, self.size, self.lazy = rows, k, size, lazy
        self.states = 1 if lazy else 0

    def act(self, now: Now) -> None:
        """Add the force of the spring."""
        firm = self.k * self.size
        now.force[self.rows] -= firm * (1.0 - self.lazy) * now.delta[self.rows]
        if self.lazy:
            now.flow[:] = firm * self.lazy * now.rate[self.rows] - now.aux / 0.4
            now.force[self.rows] -= now.aux


def _weight(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign = float(rng.choice([-1.0, 1.0]))
    true, given = scene.car.wdf, scene.declared.wdf
    more = float(rng.uniform(0.2, 1.0)) * scene.declared.sds[0] if form == "ballast added" else 0.0

    def written(size: float) -> Declared:
        factor = float(np.exp(-sign * size)) * true / given
        return scene.declared.changed(wdf=factor, m=1.0 - more).rounded()

    def spans(outcome: Outcome) -> Spans:
        return Spans({"factor": point(true / written(outcome.size).wdf)})

    return Blueprint("weight_distribution", None, form, (0.01, 0.3), declare=written, spans=spans)


def _gain(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign = float(rng.choice([-1.0, 1.0]))
    peak = max(float(np.max(np.abs(rows[:, CHANNELS.index(where)]))) for rows in scene.base[:2])

    def factors(size: float) -> tuple[float, float]:
        change = sign * size
        return (1.0 + change, 1.0 + (0.8 * change if form == "uneven halves" else change))

    def sensing(size: float) -> Sensing:
        up, down = factors(size)
        bow = 0.12 * size / peak if form == "curved scale" else 0.0

        def mount(motion: Motion, run: int) -> Motion:
            a = motion.acceleration[where]
            read = np.where(a > 0.0, up * a, down * a) + bow * a**2
            return Motion(
                motion.begin,
                motion.step,
                {**motion.acceleration, where: read},
                motion.pitch,
                motion.pitching,
            )

        return Sensing(mount=mount)

    def spans(outcome: Outcome) -> Spans:
        up, down = factors(outcome.size)
        slack = 0.06 * outcome.size if form == "curved scale" else 0.0
        return Spans({"factor": hull(up + slack, down + slack, up - slack, down - slack)})

    return Blueprint("sensor_gain", where, form, (0.001, 0.4), sensing=sensing, spans=spans)


def _lag(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    # positive: sampled later than declared; a filter makes readings of what was earlier
    sign = 1.0 if form == "pure delay" and rng.random() < 0.6 else -1.0
    nodes = np.linspace(-1.0, 1.0, 13)[1:-1]
    kernel = np.maximum(1.0 - np.abs(nodes), 0.0) ** 2 * (1.0 + 2.0 * np.abs(nodes))
    kernel = kernel / kernel.sum()

    def sensing(size: float) -> Sensing:
        if form == "pure delay":
            return Sensing(late={where: lambda t, run: np.full(len(t), sign * size)})
        if form == "sinc³ decimation":
            return Sensing(spread={where: (size * (1.0 + nodes), kernel)})
        pair = (complex(-1.5, 0.866025) / size, complex(-1.5, -0.866025) / size)
        return Sensing(poles={where: (*scene.declared.sensors[where].poles, *pair)})

    def spans(outcome: Outcome) -> Spans:
        lag = sign * outcome.size
        if form == "pure delay":
            return Spans({"lag": point(lag)})
        return Spans({"lag": hull(0.97 * lag, lag)})

    least = 0.0004 if form == "Bessel filter" else 0.00001
    return Blueprint("sensor_lag", where, form, (least, 0.012), sensing=sensing, spans=spans)


def _clock(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign = float(rng.choice([-1.0, 1.0]))
    group = [c for c in CHANNELS if c.endswith("chassis") or where == "front"]
    group = [c for c in group if where == "body" or c.startswith("front")]
    drift = float(rng.uniform(2e-5, 6e-5)) if form == "constant and drifting" else 0.0
    between = np.array([1.0, 1.0, 1.0])
    if form == "varying between runs":
        between = np.array([1.0, float(rng.uniform(0.93, 1.07)), float(rng.uniform(0.9, 1.1))])

    def sensing(size: float) -> Sensing:
        def late(times: Vector, run: int) -> Vector:
            return np.asarray(sign * size * between[run] + drift * times)

        return Sensing(late=dict.fromkeys(group, late))

    def spans(outcome: Outcome) -> Spans:
        ends = [sign * outcome.size * x for x in between[:2]]
        longest = max(d.length for d in scene.drives[:2])
        return Spans({"offset": hull(*ends, *(x + drift * longest for x in ends))})

    return Blueprint("clock_offset", where, form, (0.00001, 0.02), sensing=sensing, spans=spans)


def _bandwidth(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    corner = scene.declared.sensors[where].corner
    if corner is None:
        message = "needs a declared filter"
        raise ValueError(message)
    sign = 1.0 if form == "one pole" and rng.random() < 0.4 else -1.0
    own = complex(-2.0 * np.pi * corner)

    def poles(size: float) -> tuple[complex, ...]:
        if form == "one pole":
            return (own * float(np.exp(sign * size)),)
        if form == "second pole":
            return (own, own / float(np.expm1(size) + 1e-9))
        # Sallen and Key with Q = 0.55, whose delay at rest is that of the slower corner
        slow = -float(own.real) * float(np.exp(-size))
        damp, quick = 1.0 / (2.0 * 0.55), slow / 0.55
        root = np.sqrt(complex(damp**2 - 1.0))
        return (quick * (-damp + root), quick * (-damp - root))

    def sensing(size: float) -> Sensing:
        return Sensing(poles={where: poles(size)})

    def spans(outcome: Outcome) -> Spans:
        found = [corner * float(np.exp(sign * outcome.size))]
        if form != "one pole":
            s = 2j * np.pi * np.array([3.0, 8.0, 15.0])
            answer = np.prod([1.0 / (1.0 - s / p) for p in poles(outcome.size)], 0)
            turns = s.imag / (2.0 * np.pi)
            found += list(turns / np.sqrt(np.maximum(np.abs(answer) ** -2 - 1.0, 1e-4)))
            found += list(turns / np.tan(-np.angle(answer)))
        kept = [x for x in found if 0.0 < x < 3.0 * corner]
        return Spans({"bandwidth": hull(*kept)})

    least = float(np.log1p(corner / 1200.0)) if form == "second pole" else 0.002
    return Blueprint("sensor_bandwidth", where, form, (least, 1.1), sensing=sensing, spans=spans)


def _drift(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    sign = float(rng.choice([-1.0, 1.0]))
    warm = float(rng.uniform(4.0, 9.0))

    def shape(times: Vector) -> Vector:
        if form == "warming up":
            return np.asarray(warm * -np.expm1(-times / warm))
        if form == "parabola":
            return times * (0.75 + 0.25 * times / 3.0)
        return times

    def sensing(size: float) -> Sensing:
        return Sensing(shift={where: lambda t, run: sign * size * shape(t)})

    def spans(outcome: Outcome) -> Spans:
        slopes = []
        for times in scene.times[:2]:
            line = np.polyfit(times, shape(times), 1)[0]
            slopes += [float(line), float((shape(times)[-1]) / times[-1])]
        return Spans({"slope": hull(*(sign * outcome.size * x for x in slopes))})

    return Blueprint("sensor_drift", where, form, (0.0005, 3.0), sensing=sensing, spans=spans)


def _engine(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    low, high = 22.0, min(58.0, 0.36 * scene.rate)
    tone, load = float(rng.uniform(low, high)), scene.car.mean_load
    front = float(rng.uniform(0.1, 0.8))
    share = np.array([front, 1.0 - front])
    hunt = float(rng.uniform(0.03, 0.12)) if form == "hunting idle" else 0.0
    pace = float(rng.uniform(0.3, 0.7))
    waves = []
    for drive in scene.drives:
        t = drive.half_times
        phase = float(rng.uniform(0.0, 6.28))
        turn = 2.0 * np.pi * tone * t - hunt / pace * np.cos(2.0 * np.pi * pace * t) + phase
        wave = np.cos(turn)
        if form == "two orders":
            wave = wave + 0.35 * np.cos(0.5 * turn + 1.0)
        rise = np.clip((t - t[0]) / 0.15, 0.0, 1.0)
        waves.append(wave * rise)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        curve = np.stack(waves, 1)[:, runs] * size * load
        return Pushed(curve[:, None, :] * share[None, :, None])

    def spans(outcome: Outcome) -> Spans:
        found: dict[str, Span] = {
            "frequency": hull(tone - hunt, tone + hunt),
            "amplitude": hull(0.93 * load * outcome.size, load * outcome.size),
        }
        if not hunt:
            found["amplitude"] = point(load * outcome.size)
        return Spans(found)

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
