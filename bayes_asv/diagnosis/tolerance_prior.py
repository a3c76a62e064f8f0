"""Tolerance prior: the influence of small deviations along all other effects.

Every effect that a model does not contain may be present within its tolerance: the innovations are
ν = ν₀ − a Σ_j t_j g_j with sensitivities g_j and t_j ~ N(0, 1), truncated at three.  The t_j are
integrated out.  The scale a differs from car to car, from 0 for a car without deviations to 1 for
one with all deviations that data sheets allow, and the evidence is averaged over it.  Thus a car
with a single fault is not reported to have small deviations everywhere, nor the other way round.

If tolerances are large, a model without them treats them as noise.  At the most probable scale, the
mode is therefore found again, with the tolerances at their own mode.

To first order, the tolerances explain a car with small deviations to within some tens of nats.  Any
effect that is fitted in full gains these nats and would be named.  If it turns out to be no larger
than a tolerance, the same fit gives a better estimate of the evidence of the tolerances alone: one
effect is treated exactly, with its tolerance as the prior in place of the wide one.  The ratio of
the two evidences is the posterior mean of the ratio of the priors (Savage–Dickey ratio, with a
narrow prior in place of a point; Verdinelli & Wasserman 1995, J. Am. Stat. Assoc. 90, 614).

The integral over the tolerances is that of a Gaussian likelihood times a truncated normal prior.
The log-likelihood is gᵀt − ½ tᵀIt in coordinates t, with gradient g and information I (nuisance
parameters projected out), and each t has a standard normal prior truncated to its bounds.  The
integrand is expanded about the constrained mode.  A coordinate at a bound is integrated over the
tail of its marginal, any other one over the part of its marginal within the bounds.  This is exact
for a single coordinate and for independent ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert
from scipy.optimize import lsq_linear
from scipy.special import erfcx, log_ndtr, logsumexp, ndtr

from bayes_asv.diagnosis.score_test import NuisanceProjection, ScoreTest, nuisance_projection
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.effect_fit import Candidate
from bayes_asv.posterior.fisher_scoring import STEP, ScoreAndInformation
from bayes_asv.posterior.fitted_model import FittedModel, fit_model, is_resolved
from bayes_asv.posterior.likelihood import Posterior

__all__ = [
    "MAX_TOLERANCES",
    "TOLERANCE_SCALES",
    "ModelEvidence",
    "OffsetPosterior",
    "TruncatedGaussian",
    "evidence_as_tolerance",
    "half_normal_correction",
    "integrate_truncated",
    "marginal_scores",
    "projection_with_tolerances",
    "tolerance_evidence",
    "with_offset",
]


class TruncatedGaussian(NamedTuple):
    """Posterior of truncated coordinates.

    Parameters
    ----------
    log_integral : float
        Logarithm of the integral of likelihood times prior, relative to the likelihood at t = 0.
    mode : (K,) array
        Mode inside the bounds.
    covariance : (K, K) array
        Inverse of the curvature at the mode, without the bounds.
    at_bound : (K,) bool array
        Whether the mode of a coordinate is at a bound.
    """

    log_integral: float
    mode: Array
    covariance: Array
    at_bound: NDArray[np.bool_]


def integrate_truncated(
    gradient: Array, information: Array, lower: Array, upper: Array
) -> TruncatedGaussian:
    """Integrate truncated standard normal coordinates out of a quadratic log-likelihood.

    Parameters
    ----------
    gradient : (K,) array
        Gradient of the log-likelihood at t = 0.
    information : (K, K) array
        Its negative curvature.
    lower, upper : (K,) arrays
        Bounds.
    """
    precision = information + np.eye(len(gradient))
    root = np.linalg.cholesky(precision)
    covariance = np.asarray(np.linalg.inv(precision), np.float64)
    mode = covariance @ gradient
    if np.any((mode < lower) | (mode > upper)):
        fit = lsq_linear(
            root.T, np.linalg.solve(root, gradient), bounds=(lower, upper), method="bvls"
        )
        mode = np.clip(fit.x, lower, upper)
    sd = np.sqrt(np.diag(covariance))
    slope = gradient - precision @ mode
    # distance of the unconstrained mode from the bound, in standard deviations of the marginal
    excess = np.abs(slope) * sd
    above, below = (mode >= upper - 1e-9) & (slope > 0.0), (mode <= lower + 1e-9) & (slope < 0.0)
    mode = np.where(above, upper, np.where(below, lower, mode))  # bvls stops just short of it
    at_bound = above | below
    b, width = excess[at_bound], ((upper - lower) / sd)[at_bound]
    beyond_width = np.exp(-b * width - 0.5 * width**2) * erfcx((b + width) / np.sqrt(2.0))
    tails = np.log(0.5 * (erfcx(b / np.sqrt(2.0)) - beyond_width))
    free = ~at_bound
    inside = _log_probability((lower - mode)[free] / sd[free], (upper - mode)[free] / sd[free])
    value = float(gradient @ mode - 0.5 * mode @ precision @ mode - np.log(np.diag(root)).sum())
    value += float(tails.sum() + inside.sum() - _log_probability(lower, upper).sum())
    return TruncatedGaussian(value, mode, covariance, at_bound)


def _log_probability(lower: Array, upper: Array) -> Array:
    """Log-probability of a standard normal between bounds that enclose zero."""
    return np.asarray(log_ndtr(upper) + np.log1p(-ndtr(lower) / ndtr(upper)))


Array = NDArray[np.float64]

TOLERANCE_SCALES = np.array([0.0, 0.5, 1.0])
"""Scales of the tolerance prior: no deviations, as on a test rig, or about those that data sheets
allow.

