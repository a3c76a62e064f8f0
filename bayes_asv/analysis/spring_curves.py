"""Curve and shape of a spring whose force is not proportional to travel.

The stiffness at rest and the force over the deflection at the travel used on either side stand for
its curve F(δ).  Its shape is described by ratios that hold for any curve, with the posterior
probability of each statement: on either side the mean slope over the upper half of the travel used
over that in its lowest eighth, more is stiffening, less is softening; and, at the travel that both
sides used, force in extension over force in compression.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.curve_shapes import SLOWEST, CurveShape, curve_shapes, log_bend, ratio
from bayes_asv.filters.force_laws import excess_many
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["SpringCurve", "spring_curves"]

Array = NDArray[np.float64]

_MAX_DRAWS = 2000  # of which curves are worked out: intervals of 95 % to a twentieth of their width
_DEEPEST = 0.99  # quantile of the travel on either side up to which the shape is described
_BENT = 1.1  # ratio of slopes from which a curve is called bent: twice a spring's tolerance
_POINTS = 61  # of a curve over the range driven
_LEAST = 1e-6  # m, of travel on a side that was not used


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
        Compression and extension that were used, m, both positive.
    at_rest : (N,) array
        Stiffness at rest, N/m.
    compression, extension : (N,) arrays
        Force over deflection at ``travel`` on either side, N/m.
    shapes : tuple of CurveShape
        Statements that are more probable than not.
    deflection : (P,) array
        Deflections over the range driven, m, extension positive.
    force : (N, P) array
        Force at these, N, positive where it resists extension.
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
    """Curves of every spring that has a free one.

    Parameters
    ----------
    posterior : Posterior
        With effects.
    mode : (D,) array
        Coordinates at which the deflections driven are worked out.
    z : (N, D) array
        Draws of the posterior; 2000 of them are used.
    draws : mapping of str to (N,) array
        The same of the car's quantities, SI units; a spring rate that is not there is nominal.

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
    driven = [posterior.innovations_and_variances(mode, run)[2] for run in runs]
    used = np.linspace(0, len(z) - 1, min(len(z), _MAX_DRAWS)).astype(int)
    tables = []
    for one in z[used]:
        values = space.effects(one)
        tables.append(law_table(space.car, {placed: values[placed] for placed in laws}, 0))
    out = []
    for e, element in enumerate(space.car.elements):
        if not any(s.effect.free_form and e in s.elements(space.car) for s in laws):
            continue
        deflection = np.concatenate([run[:, 2 * e] for run in driven])
        travel = _travel(-deflection), _travel(deflection)
        shown = np.linspace(min(deflection.min(), 0.0), max(deflection.max(), 0.0), _POINTS)
        shares = np.array([SLOWEST, 0.5, 1.0])
        common = min(travel)
        grid = np.concatenate([-travel[0] * shares, travel[1] * shares, [-common, common], shown])
        nominal = np.full(len(z), space.car.nominal[element.spring][0])
        k = draws.get(element.spring, nominal).ravel()[used]
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
                force=force[:, 8:],
            )
        )
    return tuple(out)


def _travel(beyond: Array) -> float:
    """Travel that was used on one side, where deflections (N,) to that side are positive."""
    own = beyond[beyond > 0.0]
    return max(float(np.quantile(own, _DEEPEST)), _LEAST) if len(own) else _LEAST
