"""Consistency of runs: the posterior of each run alone, and whether the runs share one car.

A joint posterior assumes that c_f, c_r and i are the same in every run.  Here every run is
estimated alone, and the estimates are compared; errors of the given values are common to all runs
(:mod:`bayes_asv.analysis.random_effects`).  If the runs are inconsistent, the result is that of the
mean car, and its interval includes the spread between runs; a joint fit would hide the difference
in larger noise levels and an autoregression.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.random_effects import (
    HomogeneityTest,
    RandomEffectsPosterior,
    RunLikelihood,
    estimates_of_runs,
    fit_random_effects,
    homogeneity_test,
    likelihood_of_run,
)
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.fit_checks import explained_power_findings
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.importance import WeightedDraws, importance_sample
from bayes_asv.posterior.likelihood import shared_work
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "DISAGREE_BELOW",
    "MAX_COMPARED",
    "RunConsistency",
    "SingleRunFit",
    "compare_runs",
    "fit_single_run",
]

Array = NDArray[np.float64]

MAX_COMPARED = 3
"""Largest number of parameters that may differ between runs: their spreads are integrated on a
grid."""

DISAGREE_BELOW = 0.01
"""Level of the homogeneity test below which runs are reported as inconsistent.

Its false-alarm rate on equal runs of the rig is measured in ``benchmarks/agreement.py``.
"""
_SURELY = 0.9  # probability of a difference between runs above which a parameter is named

_WEIGHTED = 512  # weighted draws of the posterior of one run
_RESAMPLED = 1024  # draws after resampling to equal weights
_FEWEST = 60.0  # effective draws below which the moments of a run's posterior are not trusted


@dataclass(frozen=True)
class SingleRunFit:
    """Posterior of one run alone.

    Parameters
    ----------
    fit : MapFit
        Its mode; the posterior has the residual autoregression of this run.
    z : (S, D) array
        Draws of its posterior, equally weighted, in the coordinates of a single run.
    effective : float
        Effective number of the weighted draws from which they were resampled.
    likelihood : RunLikelihood
        Gaussian likelihood over the car's coordinates.
    misfit_reasons : tuple of str
        Reasons why the car explains too little of this run, if so.
    """

    fit: MapFit
    z: Array
    effective: float
    likelihood: RunLikelihood
    misfit_reasons: tuple[str, ...]

    @property
    def trusted(self) -> bool:
        """Whether mean and covariance of its posterior are reliable."""
        return self.fit.mode.converged and self.effective >= _FEWEST


@dataclass(frozen=True)
class RunConsistency:
    """Whether the runs of one car are consistent.

    Parameters
    ----------
    verdict : str
        ``agree``, ``disagree``, or ``unknown`` if the posterior of a run is unreliable or nothing
        can be compared.
    overall_test : HomogeneityTest
        Test of all of :attr:`compared` together.
    parameter_tests : dict of str to HomogeneityTest
        Test of each parameter, with the others free to differ.
    runs : tuple of SingleRunFit
        Fits of the single runs.
    population : RandomEffectsPosterior
        Mean car, spread between runs and next run; valid for any verdict.
    shift, sd : (R, 3) arrays
        Estimate of each run with the given values fixed at their estimates: logarithm relative to
        the mean car, and its standard deviation; nan and infinite if a run has no information.
    """

    verdict: str
    overall_test: HomogeneityTest
    parameter_tests: dict[str, HomogeneityTest]
    runs: tuple[SingleRunFit, ...]
    population: RandomEffectsPosterior
    shift: Array
    sd: Array

    @property
    def compared(self) -> tuple[str, ...]:
        """Parameters that may differ between runs: those that are estimated."""
        return self.space.car.estimated

    @property
    def differing(self) -> tuple[str, ...]:
        """Parameters that almost certainly differ, or else the one that most probably does."""
        probability = np.mean(self.population.spread > 0.0, axis=0)
        almost_certain = [
            name for name, p in zip(self.compared, probability, strict=True) if p > _SURELY
        ]
        return tuple(almost_certain) or (self.compared[int(np.argmax(probability))],)

    def spread_percent(self, name: str) -> tuple[float, float, float]:
        """Quantiles 2.5, 50 and 97.5 % of a parameter's spread between runs, in percent."""
        k = self.compared.index(name)
        spread = 100.0 * np.expm1(self.population.spread[:, k])
        low, middle, high = np.quantile(spread, [0.025, 0.5, 0.975])
        return float(low), float(middle), float(high)

    def own_percent(self, name: str) -> float:
        """Root mean square of the single runs' standard deviations of a parameter, in percent."""
        sd = self.sd[:, self.compared.index(name)]
        finite = sd[np.isfinite(sd)]
        return 100.0 * float(np.sqrt(np.mean(finite**2))) if len(finite) else math.nan

    def estimates_of_runs(self, name: str) -> tuple[Array, Array]:
        """Return each run's estimate with given values fixed: values and standard deviations (R,).

        SI units; nan and infinite if a run has no information.
        """
        k = self.compared.index(name)
        z = np.zeros((1, self.space.dimension))
        z[0, : self.space.car_dimension] = self.population.centre.mean(axis=0)
        middle = float(self.space.values(z)[name][0])
        value = middle * np.exp(self.shift[:, k])
        return value, value * self.sd[:, k]

    @property
    def fit_separately(self) -> bool:
        """Whether to fit the runs separately: they disagree, or the car does not explain one."""
        return self.verdict == "disagree" or any(run.misfit_reasons for run in self.runs)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons to refuse even separate fits: a misfit, or parameters that no run identifies."""
        faults = [why for run in self.runs for why in run.misfit_reasons]
        common_reasons = [
            why for why in self.runs[0].fit.reasons if all(why in r.fit.reasons for r in self.runs)
        ]
        return tuple(dict.fromkeys([*faults, *common_reasons]))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: that the runs disagree, if so, and the warnings of each run."""
        inconsistency = [self.sentence()] if self.verdict == "disagree" else []
        of_runs = [note for run in self.runs for note in run.fit.warnings]
        return tuple(dict.fromkeys([*inconsistency, *of_runs]))

    @property
    def space(self) -> ParameterSpace:
        """Parameter space of a single run; the car's coordinates come first, alike in all runs."""
        return self.runs[0].fit.space

    def quantities(self, car: Array, seed: int) -> dict[str, Array]:
        """Quantities of the car by name, SI units, for coordinates (N, n) of cars."""
        z = np.zeros((len(car), self.space.dimension))
        z[:, : self.space.car_dimension] = car
        return self.space.quantities(z, seed)

    def joint(self, count: int, seed: int) -> Array:
        """Draw coordinates (N, n) of the car if all runs share it, from the runs' likelihoods."""
        likelihoods = [run.likelihood for run in self.runs]
        precision = np.eye(self.space.car_dimension) + sum(one.precision for one in likelihoods)
        root = np.linalg.cholesky(precision)
        mean = np.linalg.solve(precision, np.asarray(sum(one.linear for one in likelihoods)))
        rng = np.random.default_rng([seed, 6])
        return np.asarray(mean + np.linalg.solve(root.T, rng.standard_normal((len(mean), count))).T)

    def nuisance(self, shape: tuple[int, int], seed: int) -> dict[str, Array]:
        """Draws of the nuisance parameters of every run, SI units, by name in a joint fit."""
        rng = np.random.default_rng([seed, 7])
        out = {}
        for r, run in enumerate(self.runs):
            pick = rng.integers(len(run.z), size=shape)
            shared_names = {one.name for one in run.fit.space.coordinates if one.run is None}
            for name, value in run.fit.space.nuisance(run.z).items():
                joint_name = name if name in shared_names else name.removesuffix(" 0")
                out[f"{joint_name} {r}"] = value[pick]
        return out

    def sentence(self) -> str:
        """Message that the runs are inconsistent: what differs, and by how much."""
        parts = []
        for name in self.differing:
            low, middle, high = self.spread_percent(name)
            own_sd = self.own_percent(name)
            parts.append(
                f"the {QUANTITIES[name][1]} differs from run to run by {_two_digits(middle)} % "
                f"(95 %: {_two_digits(low)} to {_two_digits(high)} %), more than their own "
                f"uncertainty of {_two_digits(own_sd)} %"
            )
        few = " (two runs say little about a spread, so it is wide)" if len(self.runs) == 2 else ""
        return (
            f"the runs do not agree: {'; '.join(parts)}; the interval allows for that{few}; "
            "the car changes between the runs, or the model lacks it"
        )