With a scale of 0.1, tolerances would explain a single small fault; with a scale of 2, a large one.
"""

MAX_TOLERANCES = 3.0
"""Bound of the tolerance prior: a larger deviation is not a tolerance, and has to be named."""

_LOG_PRIOR_OF_SCALE = np.log([0.7, 0.15, 0.15])
_ROUNDS = 2  # iterations between the mode of the model and that of the tolerances
_REFIT_GAIN = 3.0  # gain by tolerances (nats) above which the mode is found again


@dataclass(frozen=True)
class ModelEvidence:
    """Evidence and posterior of a model under the tolerance prior of all other effects.

    Parameters
    ----------
    by_scale : (3,) array
        Log evidence at each of :data:`TOLERANCE_SCALES`, with the log prior of the scale.
    scale : float
        The most probable scale.
    mode_shift : (D,) array
        Shift of the model's mode by the tolerances at that scale.
    covariance : (D, D) array
        Covariance of the model's coordinates, tolerances integrated out.
    model : FittedModel
        The model with the tolerances at their mode.
    sensitivities : (K, N) array
        Sensitivities along the tolerances at that scale.  Effects whose size would have to be
        negative, such as a knee that stiffens a damper, are left out.
    offsets : (K,) array
        Values of these tolerances that the model's innovations include.
    """

    by_scale: Array
    scale: float
    mode_shift: Array
    covariance: Array
    model: FittedModel
    sensitivities: Array
    offsets: Array

    @property
    def log_evidence(self) -> float:
        """Log evidence of the model, averaged over the scales."""
        return float(logsumexp(self.by_scale))


@dataclass(frozen=True)
class OffsetPosterior(Posterior):
    """A posterior whose predictions are shifted by a fixed offset.

    Parameters
    ----------
    offset : tuple of (E, ny) arrays
        Offset of each run, in standard deviations of the innovations.
    log_variances : tuple of (E, ny) arrays
        Logarithms of the corresponding variances.
    cost : float
        Minus the log prior of the offset, nats.
    """

    offset: tuple[Array, ...] = ()
    log_variances: tuple[Array, ...] = ()
    cost: float = 0.0

    def filter_passes(self, z: Array, run: int) -> tuple[Array, Array, Array]:
        """Return the passes of the plain posterior, with the offset subtracted."""
        nu, logs, states = super().filter_passes(z, run)
        change = np.exp(-0.5 * (logs - self.log_variances[run])) * self.offset[run]
        return np.where(logs != 0.0, nu - change, 0.0), logs, states

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,) at coordinates (W, D), with the log prior of the offset."""
        value = self.space.log_prior(z) - self.cost

        def log_likelihood(at: tuple[int, int]) -> float:
            w, run = at
            nu, logs, _ = self.innovations_and_variances(z[w], run)
            valid = logs != 0.0
            part = nu[valid] ** 2 + logs[valid] + math.log(2.0 * math.pi)
            return float(self.removed_band_correction(z[w : w + 1], run)[0] - 0.5 * part.sum())

        runs = range(len(self.space.recordings))
        work = self.pool.map if self.pool else map
        for w in np.flatnonzero(np.isfinite(value)).tolist():
            value[w] += sum(work(log_likelihood, [(w, run) for run in runs]))
        return np.where(np.isfinite(value), value, -np.inf)


