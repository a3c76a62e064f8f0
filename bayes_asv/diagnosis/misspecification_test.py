"""Misspecification tests: whether something remains that no listed effect explains.

The final model, on all recordings together, is tested against a free force and unlisted faults
beside the named effects, against autocorrelated innovations, against a misfit of a few readings,
against a variance that grows with the slope of a signal, and against excess noise.

If named effects reproduce another fault together, nothing remains beside them.  Therefore a single
unlisted fault is also compared with them, as an alternative in their place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bayes_asv.diagnosis.denoised_model import denoised_model
from bayes_asv.diagnosis.residual_tests import (
    Outlier,
    outlier_test,
    timing_jitter_test,
    whiteness_test,
)
from bayes_asv.diagnosis.score_test import max_score_p_value, nuisance_projection
from bayes_asv.diagnosis.thresholds import (
    ALTERNATIVE_MARGIN,
    DECISIVE_EVIDENCE,
    EXCESS_NOISE,
    FIRST_ORDER_ERROR,
    MISSPECIFICATION_LEVEL,
    UNKNOWN_SIZE_COST,
)
from bayes_asv.diagnosis.tolerance_prior import (
    ModelEvidence,
    projection_with_tolerances,
    with_offset,
)
from bayes_asv.diagnosis.unlisted_faults import free_force_evidence, unlisted_fault_scores
from bayes_asv.posterior.fisher_scoring import LaplaceApproximation, slopes
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_model
from bayes_asv.posterior.likelihood import Posterior, shared_work

__all__ = ["MisspecificationResult", "best_alternative", "misspecification_tests"]

Array = NDArray[np.float64]

_ROUNDS = 2  # number of times that an alternative is chosen and fitted


@dataclass(frozen=True)
class MisspecificationResult:
    """Tests for something that no listed effect explains.

    Parameters
    ----------
    score : float
        Log Bayes factor (nats) of a free force beside the model; negative if it is less probable.
    axle : str
        Axle at which the free force gains most.
    p_whiteness : float
        p-value of the whiteness test.
    excess_noise : tuple of str
        Channels whose noise is far above the declared level.
    p_unlisted : float
        Family-wise p-value of the unlisted faults.
    closest_fault : str
        The unlisted fault with the largest score.
    failed : tuple of str
        Effects that were fitted and increased the error on held-out recordings.
    alternative : float
        Log Bayes factor (nats) of an unlisted fault alone against the named effects.
    p_jitter : float
        p-value of the timing-jitter test; small if the variance grows with a signal's slope.
    jitter_channel : str
        The channel on whose slope the variance depends most.
    missing_bits : tuple of str
        Channels whose converter never sets, or never clears, one of its bits.
    outlier : Outlier
        The readings that fit worst, with their p-value.
    stopped_by : str
        The unlisted explanation that ended the selection of effects; empty without one.
    """

    score: float
    axle: str
    p_whiteness: float
    excess_noise: tuple[str, ...]
    p_unlisted: float = 1.0
    closest_fault: str = ""
    failed: tuple[str, ...] = ()
    alternative: float = -math.inf
    p_jitter: float = 1.0
    jitter_channel: str = ""
    missing_bits: tuple[str, ...] = ()
    outlier: Outlier = field(default_factory=lambda: Outlier(1.0))
    stopped_by: str = ""

    @property
    def detected(self) -> bool:
        """Whether something was detected beside the named effects."""
        p = np.array([self.p_whiteness, self.p_unlisted, self.p_jitter])
        # Fisher's combination of p-values: several weak signs may be significant together
        combined = chi2.sf(-2.0 * np.sum(np.log(np.maximum(p, 1e-300))), 2 * len(p))
        smallest = min(float(p.min()), float(combined), self.outlier.p)
        significant = smallest < MISSPECIFICATION_LEVEL
        other = self.excess_noise or self.missing_bits or self.failed or self.stopped_by
        return self.score > DECISIVE_EVIDENCE or significant or bool(other)

    @property
    def present(self) -> bool:
        """Whether something is unexplained: beside the named effects, or in their place."""
        return self.detected or self.alternative > ALTERNATIVE_MARGIN


def misspecification_tests(
    dataset: Dataset, evidence: ModelEvidence, seed: int
) -> MisspecificationResult:
    """Test a model for anything that no listed effect explains.

    Parameters
    ----------
    dataset : Dataset
        The model's recordings with denoised inputs.
    evidence : ModelEvidence
        The model under the tolerance prior of all other effects.
    seed : int
        Seed of the max-score test.
    """
    model = evidence.model
    denoised = denoised_model(dataset, model)
    projection = projection_with_tolerances(denoised.derivatives, evidence)
    force, axle = free_force_evidence(denoised, projection)
    faults = unlisted_fault_scores(denoised, projection)
    p_unlisted, k = max_score_p_value(
        faults.gradient, faults.information, faults.raw_information, faults.one_sided, seed
    )
    p_jitter, jitter_channel = timing_jitter_test(dataset, model)
    return MisspecificationResult(
        score=force,
        axle=axle,
        p_whiteness=whiteness_test(model)[1],
        excess_noise=_excess_noise(dataset, model),
        p_unlisted=p_unlisted,
        closest_fault=faults.descriptions[k],
        p_jitter=p_jitter,
        jitter_channel=jitter_channel,
        outlier=outlier_test(model),
    )


def _excess_noise(dataset: Dataset, model: FittedModel) -> tuple[str, ...]:
    """Channels whose fitted noise level is far above the declared one."""
    levels = model.space.nuisance(model.mode.z[None])
    out = []
    for run, recording in enumerate(dataset.recordings):
        for channel, given in zip(recording.channels, recording.noise, strict=True):
            level = levels.get(f"noise {channel.name} {run}")
            if given and level is not None and float(level[0]) > EXCESS_NOISE * given:
                out.append(channel.name)
    return tuple(dict.fromkeys(out))


class _Alternative(NamedTuple):
    """An unlisted fault in place of all named effects.

    Parameters
    ----------
    loss : float
        Minus the log-posterior of the car with the fault, up to a constant, nats.
    gain : float
        Gain of log-likelihood over the car without it, to first order, nats.
    description : str
        Description of the fault.
    z : (D,) array
        Mode of car and noise levels with it.
    settled : (N,) bool array
        Whether the filter has settled at each innovation.
    out_of : int
        Number of faults from which it was chosen.
    """

    loss: float
    gain: float
    description: str
    z: Array
    settled: NDArray[np.bool_]
    out_of: int


def best_alternative(
    dataset: Dataset, model: FittedModel, named: int, effect_count: int
) -> tuple[float, str]:
    """Log Bayes factor (nats) of the best single unlisted fault against all named effects.

    The fault is chosen to first order, with the car and noise levels of the full model but without
    its effects.  Its evidence is computed from a fit with free noise levels: if a named effect
    stands in for the fault, the noise level has grown to absorb the rest, and would hide it.  If
    the error of first order could change the result, the fault is chosen again from that fit.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Recordings with denoised inputs, and the model with all named effects at its mode.
    named, effect_count : int
        Number of named effects, and number of candidates from which they were selected.

    Returns
    -------
    float, str
        Log Bayes factor, and description of the fault.
    """
    posterior = dataset.posterior(())
    z = model.transfer(posterior.space)
    best, description = -math.inf, ""
    for _ in range(_ROUNDS):
        alternative = _fit_alternative(dataset, posterior, z)
        if alternative is None:
            break
        loss = _negative_log_posterior(model.posterior, model.mode, alternative.settled)
        cost = named * (UNKNOWN_SIZE_COST + math.log(effect_count))
        cost = cost - UNKNOWN_SIZE_COST - math.log(alternative.out_of)
        if loss - alternative.loss + cost > best:
            best, description = loss - alternative.loss + cost, alternative.description
        margin = ALTERNATIVE_MARGIN - FIRST_ORDER_ERROR * alternative.gain
        if not margin < best < ALTERNATIVE_MARGIN:
            break
        z = alternative.z
    return best, description


def _fit_alternative(dataset: Dataset, posterior: Posterior, z: Array) -> _Alternative | None:
    """Fit the unlisted fault with the largest gain over a car without effects; None without one."""
    with shared_work(posterior) as shared:
        at_z = slopes(shared, z)
    plain = FittedModel((), posterior, LaplaceApproximation(z, at_z, True))
    denoised = denoised_model(dataset, plain)
    # least squares of the innovations on the car's coordinates and each fault
    car = slice(posterior.space.shared_dimension)
    of_car = denoised.derivatives.only(car)
    of_car = replace(of_car, scales=0.0 * of_car.scales, removed_band_correction=0.0 * z[car])
    projection = nuisance_projection(of_car, z[car], of_car.means[:0])
    faults = unlisted_fault_scores(denoised, projection)
    k = int(np.argmax(faults.gains))
    gain = float(faults.gains[k])
    if not gain > 0.0:
        return None
    change = faults.sensitivities[k] * faults.gradient[k] / faults.information[k, k]
    start = z.copy()
    step = projection.gradient - projection.sensitivities @ change
    start[car] += np.linalg.solve(projection.precision, step)
    fit = fit_model(with_offset(plain, change[None], np.ones(1)), start)
    loss = _negative_log_posterior(fit.posterior, fit.mode, denoised.settled)
    count = len(faults.descriptions)
    return _Alternative(loss, gain, faults.descriptions[k], fit.mode.z, denoised.settled, count)


def _negative_log_posterior(
    posterior: Posterior, mode: LaplaceApproximation, settled: NDArray[np.bool_]
) -> float:
    """Minus the log-posterior up to a constant (nats), over settled innovations.

    Clipped readings are left out, since their true values are unknown.
    """
    at_mode = mode.slopes
    runs = range(len(posterior.space.recordings))
    correction = sum(float(posterior.removed_band_correction(mode.z[None], run)[0]) for run in runs)
    twice = np.sum((at_mode.nu**2 + at_mode.log_variances)[settled]) + mode.z @ mode.z
    return 0.5 * float(twice) - correction
