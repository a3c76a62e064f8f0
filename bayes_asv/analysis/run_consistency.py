"""One run against another: each run's own posterior, and whether the runs tell of one car.

A joint posterior takes for granted that c_f, c_r and i are the same in every run.  Here every run
is asked alone and the answers are held against each other, with what the runs share (the given
values and their errors) taken out: see :mod:`bayes_asv.analysis.random_effects`.  Runs that do not
agree get an answer of their own, the mean car with the spread from run to run in its interval; a
joint fit would hide the difference in swollen noise and a coloured residual.
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
"""Parameters that may differ from run to run: spreads of so many are integrated on a grid."""

DISAGREE_BELOW = 0.01
"""Probability of so much difference among equal runs, below which runs are said to disagree.

How often equal runs of the rig fall below it is measured in ``benchmarks/agreement.py``.
"""
_SURELY = 0.9  # probability of differing beyond which a quantity is named

_WEIGHTED = 512  # draws of a run alone before, and
_KEPT = 1024  # after resampling to equal weights
_FEWEST = 60.0  # effective draws without which a run's mean and deviation are not trusted


@dataclass(frozen=True)
class SingleRunFit:
    """What one run says by itself.

    Parameters
    ----------
    fit : MapFit
        Its mode; its posterior has the residual autoregression of this run.
    z : (S, D) array
        Draws of its posterior, equally weighted, in the coordinates of a single run.
    effective : float
        Effective number of the weighted draws that they come from.
    likelihood : RunLikelihood
        Over the car's coordinates.
    misfit_reasons : tuple of str
        Why the car explains too little of this run, if it does.
    """

    fit: MapFit
    z: Array
    effective: float
    likelihood: RunLikelihood
    misfit_reasons: tuple[str, ...]

    @property
    def trusted(self) -> bool:
        """Whether mean and covariance of its posterior may be believed."""
        return self.fit.mode.converged and self.effective >= _FEWEST


@dataclass(frozen=True)
class RunConsistency:
    """Whether the runs of one car agree.

    Parameters
    ----------
    verdict : str
        ``agree``, ``disagree``, or ``unknown`` where a run alone cannot be summarised or
        nothing can be compared.
    overall_test : Contrast
        Test of all of :attr:`compared` together.
    parameter_tests : dict of str to Contrast
        Test of one quantity, with the others free to differ.
    runs : tuple of SingleRunFit
        One a recording.
    population : RandomEffectsPosterior
        Mean car, spread and a run to come; meaningful whatever the verdict.
    shift, sd : (R, 3) arrays
        What each run says when the given values are held at their estimate: logarithm against
        the mean car, and its deviation; nan and infinite where a run says nothing.
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
        """What may differ from run to run: whatever is estimated."""
        return self.space.car.estimated

    @property
    def differing(self) -> tuple[str, ...]:
        """Quantities that surely differ, or the likeliest one when none surely does."""
        chance = np.mean(self.population.spread > 0.0, axis=0)
        sure = [name for name, p in zip(self.compared, chance, strict=True) if p > _SURELY]
        return tuple(sure) or (self.compared[int(np.argmax(chance))],)

    def spread_percent(self, name: str) -> tuple[float, float, float]:
        """Quantiles 2.5, 50 and 97.5 % of one deviation from run to run, in percent."""
        k = self.compared.index(name)
        spread = 100.0 * np.expm1(self.population.spread[:, k])
        low, middle, high = np.quantile(spread, [0.025, 0.5, 0.975])
        return float(low), float(middle), float(high)

    def own_percent(self, name: str) -> float:
        """Root mean square of the runs' own deviations of a quantity, in percent."""
        sd = self.sd[:, self.compared.index(name)]
        there = sd[np.isfinite(sd)]
        return 100.0 * float(np.sqrt(np.mean(there**2))) if len(there) else math.nan

    def estimates_of_runs(self, name: str) -> tuple[Array, Array]:
        """Tell what every run says with the given values held: values and deviations (R,).

        SI units; nan and infinite where a run says nothing.
        """
        k = self.compared.index(name)
        z = np.zeros((1, self.space.dimension))
        z[0, : self.space.car_dimension] = self.population.centre.mean(axis=0)
        middle = float(self.space.values(z)[name][0])
        value = middle * np.exp(self.shift[:, k])
        return value, value * self.sd[:, k]

    @property
    def fit_separately(self) -> bool:
        """Whether a joint fit is idle: the runs disagree, or one is not explained by the car."""
        return self.verdict == "disagree" or any(run.misfit_reasons for run in self.runs)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the runs cannot answer even apart: one is not of this car, or none tells enough."""
        faults = [why for run in self.runs for why in run.misfit_reasons]
        silent = [
            why for why in self.runs[0].fit.reasons if all(why in r.fit.reasons for r in self.runs)
        ]
        return tuple(dict.fromkeys([*faults, *silent]))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know of the runs: that they disagree, if so, and what each has on its own."""
        told = [self.sentence()] if self.verdict == "disagree" else []
        own = [note for run in self.runs for note in run.fit.warnings]
        return tuple(dict.fromkeys([*told, *own]))

    @property
    def space(self) -> ParameterSpace:
        """Coordinates of a single run; those of the car come first and are the same in all."""
        return self.runs[0].fit.space

    def quantities(self, car: Array, seed: int) -> dict[str, Array]:
        """Quantities of the car by name, SI units, for coordinates (N, n) of cars."""
        z = np.zeros((len(car), self.space.dimension))
        z[:, : self.space.car_dimension] = car
        return self.space.quantities(z, seed)

    def joint(self, count: int, seed: int) -> Array:
        """Coordinates (N, n) of the car if all runs were alike, from the runs' own likelihoods."""
        likelihoods = [run.likelihood for run in self.runs]
        precision = np.eye(self.space.car_dimension) + sum(one.precision for one in likelihoods)
        root = np.linalg.cholesky(precision)
        mean = np.linalg.solve(precision, np.asarray(sum(one.linear for one in likelihoods)))
        rng = np.random.default_rng([seed, 6])
        return np.asarray(mean + np.linalg.solve(root.T, rng.standard_normal((len(mean), count))).T)

    def nuisance(self, shape: tuple[int, int], seed: int) -> dict[str, Array]:
        """Draws of every run's noise deviations (m/s²) and filtered shares, by joint names."""
        rng = np.random.default_rng([seed, 7])
        out = {}
        for r, run in enumerate(self.runs):
            pick = rng.integers(len(run.z), size=shape)
            alone = {one.name for one in run.fit.space.coordinates if one.run is None}
            for name, value in run.fit.space.nuisance(run.z).items():
                own = name if name in alone else name.removesuffix(" 0")
                out[f"{own} {r}"] = value[pick]
        return out

    def sentence(self) -> str:
        """Say that the runs do not agree, what differs and by how much."""
        parts = []
        for name in self.differing:
            low, middle, high = self.spread_percent(name)
            own = self.own_percent(name)
            parts.append(
                f"the {QUANTITIES[name][1]} differs from run to run by {_two(middle)} % (95 %: "
                f"{_two(low)} to {_two(high)} %), more than their own uncertainty of {_two(own)} %"
            )
        few = " (two runs say little about a spread, so it is wide)" if len(self.runs) == 2 else ""
        return (
            f"the runs do not agree: {'; '.join(parts)}; the interval allows for that{few}; "
            "the car changes between the runs, or the model lacks it"
        )


