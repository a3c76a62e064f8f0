"""Evidence for an effect that turns out no larger than a tolerance, by the Savage–Dickey ratio.

To first order the tolerances explain a car with small amounts of every effect up to some tens of
nats.  Whichever effect is fitted in full gains those and would be named.  Where it turns out no
larger than a tolerance, the same fit gives the better evidence of the tolerances alone: one effect
in full, with its tolerance for a prior in place of the wide one.  The ratio of the two evidences is
the posterior mean of the ratio of the priors (Savage–Dickey for a width in place of a point;
Verdinelli & Wasserman 1995, J. Am. Stat. Assoc. 90, 614).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert
from scipy.special import ndtr

from bayes_asv.diagnosis.tolerance_prior import (
    MAX_TOLERANCES,
    TOLERANCE_SCALES,
    ModelEvidence,
    half_normal_correction,
)
from bayes_asv.models.effects import Site
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.fitted_model import FittedModel

__all__ = ["evidence_as_tolerance"]

Array = NDArray[np.float64]

_STEP = 1e-4  # finite-difference step, in prior standard deviations


class _TolerancePrior(NamedTuple):
    """A tolerance as a truncated normal prior of one coordinate.

    Parameters
    ----------
    mean, sd : float
        Of the normal.
    lower, upper : float
        Where it is truncated.
    log_factor : float
        Logarithm of what multiplies the normal density: the truncation, and at several elements how
        far these differ.
    """

    mean: float
    sd: float
    lower: float
    upper: float
    log_factor: float


def evidence_as_tolerance(
    sites: Sequence[Site],
    model: FittedModel,
    evidence: ModelEvidence,
    candidates: Sequence[Candidate],
) -> float:
    """Log evidence of a model in which some of its effects have tolerances for priors.

    The posterior of their first parameters is taken to be normal.  An effect with common values at
    several elements is the tolerance of each of them: how far these differ is integrated out, as if
    the data knew each equally well.

    Parameters
    ----------
    sites : sequence of Site
        The effects.
    model : FittedModel
        A model with them, at its mode.
    evidence : ModelEvidence
        The same under the tolerance prior of all other effects.
    candidates : sequence of Candidate
        Among them the tolerance of each effect, at each place.

    Returns
    -------
    float
        Minus infinity for an effect that has no tolerance, and for a car that shows none of the
        others.
    """
    if evidence.scale == 0.0 or not math.isfinite(evidence.log_evidence):
        return -math.inf
    z = model.mode.z + evidence.mode_shift
    own = [model.space.names.index(s.coordinate_name(s.effect.parameters[0])) for s in sites]
    covariance = evidence.covariance[np.ix_(own, own)]
    priors = []
    for site, k in zip(sites, own, strict=True):
        tolerances = [c for c in candidates if c.tolerance and site.meets(c.site)]
        if not tolerances:
            return -math.inf
        sd = math.sqrt(evidence.covariance[k, k])
        priors.append(_tolerance_prior(tolerances, site, model, z, k, sd, evidence.scale))
    value = float(evidence.by_scale[int(np.argmax(evidence.scale == TOLERANCE_SCALES))])
    value -= half_normal_correction(model, z, evidence.covariance)
    return value + _log_ratio(z[own], covariance, priors)


def _log_ratio(mean: Array, covariance: Array, priors: list[_TolerancePrior]) -> float:
    """Logarithm of the mean of tolerance prior over standard normal, under a normal posterior."""
    centre = np.array([p.mean for p in priors])
    tightness = np.array([p.sd for p in priors]) ** -2
    inverse = np.linalg.inv(covariance)
    precision = inverse + np.diag(tightness) - np.eye(len(mean))
    weighted = inverse @ mean + tightness * centre
    mode = np.linalg.solve(precision, weighted)
    sds = np.sqrt(np.diag(np.linalg.inv(precision)))
    misfit = float(mean @ inverse @ mean + tightness @ centre**2 - weighted @ mode)
    volume = float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(precision)[1])
    out = -0.5 * (misfit + volume) + 0.5 * float(np.log(tightness).sum())
    for p, m, sd in zip(priors, mode, sds, strict=True):
        inside = float(ndtr((p.upper - m) / sd) - ndtr((p.lower - m) / sd))
        out += p.log_factor + (math.log(inside) if inside > 0.0 else -math.inf)
    return out


def _tolerance_prior(
    tolerances: list[Candidate],
    site: Site,
    model: FittedModel,
    z: Array,
    k: int,
    sd: float,
    scale: float,
) -> _TolerancePrior:
    """Return the tolerances of an effect's elements as one prior of its coordinate ``k``.

    How many tolerances the effect is, is linearised in the coordinate about the posterior mode.
    """
    moved = z.copy()
    moved[k] += _STEP
    at_mode, next_to = model.space.effects(z)[site], model.space.effects(moved)[site]
    parts = []
    for one in tolerances:
        count = site.effect.tolerances(at_mode, one.values)
        slope = (site.effect.tolerances(next_to, one.values) - count) / _STEP
        least = 0.0 if one.signed else -MAX_TOLERANCES
        points = z[k] + (scale * np.array([0.0, least, MAX_TOLERANCES]) - count) / slope
        probability = float(ndtr(MAX_TOLERANCES) - ndtr(least))
        width = scale / abs(slope)
        lower, upper = sorted(points[1:].tolist())
        parts.append(_TolerancePrior(float(points[0]), width, lower, upper, -math.log(probability)))
    return parts[0] if len(parts) == 1 else _common(parts, sd)


def _common(parts: list[_TolerancePrior], sd: float) -> _TolerancePrior:
    """Return the priors of n elements as one of their common value, their contrasts integrated out.

    ``sd`` is the posterior standard deviation of the common value under a standard normal prior.
    """
    n = len(parts)
    means, tightness = np.array([p.mean for p in parts]), np.array([p.sd for p in parts]) ** -2
    # what the data alone know of the common value, and n times as much of a contrast of unit length
    common = 1.0 / max(sd**-2 - 1.0, 1e-12)
    contrasts = helmert(n)
    variances = np.eye(n - 1) + (contrasts / tightness) @ contrasts.T / (n * common)
    differences = contrasts @ means
    misfit = float(differences @ np.linalg.solve(variances, differences)) / (n * common)
    return _TolerancePrior(
        float(tightness @ means / tightness.sum()),
        float(tightness.sum() ** -0.5),
        max(p.lower for p in parts),
        min(p.upper for p in parts),
        sum(p.log_factor for p in parts)
        - 0.5 * float(np.linalg.slogdet(variances)[1])
        - 0.5 * misfit,
    )
