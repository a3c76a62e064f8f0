"""Listed faults of dampers, springs, friction and stops, ready to be sized."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint, Outcome, Spans, hull
from .forces import DIGRESSIVE, SPRINGS, STOPS, UNEVEN, Law, Plain, Timed, lip_seal, strut_friction
from .kinds import AXLES, Span, Vector, Whole, rows_of
from .memories import AeratedOil, BoucWen, CubicBush, LateBall, Relaxing, Strokes, Zener
from .scene import Scene
from .simulate import Mechanism
from .spans import PAGE, axle_names, equal_power, fitted, records, stop_laws, trimmed

__all__ = ["FORMS", "suspension_fault"]

FORMS: dict[str, tuple[str, ...]] = {
    "bound_rebound": (*UNEVEN, "late ball"),
    "digressive_damper": tuple(DIGRESSIVE),
    "damper_hysteresis": ("Zener mount", "aerated oil", "cubic bush"),
    "coulomb_friction": ("Bouc-Wen", "lip seal", "loaded strut"),
    "progressive_spring": tuple(SPRINGS),
    "bump_stop": ("neo-Hookean block", "pad with dashpot", "relaxing rubber"),
    "droop_stop": ("webbing with a toe", "neo-Hookean block", "relaxing rubber"),
    "damper_fade": ("leaking seal", "late foam", "foaming by strokes"),
}


def _column(pair: Span, rows: slice) -> Vector:
    return np.asarray(pair, float)[rows][:, None]


def _per_axle(
    name: str, scene: Scene, where: str, outcome: Outcome
) -> list[tuple[int, list[tuple[int, Vector, float]]]]:
    """Answers of the page's laws at each axle of a place."""
    answers = []
    for axle in axle_names(where):
        runs = records(outcome.histories, scene.drives, [axle])
        answers.append((axle, fitted(PAGE[name], runs, scene.car, axle)))
    return answers


def _damping(found: list[tuple[int, Span]]) -> tuple[Span | None, Span | None]:
    """Spans of c_f and c_r from spans by axle."""
    by_axle = dict(found)
    return by_axle.get(0), by_axle.get(1)


def _power_rates(scene: Scene, axle: int, law: Law, outcome: Outcome) -> tuple[float, float]:
    """Equal-power rates over normal rates and over those that were driven, N·s/m."""
    c = scene.car.c[axle]

    def force(rate: Vector) -> Vector:
        return np.asarray(c * rate - law(np.zeros((1, len(rate))), rate[None])[0])

    driven = np.concatenate(
        [run[0].rate for run in records(outcome.histories, scene.drives, [axle])]
    )
    return equal_power(force), equal_power(force, driven)


