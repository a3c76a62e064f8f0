"""What a diagnosis holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.engine_force import Engine
from bayes_asv.diagnosis.localization import Disagreement
from bayes_asv.diagnosis.misspecification_test import Unexplained
from bayes_asv.diagnosis.model_comparison import Option
from bayes_asv.diagnosis.simulation_error import Gap
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import Site
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["Diagnosis", "Named"]

Array = NDArray[np.float64]

# On 1292 cars of the battery (seeds 62, 64) 13 of 46 names were true with something found beside
# them, and on 453 (seeds 5, 11, 31, 32) 44 of 55 with nothing but a rival that has no name.
_STAND_IN, _RIVALLED = 0.28, 0.9


@dataclass(frozen=True)
class Named:
    """An effect that was named.

    Parameters
    ----------
    site : Site
        What and where.
    probability : float
        That it, or another of its class, is there and not merely a little of it.
    others : tuple of Option
        What these data cannot tell from it.
    gaps : dict of str to Gap
        ``fit`` and ``holdout``, before and after this effect was added.
    """

    site: Site
    probability: float
    others: tuple[Option, ...]
    gaps: dict[str, Gap]


@dataclass(frozen=True)
class Diagnosis:
    """What the workflow found.

    Parameters
    ----------
    verdict : {'agreement', 'named', 'unexplained', 'refused'}
        See ``docs/interfaces.md``.
    reasons, warnings, preflight : tuples
        Why it was refused; what to know; what was found before any fit.
    p : float
        Family-wise p-value of the linear half car.
    named : tuple of Named
        In the order in which they were added.
    engine : Engine or None
        Tones that were cut out.
    none : float
        Probability that nothing beyond tolerances is missing.
    left : Unexplained or None
        What has no name.
    seen : Disagreement or None
        Where the linear half car disagrees, an engine's tones cut out.
    gaps : dict of str to Gap
        ``fit`` and, where there is one, ``holdout``.
    fit, holdout : tuples of PreparedRecording
        What was fitted, as it was given, and what was held out, an engine's tones cut out of it.
    base, final : FittedModel or None
        The linear half car and the model with everything named, an engine's tones cut out.
    before, after : dict of str to (N,) array
        Draws of the car's quantities, SI units: under the linear half car, nothing cut out, and
        under all explanations by their shares.
    effects : dict of str to dict of str to (N,) array
        Draws of what was named, by site and parameter.
    seconds : float
        How long it took.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    preflight: tuple[dict[str, object], ...]
    vehicle: Vehicle
    seed: int
    p: float = 1.0
    named: tuple[Named, ...] = ()
    engine: Engine | None = None
    none: float = 1.0
    left: Unexplained | None = None
    seen: Disagreement | None = None
    gaps: dict[str, Gap] | None = None
    fit: tuple[PreparedRecording, ...] = ()
    holdout: tuple[PreparedRecording, ...] = ()
    base: FittedModel | None = None
    final: FittedModel | None = None
    before: dict[str, Array] | None = None
    after: dict[str, Array] | None = None
    effects: dict[str, dict[str, Array]] | None = None
    seconds: float = 0.0

    @property
    def trust(self) -> float:
        """What names count where something is left that has none, which they may stand in for."""
        if self.left is None or not self.left.present:
            return 1.0
        return _STAND_IN if self.left.found else _RIVALLED

    def believed(self, cause: Named | Engine) -> float:
        """Probability that a cause is there, also in view of what is left without a name."""
        return cause.probability * self.trust
