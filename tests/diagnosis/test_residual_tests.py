"""Whiteness, outliers and timing jitter: removed bands, wrong samples, a variance that grows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import sosfilt
from scipy.stats import chi2

from bayes_asv.diagnosis.residual_tests import (
    LAGS,
    _autocovariances,
    _min_negative_log_likelihood,
    outlier_test,
    timing_jitter_test,
)
from bayes_asv.preprocessing.tone_removal import notch_filter, notch_of
from tests.battery.cases import case
from tests.diagnosis.models import fit_linear, prepared

RATE, ROWS = 400.0, 1000
NO_NOTCH = np.zeros((0, 6))


def _p(covariances: NDArray[np.float64]) -> float:
    inverse = np.linalg.inv(covariances[0])
    by_lag = [np.trace(c.T @ inverse @ c @ inverse) for c in covariances[1:]]
    lags = np.arange(1, LAGS + 1)
    return float(chi2.sf(np.sum(ROWS**2 / (ROWS - lags) * by_lag), 4 * LAGS))


def test_autocovariances_are_sums_of_products() -> None:
    nu = np.random.default_rng(1).normal(size=(ROWS, 2))
    nu[1:, 0] += 0.3 * nu[:-1, 1]
    covariances = _autocovariances(nu, NO_NOTCH)
    for lag in range(LAGS + 1):
        expected = nu[lag:].T @ nu[: ROWS - lag] / ROWS
        np.testing.assert_allclose(covariances[lag], expected, atol=1e-14)


def test_removed_tones_do_not_make_white_noise_autocorrelated() -> None:
    """40 draws, seed 2; noise that is autocorrelated besides is still found."""
    sections = notch_filter([notch_of(f) for f in (18.0, 25.0, 36.0, 73.0)], RATE)
    rng = np.random.default_rng(2)
    raw, filled, coloured = [], [], []
    for _ in range(40):
        white = rng.normal(size=(ROWS, 2))
        rest = sosfilt(sections, white, axis=0)
        raw.append(_p(_autocovariances(rest, NO_NOTCH)))
        filled.append(_p(_autocovariances(rest, sections)))
        rest[1:] += 0.3 * rest[:-1]
        coloured.append(_p(_autocovariances(rest, sections)))
    assert np.median(raw) < 1e-6
    assert min(filled) > 1e-3
    assert np.median(coloured) < 1e-6


@pytest.mark.parametrize(
    ("name", "detected"), [("null/bump~baja", False), ("hidden_jitter-4000", True)]
)
def test_timing_jitter_is_detected_in_the_variance(name: str, detected: bool) -> None:
    one = case(name, 5, 0)
    p, channel = timing_jitter_test(*fit_linear(prepared(one.recordings, one.vehicle)))
    assert (p < 1e-3) == detected
    assert channel


@pytest.mark.parametrize("rows", [1, 40])
def test_wrong_readings_are_found_at_their_time(rows: int) -> None:
    """A single sample, or a tenth of a second that a logger filled by a straight line."""
    one = case("null/bump~baja", 5, 0)
    channel = one.recordings[0].channels.index("rear_chassis")
    sound = outlier_test(fit_linear(prepared(one.recordings, one.vehicle))[1])
    assert sound.p > 0.05
    run = one.recordings[0]
    values = run.values.copy()
    at = int(np.argmax(np.abs(values[channel]))) - rows // 2
    if rows == 1:
        values[channel, at] += 10.0 * float(one.vehicle.sensor("rear_chassis").noise or 0.0)
    else:
        ends = values[channel, [at, at + rows]]
        values[channel, at : at + rows] = np.linspace(ends[0], ends[1], rows)
    wrong = (replace(run, values=values), *one.recordings[1:])
    outlier = outlier_test(fit_linear(prepared(wrong, one.vehicle))[1])
    assert outlier.p < 1e-6
    if rows == 1:  # a longer fault moves the filter's states, and with them both channels
        assert outlier.channel == "rear_chassis"
    assert outlier.source.endswith(run.source)
    assert run.time[at] - 0.1 < outlier.time < run.time[at + rows - 1] + 0.01


@given(seed=st.integers(0, 2**32), ratio=st.floats(1.0, 30.0), level=st.floats(0.5, 2.0))
def test_level_and_growth_of_a_variance_are_its_maximum_likelihood(
    seed: int, ratio: float, level: float
) -> None:
    """With slopes of zero and one the most likely variances are the means of two groups."""
    rng = np.random.default_rng(seed)
    low, high = level * rng.normal(size=600) ** 2, ratio * level * rng.normal(size=200) ** 2
    squares, slopes = np.concatenate([low, high]), np.repeat([0.0, 1.0], [600, 200])
    groups = (low, high) if high.mean() > low.mean() else (squares,)
    expected = sum(0.5 * len(g) * (np.log(g.mean()) + 1.0) for g in groups)
    assert _min_negative_log_likelihood(squares, slopes) == pytest.approx(expected, abs=0.05)
