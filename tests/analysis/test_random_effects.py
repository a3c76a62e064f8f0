"""The model of several runs against dense least squares and one-dimensional integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2, halfcauchy, kstest, norm

from bayes_asv.analysis.random_effects import (
    LARGEST_SPREAD,
    SAME,
    SPREAD_SCALE,
    RunLikelihood,
    estimates_of_runs,
    fit_random_effects,
    homogeneity_test,
    likelihood_of_run,
)

Array = NDArray[np.float64]
seeds = st.integers(0, 10_000)


def _car(rng: np.random.Generator, n: int = 6) -> Array:
    """A way from three logarithms to n coordinates."""
    return np.asarray(rng.normal(size=(n, 3)) / np.array([1.1, 1.1, 0.7]))


def _site(rng: np.random.Generator, centre: Array, sharp: float = 300.0) -> RunLikelihood:
    """A run's likelihood, its mean scattered about ``centre`` as its precision says."""
    n = len(centre)
    root = sharp * rng.normal(size=(n, n))
    precision = root @ root.T + sharp * np.eye(n)
    mean = rng.multivariate_normal(centre, np.linalg.inv(precision))
    return RunLikelihood(precision, precision @ mean)


def _dense(sites: list[RunLikelihood], way: Array, together: list[int]) -> float:
    """Least sum of squares with a car a run whose columns ``together`` are equal in all."""
    n, runs = len(way), len(sites)
    rows, values = [], []
    free = [k for k in range(3) if k not in together]
    for r, (precision, linear) in enumerate(sites):
        half = np.linalg.cholesky(precision).T
        design = np.zeros((n, n + runs * len(free)))
        design[:, :n] = half
        for j, k in enumerate(free):
            design[:, n + r * len(free) + j] = half @ way[:, k]
        rows.append(design)
        values.append(np.linalg.solve(half.T, linear))
    # What is given has a standard normal prior, except along the ways of what is sought.
    outside = np.linalg.svd(way)[0][:, 3:].T
    rows.append(np.hstack([outside, np.zeros((n - 3, runs * len(free)))]))
    values.append(np.zeros(n - 3))
    A, b = np.vstack(rows), np.concatenate(values)
    x = np.linalg.lstsq(A, b, rcond=1e-12)[0]
    return float(np.sum((A @ x - b) ** 2))


@given(seeds)
@settings(deadline=None, max_examples=30)
def test_a_site_gives_its_posterior_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    site = _site(rng, rng.normal(size=5), 3.0)
    covariance = np.asarray(np.linalg.inv(np.eye(5) + site.precision), np.float64)
    back = likelihood_of_run(covariance @ site.linear, covariance)
    assert back.precision == pytest.approx(site.precision, rel=1e-6, abs=1e-6)
    assert back.linear == pytest.approx(site.linear, rel=1e-6, abs=1e-6)


def test_a_run_that_says_nothing_leaves_nothing() -> None:
    site = likelihood_of_run(np.array([0.02, 3.0]), np.diag([0.99, 1e-4]))
    assert site.precision[0, 0] == 0.0
    assert site.linear[0] == 0.0
    assert site.linear[1] / site.precision[1, 1] == pytest.approx(3.0, rel=1e-3)


def test_a_run_known_without_any_doubt_does_not_break_the_rest() -> None:
    site = likelihood_of_run(np.array([0.5, -0.5]), np.zeros((2, 2)))
    assert np.all(np.isfinite(site.precision))
    assert np.linalg.solve(site.precision, site.linear) == pytest.approx([0.5, -0.5])
    way = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert np.all(np.isfinite(fit_random_effects([site, site], way, 100, 0).centre))


@given(seeds, st.integers(2, 4))
@settings(deadline=None, max_examples=30)
def test_the_test_is_a_difference_of_two_least_squares(seed: int, runs: int) -> None:
    rng = np.random.default_rng(seed)
    way, centre = _car(rng), rng.normal(size=6)
    sites = [_site(rng, centre + way @ (0.01 * rng.normal(size=3)), 30.0) for _ in range(runs)]
    found = homogeneity_test(sites, way)
    assert found.freedom == 3 * (runs - 1)
    best = _dense(sites, way, [])
    assert found.q == pytest.approx(_dense(sites, way, [0, 1, 2]) - best, rel=1e-4, abs=1e-5)
    one = homogeneity_test(sites, way, [1])
    assert one.freedom == runs - 1
    assert one.q == pytest.approx(_dense(sites, way, [1]) - best, rel=1e-4, abs=1e-5)
    assert found.p == pytest.approx(chi2.sf(found.q, found.freedom))


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_what_all_runs_share_is_no_disagreement(seed: int) -> None:
    """A change of the car common to all runs, however far from the prior, moves nothing."""
    rng = np.random.default_rng(seed)
    way, centre = _car(rng), rng.normal(size=6)
    sites = [_site(rng, centre, 30.0) for _ in range(3)]
    moved = [site.around(-way @ np.array([3.0, -2.0, 5.0])) for site in sites]
    assert homogeneity_test(moved, way).q == pytest.approx(
        homogeneity_test(sites, way).q, rel=1e-4, abs=1e-4
    )