def fit_single_run(recording: PreparedRecording, vehicle: Vehicle, seed: int) -> SingleRunFit:
    """Posterior of one run by itself, by weighted draws.

    Parameters
    ----------
    recording : PreparedRecording
        The run.
    vehicle : Vehicle
        Gives the priors.
    seed : int
        Same seed, same draws.

    Returns
    -------
    SingleRunFit
    """
    fit = best_fit((recording,), vehicle)
    with shared_work(fit.posterior) as shared:
        weighted = importance_sample(shared, fit.mode, _WEIGHTED, seed)
    w = weighted.weight
    rng = np.random.default_rng([seed, 8])
    # Systematic: every draw is kept as often as its weight says, give or take one.
    at = np.searchsorted(np.cumsum(w), (rng.random() + np.arange(_KEPT)) / _KEPT)
    z = weighted.z[rng.permutation(np.minimum(at, len(w) - 1))]
    recording = fit.space.recordings[0]
    faults, _ = explained_power_findings(
        recording, free_run(fit.posterior, fit.mode.z, 0), bool(fit.shares)
    )
    return SingleRunFit(fit, z, weighted.effective, _likelihood(fit, weighted), tuple(faults))


def _likelihood(fit: MapFit, weighted: WeightedDraws) -> RunLikelihood:
    """Likelihood of a run by its posterior's moments, or by its mode where they are worth little.

    The second happens to runs whose verdict is open anyway; it only must not get in the way.
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
        Same seed, same draws.

    Returns
    -------
    RunConsistency
    """
    parameter_space = runs[0].fit.space
    n = parameter_space.car_dimension
    way = np.stack(
        [parameter_space.from_logs({name: 1.0})[:n] for name in parameter_space.car.estimated],
        axis=1,
    )
    likelihoods = [run.likelihood for run in runs]
    whole = homogeneity_test(likelihoods, way)
    if not all(run.trusted for run in runs) or whole.freedom == 0:
        verdict = "unknown"
    else:
        verdict = "disagree" if whole.p < DISAGREE_BELOW else "agree"
    found = fit_random_effects(likelihoods, way, count, seed)
    own = [estimates_of_runs(one, way, found.centre.mean(axis=0)) for one in likelihoods]
    return RunConsistency(
        verdict=verdict,
        overall_test=whole,
        parameter_tests={
            name: homogeneity_test(likelihoods, way, [k])
            for k, name in enumerate(parameter_space.car.estimated)
        },
        runs=tuple(runs),
        population=found,
        shift=np.stack([shift for shift, _ in own]),
        sd=np.stack([sd for _, sd in own]),
    )


def _two(value: float) -> str:
    """Two significant digits without a power of ten."""
    return f"{float(f'{value:.2g}'):.10g}"
