"""Listed faults of dampers, springs, friction and stops, ready to be sized."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint, Outcome, Spans, hull, point
from .forces import (
    DIGRESSIVE,
    FRICTION,
    SPRINGS,
    STOPS,
    UNEVEN,
    Bristles,
    Law,
    Maxwell,
    Plain,
    Timed,
)
from .kinds import AXLES, Span, Vector, Whole, rows_of
from .scene import Scene
from .simulate import Mechanism, Now
from .spans import PAGE, axle_names, equal_power, fitted, records, trimmed

__all__ = ["FORMS", "suspension_fault"]

FORMS: dict[str, tuple[str, ...]] = {
    "bound_rebound": tuple(UNEVEN),
    "digressive_damper": tuple(DIGRESSIVE),
    "damper_hysteresis": ("Maxwell", "gas that hardens", "rubber mount"),
    "coulomb_friction": (*FRICTION, "Dahl", "LuGre"),
    "progressive_spring": tuple(SPRINGS),
    "bump_stop": tuple(STOPS),
    "droop_stop": tuple(STOPS),
    "damper_fade": ("linear", "exponential", "thermal", "S-shaped"),
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
    rows, sign = rows_of(where), 1.0 if rng.random() < 0.7 else -1.0
    c = _column(scene.car.c, rows)

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return Plain(rows, UNEVEN[form](c, sign * size))

    def spans(outcome: Outcome) -> Spans:
        ratios, rounds, damping = [float(np.exp(sign * outcome.size))], [], []
        for axle, answers in _per_axle("bound_rebound", scene, where, outcome):
            ratios += [float(np.exp(x[0])) for _, x, _ in answers]
            rounds += [float(np.exp(x[1])) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        parameters = {"ratio": hull(*ratios)}
        if form in ("tanh", "log cosh", "hyperbola"):
            parameters["rounding"] = hull(*rounds)
        return Spans(parameters, *_damping(damping))

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

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        stiffness = np.ones_like(c) * (mean / size)
        if form == "gas that hardens":
            return Maxwell(rows, c, stiffness, hardens=mean * 0.25)
        if form == "rubber mount":
            return Maxwell(rows, c, stiffness, parallel=0.12 * c)
        return Maxwell(rows, c, stiffness)

    def spans(outcome: Outcome) -> Spans:
        values, damping = [mean / outcome.size], []
        for axle, answers in _per_axle("damper_hysteresis", scene, where, outcome):
            if form != "Maxwell":
                values += [float(np.exp(x[0])) for _, x, _ in answers]
                damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        return Spans({"stiffness": hull(*values)}, *_damping(damping))

    span = (0.0007, 0.03) if form == "gas that hardens" else (0.0002, 0.03)
    return Blueprint("damper_hysteresis", where, form, span, mechanism=mechanism, spans=spans)


def _friction(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, load = rows_of(where), scene.car.mean_load
    give = float(rng.uniform(0.0004, 0.0009))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        if form in FRICTION:
            return Plain(rows, FRICTION[form](load * size))
        return Bristles(rows, load * size, give, 0.25 if form == "LuGre" else 0.0)

    def spans(outcome: Outcome) -> Spans:
        forces, slips, damping = [load * outcome.size], [], []
        for axle, answers in _per_axle("coulomb_friction", scene, where, outcome):
            forces += [100.0 * float(x[0]) for _, x, _ in answers]
            slips += [float(np.exp(x[1])) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        parameters = {"force": hull(*forces)}
        if form in ("tanh", "arctan"):
            parameters["slip"] = hull(*slips)
        return Spans(parameters, *_damping(damping))

    return Blueprint(
        "coulomb_friction", where, form, (0.0003, 0.25), mechanism=mechanism, spans=spans
    )


def _progressive(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, sign = rows_of(where), 1.0 if form == "cubic" or rng.random() < 0.75 else -1.0
    k = _column(scene.car.k, rows)
    reach = float(np.max(np.abs(scene.history.delta[:, rows, :2])))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return Plain(rows, SPRINGS[form](k, sign * size / reach**2))

    def spans(outcome: Outcome) -> Spans:
        values, damping = [sign * outcome.size / reach**2], []
        for axle, answers in _per_axle("progressive_spring", scene, where, outcome):
            values += [100.0 * float(x[0]) for _, x, _ in answers]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        parameters = {"kappa": hull(*values)}
        if form == "cubic":
            parameters["curl"] = point(0.0)
        elif form == "sinh" and sign > 0:
            parameters["curl"] = point(0.3)
        return Spans(parameters, *_damping(damping))

    return Blueprint(
        "progressive_spring", where, form, (0.002, 1.0), mechanism=mechanism, spans=spans
    )


def _stop(scene: Scene, where: str, form: str, rng: np.random.Generator, sign: float) -> Blueprint:
    """Return a stop at one axle; its size is the share of the travel that lies beyond it."""
    rows, axle = rows_of(where), AXLES.index(where)
    first = float(np.exp(rng.uniform(np.log(1.8), np.log(7.0)))) * float(np.mean(scene.car.k))
    peak = float(np.max(sign * scene.history.delta[:, axle, :2]))
    law = STOPS[form]

    def gap_of(size: Vector) -> Vector:
        return np.asarray(peak * (1.0 - size))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        gap = gap_of(size)

        def force(delta: Vector, rate: Vector) -> Vector:
            d = np.maximum(sign * delta - gap, 0.0)
            return np.asarray(-sign * law(first, d, sign * rate))

        return Plain(rows, force)

    def spans(outcome: Outcome) -> Spans:
        gap = float(gap_of(np.array(outcome.size)))
        deepest = max(
            float(np.max(sign * h.delta[:, axle, 0])) - gap for h in outcome.histories[:2]
        )
        d = np.linspace(0.0, max(deepest, 1e-5), 200)
        force = law(first, d, np.zeros_like(d))
        slopes = np.gradient(force, d)
        straight = np.polyfit(d[40:], force[40:], 1)
        meets = gap - float(straight[1]) / float(straight[0])
        parameters = {"gap": hull(gap, meets)}
        if form != "Hunt-Crossley":
            parameters["rate"] = hull(float(slopes[1]), float(slopes[-2]))
        return Spans(parameters)

    name = "bump_stop" if sign < 0 else "droop_stop"
    return Blueprint(name, where, form, (0.01, 0.7), mechanism=mechanism, spans=spans)


def _bump(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    return _stop(scene, where, form, rng, -1.0)


def _droop(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    return _stop(scene, where, form, rng, 1.0)


class _Thermal:
    """A damper that thins as it warms: memory is the work it has taken (J)."""

    def __init__(self, rows: slice, c: Vector, size: Vector, work: Vector) -> None:
        self.rows, self.c, self.size, self.work = rows, c, size, work
        self.states = rows.stop - rows.start

    def worn(self, taken: Vector) -> Vector:
        """Share of the rate that is lost after work has been taken (J)."""
        return np.asarray(self.size * np.expm1(-0.7 * taken / self.work) / np.expm1(-0.7))

    def act(self, now: Now) -> None:
        """Take away the lost share of the damper force."""
        rate = now.rate[self.rows]
        now.flow[:] = self.c * rate**2
        now.force[self.rows] += self.c * self.worn(now.aux) * rate


def _fade(scene: Scene, where: str, form: str, rng: np.random.Generator) -> Blueprint:
    rows, bend = rows_of(where), float(rng.uniform(1.5, 3.0))
    c = _column(scene.car.c, rows)
    power = c[None] * scene.history.rate[:, rows] ** 2
    work = np.max(np.sum(power[:, :, :2], 0), 1)[:, None] * scene.drives[0].step

    def worn(share: Vector) -> Vector:
        s = np.clip(share, 0.0, 1.0)
        if form == "exponential":
            return np.asarray(np.expm1(-bend * s) / np.expm1(-bend))
        if form == "S-shaped":
            return s * s * (3.0 - 2.0 * s)
        return s

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        if form == "thermal":
            return _Thermal(rows, c, size, work)
        shares = np.stack([d.half_times / d.length for d in scene.drives], 1)[:, runs]
        return Timed(rows, c, -size * worn(shares)[:, None, :])

    def spans(outcome: Outcome) -> Spans:
        losses, bends, damping = [outcome.size], [], []
        for axle, answers in _per_axle("damper_fade", scene, where, outcome):
            losses += [float(x[0]) for _, x, _ in answers]
            bends += [float(x[1]) for number, x, _ in answers if number == 0]
            damping.append((axle, trimmed([a[2] for a in answers], scene.car.c[axle])))
        if form in ("linear", "exponential"):
            exact = {"linear": 0.0, "exponential": bend}[form]
            return Spans({"loss": point(outcome.size), "bend": point(exact)})
        return Spans({"loss": hull(*losses), "bend": hull(*bends)}, *_damping(damping))

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
