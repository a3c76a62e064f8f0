"""The watch over the filter, on innovations that are made up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from bayes_asv.tracking.consistency import Consistency, Watched, band

Array = NDArray[np.float64]

RATE = 400.0


def _watched(nu: Array, chunk: int = 500, level: float = 1.0) -> tuple[Consistency, Watched]:
    """What the watch says of innovations (N, 2)."""
    watch = Consistency(RATE)
    parts = []
    for k in range(0, len(nu), chunk):
        part = nu[k : k + chunk]
        n = len(part)
        parts.append(
            watch.watch(
                np.sum(part**2, axis=1), np.full(n, 2.0), part, np.full((n, 2), level)
            )
        )  # fmt: skip
    return watch, Watched(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in ("mean", "low", "high", "colour", "consistent")
        )
    )


@pytest.mark.parametrize("n", [1, 2, 10, 100, 5000])
def test_the_band_is_that_of_chi_squared(n: int) -> None:
    low, high = band(np.array([n]))
    wanted = chi2.ppf([0.025, 0.975], n) / n
    np.testing.assert_allclose([low[0], high[0]], wanted, rtol=0.02, atol=0.02 if n < 3 else 0.003)


def test_without_readings_anything_is_well() -> None:
    low, high = band(np.array([0]))
    assert low[0] == 0.0
    assert high[0] == np.inf


def test_white_innovations_are_consistent() -> None:
    """A minute at 400 Hz, twenty times; seed 1."""
    rng = np.random.default_rng(1)
    inside, well = [], []
    for _ in range(20):
        watch, told = _watched(rng.normal(size=(24_000, 2)))
        inside.append(np.mean((told.mean >= told.low) & (told.mean <= told.high)))
        well.append(told.consistent.mean())
        assert watch.summary().verdict == "consistent"
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)
    assert np.mean(well) > 0.999


def test_innovations_that_are_too_large_are_not() -> None:
    rng = np.random.default_rng(2)
    nu = rng.normal(size=(8000, 2))
    nu[3000:5000] *= 1.6
    watch, told = _watched(nu)
    assert told.consistent[:2900].all()
    assert not told.consistent[3250:4900].any()
    assert told.consistent[6500:].all()
    found = watch.summary()
    assert found.verdict == "recovered"
    assert found.faults == ("uneven",)


def test_innovations_that_hang_together_are_coloured() -> None:
    rng = np.random.default_rng(3)
    nu = rng.normal(size=(8000, 2))
    for k in range(1, len(nu)):
        nu[k] = 0.5 * nu[k - 1] + np.sqrt(0.75) * nu[k]
    watch, told = _watched(nu)
    assert not told.consistent[2000:].any()
    found = watch.summary()
    assert found.verdict == "inconsistent"
    assert "coloured" in found.faults
    np.testing.assert_allclose(found.correlation[:, 1], 0.5, atol=0.05)
    np.testing.assert_allclose(found.correlation[:, 2], 0.25, atol=0.05)


def test_noise_that_had_to_be_raised_is_named() -> None:
    rng = np.random.default_rng(4)
    watch, told = _watched(rng.normal(size=(3000, 2)), level=9.0)
    assert not told.consistent.any()
    assert watch.summary().faults == ("swollen",)
    heard = Consistency(RATE, declared=False)
    nu = rng.normal(size=(3000, 2))
    told = heard.watch(np.sum(nu**2, axis=1), np.full(3000, 2.0), nu, np.full((3000, 2), 9.0))
    assert told.consistent.all()


@given(seed=st.integers(0, 1000), chunk=st.integers(1, 400))
def test_chunks_make_no_difference(seed: int, chunk: int) -> None:
    rng = np.random.default_rng(seed)
    nu = rng.normal(size=(900, 2)) * rng.uniform(0.8, 1.5)
    _, whole = _watched(nu, 900)
    _, parts = _watched(nu, chunk)
    np.testing.assert_allclose(whole.mean, parts.mean, rtol=1e-9)
    np.testing.assert_array_equal(whole.consistent, parts.consistent)
