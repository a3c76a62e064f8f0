"""A spring whose curve is free: any force that rises with deflection, each side its own.

F = −k G(δ) with G(δ) = ∫₀^δ g.  The relative slope g is piecewise linear between knots at 0, ±4 mm
and each √2 times the last up to ±91 mm, constant beyond, and positive, so that the force rises with
deflection.  g(0) = 1: k is the stiffness at rest, as given.  From knot to knot ln g takes
independent normal steps with a standard deviation of _STEP: a random walk over the logarithm of
deflection, which is smooth where the data are not informative, and with which the slope may double
or halve at twenty times the deflection.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import KNOT_RATIO, SPRING_CURVE, SPRING_FIRST, SPRING_KNOTS
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter
from bayes_asv.models.effects.piecewise_slope import (
    USUAL_STEP,
    integral,
    slopes_of_steps,
    step_names,
)

__all__ = ["EFFECT", "KNOTS", "slopes"]

_SIDE = SPRING_FIRST * KNOT_RATIO ** np.arange(SPRING_KNOTS)
KNOTS: Array = np.concatenate([-_SIDE[::-1], [0.0], _SIDE])
"""Deflections at the knots, m."""
_STEPS = step_names(SPRING_KNOTS)


def slopes(values: Mapping[str, float]) -> Array:
    """Slope of the force over the stiffness at rest.

    Parameters
    ----------
    values : mapping of str to float
        Values of the effect's parameters: the step of ln g from each knot to the next one.

    Returns
    -------
    (K,) array
        Relative slopes g at :data:`KNOTS`; 1 at rest.
    """
    return slopes_of_steps(values, _STEPS)


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(slopes(values).tolist())


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    return np.asarray(-k * (integral(KNOTS, slopes(values), delta) - delta))


EFFECT = Effect(
    name="spring_curve",
    title="a spring whose force is not proportional to travel",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=tuple(
        Parameter(name, "", "linear", 0.0, USUAL_STEP, (0.0,), shape=True) for name in _STEPS
    ),
    code=SPRING_CURVE,
    packed=_packed,
    force=_force,
    on_spring=True,
    contains=("progressive_spring",),
    free_form=True,
    on_request=True,
    fit_starts=(
        {},
        dict.fromkeys(_STEPS, 0.5 * USUAL_STEP),
    ),  # proportional to travel, or stiffening
    drive="bumps of several heights, so that little and much of the travel is used",
    travel=True,
)