def with_offset(
    model: FittedModel, sensitivities: Array, offsets: Array, cost: float = 0.0
) -> OffsetPosterior:
    """Shift a posterior's predictions by offsets (K,) along sensitivities (K, N)."""
    by_run, log_variances, begin = [], [], 0
    change = offsets @ sensitivities
    for run in range(len(model.space.recordings)):
        logs = model.posterior.innovations_and_variances(model.mode.z, run)[1]
        valid = logs != 0.0
        offset = np.zeros_like(logs)
        end = begin + int(np.count_nonzero(valid))
        offset[valid] = change[begin:end]
        begin = end
        by_run.append(offset)
        log_variances.append(logs)
    fields = ("space", "residual_ars", "sensor_corrections", "perturbations")
    plain = {name: getattr(model.posterior, name) for name in fields}
    return OffsetPosterior(
        **plain, offset=tuple(by_run), log_variances=tuple(log_variances), cost=cost
    )


def tolerance_evidence(
    model: FittedModel, test: ScoreTest, *, rough: bool = False
) -> ModelEvidence:
    """Integrate the tolerances of all other effects out of a model.

    Parameters
    ----------
    model : FittedModel
        A model at its mode.
    test : ScoreTest
        Scores of candidates at the mode; those that are not tolerances are ignored.
    rough : bool
        Expand about the model's own mode only, which overestimates the evidence.
    """
    alone = model.mode.log_evidence
    if model.diverged or not np.all(is_resolved(test.information)):
        no_sensitivities = np.zeros((0, len(model.mode.slopes.nu)))
        origin = np.zeros(len(model.mode.z))
        impossible = np.full(len(TOLERANCE_SCALES), -math.inf)
        unit = np.eye(len(origin))
        return ModelEvidence(
            impossible, 0.0, origin, unit, model, no_sensitivities, no_sensitivities[:, 0]
        )
    keep = np.array([c.tolerance for c in test.candidates], bool)
    sensitivities = test.sensitivities[keep]
    upper = np.full(len(sensitivities), MAX_TOLERANCES)
    one_sided = [c.one_sided for c in test.candidates if c.tolerance]
    lower = np.where(one_sided, 0.0, -MAX_TOLERANCES)
    gradient, information = test.gradient[keep], test.information[np.ix_(keep, keep)]
    integrals = [
        integrate_truncated(a * gradient, a * a * information, lower, upper)
        for a in TOLERANCE_SCALES
    ]
    gains = np.array([one.log_integral for one in integrals])
    best = int(np.argmax(gains + _LOG_PRIOR_OF_SCALE))
    scale = float(TOLERANCE_SCALES[best])
    sensitivities = scale * sensitivities
    expansion = _Expansion(
        model, test.derivatives, sensitivities, np.zeros(len(sensitivities)), integrals[best]
    )
    if not rough and scale > 0.0 and gains[best] > gains[0] + _REFIT_GAIN:
        refit: _Expansion | None = expansion
        for _ in range(_ROUNDS):
            refit = (
                None
                if refit is None
                else _refit_with_tolerances(model, test, sensitivities, lower, upper, refit)
            )
        if refit is not None and math.isfinite(refit.log_evidence):
            expansion = refit
            # Expanded about a mode without tolerances, the gains are too large, by about the same
            # factor at all scales.
            factor = (expansion.log_evidence - alone) / gains[best]
            gains = np.where(gains > 0.0, factor * gains, gains)
    slope = expansion.mode_slope()
    shift = (
        expansion.model.mode.z
        - model.mode.z
        + slope @ (expansion.tolerances.mode - expansion.offsets)
    )
    covariance = expansion.model.mode.covariance + slope @ expansion.tolerances.covariance @ slope.T
    at_zero = (
        expansion.tolerances.at_bound
        & (expansion.tolerances.mode == 0.0)
        & (expansion.offsets == 0.0)
    )
    correction = half_normal_correction(model, model.mode.z + shift, covariance)
    return ModelEvidence(
        alone + correction + gains + _LOG_PRIOR_OF_SCALE,
        scale,
        shift,
        covariance,
        expansion.model,
        expansion.sensitivities[~at_zero],
        expansion.offsets[~at_zero],
    )


