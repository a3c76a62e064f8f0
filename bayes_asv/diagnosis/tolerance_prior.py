"""Tolerance prior: the effect of small amounts of every other effect on evidence and intervals.

Every effect that a model does not contain may be present within its tolerance: the innovations are
ν = ν₀ − a Σ_j t_j g_j with sensitivities g_j and t_j ~ N(0, 1), truncated at three, which is
integrated out.  The scale a differs from car to car, from 0 for a clean one to 1 for one that has
all that data sheets allow, and the evidence is averaged over it: a car with a single fault is not
said to have small amounts of all, nor a car with small amounts of all to have a single fault.

Where tolerances are large, a model without them mistakes them for noise.  At the most probable
scale the mode is therefore found again, with the tolerances at their own mode.

To first order the tolerances explain a car with small amounts of every effect up to some tens of
nats.  Whichever effect is fitted in full gains those and would be named.  Where it turns out no
larger than a tolerance, the same fit gives the better evidence of the tolerances alone: one effect
in full, with its tolerance for a prior in place of the wide one.  The ratio of the two evidences is
the posterior mean of the ratio of the priors (Savage–Dickey for a width in place of a point;
Verdinelli & Wasserman 1995, J. Am. Stat. Assoc. 90, 614).

The integral over the tolerances is that of a Gaussian likelihood times a truncated normal prior.
Along coordinates t a quadratic log-likelihood gains gᵀt − ½ tᵀIt, with gradient g and information I
(nuisance parameters projected out), and each t has a standard normal prior truncated to its bounds.
The integral of the product is expanded about the constrained mode.  A coordinate that a bound holds
is integrated along the tail of its marginal, any other over what the bounds leave of its marginal:
exact for one coordinate and for independent ones.
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
from bayes_asv.posterior.fitted_model import FittedModel, fit_model
from bayes_asv.posterior.likelihood import Perturbation, Posterior

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
        About the mode, bounds ignored.
    at_bound : (K,) bool array
        Coordinates whose unconstrained mode lies beyond a bound.
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
    # in standard deviations of the marginal, whose mode lies beyond the bound
    excess = np.abs(slope) * sd
    above, below = (mode >= upper - 1e-9) & (slope > 0.0), (mode <= lower + 1e-9) & (slope < 0.0)
    mode = np.where(above, upper, np.where(below, lower, mode))  # bvls stops a digit short of it
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
"""Scales of the tolerance prior: none, as on a rig or a new car, or about what data sheets allow.

With a scale of 0.1 small amounts of all would explain a single small fault, with 2 a large one.
"""

MAX_TOLERANCES = 3.0
"""Bound of the tolerance prior: what is larger is no tolerance, and has to be named."""

_LOG_PRIOR_OF_SCALE = np.log([0.7, 0.15, 0.15])
_ROUNDS = 2
_REFIT_GAIN = 3.0  # nats that tolerances have to gain for the mode to be found again


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
        Sensitivities along the tolerances there.  Effects that would have to be negative, such as a
        knee that stiffens a damper, reproduce nothing and are left out.
    offsets : (K,) array
        Values of these that the model's innovations contain.
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
    """A posterior whose predictions are moved by a fixed offset.

    Parameters
    ----------
    offset : tuple of (E, ny) arrays
        In standard deviations, as the innovations are.
    log_variances : tuple of (E, ny) arrays
        Log variances that these standard deviations belong to.
    cost : float
        Minus the log prior of the offset, nats.
    """

    offset: tuple[Array, ...] = ()
    log_variances: tuple[Array, ...] = ()
    cost: float = 0.0

    def filter_passes(
        self, z: Array, run: int, nudge: Perturbation | None = None
    ) -> tuple[Array, Array, Array]:
        """Return what the plain posterior does, the offset subtracted from the innovations."""
        nu, logs, states = super().filter_passes(z, run, nudge)
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
    """Return a model's posterior, predictions moved by offsets (K,) along sensitivities (K, N)."""
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
        Scores of candidates there; those that are no tolerances are left out.
    rough : bool
        Expand about the model's own mode only, which promises more than there is.
    """
    alone = model.mode.log_evidence
    if not (math.isfinite(alone) and np.all(np.isfinite(test.information))):  # a fit that diverged
        nothing = np.zeros((0, len(model.mode.slopes.nu)))
        origin = np.zeros(len(model.mode.z))
        impossible = np.full(len(TOLERANCE_SCALES), -math.inf)
        unit = np.eye(len(origin))
        return ModelEvidence(impossible, 0.0, origin, unit, model, nothing, nothing[:, 0])
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
    at = _Expansion(
        model, test.derivatives, sensitivities, np.zeros(len(sensitivities)), integrals[best]
    )
    if not rough and scale > 0.0 and gains[best] > gains[0] + _REFIT_GAIN:
        refit: _Expansion | None = at
        for _ in range(_ROUNDS):
            refit = (
                None if refit is None else _refit(model, test, sensitivities, lower, upper, refit)
            )
        if refit is not None and math.isfinite(refit.log_evidence):
            at = refit
            # Expanded about a mode without tolerances the gains are too large, at all scales by
            # about the same factor.
            factor = (at.log_evidence - alone) / gains[best]
            gains = np.where(gains > 0.0, factor * gains, gains)
    slope = at.mode_slope()
    shift = at.model.mode.z - model.mode.z + slope @ (at.tolerances.mode - at.offsets)
    covariance = at.model.mode.covariance + slope @ at.tolerances.covariance @ slope.T
    at_zero = at.tolerances.at_bound & (at.tolerances.mode == 0.0) & (at.offsets == 0.0)
    correction = half_normal_correction(model, model.mode.z + shift, covariance)
    return ModelEvidence(
        alone + correction + gains + _LOG_PRIOR_OF_SCALE,
        scale,
        shift,
        covariance,
        at.model,
        at.sensitivities[~at_zero],
        at.offsets[~at_zero],
    )


def half_normal_correction(model: FittedModel, z: Array, covariance: Array) -> float:
    """Log evidence (nats) that Laplace's approximation misses for half-normal priors.

    A prior on the size of a coordinate is twice a normal one on one side of zero: log 2 far from
    zero, and nothing at zero, where the posterior reaches over to the other side.

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
    """A model with tolerances at some offsets, and their posterior expanded from there.

    Parameters
    ----------
    model : FittedModel
        At its mode with the offsets.
    derivatives : ScoreAndInformation
        Its innovations and their changes on denoised inputs.
    sensitivities : (K, N) array
        Sensitivities along the tolerances.
    offsets : (K,) array
        Values that the innovations contain.
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
        """Laplace's log evidence, tolerances integrated out."""
        # the prior of the offsets is in the posterior and in the integral: once too often
        prior = 0.5 * float(self.offsets @ self.offsets)
        return self.model.mode.log_evidence + prior + self.tolerances.log_integral

    def mode_slope(self) -> Array:
        """Return the derivative (D, K) of the mode with respect to the tolerances."""
        cross = self.derivatives.means @ self.sensitivities.T
        return np.asarray(-np.linalg.solve(self.derivatives.precision(), cross), np.float64)


