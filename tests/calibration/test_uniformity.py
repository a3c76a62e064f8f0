"""Simultaneous bands against simulation, and against what they must not let pass."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from benchmarks.calibration.uniformity import (
    bands,
    departure,
    differences,
    histogram_band,
    inside,
    points,
    probability,
)

RUNS = 2000


@pytest.mark.parametrize(("count", "alpha"), [(40, 0.05), (250, 0.2), (1000, 0.05)])
def test_uniform_curves_stay_inside_the_bands_as_often_as_promised(
    count: int, alpha: float
) -> None:
    """Seed 1, 2000 curves: five deviations of the share, and what whole counts leave over."""
    low, high = bands(count, alpha)
    rng = np.random.default_rng(1)
    within = 0
    for _ in range(RUNS):
        apart = differences(rng.random(count))
        within += bool(np.all((apart >= low) & (apart <= high)))
    chance = 5.0 * np.sqrt(alpha * (1.0 - alpha) / RUNS)
    assert 1.0 - alpha - chance < within / RUNS < 1.0 - alpha + chance + 0.3 * alpha


def test_the_probability_is_that_of_the_first_point_when_there_is_only_one() -> None:
    low, high = inside(2, 0.4)  # two places, one point at a half
    exact = binom.cdf(high, 2, 0.5) - binom.cdf(low - 1, 2, 0.5)
    assert probability(2, 0.4) == pytest.approx(float(exact[0]))


def test_the_probability_of_bands_that_leave_nothing_out_is_one() -> None:
    assert probability(60, 1e-12) == pytest.approx(1.0, abs=1e-9)
    assert probability(60, 1e-2) < probability(60, 1e-3)


def test_p_values_of_uniform_places_are_uniform_themselves() -> None:
    """Seed 2, 300 sets of 40 places; counts are whole, so p may only be larger."""
    rng = np.random.default_rng(2)
    p = np.array([departure(rng.random(40)) for _ in range(300)])
    for level in (0.05, 0.2, 0.5):
        chance = 4.0 * np.sqrt(level * (1.0 - level) / len(p))
        assert np.mean(p < level) < level + chance
        assert np.mean(p < level) > 0.7 * level - chance


@pytest.mark.parametrize("power", [0.6, 1.6], ids=["truths too high", "truths too low"])
def test_places_that_lean_to_one_side_are_found(power: float) -> None:
    places = np.random.default_rng(3).random(300) ** power
    assert departure(places) < 1e-3


def test_intervals_that_are_too_narrow_are_found() -> None:
    """Normal posteriors whose deviation is 0.75 of what it should be."""
    from scipy.special import ndtr

    truth = np.random.default_rng(4).normal(size=500)
    assert departure(np.asarray(ndtr(truth / 0.75))) < 1e-3
    assert departure(np.asarray(ndtr(truth))) > 0.05


def test_differences_are_those_of_the_definition() -> None:
    places = np.array([0.1, 0.1, 0.6, 0.9])
    assert points(4) == pytest.approx([0.25, 0.5, 0.75])
    assert differences(places) == pytest.approx([0.5 - 0.25, 0.5 - 0.5, 0.75 - 0.75])


def test_bars_stay_inside_their_band_as_often_as_promised() -> None:
    """Seed 5: at least 95 % of 2000 histograms, less five deviations."""
    low, high = histogram_band(400, 20, 0.05)
    rng = np.random.default_rng(5)
    counts = rng.multinomial(400, np.full(20, 0.05), size=2000)
    within = np.mean(np.all((counts >= low) & (counts <= high), axis=1))
    assert within > 0.95 - 5.0 * np.sqrt(0.95 * 0.05 / 2000)
    assert within < 0.995
