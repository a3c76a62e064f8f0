"""Result of an estimation: the posterior of a car, and its fit to each recording."""

from __future__ import annotations

import math
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


@dataclass(frozen=True)
class RunFit:
    """Fit to one recording at the posterior mean.

    Parameters
    ----------
    recording : Recording
        Recording as read.
    prepared : PreparedRecording
        The prepared recording.
    free : FreeRun
        Simulation from the wheels alone, at the posterior mean of the coordinates.
    ensemble : (S, E, ny) array
        Outputs of the simulation for S draws of the posterior, m/s².
    travel, velocity : (S, E, ne) arrays
        Deflections for the same draws, m, and their rates, m/s.
    innovations : (E, ny) array
        Normalised innovations, whitened by the residual autoregression; nan without a reading.
    residual_ar : ResidualAR
        Residual autoregression.
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
    """A posterior with its diagnostics.

    Parameters
    ----------
    verdict : str
        ``ok``, ``not_converged`` or ``refused``.
    reasons, warnings : tuple of str
        Reasons for a refusal, and warnings.
    vehicle : Vehicle
        Declared vehicle and sensors.
    car : CarModel
        Its model.
    recordings : tuple of Recording
        Recordings as read.
    draws : dict of str to (4, S) array
        Draws of every parameter of the model that is not exact, and of quantities derived from
        them, SI units, one row per ensemble; empty if refused.
    nuisance : dict of str to (4, S) array
        Draws of noise levels (SI units), gains, clock errors, and filtered shares of the noise
        variance.
    log_posterior : (4, S) array
        Log posterior of the draws, not normalised; with several runs, see
        :mod:`bayes_asv.posterior.shared_posterior`.
    rhat_max, ess_bulk_min, ess_tail_min : float
        R̂ and effective sample sizes of the worst coordinate; nan if refused.
    acceptance : float
        Mean share of accepted proposals; nan for independent draws.
    runs : tuple of RunFit
        Fit to each recording; empty if refused.
    space : ParameterSpace or None
        Coordinates and priors.
    uncertainty_budget : UncertaintyBudget or None
        Uncertainty budget of the parameters of interest; None if refused or if runs are
        inconsistent.
    run_consistency : RunConsistency or None
        Comparison of runs; None with a single run.  If its verdict is ``disagree``, the draws are
        those of its mean car, and each run has the fit of its own posterior.
    pooled_draws : dict of str to array
        Draws of the car if all runs share it; empty unless runs are inconsistent.
    likelihood : str
        Likelihood that was used: ``coloured`` in a band if sensor noise does not explain the
        residuals.
    below : float or None
        Upper edge of the band, Hz; None at full band.
    effects : dict of PlacedEffect to dict of str to array
        Draws of the parameters of every effect in the model, SI units.
    dampers : tuple of DampingRates
        Rates of every damper whose force is not proportional to speed.
    springs : tuple of SpringCurve
        Free curves of springs.
    input_check : InputCheck or None
        Why the estimate supports no verdict on a damper: the input is probably wrong, or the model
        does not fit.  None if nothing argues against it.
    long_logs : tuple of LogEvents
        Events of recordings that are too long to be used whole; the runs are then the events that
        were used.
    seconds : float
        Computing time.
    seed : int
        Seed of the draws.
    sampler : str
        Method of the draws: ``ensembles`` of emcee, ``weighted draws``, ``normal approximation`` at
        the mode with model error, or ``random effects``.
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
        """Total number of draws."""
        return int(next(iter(self.draws.values())).size) if self.draws else 0

    @property
    def estimands(self) -> tuple[str, ...]:
        """Names of the parameters of interest: all draws except those of given values."""
        given = {p.name for p in self.car.parameters if p.kind != "estimated"}
        return tuple(name for name in self.draws if name not in given)

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal value of each parameter and derived quantity, SI units."""
        values = self.car.nominal
        derived = {} if self.car.derived is None else self.car.derived(values)
        return {name: float(x[0]) for name, x in {**values, **derived}.items()}

    @cached_property
    def nominal_damping(self) -> NominalDamping | None:
        """Possible mistakes in nominal damping; None if there is no verdict on the dampers."""
        rates = {element.damping for element in self.car.elements}
        if self.input_check is not None or not rates <= set(self.draws):
            return None
        values = {name: float(np.median(self.draws[name])) for name in rates}
        return nominal_damping(self.car, values)

    def probability_below_nominal(self, name: str) -> float:
        """Return the probability that a quantity is below nominal, allowing for a mistake."""
        p = float(np.mean(self.draws[name] < self.nominal[name]))
        return (
            p if self.nominal_damping is None else self.nominal_damping.probability_below(name, p)
        )