def half_normal_correction(model: FittedModel, z: Array, covariance: Array) -> float:
    """Correction (nats) of Laplace's log evidence for half-normal priors.

    A half-normal density is twice the normal one on one side of zero.  The correction is log 2 for
    a posterior far from zero, and none at zero, where half of the posterior is on the other side.

    Parameters
    ----------
    model : FittedModel
        A model.
    z, covariance : (D,) and (D, D) arrays
        Its posterior.
    """
    out = 0.0
    for placed in model.placed_effects:
        for p in placed.effect.parameters:
            if p.form == "positive":
                k = model.space.names.index(placed.coordinate_name(p))
                out += float(np.log(2.0 * ndtr(abs(z[k]) / np.sqrt(covariance[k, k]))))
    return out


@dataclass(frozen=True)
class _Expansion:
    """A model with tolerances at some offsets, and the posterior of the tolerances there.

    Parameters
    ----------
    model : FittedModel
        Model at its mode with the offsets.
    derivatives : ScoreAndInformation
        Its innovations and their derivatives on denoised inputs.
    sensitivities : (K, N) array
        Sensitivities along the tolerances.
    offsets : (K,) array
        Values of the tolerances that the innovations include.
    tolerances : TruncatedGaussian
        Posterior of the tolerances.
    """

    model: FittedModel
    derivatives: ScoreAndInformation
    sensitivities: Array
    offsets: Array
    tolerances: TruncatedGaussian

    @property
    def log_evidence(self) -> float:
        """Laplace's log evidence, with tolerances integrated out."""
        # the prior of the offsets is in both the posterior and the integral: remove it once
        prior = 0.5 * float(self.offsets @ self.offsets)
        return self.model.mode.log_evidence + prior + self.tolerances.log_integral

    def mode_slope(self) -> Array:
        """Return the derivative (D, K) of the mode with respect to the tolerances."""
        cross = self.derivatives.means @ self.sensitivities.T
        return np.asarray(-np.linalg.solve(self.derivatives.precision(), cross), np.float64)


def _refit_with_tolerances(
    model: FittedModel,
    test: ScoreTest,
    sensitivities: Array,
    lower: Array,
    upper: Array,
    at: _Expansion,
) -> _Expansion | None:
    """Find the model's mode with the tolerances at their own mode, and expand about it.

    Return None if that fit diverged.
    """
    offsets = at.tolerances.mode
    start = at.model.mode.z + at.mode_slope() @ (offsets - at.offsets)
    cost = 0.5 * float(offsets @ offsets)
    refitted = fit_model(with_offset(model, sensitivities, offsets, cost), start)
    # the predictions have the same derivatives; only the standard deviations have changed
    slopes_at_mode = refitted.mode.slopes
    ratio = np.exp(-0.5 * (slopes_at_mode.log_variances - model.mode.slopes.log_variances))
    derivatives = replace(
        slopes_at_mode, means=test.derivatives.means * ratio, scales=test.derivatives.scales
    )
    scaled = sensitivities * ratio
    drifts = test.quantization_drifts * ratio
    projection = nuisance_projection(derivatives, refitted.mode.z, drifts)
    gradient, information = projection.project_out(scaled)
    if not (np.all(np.isfinite(gradient)) and np.all(np.isfinite(information))):
        return None
    # integrate_truncated takes the gradient at t = 0; here it is known at the offsets
    posterior = integrate_truncated(gradient + information @ offsets, information, lower, upper)
    to_offsets = float((gradient + 0.5 * information @ offsets) @ offsets)
    posterior = posterior._replace(log_integral=posterior.log_integral - to_offsets)
    return _Expansion(refitted, derivatives, scaled, offsets, posterior)


def projection_with_tolerances(
    derivatives: ScoreAndInformation, evidence: ModelEvidence
) -> NuisanceProjection:
    """Return the projection for a model's coordinates and the tolerances of all other effects.

    Parameters
    ----------
    derivatives : ScoreAndInformation
        Derivatives of ``evidence.model``, on denoised inputs.
    evidence : ModelEvidence
        The model under its tolerance prior.
    """
    z = evidence.model.mode.z
    return nuisance_projection(derivatives, z, evidence.sensitivities, evidence.offsets)


def marginal_scores(test: ScoreTest) -> tuple[Array, Array]:
    """Gradient and information (K,) of each candidate, with all other tolerances projected out."""
    tolerances = np.flatnonzero([c.tolerance for c in test.candidates])
    gradient, information = test.gradient.copy(), np.diag(test.information).copy()
    for k in range(len(gradient)):
        placed = test.candidates[k].placed
        others = np.array(
            [j for j in tolerances if not placed.overlaps(test.candidates[j].placed)], int
        )
        precision = test.information[np.ix_(others, others)] + np.eye(len(others))
        cross = test.information[k, others]
        solved = np.linalg.solve(precision, np.column_stack([cross, test.gradient[others]]))
        information[k] -= cross @ solved[:, 0]
        gradient[k] -= cross @ solved[:, 1]
    return gradient, np.maximum(information, 0.0)


