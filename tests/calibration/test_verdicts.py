"""Counts, their intervals and adjusted tests, against figures worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.calibration.verdicts import Coverage, coverage, holm


def test_holm_by_hand() -> None:
    """Smallest times four, next times three, and so on, never falling."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == pytest.approx([1.0, 1.0])
    assert holm([]) == []


@given(p=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_holm_rejects_what_the_step_down_rule_rejects(p: list[float]) -> None:
    level = 0.05
    rejected = set()
    for rank, k in enumerate(sorted(range(len(p)), key=lambda k: p[k])):
        if p[k] > level / (len(p) - rank):
            break
        rejected.add(k)
    found = {k for k, value in enumerate(holm(p)) if value <= level}
    # a p that equals its threshold may fall on either side by rounding
    near = {k for k, value in enumerate(holm(p)) if abs(value - level) < 1e-12}
    assert found - near == rejected - near


def test_the_binomial_test_sums_what_is_no_likelier() -> None:
    one = Coverage(0.95, 17, 20)
    weights = [math.comb(20, k) * 0.95**k * 0.05 ** (20 - k) for k in range(21)]
    exact = sum(w for w in weights if w <= weights[17] * (1.0 + 1e-9))
    assert one.p == pytest.approx(exact)
    assert one.share == 0.85


def test_jeffreys_interval_holds_its_share_of_a_beta() -> None:
    """Numerical integral of the posterior under Jeffreys' prior between its ends."""
    low, high = Coverage(0.95, 188, 200).interval
    x = (np.arange(200_000) + 0.5) / 200_000
    density = x ** (188 - 0.5) * (1.0 - x) ** (12 - 0.5)
    density /= density.sum()
    assert density[(x > low) & (x < high)].sum() == pytest.approx(0.95, abs=1e-3)
    assert density[x < low].sum() == pytest.approx(0.025, abs=1e-3)
    assert Coverage(0.95, 0, 30).interval[0] == 0.0
    assert Coverage(0.95, 30, 30).interval[1] == 1.0


def test_coverage_counts_equal_tails_with_their_ends() -> None:
    places = np.array([0.0, 0.02, 0.025, 0.3, 0.5, 0.975, 0.98, 1.0])
    assert coverage(places, 0.95) == Coverage(0.95, 4, 8)
    assert coverage(places, 0.5) == Coverage(0.5, 2, 8)
