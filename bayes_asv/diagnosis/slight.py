"""What is fitted in full and turns out slight: a tolerance after all.

To first order the tolerances explain a car with a little of everything, all but some tens of nats:
dry friction of one newton changes where dry friction acts.  Whichever effect is fitted in full wins
those, and would be named.  But where it turns out no larger than a tolerance the same fit says how
well a little of everything explains the data with that one effect in full, for its tolerance is
only another belief about the same parameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr

from bayes_asv.diagnosis.tolerance import AMOUNTS, MOST, Allowed
from bayes_asv.inference.candidates import Candidate
from bayes_asv.inference.stage import Stage
from bayes_asv.model.effects import BOTH, Site

__all__ = ["as_slight"]

Array = NDArray[np.float64]

_GRID = np.linspace(-6.0, 6.0, 241)  # deviations


def as_slight(site: Site, stage: Stage, allowed: Allowed, little: Sequence[Candidate]) -> float:
    """Log evidence of a stage in which a named effect is a tolerance like all others.

    The posterior of its first parameter is taken for normal, and weighed with the ratio of the two
    beliefs (Savage & Dickey's, for a width in place of a point; Verdinelli & Wasserman 1995).  On
    both axles alike an effect is the tolerance of one and of the other; how far these may differ
    is taken to be as well known as what they have in common, if the axles know it equally well.

    Parameters
    ----------
    site : Site
        The effect.
    stage : Stage
        A model with it, at its mode.
    allowed : Allowed
        The same with a little of everything else.
    little : sequence of Candidate
        With the values that are a little of it, at each place.

    Returns
    -------
    float
        Minus infinity for what nobody has a little of.
    """
    own = [c for c in little if c.tolerance and site.meets(c.site)]
    if not own or not math.isfinite(allowed.log_evidence):
        return -math.inf
    assert stage.space.sizes is not None
    first = site.effect.parameters[0]
    k = stage.space.names.index(site.coordinate_name(first))
    sd = math.sqrt(float(allowed.covariance[k, k]))
    z = stage.mode.z[k] + allowed.shift[k] + sd * _GRID
    value = first.value(z, stage.space.sizes)
    ratio = 0.5 * z**2 + 0.5 * math.log(2.0 * math.pi)  # of the wide belief, as a mode knows it
    there = -0.5 * _GRID**2 - float(logsumexp(-0.5 * _GRID**2))
    out = allowed.by_amount.copy()
    for a, amount in enumerate(AMOUNTS):
        if amount == 0.0:
            out[a] = -math.inf
            continue
        belief = sum(_belief(c, value, z, float(amount)) for c in own)
        apart = math.log(2.0 * sd) + 0.5 * math.log(2.0 * math.pi) if site.where == BOTH else 0.0
        out[a] += float(logsumexp(there + belief + ratio)) + apart
    return float(logsumexp(out))


def _belief(one: Candidate, value: Array, z: Array, amount: float) -> Array:
    """Log density (per unit of z) of a tolerance's values, ``amount`` tolerances wide."""
    effect = one.site.effect
    times = effect.tolerances(value, one.values[effect.parameters[0].name])
    least = 0.0 if one.signed else -MOST
    share = ndtr(MOST) - ndtr(least)
    density = -0.5 * (times / amount) ** 2 - math.log(amount * share * math.sqrt(2.0 * math.pi))
    inside = (times >= least * amount) & (times <= MOST * amount)
    with np.errstate(divide="ignore"):
        return np.asarray(
            np.where(inside, density + np.log(np.abs(np.gradient(times, z))), -np.inf)
        )