class _TolerancePrior(NamedTuple):
    """A tolerance as a truncated normal prior of one coordinate.

    Parameters
    ----------
    mean, sd : float
        Mean and standard deviation of the normal density.
    lower, upper : float
        Bounds of the truncation.
    log_factor : float
        Logarithm of the factor on the normal density: from the truncation, and with several
        elements from the differences between them.
    """

    mean: float
    sd: float
    lower: float
    upper: float
    log_factor: float


def evidence_as_tolerance(
    placed_effects: Sequence[PlacedEffect],
    model: FittedModel,
    evidence: ModelEvidence,
    candidates: Sequence[Candidate],
) -> float:
    """Log evidence of a model in which the priors of some effects are their tolerances.

    The posterior of their first parameters is assumed to be normal.  An effect with common values
    at several elements is a tolerance of each of them; the differences between elements are
    integrated out, assuming that the data determine each element equally well.

    Parameters
    ----------
    placed_effects : sequence of PlacedEffect
        The effects.
    model : FittedModel
        A model with these effects, at its mode.
    evidence : ModelEvidence
        Its evidence under the tolerance prior of all other effects.
    candidates : sequence of Candidate
        Candidates that include the tolerance of each effect at each place.

    Returns
    -------
    float
        Minus infinity if an effect has no tolerance, or if the most probable scale is zero.
    """
    if evidence.scale == 0.0 or not math.isfinite(evidence.log_evidence):
        return -math.inf
    z = model.mode.z + evidence.mode_shift
    indices = [
        model.space.names.index(s.coordinate_name(s.effect.parameters[0])) for s in placed_effects
    ]
    covariance = evidence.covariance[np.ix_(indices, indices)]
    priors = []
    for placed, k in zip(placed_effects, indices, strict=True):
        tolerances = [c for c in candidates if c.tolerance and placed.overlaps(c.placed)]
        if not tolerances:
            return -math.inf
        sd = math.sqrt(evidence.covariance[k, k])
        priors.append(_tolerance_prior(tolerances, placed, model, z, k, sd, evidence.scale))
    value = float(evidence.by_scale[int(np.argmax(evidence.scale == TOLERANCE_SCALES))])
    value -= half_normal_correction(model, z, evidence.covariance)
    return value + _log_ratio(z[indices], covariance, priors)


def _log_ratio(mean: Array, covariance: Array, priors: list[_TolerancePrior]) -> float:
    """Log of the mean ratio of tolerance prior to standard normal, under a normal posterior."""
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
    placed: PlacedEffect,
    model: FittedModel,
    z: Array,
    k: int,
    sd: float,
    scale: float,
) -> _TolerancePrior:
    """Return the tolerances of an effect's elements as one prior of its coordinate ``k``.

    The size of the effect in tolerances is linearised in the coordinate at the posterior mode.
    """
    stepped = z.copy()
    stepped[k] += STEP
    at_mode, after_step = model.space.effects(z)[placed], model.space.effects(stepped)[placed]
    parts = []
    for one in tolerances:
        count = placed.effect.in_tolerances(at_mode, one.values)
        slope = (placed.effect.in_tolerances(after_step, one.values) - count) / STEP
        least = 0.0 if one.one_sided else -MAX_TOLERANCES
        points = z[k] + (scale * np.array([0.0, least, MAX_TOLERANCES]) - count) / slope
        probability = float(ndtr(MAX_TOLERANCES) - ndtr(least))
        width = scale / abs(slope)
        lower, upper = sorted(points[1:].tolist())
        parts.append(_TolerancePrior(float(points[0]), width, lower, upper, -math.log(probability)))
    return parts[0] if len(parts) == 1 else _combine_priors(parts, sd)


def _combine_priors(parts: list[_TolerancePrior], sd: float) -> _TolerancePrior:
    """Combine the priors of n elements to one of their common value, with contrasts integrated out.

    ``sd`` is the posterior standard deviation of the common value under a standard normal prior.
    """
    n = len(parts)
    means, tightness = np.array([p.mean for p in parts]), np.array([p.sd for p in parts]) ** -2
    # information of the data about the common value; about a contrast of unit length it is n times
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
