"""Ensembles on posteriors whose answer is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, skewnorm

from bayes_asv.posterior.newton import PosteriorMode
from bayes_asv.posterior.sampler import (
    convergence_diagnostics,
    effective_sizes,
    importance_resample,
    sample_mcmc,
)

Array = NDArray[np.float64]


class Known:
    """A stand-in for a posterior: a log density of (W, D) points."""

    def __init__(self, log_density: Callable[[Array], Array]) -> None:
        self.log_density = log_density

    def log_posterior(self, z: Array) -> Array:
        return self.log_density(z)


def _mode(d: int, sd: float = 1.0) -> PosteriorMode:
    return PosteriorMode(np.zeros(d), sd**2 * np.eye(d), 0.0, True)


def test_a_correlated_normal_is_recovered() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(5, 5))
    covariance = root @ root.T + 0.1 * np.eye(5)
    precision = np.linalg.inv(covariance)
    posterior = Known(lambda z: -0.5 * np.einsum("wi,ij,wj->w", z, precision, z))
    result = sample_mcmc(posterior, PosteriorMode(np.zeros(5), covariance, 0.0, True), seed=1)
    assert result.converged
    flat = result.draws.reshape(-1, 5)
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(flat.mean(axis=0)) < 5.0 * sd / np.sqrt(result.ess_bulk_min))
    np.testing.assert_allclose(flat.std(axis=0), sd, rtol=0.1)


def test_a_skewed_posterior_keeps_its_tails() -> None:
    posterior = Known(lambda z: np.sum(skewnorm.logpdf(z, 6.0), axis=1))
    result = sample_mcmc(posterior, _mode(3), seed=2)
    assert result.converged
    low, high = np.quantile(result.draws.reshape(-1, 3), [0.025, 0.975], axis=0)
    np.testing.assert_allclose(low, skewnorm.ppf(0.025, 6.0), atol=0.08)
    np.testing.assert_allclose(high, skewnorm.ppf(0.975, 6.0), atol=0.15)


def test_a_start_far_too_narrow_is_outgrown() -> None:
    posterior = Known(lambda z: -0.5 * np.sum((z - 0.5) ** 2, axis=1))
    result = sample_mcmc(posterior, _mode(2, 0.05), seed=3)
    assert result.converged
    np.testing.assert_allclose(result.draws.reshape(-1, 2).std(axis=0), 1.0, rtol=0.12)


def test_two_separate_modes_are_admitted_as_not_converged() -> None:
    def log_density(z: Array) -> Array:
        far, near = -0.5 * np.sum((z - 60.0) ** 2, axis=1), -0.5 * np.sum(z**2, axis=1)
        return np.asarray(np.logaddexp(far, near))

    wide = sample_mcmc(Known(log_density), _mode(2, 20.0), seed=4, most=60)
    assert not wide.converged


def test_ensembles_that_disagree_show_in_rhat() -> None:
    rng = np.random.default_rng(0)
    chains = rng.normal(size=(4, 100, 32, 1))
    fine = convergence_diagnostics(chains)[0]
    chains[2] += 0.5
    assert fine < 1.01 < convergence_diagnostics(chains)[0]


def test_effective_size_of_independent_draws_is_their_number() -> None:
    chains = np.random.default_rng(1).normal(size=(4, 60, 32, 2))
    _, bulk, tail = convergence_diagnostics(chains)
    assert 0.7 * 7680 < bulk < 1.4 * 7680
    assert 0.6 * 7680 < tail < 1.4 * 7680


def test_progress_is_told() -> None:
    told: list[tuple[float, str]] = []
    posterior = Known(lambda z: -0.5 * np.sum(z**2, axis=1))
    sample_mcmc(posterior, _mode(2), 0, lambda share, words: told.append((share, words)))
    assert told
    assert all(0.0 <= share <= 1.0 and "R̂" in words for share, words in told)
    assert told[-1][0] == 1.0


def _skewed(z: Array) -> Array:
    return np.asarray(np.sum(skewnorm.logpdf(z, 2.0), axis=1))


def _skewed_mode(d: int) -> PosteriorMode:
    at = np.full(d, skewnorm.median(2.0))
    return PosteriorMode(at, skewnorm.var(2.0) * np.eye(d), 0.0, True)


def test_weighted_draws_are_as_precise_as_they_say() -> None:
    """Means and ends of intervals vary from seed to seed no more than independent draws would."""
    means, ends, sizes = [], [], []
    for seed in range(60):
        found = importance_resample(Known(_skewed), _skewed_mode(6), seed)
        assert found is not None
        assert (found.sampler, found.converged) == ("weighted draws", True)
        assert found.draws.shape[:2] == found.log_posterior.shape
        flat = found.draws.reshape(-1, 6)
        assert min(found.ess_bulk_min, found.ess_tail_min) >= len(flat)
        np.testing.assert_allclose(_skewed(flat), found.log_posterior.ravel())
        means.append(flat.mean(axis=0))
        ends.append(np.quantile(flat, [0.025, 0.975], axis=0))
        sizes.append(len(flat))
    size, count = float(np.mean(sizes)), 60 * 6
    assert size > 900
    error = (np.array(means) - skewnorm.mean(2.0)) / np.sqrt(skewnorm.var(2.0) / size)
    assert np.mean(error**2) < chi2.ppf(0.9999, count) / count
    for end, found_ends in zip((0.025, 0.975), np.array(ends).transpose(1, 0, 2), strict=True):
        exact = skewnorm.ppf(end, 2.0)
        sd = np.sqrt(end * (1.0 - end) / size) / skewnorm.pdf(exact, 2.0)
        assert np.mean(((found_ends - exact) / sd) ** 2) < 1.5
    first, second = (importance_resample(Known(_skewed), _skewed_mode(6), 3) for _ in range(2))
    assert first is not None
    assert second is not None
    assert np.array_equal(first.draws, second.draws)


def test_a_tail_of_one_draw_has_the_size_of_one() -> None:
    """A draw that has nearly all of the weight is beyond every end."""
    z = np.arange(4.0)[:, None]
    _, tail = effective_sizes(z, np.array([0.01, 0.01, 0.01, 0.97]))
    assert tail == 1.0


def test_weights_that_cannot_be_trusted_are_not() -> None:
    heavy = Known(lambda z: -1.5 * np.log1p(np.sum(z**2, axis=1)))  # Student t, one degree
    assert importance_resample(heavy, _mode(2), 1) is None
    narrow = Known(lambda z: -0.5 * np.sum(z**2, axis=1))
    assert importance_resample(narrow, _mode(4, 0.05), 1) is None
    nowhere = Known(lambda z: np.full(len(z), -np.inf))
    assert importance_resample(nowhere, _mode(2), 1) is None


def test_an_interrupt_in_a_likelihood_is_not_printed(capfd: pytest.CaptureFixture[str]) -> None:
    calls = 0

    def interrupted(z: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls > 12:
            raise KeyboardInterrupt
        return np.asarray(-0.5 * np.sum(z**2, axis=1))

    with pytest.raises(KeyboardInterrupt):
        sample_mcmc(Known(interrupted), _mode(3), 1)
    assert calls > 12
    assert capfd.readouterr() == ("", "")
