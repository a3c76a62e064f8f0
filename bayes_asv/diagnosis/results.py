"""Result of a diagnosis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bayes_asv.analysis.damping_rates import DampingRates
from bayes_asv.analysis.spring_curves import SpringCurve
from bayes_asv.diagnosis.engine import Engine
from bayes_asv.diagnosis.localization import Localization
from bayes_asv.diagnosis.misspecification_test import MisspecificationResult
from bayes_asv.diagnosis.model_comparison import ExtendedModel
from bayes_asv.diagnosis.simulation_error import ErrorChange
from bayes_asv.diagnosis.thresholds import (
    CLEARLY_WORSE,
    LEAST_ODDS,
    RELIABILITY_ALONE,
    RELIABILITY_BESIDE_FAULT,
    RELIABILITY_WITHOUT_ALTERNATIVE,
)
from bayes_asv.diagnosis.unlisted_fault_models import UnnamedCause
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = ["DiagnosisResult", "NamedEffect"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NamedEffect:
    """An effect that was found to be missing from the linear car.

    Parameters
    ----------
    placed : PlacedEffect
        Effect and place.
    probability : float
        Probability that this effect, or an indistinguishable one, is present beyond its tolerance,
        given that the cause is in the list.
    indistinguishable : tuple of ExtendedModel
        Models with other effects that the data cannot distinguish from it.
    errors : dict of str to ErrorChange
        Simulation error on ``fit`` and ``holdout`` before and after this effect was added.
    """

    placed: PlacedEffect
    probability: float
    indistinguishable: tuple[ExtendedModel, ...]
    errors: dict[str, ErrorChange]


@dataclass(frozen=True)
class DiagnosisResult:
    """Result of :func:`bayes_asv.diagnosis.workflow.diagnose`.

    Parameters
    ----------
    verdict : {'agreement', 'named', 'unexplained', 'refused'}
        Whether the linear car agrees with the recordings, lacks named effects, disagrees for an
        unknown reason, or cannot be tested with them.
    reasons, warnings : tuple of str
        Reasons for a refusal, and limitations of the result.
    recording_faults : tuple of dict
        Faults of the recordings that are found before any fit, see
        :func:`bayes_asv.diagnosis.recording_faults.find_recording_faults`.
    vehicle : Vehicle
        Declared vehicle and sensors.
    seed : int
        Seed of all draws.
    car : str
        Name of the car model.
    p_value : float
        Family-wise p-value of the linear car.
    named : tuple of NamedEffect
        Named effects, in the order in which they were added.
    engine : Engine or None
        Engine whose tones were removed.
    p_none : float
        Probability that nothing beyond tolerances is missing.
    unexplained : MisspecificationResult or None
        Tests for something that no listed effect explains.
    unnamed : tuple of UnnamedCause
        Unlisted faults that were added to the model, the largest first.
    localization : Localization or None
        Where the linear car disagrees, with engine tones removed.
    errors : dict of str to ErrorChange
        Simulation error on ``fit`` and, if there is any, ``holdout``.
    fitted, holdout : tuples of PreparedRecording
        Fitted recordings, as given, and held-out ones, with engine tones removed.
    base_model, final_model : FittedModel or None
        The linear car and the final model, with engine tones removed.
    quantities_before, quantities_after : dict of str to (N,) array
        Draws of the car's quantities, SI units: under the linear car on the recordings as
        given, and averaged over all explanations.
    effect_draws : dict of str to dict of str to (N,) array
        Draws of the parameters of each named effect, by effect and place, SI units.
    dampers : tuple of DampingRates
        Rates of the dampers whose force is not proportional to speed, under the final model.
    springs : tuple of SpringCurve
        Free curves of springs, under the final model.
    seconds : float
        Computing time.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    recording_faults: tuple[dict[str, object], ...]
    vehicle: Vehicle
    seed: int
    car: str = "half"
    p_value: float = 1.0
    named: tuple[NamedEffect, ...] = ()
    engine: Engine | None = None
    p_none: float = 1.0
    unexplained: MisspecificationResult | None = None
    unnamed: tuple[UnnamedCause, ...] = ()
    localization: Localization | None = None
    errors: dict[str, ErrorChange] | None = None
    fitted: tuple[PreparedRecording, ...] = ()
    holdout: tuple[PreparedRecording, ...] = ()
    base_model: FittedModel | None = None
    final_model: FittedModel | None = None
    quantities_before: dict[str, Array] | None = None
    quantities_after: dict[str, Array] | None = None
    effect_draws: dict[str, dict[str, Array]] | None = None
    dampers: tuple[DampingRates, ...] = ()
    springs: tuple[SpringCurve, ...] = ()
    seconds: float = 0.0

    @property
    def _against_unlisted_fault(self) -> float:
        """Probability of the named effects against an unlisted fault in their place.

        Bounded, since evidences have errors; one if no such fault was compared.
        """
        if self.unexplained is None or not self.unexplained.present:
            return 1.0
        return max(float(expit(-self.unexplained.alternative)), LEAST_ODDS)

    @property
    def _reliability(self) -> float:
        """Share of names that are true among those that nothing else speaks against."""
        if self.unexplained is None or not self.unexplained.detected:
            return RELIABILITY_ALONE
        alternative = self.unexplained.alternative
        if math.isfinite(alternative) and alternative < -CLEARLY_WORSE:
            return RELIABILITY_WITHOUT_ALTERNATIVE
        return RELIABILITY_BESIDE_FAULT

    def probability_of(self, cause: NamedEffect | Engine) -> float:
        """Probability that a cause is present, in view of what remains unexplained.

        An engine is removed before effects are compared with unlisted faults: both have it.
        """
        against_unlisted = 1.0 if isinstance(cause, Engine) else self._against_unlisted_fault
        return cause.probability * against_unlisted * self._reliability

    @property
    def supported(self) -> tuple[NamedEffect, ...]:
        """Effects with which the car is modelled better than without, whatever their true cause.

        They are more probable than not beside the other effects and in comparison with an unlisted
        fault in their place; if something remains, no unlisted fault alone comes near them.
        """
        if self._reliability == RELIABILITY_BESIDE_FAULT:
            return ()
        return tuple(e for e in self.named if e.probability * self._against_unlisted_fault > 0.5)