def _bound_rebound(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, sign = rows_of(where), 1.0 if rng.random() < 0.65 else -1.0
    c, late = _column(scene.car.c, rows), float(rng.uniform(0.001, 0.002))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        if form in UNEVEN:
            return Plain(rows, UNEVEN[form](c, sign * size))
        return LateBall(rows, c, np.tanh(0.5 * sign * size), late)

    def spans(outcome: Outcome) -> Spans:
        ratios, damping = [float(np.exp(sign * outcome.size))], []
        for axle, answers in _per_axle("bound_rebound", scene, where, outcome):
            ratios += [float(np.exp(x[0])) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        return Spans({"ratio": hull(*ratios)}, *_damping(damping))

    return Blueprint("bound_rebound", where, form, (0.002, 1.6), mechanism=mechanism, spans=spans)


def _digressive(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows = rows_of(where)
    c = _column(scene.car.c, rows)
    maker, span = DIGRESSIVE[form]

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return Plain(rows, maker(c, size))

    def spans(outcome: Outcome) -> Spans:
        knees, damping = [], []
        for axle, answers in _per_axle("digressive_damper", scene, where, outcome):
            knees += [float(np.exp(x[0])) for _, x, _ in answers]
            law = maker(np.array([[scene.car.c[axle]]]), np.array([outcome.size]))
            rates = _power_rates(scene, axle, law, outcome)
            values = [a[2] for a in answers] + list(rates)
            damping.append((axle, trimmed(values, scene.car.c[axle])))
        return Spans({"knee": hull(*knees)}, *_damping(damping))

    return Blueprint("digressive_damper", where, form, span, mechanism=mechanism, spans=spans)


def _hysteresis(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows = rows_of(where)
    c = _column(scene.car.c, rows)
    mean = float(np.mean(c))
    usual = c * float(np.std(scene.history.rate[:, rows, :2]))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        stiffness = np.ones_like(c) * (mean / size)
        if form == "Zener mount":
            return Zener(rows, c, stiffness)
        if form == "aerated oil":
            return AeratedOil(rows, c, stiffness, 8.0 * usual)
        return CubicBush(rows, c, stiffness, 6.0 * usual)

    def spans(outcome: Outcome) -> Spans:
        values, damping = [mean / outcome.size], []
        for axle, answers in _per_axle("damper_hysteresis", scene, where, outcome):
            values += [float(np.exp(x[0])) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        return Spans({"stiffness": hull(*values)}, *_damping(damping))

    span = (0.0007, 0.03)
    return Blueprint("damper_hysteresis", where, form, span, mechanism=mechanism, spans=spans)


def _friction(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, load = rows_of(where), scene.car.mean_load
    give = float(rng.uniform(0.000012, 0.00003))
    bias = float(rng.uniform(-0.1, 0.1))
    reach = float(np.max(np.abs(scene.history.delta[:, rows, :2])))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        if form == "loaded strut":
            return Plain(rows, strut_friction(load * size, reach))
        if form == "lip seal":
            return Plain(rows, lip_seal(load * size, bias))
        return BoucWen(rows, load * size, give)

    def spans(outcome: Outcome) -> Spans:
        forces, damping = [load * outcome.size], []
        for axle, answers in _per_axle("coulomb_friction", scene, where, outcome):
            forces += [100.0 * float(x[0]) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        return Spans({"force": hull(*forces)}, *_damping(damping))

    return Blueprint(
        "coulomb_friction", where, form, (0.0003, 0.25), mechanism=mechanism, spans=spans
    )


def _progressive(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    maker, softens = SPRINGS[form]
    rows, sign = rows_of(where), -1.0 if softens and rng.random() < 0.5 else 1.0
    k = _column(scene.car.k, rows)
    reach = float(np.max(np.abs(scene.history.delta[:, rows, :2])))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return Plain(rows, maker(k, sign * size / reach**2))

    def spans(outcome: Outcome) -> Spans:
        values, damping = [sign * outcome.size / reach**2], []
        for axle, answers in _per_axle("progressive_spring", scene, where, outcome):
            values += [100.0 * float(x[0]) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        return Spans({"kappa": hull(*values)}, *_damping(damping))

    return Blueprint(
        "progressive_spring", where, form, (0.002, 0.7), mechanism=mechanism, spans=spans
    )


def _stop(scene: Scene, where: str, form: str, rng: np.random.Generator, sign: float) -> Blueprint:
    """Return a stop at one axle; its size is the share of the travel that lies beyond it."""
    rows, axle = rows_of(where), AXLES.index(where)
    first = float(np.exp(rng.uniform(np.log(1.6), np.log(8.0)))) * float(np.mean(scene.car.k))
    peak = float(np.max(sign * scene.history.delta[:, axle, :2]))
    fades = float(rng.uniform(0.03, 0.07))

    def gap_of(size: Vector) -> Vector:
        return np.asarray(peak * (1.0 - size))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        gap = gap_of(size)
        if form == "relaxing rubber":
            return Relaxing(rows, sign, first, gap, fades)
        law = STOPS[form]

        def force(delta: Vector, rate: Vector) -> Vector:
            d = np.maximum(sign * delta - gap, 0.0)
            return np.asarray(-sign * law(first, d, sign * rate))

        return Plain(rows, force)

    def spans(outcome: Outcome) -> Spans:
        gap = float(gap_of(np.array(outcome.size)))
        runs = records(outcome.histories, scene.drives, [axle])
        whole = fitted(stop_laws(sign, gap, first), runs, scene.car, axle)
        # a run that does not meet the stop says nothing of it
        answers = [a for a in whole if 0.8 * gap < 0.01 * a[1][1] < 1.2 * gap]
        gaps = [gap, *(0.01 * float(x[1]) for _, x, _ in answers)]
        rates = [first, *(float(np.exp(x[0])) for number, x, _ in answers if number == 0)]
        kept = [r for r in rates if first / 6.0 < r < 6.0 * first]
        damping = [(axle, trimmed([a[2] for a in answers], scene.car.c[axle]))]
        return Spans({"gap": hull(*gaps), "rate": hull(*kept)}, *_damping(damping))

    name = "bump_stop" if sign < 0 else "droop_stop"
    return Blueprint(name, where, form, (0.01, 0.7), mechanism=mechanism, spans=spans)


def _bump(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    return _stop(scene, where, form, rng, -1.0)


def _droop(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    return _stop(scene, where, form, rng, 1.0)


def _fade(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, power = rows_of(where), float(rng.uniform(1.4, 2.2))
    c = _column(scene.car.c, rows)
    ways = np.sum(np.abs(scene.history.rate[:, rows, :2]), 0) * scene.drives[0].step
    whole = np.max(ways, 1)[:, None]

    def worn(share: Vector) -> Vector:
        s = np.clip(share, 0.0, 1.0)
        return s * (2.0 - s) if form == "leaking seal" else s**power

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        if form == "foaming by strokes":
            return Strokes(rows, c, size, whole)
        shares = np.stack([d.half_times / d.length for d in scene.drives], 1)[:, runs]
        return Timed(rows, c, -size * worn(shares)[:, None, :])

    def spans(outcome: Outcome) -> Spans:
        losses, bends, damping = [outcome.size], [], []
        for axle, whole_answers in _per_axle("damper_fade", scene, where, outcome):
            # before the obstacle nothing moves, and a free bend may put any rate there
            true = scene.car.c[axle]
            most = 0.02 + 0.4 * outcome.size
            answers = [a for a in whole_answers if abs(np.log(a[2] / true)) < most]
            losses += [float(x[0]) for _, x, _ in answers]
            bends += [float(x[1]) for number, x, _ in answers if number == 0]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        parameters = {"loss": hull(*losses)}
        if bends and form != "foaming by strokes":
            parameters["bend"] = hull(*bends)
        return Spans(parameters, *_damping(damping))

    return Blueprint("damper_fade", where, form, (0.004, 0.75), mechanism=mechanism, spans=spans)


_MAKERS: dict[str, Callable[[Scene, str, str, np.random.Generator], Blueprint]] = {
    "bound_rebound": _bound_rebound,
    "digressive_damper": _digressive,
    "damper_hysteresis": _hysteresis,
    "coulomb_friction": _friction,
    "progressive_spring": _progressive,
    "bump_stop": _bump,
    "droop_stop": _droop,
    "damper_fade": _fade,
}


def suspension_fault(
    name: str, scene: Scene, where: str, form: str, rng: np.random.Generator
) -> Blueprint:
    """Return a listed fault of the suspension in one of its forms."""
    return _MAKERS[name](scene, where, form, rng)
