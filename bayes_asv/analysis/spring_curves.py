"""Curve and shape of a spring whose force is not proportional to travel.

Its curve F(δ) is summarised by the stiffness at rest, and by force over deflection at the travel
used on either side.  Its shape is described by ratios that are defined for any curve, with the
posterior probability of each statement: on either side, the mean slope over the upper half of the
travel used over that in its lowest eighth (larger is stiffening, smaller is softening); and force
in extension over force in compression, at the travel that both sides used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.curve_shapes import SLOWEST, CurveShape, curve_shapes, log_bend, ratio
from bayes_asv.analysis.damping_rates import MAX_DRAWS
from bayes_asv.filters.force_laws import excess_many
from bayes_asv.models.effects.piecewise_slope import between_knots
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["SpringCurve", "spring_curves"]

Array = NDArray[np.float64]

_DEEPEST = 0.99  # quantile of the travel on either side up to which the shape is described
# Ratio of slopes above which a curve is stiffening or softening: twice a spring's tolerance.
_BENT = 1.1
_POINTS = 61  # number of points of a curve over the range driven
_LEAST = 1e-6  # travel on a side that was not used, m


@dataclass(frozen=True)
class SpringCurve:
    """Draws of the curve of one spring.

    Parameters
    ----------
    element : str
        Name of the suspension element.
    parameter : str
        Name of its spring rate.
    travel : pair of float
        Largest compression and extension, m, both positive.
    at_rest : (N,) array
        Stiffness at rest, N/m.
    compression, extension : (N,) arrays
        Force over deflection at ``travel`` on either side, N/m.
    shapes : tuple of CurveShape
        Statements that are more probable than not.
    deflection : (P,) array
        Deflections over the range driven, m, extension positive.
    force : (N, P) array
        Force at these deflections, N, positive if it resists extension.
    """

    element: str
    parameter: str
    travel: tuple[float, float]
    at_rest: Array
    compression: Array
    extension: Array
    shapes: tuple[CurveShape, ...]
    deflection: Array
    force: Array


def spring_curves(
    posterior: Posterior, mode: Array, z: Array, draws: Mapping[str, Array]
) -> tuple[SpringCurve, ...]:
    """Compute the curve of every spring that has a free one.

    Parameters
    ----------
    posterior : Posterior
        Posterior of a model with effects.
    mode : (D,) array
        Coordinates for which the deflections driven are computed.
    z : (N, D) array
        Draws of the posterior; 2000 of them are used.
    draws : mapping of str to (N,) array
        Corresponding draws of the car's quantities, SI units; a missing spring rate is nominal.

    Returns
    -------
    tuple of SpringCurve
        In the order of the car's suspension elements; empty without a free curve.
    """
    space = posterior.space
    laws = [s for s in space.placed_effects if s.effect.on_spring]
    if not any(placed.effect.free_form for placed in laws):
        return ()
    runs = range(len(space.recordings))
    states = [posterior.innovations_and_variances(mode, run)[2] for run in runs]
    picked = np.linspace(0, len(z) - 1, min(len(z), MAX_DRAWS)).astype(int)
    tables = []
    for one in z[picked]:
        values = space.effects(one)
        tables.append(law_table(space.car, {placed: values[placed] for placed in laws}, 0))
    out = []
    for e, element in enumerate(space.car.elements):
        if not any(s.effect.free_form and e in s.elements(space.car) for s in laws):
            continue
        deflection = np.concatenate([run[:, 2 * e] for run in states])
        travel = _travel(-deflection), _travel(deflection)
        shown = np.linspace(min(deflection.min(), 0.0), max(deflection.max(), 0.0), _POINTS)
        shares = np.array([SLOWEST, 0.5, 1.0])
        common = min(travel)
        grid = np.concatenate([-travel[0] * shares, travel[1] * shares, [-common, common], shown])
        nominal = np.full(len(z), space.car.nominal[element.spring][0])
        k = draws.get(element.spring, nominal).ravel()[picked]
        zero = np.zeros_like(grid)
        force = np.array(
            [
                one * grid - excess_many(table, e, 0.0, one, grid, zero, zero, 1.0)[:, 0]
                for one, table in zip(k, tables, strict=True)
            ]
        )
        bends = {
            "compression": log_bend(*-force[:, 0:3].T),
            "extension": log_bend(*force[:, 3:6].T),
        }
        sides = ratio(force[:, 7], -force[:, 6])
        out.append(
            SpringCurve(
                element=element.name,
                parameter=element.spring,
                travel=travel,
                at_rest=k,
                compression=-force[:, 2] / travel[0],
                extension=force[:, 5] / travel[1],
                shapes=curve_shapes(bends, sides, ("softening", "stiffening"), _BENT),
                deflection=shown,
                force=between_knots(force[:, 8:]),
            )
        )
    return tuple(out)


def _travel(deflection: Array) -> float:
    """Travel that was used on one side, given deflections (N,) that are positive on that side."""
    positive = deflection[deflection > 0.0]
    return max(float(np.quantile(positive, _DEEPEST)), _LEAST) if len(positive) else _LEAST
