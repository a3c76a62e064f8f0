"""A damper whose curve is free: any force that rises with speed, each side its own.

F = −c G(δ̇) with G(v) = ∫₀ᵛ g.  The relative slope g is piecewise linear between knots at
0, ±6.25 mm/s and each √2 times the last up to ±0.8 m/s, constant beyond, and positive, so that the
force rises with speed.  From knot to knot ln g takes independent steps of USUAL_STEP sinh(z), with
z standard normal: a random walk over the logarithm of speed, which is smooth where the data are not
informative, and whose heavy tails (nine times the usual step at three standard deviations) permit a
knee, or a damper whose slope falls over the whole range.

g is scaled so that E[g] = 1 for normally distributed rates of deflection.  By Stein's lemma that is
E[F v] = −c E[v²]: c is the rate of the linear damper that takes the same power at those rates.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import norm

from bayes_asv.filters.force_laws import CURVE_FIRST, CURVE_KNOTS, DAMPER_CURVE, KNOT_RATIO
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter
from bayes_asv.models.effects.piecewise_slope import (
    USUAL_STEP,
    integral,
    slopes_of_steps,
    step_names,
)

__all__ = ["CURVE_SPEED", "EFFECT", "KNOTS", "slopes"]

CURVE_SPEED = 0.15
"""Standard deviation of the rates of deflection for which c is the rate of equal power, m/s."""

_SIDE = CURVE_FIRST * KNOT_RATIO ** np.arange(CURVE_KNOTS)
KNOTS: Array = np.concatenate([-_SIDE[::-1], [0.0], _SIDE])
"""Rates of deflection at the knots, m/s."""
_STEPS = step_names(CURVE_KNOTS)
# Least relative slope: the rate of a damper in series with a stiffness is not determined by a force
# that does not rise with speed.
_FLATTEST = 1e-3


def _weights() -> Array:
    """Mean of each knot's hat function under the normal distribution of rates."""
    edges = norm.cdf(KNOTS / CURVE_SPEED)
    means = -CURVE_SPEED * np.diff(norm.pdf(KNOTS / CURVE_SPEED))  # ∫ v φ over each interval
    inside, width = np.diff(edges), np.diff(KNOTS)
    out = np.zeros(len(KNOTS))
    out[:-1] += (KNOTS[1:] * inside - means) / width
    out[1:] += (means - KNOTS[:-1] * inside) / width
    out[0] += edges[0]
    out[-1] += 1.0 - edges[-1]
    return out


_WEIGHTS = _weights()


def slopes(values: Mapping[str, float]) -> Array:
    """Relative slopes g at :data:`KNOTS`."""
    g = slopes_of_steps(values, _STEPS)
    return np.asarray(np.maximum(g / (_WEIGHTS @ g), _FLATTEST))


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(slopes(values).tolist())


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    return np.asarray(-c * (integral(KNOTS, slopes(values), rate) - rate))


EFFECT = Effect(
    name="damper_curve",
    title="a damper whose force is not proportional to speed",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=tuple(
        Parameter(name, "", "sinh", 0.0, USUAL_STEP, (0.0,), shape=True) for name in _STEPS
    ),
    code=DAMPER_CURVE,
    packed=_packed,
    force=_force,
    on_damper=True,
    contains=("bound_rebound", "digressive_damper"),
    free_form=True,
    on_request=True,
    fit_starts=({}, dict.fromkeys(_STEPS, -USUAL_STEP)),  # proportional to speed, or digressive
    drive="bumps of several heights, so that the damper moves slowly and fast both ways",
)