def fit_single_run(recording: PreparedRecording, vehicle: Vehicle, seed: int) -> SingleRunFit:
    """Posterior of one run alone, by importance sampling.

    Parameters
    ----------
    recording : PreparedRecording
        The run.
    vehicle : Vehicle
        Gives the priors.
    seed : int
        Seed of the draws.

    Returns
    -------
    SingleRunFit
    """
    fit = best_fit((recording,), vehicle)
    with shared_work(fit.posterior) as shared:
        weighted = importance_sample(shared, fit.mode, _WEIGHTED, seed)
    w = weighted.weight
    rng = np.random.default_rng([seed, 8])
    # systematic resampling: the multiplicity of a draw differs from its weight by less than one
    at = np.searchsorted(np.cumsum(w), (rng.random() + np.arange(_RESAMPLED)) / _RESAMPLED)
    z = weighted.z[rng.permutation(np.minimum(at, len(w) - 1))]
    recording = fit.space.recordings[0]
    faults, _ = explained_power_findings(
        recording, free_run(fit.posterior, fit.mode.z, 0), bool(fit.shares)
    )
    return SingleRunFit(fit, z, weighted.effective, _likelihood(fit, weighted), tuple(faults))


def _likelihood(fit: MapFit, weighted: WeightedDraws) -> RunLikelihood:
    """Likelihood of a run from the moments of its posterior, or from its mode if these are poor.

    In the second case, the verdict is ``unknown`` anyway.
    """
    n = fit.space.car_dimension
    if weighted.effective >= _FEWEST:
        car, w = weighted.z[:, :n], weighted.weight
        mean = w @ car
        return likelihood_of_run(mean, (car - mean).T @ ((car - mean) * w[:, None]))
    mean, covariance = fit.mode.z[:n], fit.mode.covariance[:n, :n]
    if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance))):
        return RunLikelihood(np.zeros((n, n)), np.zeros(n))
    return likelihood_of_run(mean, covariance)