def _refit(
    model: FittedModel,
    test: ScoreTest,
    sensitivities: Array,
    lower: Array,
    upper: Array,
    at: _Expansion,
) -> _Expansion | None:
    """Find the model's mode with tolerances at their own mode, and expand from there.

    None where that fit diverged.
    """
    offsets = at.tolerances.mode
    start = at.model.mode.z + at.mode_slope() @ (offsets - at.offsets)
    cost = 0.5 * float(offsets @ offsets)
    moved = fit_model(with_offset(model, sensitivities, offsets, cost), start)
    # Along a coordinate the predictions change as they did; standard deviations are others.
    here = moved.mode.slopes
    ratio = np.exp(-0.5 * (here.log_variances - model.mode.slopes.log_variances))
    derivatives = replace(
        here, means=test.derivatives.means * ratio, scales=test.derivatives.scales
    )
    scaled = sensitivities * ratio
    drifts = test.quantization_drifts * ratio
    projection = nuisance_projection(derivatives, moved.mode.z, drifts)
    gradient, information = projection.project_out(scaled)
    if not (np.all(np.isfinite(gradient)) and np.all(np.isfinite(information))):
        return None
    # integrate_truncated takes the gradient at t = 0, of a likelihood that is known at the offsets
    posterior = integrate_truncated(gradient + information @ offsets, information, lower, upper)
    to_offsets = float((gradient + 0.5 * information @ offsets) @ offsets)
    posterior = posterior._replace(log_integral=posterior.log_integral - to_offsets)
    return _Expansion(moved, derivatives, scaled, offsets, posterior)


def projection_with_tolerances(
    derivatives: ScoreAndInformation, evidence: ModelEvidence
) -> NuisanceProjection:
    """Return what a model reproduces by its coordinates and the tolerances of all other effects.

    Parameters
    ----------
    derivatives : ScoreAndInformation
        Of ``evidence.model``, on denoised inputs.
    evidence : ModelEvidence
        The model under its tolerance prior.
    """
    z = evidence.model.mode.z
    return nuisance_projection(derivatives, z, evidence.sensitivities, evidence.offsets)


def marginal_scores(test: ScoreTest) -> tuple[Array, Array]:
    """Gradient and information (K,) of each candidate, tolerances of all others projected out."""
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
    placed_effects: Sequence[PlacedEffect],
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
    placed_effects : sequence of PlacedEffect
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
    own = [
        model.space.names.index(s.coordinate_name(s.effect.parameters[0])) for s in placed_effects
    ]
    covariance = evidence.covariance[np.ix_(own, own)]
    priors = []
    for placed, k in zip(placed_effects, own, strict=True):
        tolerances = [c for c in candidates if c.tolerance and placed.overlaps(c.placed)]
        if not tolerances:
            return -math.inf
        sd = math.sqrt(evidence.covariance[k, k])
        priors.append(_tolerance_prior(tolerances, placed, model, z, k, sd, evidence.scale))
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
    placed: PlacedEffect,
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
    moved[k] += STEP
    at_mode, next_to = model.space.effects(z)[placed], model.space.effects(moved)[placed]
    parts = []
    for one in tolerances:
        count = placed.effect.in_tolerances(at_mode, one.values)
        slope = (placed.effect.in_tolerances(next_to, one.values) - count) / STEP
        least = 0.0 if one.one_sided else -MAX_TOLERANCES
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