def test_equal_runs_have_uniform_probabilities() -> None:
    """200 threes of runs, given values off as their prior says; seed 1."""
    rng = np.random.default_rng(1)
    way = _car(rng)
    outside = np.linalg.svd(way)[0][:, 3:]
    found = []
    for _ in range(200):
        centre = outside @ rng.normal(size=3) + way @ rng.normal(size=3)
        found.append(homogeneity_test([_site(rng, centre, 20.0) for _ in range(3)], way).p)
    assert kstest(found, "uniform").pvalue > 1e-3


def test_one_run_and_silent_runs_cannot_be_compared() -> None:
    rng = np.random.default_rng(2)
    way = _car(rng)
    site = _site(rng, np.zeros(6))
    silent = RunLikelihood(np.zeros((6, 6)), np.zeros(6))
    for sites in ([site], [site, silent]):
        found = homogeneity_test(sites, way)
        assert found.freedom == 0
        assert math.isnan(found.p)
    shift, sd = estimates_of_runs(silent, way, np.zeros(6))
    assert np.all(np.isnan(shift))
    assert np.all(np.isinf(sd))


def test_what_is_given_as_exact_is_not_tested_and_cannot_differ() -> None:
    rng = np.random.default_rng(3)
    way = _car(rng)
    way[:, 2] = 0.0
    sites = [_site(rng, np.zeros(6)) for _ in range(3)]
    assert homogeneity_test(sites, way).freedom == 4
    found = fit_random_effects(sites, way, 500, 0)
    assert np.all(found.spread[:, 2] == 0.0)
    assert np.any(found.spread[:, 0] > 0.0)


def test_own_values_are_the_runs_with_the_given_values_held() -> None:
    rng = np.random.default_rng(4)
    way, truth = _car(rng), np.array([0.02, -0.01, 0.03])
    shift, sd = estimates_of_runs(_site(rng, way @ truth), way, np.zeros(6))
    assert np.all(np.abs(shift - truth) < 4.5 * sd)
    assert np.all(sd < 0.01)


@pytest.mark.parametrize(("runs", "apart"), [(2, 0.08), (3, 0.0), (5, 0.02), (10, 0.05)])
def test_one_quantity_against_an_integral(runs: int, apart: float) -> None:
    """The normal–normal model by brute force: no coordinates, no Cholesky, no grid of three."""
    rng = np.random.default_rng([runs, 7])
    sd = 0.002 * rng.uniform(0.5, 2.0, runs)
    value = apart * rng.normal(size=runs) + sd * rng.normal(size=runs)
    # One coordinate, its prior deviation a factor 3; the other two ways lead nowhere.
    scale = math.log(3.0)
    sites = [
        RunLikelihood(np.array([[(scale / s) ** 2]]), np.array([scale * v / s**2]))
        for v, s in zip(value, sd, strict=True)
    ]
    found = fit_random_effects(sites, np.array([[1.0 / scale, 0.0, 0.0]]), 20_000, 1)

    tau = np.exp(np.linspace(math.log(1e-7), math.log(LARGEST_SPREAD), 1500))
    step = math.log(tau[1] / tau[0])
    prior = np.append(SAME, (1.0 - SAME) * halfcauchy(scale=SPREAD_SCALE).pdf(tau) * tau * step)
    every = np.append(0.0, tau)
    variance = sd**2 + every[:, None] ** 2
    precision = np.sum(1.0 / variance, axis=1) + 1.0 / scale**2
    mean = np.sum(value / variance, axis=1) / precision
    log_weight = (
        np.sum(norm.logpdf(value, 0.0, np.sqrt(variance)), axis=1)
        + 0.5 * mean**2 * precision
        - 0.5 * np.log(precision)
    )
    weight = prior * np.exp(log_weight - log_weight.max())
    weight /= weight.sum()

    assert np.mean(found.spread[:, 0] == 0.0) == pytest.approx(weight[0], abs=0.01)
    for q in (0.25, 0.5, 0.9, 0.975):
        wanted = every[np.searchsorted(np.cumsum(weight), q)]
        assert np.quantile(found.spread[:, 0], q) == pytest.approx(wanted, rel=0.1, abs=1e-4)
    grid = np.linspace(-0.6, 0.6, 2001)
    below = np.array([weight @ norm.cdf((g - mean) * np.sqrt(precision)) for g in grid])
    for q in (0.025, 0.5, 0.975):
        wanted = float(np.interp(q, below, grid))
        width = float(np.interp(0.975, below, grid) - np.interp(0.025, below, grid))
        assert np.quantile(scale * found.centre[:, 0], q) == pytest.approx(
            wanted, abs=0.03 * width + 1e-5
        )
    again = fit_random_effects(sites, np.array([[1.0 / scale, 0.0, 0.0]]), 20_000, 1)
    assert np.array_equal(again.centre, found.centre)
