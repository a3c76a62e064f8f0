"""Covariances of innovations: against sums, and with bands that were cut out."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfilt
from scipy.stats import chi2

from bayes_asv.diagnosis.whiteness_test import LAGS, _covariances
from bayes_asv.preprocessing.tone_removal import notch_filter, notch_of

RATE, ROWS = 400.0, 1000
NOTHING = np.zeros((0, 6))


def _p(covariances: NDArray[np.float64]) -> float:
    inverse = np.linalg.inv(covariances[0])
    each = [np.trace(c.T @ inverse @ c @ inverse) for c in covariances[1:]]
    lags = np.arange(1, LAGS + 1)
    return float(chi2.sf(np.sum(ROWS**2 / (ROWS - lags) * each), 4 * LAGS))


def test_without_a_cut_they_are_sums_of_products() -> None:
    nu = np.random.default_rng(1).normal(size=(ROWS, 2))
    nu[1:, 0] += 0.3 * nu[:-1, 1]
    found = _covariances(nu, NOTHING)
    for lag in range(LAGS + 1):
        np.testing.assert_allclose(found[lag], nu[lag:].T @ nu[: ROWS - lag] / ROWS, atol=1e-14)


def test_white_noise_without_its_tones_remembers_nothing_and_a_colour_still_does() -> None:
    """40 draws, seed 2."""
    sections = notch_filter([notch_of(f) for f in (18.0, 25.0, 36.0, 73.0)], RATE)
    rng = np.random.default_rng(2)
    raw, filled, coloured = [], [], []
    for _ in range(40):
        white = rng.normal(size=(ROWS, 2))
        left = sosfilt(sections, white, axis=0)
        raw.append(_p(_covariances(left, NOTHING)))
        filled.append(_p(_covariances(left, sections)))
        left[1:] += 0.3 * left[:-1]
        coloured.append(_p(_covariances(left, sections)))
    assert np.median(raw) < 1e-6
    assert min(filled) > 1e-3
    assert np.median(coloured) < 1e-6
