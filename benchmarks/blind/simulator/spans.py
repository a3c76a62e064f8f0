"""Spans of the values that may rightly be reported for a law of another form.

The laws of the page of effects are fitted to the force that the suspension really had: over both
runs and over each, with even weight and with weight on fast motion, with the spring as it is and
free. The span holds all of these answers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from .blueprint import hull
from .cars import Car
from .kinds import AXLES, Span, Vector
from .simulate import Drive, History

__all__ = [
    "PAGE",
    "SPRING",
    "PageLaw",
    "Record",
    "equal_power",
    "fitted",
    "records",
    "stop_laws",
    "trimmed",
]


@dataclass(frozen=True)
class Record:
    """Force of one axle's suspension (N, upward on the chassis) over a run.

    ``delta`` (m), ``rate`` (m/s), and the elapsed share of the run.
    """

    delta: Vector
    rate: Vector
    force: Vector
    share: Vector
    step: float


def records(
    histories: Sequence[History], drives: Sequence[Drive], axles: Sequence[int]
) -> list[list[Record]]:
    """Return records of the fitted runs: for each run, one for each axle."""
    found = []
    for history, drive in zip(histories[:2], drives[:2], strict=True):
        inside = (history.times >= 0.0) & (history.times <= drive.length)
        pick = np.flatnonzero(inside)[::3]
        found.append(
            [
                Record(
                    history.delta[pick, axle, 0],
                    history.rate[pick, axle, 0],
                    history.suspension[pick, axle, 0],
                    history.times[pick] / drive.length,
                    3.0 * drive.step,
                )
                for axle in axles
            ]
        )
    return found


PageLaw = Callable[[Vector, float, float, Record], Vector]
"""Force of a law of the page: from its parameters, c, k and the motion."""


def _bound_rebound(p: Vector, c: float, k: float, r: Record) -> Vector:
    ratio, rounding = np.exp(p[0]), np.exp(p[1])
    a = (ratio - 1.0) / (ratio + 1.0)
    uneven = 1.0 + a * r.rate / np.hypot(r.rate, rounding)
    return np.asarray(-k * r.delta - c * r.rate * uneven)


def _digressive(p: Vector, c: float, k: float, r: Record) -> Vector:
    knee, drop = np.exp(p[0]), np.exp(p[1])
    speed = np.abs(r.rate / knee) + 1e-12
    flat = 1.0 - drop / (1.0 + drop) * (1.0 - 1.0 / np.hypot(1.0, speed))
    return np.asarray(-k * r.delta - c * r.rate * flat)


def _digressive_fixed(p: Vector, c: float, k: float, r: Record) -> Vector:
    return _digressive(np.array([p[0], np.log(2.0)]), c, k, r)  # the centre of its prior


def _friction(p: Vector, c: float, k: float, r: Record) -> Vector:
    slip = np.exp(p[1])
    rub = 100.0 * p[0] * r.rate / np.hypot(r.rate, slip)
    return np.asarray(-k * r.delta - c * r.rate - rub)


def _progressive(p: Vector, c: float, k: float, r: Record) -> Vector:
    kappa, x = 100.0 * p[0], r.delta
    bent = 1.0 + kappa * x**2 + p[1] * kappa**2 * x**4
    return np.asarray(-k * x * bent - c * r.rate)


def _progressive_fixed(p: Vector, c: float, k: float, r: Record) -> Vector:
    return _progressive(np.array([p[0], 0.15]), c, k, r)


def _fade(p: Vector, c: float, k: float, r: Record) -> Vector:
    b = p[1] if abs(p[1]) > 1e-4 else 1e-4
    worn = np.expm1(-b * r.share) / np.expm1(-b)
    return np.asarray(-k * r.delta - c * r.rate * (1.0 - p[0] * worn))


def _fade_straight(p: Vector, c: float, k: float, r: Record) -> Vector:
    return _fade(np.array([p[0], 0.0]), c, k, r)


def _hysteresis(p: Vector, c: float, k: float, r: Record) -> Vector:
    z = r.step * float(np.exp(p[0])) / c
    keep = float(np.exp(-z))
    old = -np.expm1(-z) / z - keep
    lagged = lfilter([1.0 - keep - old, old], [1.0, -keep], r.rate)
    return np.asarray(-k * r.delta - c * lagged)


def stop_laws(sign: float, gap: float, rate: float) -> tuple[tuple[PageLaw, Vector], ...]:
    """Return the page's stop, as a spring and with a free exponent; the start is near the truth.

    ``sign`` is −1 in compression. Parameters are the logarithm of the rate, the gap in
    centimetres, the logarithm of the onset and that of the exponent.
    """

    def spring(p: Vector, c: float, k: float, r: Record) -> Vector:
        return bent(np.array([*p, 0.0]), c, k, r)

    def bent(p: Vector, c: float, k: float, r: Record) -> Vector:
        first, onset, power = np.exp(p[0]), np.exp(p[2]), np.exp(p[3])
        over = sign * r.delta - 0.01 * p[1]
        rest = -0.01 * p[1]
        d = 0.5 * (over + np.hypot(over, onset)) - 0.5 * (rest + np.hypot(rest, onset))
        push = first * onset * (np.maximum(d, 0.0) / onset) ** power
        return np.asarray(-k * r.delta - c * r.rate - sign * push)

    start = np.array([np.log(rate), 100.0 * gap, np.log(0.002)])
    return ((spring, start), (bent, np.array([*start, 0.15])))


def _spring(p: Vector, c: float, k: float, r: Record) -> Vector:
    return np.asarray(-k * float(np.exp(p[0])) * r.delta - c * r.rate)


SPRING: tuple[tuple[PageLaw, Vector], ...] = ((_spring, np.array([0.0])),)
"""Linear spring whose factor (its logarithm) is free."""

PAGE: dict[str, tuple[tuple[PageLaw, Vector], ...]] = {
    "bound_rebound": ((_bound_rebound, np.array([0.0, np.log(0.015)])),),
    "digressive_damper": (
        (_digressive, np.array([np.log(0.5), np.log(2.0)])),
        (_digressive_fixed, np.array([np.log(0.5)])),
    ),
    "coulomb_friction": ((_friction, np.array([0.1, np.log(0.01)])),),
    "progressive_spring": (
        (_progressive, np.array([0.1, 0.15])),
        (_progressive_fixed, np.array([0.1])),
    ),
    "damper_fade": ((_fade, np.array([0.05, 0.4])), (_fade_straight, np.array([0.05]))),
    "damper_hysteresis": ((_hysteresis, np.array([np.log(8e5)])),),
}
"""Laws of the page that are fitted, with starts; logarithms where the parameter is positive."""


def fitted(
    laws: Sequence[tuple[PageLaw, Vector]],
    runs: Sequence[Sequence[Record]],
    car: Car,
    axle: int,
    springs: bool = True,
) -> list[tuple[int, Vector, float]]:
    """Answers (number of the law, parameters, c in N·s/m) at one axle.

    ``runs`` has records of that axle. With ``springs``, one answer has a spring that is free.
    """
    c_true, k_true = car.c[axle], car.k[axle]
    answers: list[tuple[int, Vector, float]] = []
    for number, (law, start) in enumerate(laws):
        for pick, fast, free in (
            (runs, False, False),
            (runs[:1], False, False),
            (runs[1:], False, False),
            (runs, True, False),
            *(((runs, False, True),) if springs else ()),
        ):
            used = [run[0] for run in pick]
            rms = float(np.sqrt(np.mean(np.concatenate([r.force for r in used]) ** 2)))

            def misfit(
                x: Vector,
                law: PageLaw = law,
                used: list[Record] = used,
                fast: bool = fast,
                free: bool = free,
                rms: float = rms,
            ) -> Vector:
                c = c_true * float(np.exp(x[0]))
                k = k_true * float(np.exp(x[1])) if free else k_true
                parts = []
                for record in used:
                    gap = (law(x[2:], c, k, record) - record.force) / rms
                    if fast:
                        gap = gap * np.abs(record.rate) / (np.std(record.rate) + 1e-9)
                    parts.append(gap)
                return np.concatenate(parts)

            first = np.concatenate([[0.0, 0.0], start])
            wide = np.full(len(start), 12.0)
            if law is _digressive:
                wide[1] = 2.6  # drop from 0.15 to 27, where its prior lies
            low = np.concatenate([[-2.0, -1.0], start - wide])
            high = np.concatenate([[2.0, 1.0], start + wide])
            found = least_squares(misfit, first, bounds=(low, high), x_scale=0.1, max_nfev=60)
            answers.append((number, found.x[2:], c_true * float(np.exp(found.x[0]))))
    return answers


def trimmed(values: Sequence[float], centre: float | None = None) -> Span:
    """Span of answers, with a true value of the law where it has one."""
    kept = [v for v in values if np.isfinite(v)]
    if centre is not None:
        kept.append(centre)
    return hull(*kept)


def equal_power(force: Callable[[Vector], Vector], rates: Vector | None = None) -> float:
    """Rate (N·s/m) of the linear damper that takes the same power.

    ``force`` opposes the rate. Without ``rates`` (m/s) they are normal with 0.15 m/s.
    """
    if rates is None:
        grid: Vector = np.linspace(-0.9, 0.9, 3601)
        weight: Vector = np.exp(-0.5 * (grid / 0.15) ** 2)
    else:
        grid, weight = rates, np.ones_like(rates)
    return float(np.sum(weight * force(grid) * grid) / np.sum(weight * grid**2))


def axle_names(where: str) -> tuple[int, ...]:
    """Numbers of the axles at a place."""
    return (0, 1) if where == "both" else (AXLES.index(where),)
