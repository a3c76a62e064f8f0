"""The algebra of an error budget, against simulation and against doing what it says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.analysis.uncertainty_budget.budget import Budget

Array = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, d: int = 6, data: int = 4) -> tuple[Budget, Array]:
    """A budget whose data see fewer directions than there are parameters, and an answer."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(data, d)) * np.exp(rng.normal(0.0, 1.5, size=(data, 1)))
    sd = np.exp(rng.normal(0.0, 1.5, size=d))
    sd[-1] = 0.0
    return Budget(sd, slopes.T @ slopes), rng.normal(size=d)


@given(seeds)
def test_shares_add_up_and_say_what_a_small_improvement_is_worth(seed: int) -> None:
    budget, answer = drawn(seed)
    shares, data = budget.shares(answer)
    assert shares.sum() + data == pytest.approx(1.0, rel=1e-9)
    assert shares[-1] == 0.0
    h = 1e-3  # central: what rounding does to a variance of nearly singular cars stays below 1e-6
    now = budget.variance(answer)
    for k in range(len(shares)):
        better, worse = (budget.variance(answer, {k: math.exp(x)}) for x in (h, -h))
        assert (worse - better) / (2.0 * now * h) == pytest.approx(shares[k], rel=1e-3, abs=1e-6)
    more = budget.variance(answer, data=math.exp(h))
    assert (now - more) / (now * h) == pytest.approx(data, rel=1e-3, abs=1e-6)
    assert budget.elasticity(answer, -budget.information) == pytest.approx(data, rel=1e-9)


def test_a_share_is_the_variance_that_one_error_alone_makes() -> None:
    """20000 weighted least squares with one source of error switched on at a time, seed 5."""
    rng = np.random.default_rng(5)
    slopes, sd = rng.normal(size=(9, 3)), np.array([0.3, 1.0, 0.6])
    budget, answer = Budget(sd, slopes.T @ slopes), np.array([1.0, -0.5, 0.2])
    design = np.concatenate([slopes, np.diag(1.0 / sd)])
    gain = np.linalg.solve(design.T @ design, design.T)
    shares, data = budget.shares(answer)
    whole = budget.variance(answer)
    n = 20_000
    for rows, share in (
        (range(9), data), *(((9 + k,), shares[k]) for k in range(3)),
    ):  # fmt: skip
        error = np.zeros((12, n))
        error[list(rows)] = rng.normal(size=(len(rows), n))
        spread = float(np.var(answer @ gain @ error))
        # the deviation of a variance of n normal draws is √(2/n) of it: four of them
        assert spread == pytest.approx(share * whole, rel=4.0 * math.sqrt(2.0 / n))


@given(seeds)
def test_an_exact_value_is_one_that_is_not_there(seed: int) -> None:
    budget, answer = drawn(seed)
    fixed = Budget(np.where(np.arange(6) == 2, 0.0, budget.sd), budget.information)
    exact = budget.variance(answer, {2: math.inf})
    assert exact == pytest.approx(fixed.variance(answer), rel=1e-9)


@settings(deadline=None, max_examples=25)
@given(seeds)
def test_what_is_said_to_halve_a_width_halves_it(seed: int) -> None:
    budget, answer = drawn(seed)
    sources = [0, 1, 2, 3, -1]
    assume(budget.shares(answer)[0][4] < 0.2)  # nobody betters the fifth
    found = budget.halving(answer, sources)
    assert found
    size = len(found[0].sources)
    assert [r.times for r in found] == sorted(r.times for r in found)
    for remedy in found:
        assert len(remedy.sources) == size
        sd = budget.sd.copy()
        for k in remedy.sources:
            if k >= 0:
                sd[k] /= math.sqrt(remedy.times)
        information = budget.information * (remedy.times if -1 in remedy.sources else 1.0)
        after = Budget(sd, information).variance(answer)
        assert math.sqrt(after / budget.variance(answer)) == pytest.approx(0.5, rel=1e-3)
        if size > 1:  # less than all of them does not do, however good
            for k in remedy.sources:
                rest = [s for s in remedy.sources if s != k]
                times = {s: 1e12 for s in rest if s >= 0}
                left = budget.variance(answer, times, 1e12 if -1 in rest else 1.0)
                assert left > 0.25 * budget.variance(answer)


def test_what_cannot_be_halved_has_no_remedy() -> None:
    budget = Budget(np.array([1.0, 1.0]), np.zeros((2, 2)))
    assert budget.halving(np.array([0.0, 1.0]), [0, -1]) == []
    assert budget.halving(np.array([0.0, 1.0]), [1])[0].times == pytest.approx(4.0, rel=1e-3)


def test_endless_data_of_few_directions_leave_the_rest_to_what_was_given() -> None:
    """Strong data that see one direction, many billion times over: rounding must not matter."""
    seen = np.array([1.0, 2.0, -1.0]) * 1e3
    budget = Budget(np.array([1.0, 1.0, 2.0]), np.outer(seen, seen))
    unit = seen / np.linalg.norm(seen)
    across = np.array([2.0, -1.0, 0.0])  # no data bear on it, and two values of equal deviation
    assert budget.variance(unit, data=1e12) == pytest.approx(0.0, abs=1e-6)
    assert budget.variance(across, data=1e12) == pytest.approx(5.0, rel=1e-4)