def compare_runs(runs: Sequence[SingleRunFit], count: int, seed: int) -> RunConsistency:
    """Test whether the runs share one car.

    Parameters
    ----------
    runs : sequence of SingleRunFit
        Two or more.
    count : int
        Draws of the mean car.
    seed : int
        Seed of the draws.

    Returns
    -------
    RunConsistency
    """
    parameter_space = runs[0].fit.space
    n = parameter_space.car_dimension
    basis = np.stack(
        [parameter_space.from_logs({name: 1.0})[:n] for name in parameter_space.car.estimated],
        axis=1,
    )
    likelihoods = [run.likelihood for run in runs]
    overall_test = homogeneity_test(likelihoods, basis)
    if not all(run.trusted for run in runs) or overall_test.freedom == 0:
        verdict = "unknown"
    else:
        verdict = "disagree" if overall_test.p < DISAGREE_BELOW else "agree"
    population = fit_random_effects(likelihoods, basis, count, seed)
    estimates = [
        estimates_of_runs(one, basis, population.centre.mean(axis=0)) for one in likelihoods
    ]
    return RunConsistency(
        verdict=verdict,
        overall_test=overall_test,
        parameter_tests={
            name: homogeneity_test(likelihoods, basis, [k])
            for k, name in enumerate(parameter_space.car.estimated)
        },
        runs=tuple(runs),
        population=population,
        shift=np.stack([shift for shift, _ in estimates]),
        sd=np.stack([sd for _, sd in estimates]),
    )


def _two_digits(value: float) -> str:
    """Two significant digits without a power of ten."""
    return f"{float(f'{value:.2g}'):.10g}"
