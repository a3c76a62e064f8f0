"""What an estimation finds: the posterior of a car, and how it explains each recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.damping_rates import (
    DampingRates,
)
from bayes_asv.analysis.input_mistakes import InputCheck
from bayes_asv.analysis.nominal_values import NominalDamping, nominal_damping
from bayes_asv.analysis.predictive_checks import Check
from bayes_asv.analysis.run_consistency import (
    RunConsistency,
)
from bayes_asv.analysis.spring_curves import SpringCurve
from bayes_asv.analysis.uncertainty_budget import UncertaintyBudget
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.free_simulation import FreeRun
from bayes_asv.posterior.likelihood import ResidualAR
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.events import LogEvents
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = ["EstimationResult", "RunFit"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class RunFit:
    """How one recording was explained at the centre of the posterior.

    Parameters
    ----------
    recording : Recording
        As read.
    prepared : PreparedRecording
        The same, laid out.
    free : FreeRun
        Simulation from the wheels alone at the mean of the posterior's coordinates.
    ensemble : (S, E, ny) array
        Outputs of the simulation for S draws of the posterior, m/s².
    travel, velocity : (S, E, ne) arrays
        Deflections for the same draws, m, and their rates, m/s.
    innovations : (E, ny) array
        Normalised innovations after the colour was taken out; nan where there was no reading.
    residual_ar : ResidualAR
        Colour that the innovations had.
    checks : tuple of Check
        Posterior predictive checks.
    """

    recording: Recording
    prepared: PreparedRecording
    free: FreeRun
    ensemble: Array
    travel: Array
    velocity: Array
    innovations: Array
    residual_ar: ResidualAR
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class EstimationResult:
    """A posterior and what it stands on.

    Parameters
    ----------
    verdict : str
        ``ok``, ``not_converged`` or ``refused``.
    reasons, warnings : tuple of str
        Why it was refused; what to know otherwise.
    vehicle : Vehicle
        The car as given.
    car : CarModel
        Its model.
    draws : dict of str to (4, S) array
        Draws of every parameter of the model that is not exact and of what is derived from them,
        SI units, one row an ensemble; empty when refused.
    nuisance : dict of str to (4, S) array
        Draws of noise deviations (m/s²) and of the filtered share of the noise's variance.
    log_posterior : (4, S) array
        Not normalised; of several runs as :mod:`bayes_asv.posterior.shared_posterior` has it.
    rhat_max, ess_bulk_min, ess_tail_min : float
        Worst of all coordinates; nan when refused.
    runs : tuple of RunFit
        One a recording; empty when refused.
    space : ParameterSpace or None
        Coordinates and priors.
    uncertainty_budget : UncertaintyBudget or None
        What makes each answer as wide as it is; only with an answer, and only when runs agree.
    run_consistency : RunConsistency or None
        One run against another; None with a single run.  Where it says ``disagree`` the draws
        are those of its mean car, and each run is explained at its own posterior.
    pooled_draws : dict of str to array
        Draws of the same car if all runs were alike; empty unless they disagree.
    likelihood : str
        Which likelihood was used: ``coloured`` in a band where the sensors' noise does not
        explain what is left.
    below : float or None
        Upper edge of the band that was used, Hz; None at full band.
    effects : dict of PlacedEffect to dict of str to array
        Draws of the parameters of every effect in the model, SI units.
    dampers : tuple of DampingRates
        Rates of every damper whose force is not proportional to speed.
    springs : tuple of SpringCurve
        Curves of every spring that has a free one.
    input_check : Doubt or None
        Why the input is probably wrong or the model does not hold, so that no verdict on a damper
        may rest on this estimate; None where nothing speaks against it.
    long_logs : tuple of LogEvents
        What was found in recordings that are too long to be taken whole, one each; the runs are
        then the events that were used.
    seconds : float
        Time it took.
    seed : int
        Of the draws.
    sampler : str
        How the draws were made: ``ensembles`` of emcee, ``weighted draws``, ``normal
        approximation`` at a mode that the model's error moves, or ``random effects``.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    vehicle: Vehicle
    car: CarModel
    recordings: tuple[Recording, ...]
    likelihood: str
    seed: int
    seconds: float
    draws: dict[str, Array] = field(default_factory=dict)
    nuisance: dict[str, Array] = field(default_factory=dict)
    log_posterior: Array = field(default_factory=lambda: np.zeros((0, 0)))
    rhat_max: float = math.nan
    ess_bulk_min: float = math.nan
    ess_tail_min: float = math.nan
    acceptance: float = math.nan
    sampler: str = "ensembles"
    runs: tuple[RunFit, ...] = ()
    space: ParameterSpace | None = None
    uncertainty_budget: UncertaintyBudget | None = None
    run_consistency: RunConsistency | None = None
    pooled_draws: dict[str, Array] = field(default_factory=dict)
    below: float | None = None
    effects: dict[PlacedEffect, dict[str, Array]] = field(default_factory=dict)
    dampers: tuple[DampingRates, ...] = ()
    springs: tuple[SpringCurve, ...] = ()
    input_check: InputCheck | None = None
    long_logs: tuple[LogEvents, ...] = ()

    @property
    def count(self) -> int:
        """Number of draws in all."""
        return int(next(iter(self.draws.values())).size) if self.draws else 0

    @property
    def estimands(self) -> tuple[str, ...]:
        """Names of the draws that were asked for: all but those of the given values."""
        given = {p.name for p in self.car.parameters if p.kind != "estimated"}
        return tuple(name for name in self.draws if name not in given)

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal value of each parameter and of what is derived from them, SI units."""
        values = self.car.nominal
        derived = {} if self.car.derived is None else self.car.derived(values)
        return {name: float(x[0]) for name, x in {**values, **derived}.items()}

    @cached_property
    def nominal_damping(self) -> NominalDamping | None:
        """Whether nominal damping is mistaken; None where there is no verdict on the dampers."""
        rates = {element.damping for element in self.car.elements}
        if self.input_check is not None or not rates <= set(self.draws):
            return None
        values = {name: float(np.median(self.draws[name])) for name in rates}
        return nominal_damping(self.car, values)

    def probability_below_nominal(self, name: str) -> float:
        """Return the probability that a quantity is below nominal, which may be mistaken."""
        p = float(np.mean(self.draws[name] < self.nominal[name]))
        return (
            p if self.nominal_damping is None else self.nominal_damping.probability_below(name, p)
        )
