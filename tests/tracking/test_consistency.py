"""The consistency monitor on synthetic innovations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from bayes_asv.tracking.consistency import ConsistencyMonitor, WindowStatistics, nis_band

Array = NDArray[np.float64]

RATE = 400.0


def _monitored(
    nu: Array, chunk: int = 500, noise_factor: float = 1.0
) -> tuple[ConsistencyMonitor, WindowStatistics]:
    """Monitor after innovations (N, 2), and its statistics."""
    monitor = ConsistencyMonitor(RATE)
    parts = []
    for k in range(0, len(nu), chunk):
        part = nu[k : k + chunk]
        n = len(part)
        parts.append(
            monitor.update(
                np.sum(part**2, axis=1), np.full(n, 2.0), part, np.full((n, 2), noise_factor)
            )
        )  # fmt: skip
    return monitor, WindowStatistics(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in ("mean", "low", "high", "box_pierce", "consistent")
        )
    )


@pytest.mark.parametrize("n", [1, 2, 10, 100, 5000])
def test_nis_band_is_that_of_chi_squared(n: int) -> None:
    low, high = nis_band(np.array([n]))
    wanted = chi2.ppf([0.025, 0.975], n) / n
    np.testing.assert_allclose([low[0], high[0]], wanted, rtol=0.02, atol=0.02 if n < 3 else 0.003)


def test_without_readings_the_band_is_unbounded() -> None:
    low, high = nis_band(np.array([0]))
    assert low[0] == 0.0
    assert high[0] == np.inf


def test_white_innovations_are_consistent() -> None:
    """A minute at 400 Hz, twenty times; seed 1."""
    rng = np.random.default_rng(1)
    inside, consistent = [], []
    for _ in range(20):
        monitor, statistics = _monitored(rng.normal(size=(24_000, 2)))
        inside.append(
            np.mean((statistics.mean >= statistics.low) & (statistics.mean <= statistics.high))
        )
        consistent.append(statistics.consistent.mean())
        assert monitor.summary().verdict == "consistent"
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)
    assert np.mean(consistent) > 0.999


def test_large_innovations_are_inconsistent_until_they_end() -> None:
    rng = np.random.default_rng(2)
    nu = rng.normal(size=(8000, 2))
    nu[3000:5000] *= 1.6
    monitor, statistics = _monitored(nu)
    assert statistics.consistent[:2900].all()
    assert not statistics.consistent[3250:4900].any()
    assert statistics.consistent[6500:].all()
    summary = monitor.summary()
    assert summary.verdict == "recovered"
    assert summary.faults == ("uneven",)


def test_autocorrelated_innovations_are_coloured() -> None:
    rng = np.random.default_rng(3)
    nu = rng.normal(size=(8000, 2))
    for k in range(1, len(nu)):
        nu[k] = 0.5 * nu[k - 1] + np.sqrt(0.75) * nu[k]
    monitor, statistics = _monitored(nu)
    assert not statistics.consistent[2000:].any()
    summary = monitor.summary()
    assert summary.verdict == "inconsistent"
    assert "coloured" in summary.faults
    np.testing.assert_allclose(summary.correlation[:, 1], 0.5, atol=0.05)
    np.testing.assert_allclose(summary.correlation[:, 2], 0.25, atol=0.05)


def test_raised_noise_factor_is_a_fault_if_noise_was_declared() -> None:
    rng = np.random.default_rng(4)
    monitor, statistics = _monitored(rng.normal(size=(3000, 2)), noise_factor=9.0)
    assert not statistics.consistent.any()
    assert monitor.summary().faults == ("swollen",)
    undeclared = ConsistencyMonitor(RATE, declared=False)
    nu = rng.normal(size=(3000, 2))
    statistics = undeclared.update(
        np.sum(nu**2, axis=1), np.full(3000, 2.0), nu, np.full((3000, 2), 9.0)
    )
    assert statistics.consistent.all()


def test_a_few_readings_after_a_standstill_are_not_correlated() -> None:
    """The products reach back before the window, where innovations were larger."""
    rng = np.random.default_rng(6)
    monitor = ConsistencyMonitor(RATE)
    nu = rng.normal(size=(2000, 2))
    nu[1000:] = 0.0
    nu[995:1000] = 1e-3
    readings = np.where(nu.any(axis=1), 2.0, 0.0)
    statistics = monitor.update(np.sum(nu**2, axis=1), readings, nu, np.ones((2000, 2)))
    assert statistics.consistent.all()


@given(seed=st.integers(0, 1000), chunk=st.integers(1, 400))
def test_chunk_size_has_no_effect(seed: int, chunk: int) -> None:
    rng = np.random.default_rng(seed)
    nu = rng.normal(size=(900, 2)) * rng.uniform(0.8, 1.5)
    _, whole = _monitored(nu, 900)
    _, parts = _monitored(nu, chunk)
    np.testing.assert_allclose(whole.mean, parts.mean, rtol=1e-9)
    np.testing.assert_array_equal(whole.consistent, parts.consistent)
