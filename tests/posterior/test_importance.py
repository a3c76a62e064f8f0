"""Weighted draws against the ensembles, and against integrals known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import gamma, norm

from bayes_asv.posterior.importance import Proposal, WeightedDraws, importance_sample
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.posterior.newton import PosteriorMode
from bayes_asv.posterior.sampler import sample_mcmc
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, case, vehicle

Array = NDArray[np.float64]


class Skewed:
    """A product of gamma densities in the logarithm of their variable: skewed, normalised."""

    shape = 12.0

    def log_posterior(self, z: Array) -> Array:
        value = self.shape * z - np.exp(z) - math.lgamma(self.shape)
        return np.asarray(value.sum(axis=1))

    def mode(self, d: int) -> PosteriorMode:
        middle = np.full(d, math.log(self.shape))
        top = float(self.log_posterior(middle[None])[0])
        return PosteriorMode(middle, np.eye(d) / self.shape, top, True)


def test_a_proposal_is_a_normalised_density() -> None:
    root = np.array([[1.0, 0.0], [0.6, 0.8]])
    skewed = Proposal(
        np.array([1.0, -2.0]), np.array([0.5, 1.0]), np.array([2.0, 1.0]), root @ root.T
    )
    # midpoints, so that the bend at the middle falls between two of them
    x, y = np.arange(-15.0, 40.0, 0.05) + 0.025, np.arange(-20.0, 16.0, 0.05) + 0.025
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    mass = np.exp(skewed.log_density(grid)).sum() * 0.05**2
    assert mass == pytest.approx(1.0, abs=2e-3)


def test_a_skewed_integral_and_its_quantiles_come_out_right() -> None:
    posterior = Skewed()
    found = importance_sample(posterior, posterior.mode(4), 2048, 3)
    assert found.log_evidence == pytest.approx(0.0, abs=0.02)
    assert found.effective > 1200.0
    value = np.exp(found.z[:, 2])
    wanted = gamma(posterior.shape).ppf([0.025, 0.5, 0.975])
    assert found.quantile(value, np.array([0.025, 0.5, 0.975])) == pytest.approx(wanted, rel=0.03)
    assert found.mean(value) == pytest.approx(posterior.shape, rel=0.01)
    assert found.sd(value) == pytest.approx(math.sqrt(posterior.shape), rel=0.03)
    assert found.probability_below(value, posterior.shape) == pytest.approx(
        gamma(12.0).cdf(12.0), abs=0.015
    )


def test_weighted_draws_agree_with_the_ensembles() -> None:
    _, _, recording = case("rough", 17, DECLARED)
    car = vehicle(DECLARED)
    lines, reasons, _ = prepare_runs((recording,), car)
    assert not reasons
    fit = best_fit(lines, car)
    weighted = importance_sample(fit.posterior, fit.mode, 2048, 1)
    ensembles = sample_mcmc(fit.posterior, fit.mode, 1)
    one = fit.space.quantities(weighted.z, 1)
    other = fit.space.quantities(ensembles.draws.reshape(-1, fit.space.dimension), 1)
    shares = np.array([0.025, 0.25, 0.5, 0.75, 0.975])
    # five deviations of what chance alone does to a quantile of so many draws
    chance = (
        5.0 * np.sqrt(shares * (1.0 - shares) / weighted.effective) / norm.pdf(norm.ppf(shares))
    )
    for name in ("c_f", "c_r", "i", "k_g"):
        apart = weighted.quantile(one[name], shares) - np.quantile(other[name], shares)
        assert np.all(np.abs(apart) < chance * np.std(other[name])), name


def test_a_probability_stays_one_where_its_weights_do_not_sum_exactly() -> None:
    weight = np.full(8, 0.125)
    weight[0] += 1e-15
    draws = WeightedDraws(np.zeros((8, 1)), weight, 0.0)
    value = np.arange(8.0)
    assert weight.sum() > 1.0
    assert draws.probability_below(value, 8.0) == 1.0
    assert draws.probability_below(value, 3.5) == pytest.approx(0.5)
    assert draws.probability_below(value, 3.0) == pytest.approx(0.4375)
