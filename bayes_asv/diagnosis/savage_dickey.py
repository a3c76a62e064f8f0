"""What is fitted in full and turns out slight: a tolerance after all.

To first order the tolerances explain a car with a little of everything, up to some tens of nats:
dry friction of one newton changes where dry friction acts.  Whichever effect is fitted in full wins
those, and would be named.  But where it turns out no larger than a tolerance the same fit says how
well a little of everything explains the data with that one effect in full: its tolerance is only
another belief about how much of it there is, how sharply it bends believed as before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_asv.diagnosis.tolerance_prior import AMOUNTS, MOST, ModelEvidence, unfolded
from bayes_asv.models.effects import BOTH, Site
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.fitted_model import FittedModel

__all__ = ["as_slight"]

Array = NDArray[np.float64]

_STEP = 1e-4  # deviations


class _Belief(NamedTuple):
    """A tolerance as a belief about one coordinate: normal, and cut off.

    Parameters
    ----------
    middle, width : float
        Of the normal.
    low, high : float
        Where it is cut off.
    log_density : float
        Logarithm of what cutting off adds to its density, and of what both axles cost.
    """

    middle: float
    width: float
    low: float
    high: float
    log_density: float


def as_slight(
    sites: Sequence[Site], stage: FittedModel, allowed: ModelEvidence, known: Sequence[Candidate]
) -> float:
    """Log evidence of a stage in which named effects are tolerances like all others.

    The posterior of their first parameters is taken for normal, and weighed with the ratio of the
    two beliefs (Savage & Dickey's, for a width in place of a point; Verdinelli & Wasserman 1995).
    On both axles alike an effect is the tolerance of one and of the other: how far these differ is
    integrated out, as if each axle knew its own equally well.

    Parameters
    ----------
    sites : sequence of Site
        The effects.
    stage : FittedModel
        A model with them, at its mode.
    allowed : ModelEvidence
        The same with a little of everything else.
    known : sequence of Candidate
        Among them what is a little of each effect, at each place.

    Returns
    -------
    float
        Minus infinity for what nobody has a little of, and for a car that shows none of
        everything else.
    """
    if allowed.amount == 0.0 or not math.isfinite(allowed.log_evidence):
        return -math.inf
    z = stage.mode.z + allowed.shift
    at = [stage.space.names.index(s.coordinate_name(s.effect.parameters[0])) for s in sites]
    covariance = allowed.covariance[np.ix_(at, at)]
    beliefs = []
    for site, k in zip(sites, at, strict=True):
        own = [c for c in known if c.tolerance and site.meets(c.site)]
        if not own:
            return -math.inf
        beliefs.append(
            _belief(own, site, stage, z, k, math.sqrt(allowed.covariance[k, k]), allowed.amount)
        )
    value = float(allowed.by_amount[int(np.argmax(allowed.amount == AMOUNTS))])
    value -= unfolded(stage, z, allowed.covariance)
    return value + _ratio(z[at], covariance, beliefs)


def _ratio(mean: Array, covariance: Array, beliefs: list[_Belief]) -> float:
    """Logarithm of the mean of belief over standard normal, under a normal posterior."""
    middle = np.array([b.middle for b in beliefs])
    tight = np.array([b.width for b in beliefs]) ** -2
    inverse = np.linalg.inv(covariance)
    precision = inverse + np.diag(tight) - np.eye(len(mean))
    pull = inverse @ mean + tight * middle
    there = np.linalg.solve(precision, pull)
    sds = np.sqrt(np.diag(np.linalg.inv(precision)))
    misfit = float(mean @ inverse @ mean + tight @ middle**2 - pull @ there)
    volume = float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(precision)[1])
    out = -0.5 * (misfit + volume) + 0.5 * float(np.log(tight).sum())
    for b, m, sd in zip(beliefs, there, sds, strict=True):
        inside = float(ndtr((b.high - m) / sd) - ndtr((b.low - m) / sd))
        out += b.log_density + (math.log(inside) if inside > 0.0 else -math.inf)
    return out


def _belief(
    own: list[Candidate], site: Site, stage: FittedModel, z: Array, k: int, sd: float, amount: float
) -> _Belief:
    """Return the tolerances of an effect's axles as one belief about its coordinate ``k``.

    Next to where the data have it, tolerances go with the coordinate along a line.
    """
    moved = z.copy()
    moved[k] += _STEP
    here, next_to = stage.space.effects(z)[site], stage.space.effects(moved)[site]
    parts = []
    for one in own:
        times = site.effect.tolerances(here, one.values)
        slope = (site.effect.tolerances(next_to, one.values) - times) / _STEP
        least = 0.0 if one.signed else -MOST
        ends = z[k] + (amount * np.array([0.0, least, MOST]) - times) / slope
        share = float(ndtr(MOST) - ndtr(least))
        width = amount / abs(slope)
        low, high = sorted(ends[1:].tolist())
        parts.append(_Belief(float(ends[0]), width, low, high, -math.log(share)))
    if site.where != BOTH:
        return parts[0]
    front, rear = parts
    tight = front.width**-2, rear.width**-2
    apart = front.width**2 + rear.width**2
    # the data's own knowledge of what the axles have in common, and of how they differ
    alone = 1.0 / max(sd**-2 - 1.0, 1e-12)
    spread = 4.0 * alone
    beside = front.middle - rear.middle
    return _Belief(
        (tight[0] * front.middle + tight[1] * rear.middle) / sum(tight),
        sum(tight) ** -0.5,
        max(front.low, rear.low),
        min(front.high, rear.high),
        front.log_density
        + rear.log_density
        + 0.5 * math.log(spread / (spread + apart))
        - 0.5 * beside**2 / (spread + apart),
    )
