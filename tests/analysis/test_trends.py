"""The trend of a season: against enumeration, against a dense Gaussian, and its calibration."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import halfcauchy, multivariate_normal

import bayes_asv as asv
from bayes_asv.analysis.random_effects import RunLikelihood
from bayes_asv.analysis.trends import Coordinates, find_trend, values_of_runs
from bayes_asv.models.cars import car_model
from benchmarks.change_points import RESULTS, calibration_error, simulate_season

Array = NDArray[np.float64]


def _season(seed: int, count: int, change: float = 0.0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    time = np.sort(rng.random(count)) * 100.0
    sd = rng.uniform(0.005, 0.02, count)
    value = rng.normal(0.0, np.sqrt(sd**2 + 0.015**2))
    return time, value + change * (np.arange(count) >= count // 2), sd


def _enumerated(time: Array, value: Array, sd: Array) -> Array:
    """Probabilities of no, a gradual, one, two and three changes, hypothesis by hypothesis."""
    n, wide, within = len(value), 400.0, 0.2**2 / 2.0
    ramp = (time - time[0]) / (time[-1] - time[0])
    prior = np.array([0.5, 0.25, *(0.25 * 0.5**k / (1.0 - 0.5**5) for k in (1, 2, 3))])
    ways: list[list[Array]] = [[np.full((n, n), wide)], [wide + 0.2**2 * np.outer(ramp, ramp)]]
    for k in (1, 2, 3):
        some = []
        for starts in itertools.combinations(range(1, n), k):
            lengths = np.diff([0, *starts, n])
            if lengths.min() >= 2:
                group = np.repeat(np.arange(k + 1), lengths)
                some.append(wide + within * (group[:, None] == group))
        ways.append(some)
    sigma = halfcauchy.ppf((np.arange(400) + 0.5) / 400, scale=0.03)
    evidence = np.zeros(5)
    for h, some in enumerate(ways):
        for covariance in some:
            # the level within a stretch has the same variance whatever the number of stretches
            extra = within if h == 0 or h == 1 else 0.0
            for s in sigma:
                noise = np.diag(sd**2 + s**2)
                density = multivariate_normal.pdf(value, cov=covariance + extra + noise)
                evidence[h] += density / (len(some) * len(sigma))
    found = prior * evidence
    return np.asarray(found / found.sum())


@pytest.mark.parametrize(("seed", "change"), [(0, 0.0), (1, -0.06), (2, 0.04)])
def test_probabilities_are_those_of_an_enumeration(seed: int, change: float) -> None:
    time, value, sd = _season(seed, 8, change)
    trend = find_trend(time, value, sd)
    assert trend is not None
    ours = [trend.no_change, trend.gradual, *trend.sudden[:3]]
    assert ours == pytest.approx(_enumerated(time, value, sd), abs=0.01)
    assert trend.sudden[3:] == pytest.approx(0.0)  # four changes need ten recordings


@given(seed=st.integers(0, 10**6), shift=st.floats(-2.0, 2.0), scale=st.floats(0.01, 1000.0))
def test_units_do_not_matter(seed: int, shift: float, scale: float) -> None:
    time, value, sd = _season(seed, 9, -0.05)
    one = find_trend(time, value, sd)
    other = find_trend(1000.0 + scale * time, value + shift, sd)
    assert one is not None
    assert other is not None
    assert other.no_change == pytest.approx(one.no_change, rel=1e-6)
    assert other.level == pytest.approx(one.level + shift, abs=1e-6)
    assert one.no_change + one.gradual + one.sudden.sum() == pytest.approx(1.0)


def test_a_fall_and_a_rise_are_found_where_they_are() -> None:
    time, value, sd = _season(4, 30)
    value += np.repeat([0.0, -0.2, 0.05], 10)
    trend = find_trend(time, value, sd)
    assert trend is not None
    assert trend.kind == "sudden"
    assert trend.p_value < 0.01
    down, up = trend.changes
    assert (down.first, down.last) == (9, 10)
    assert (up.first, up.last) == (19, 20)
    assert down.low < math.exp(-0.2) < down.high
    assert up.low < math.exp(0.25) < up.high
    assert min(down.probability, up.probability) > 0.99
    assert 0.008 < trend.scatter[1] < 0.015 < trend.scatter[2] < 0.03


def test_a_gradual_change_is_told_from_a_sudden_one() -> None:
    time, value, sd = _season(5, 30)
    trend = find_trend(time, value - 0.2 * time / time[-1], sd)
    assert trend is not None
    assert trend.kind == "gradual"
    middle, low, high = np.log(trend.drift)
    assert abs(middle + 0.2 * (1.0 - time[0] / time[-1])) < 3.0 * (high - low) / 3.92
    assert trend.changes == ()


def test_one_odd_recording_is_no_change_and_neither_is_one_between_equal_times() -> None:
    time, value, sd = _season(6, 16)
    value[7] -= 0.15
    odd = find_trend(time, value, sd)
    assert odd is not None
    assert odd.no_change > 0.5
    time, value, sd = _season(7, 16, -0.2)
    time[5:11] = time[5]
    trend = find_trend(time, value, sd)
    assert trend is not None
    for change in trend.changes:
        assert not (change.first >= 5 and change.last <= 10)


def test_too_few_recordings_have_no_trend() -> None:
    assert find_trend(np.arange(3.0), np.zeros(3), np.full(3, 0.01)) is None
    assert find_trend(np.full(6, 2.0), np.zeros(6), np.full(6, 0.01)) is None


def _runs(seed: int, count: int, error: Array | None) -> tuple[list[RunLikelihood], Array, Array]:
    """Likelihoods of runs that share the errors of the given values, B, and what is true."""
    car = car_model("half", asv.read_vehicle(asv.example("baja2008.toml")))
    way = Coordinates(car).directions
    n = len(way)
    rng = np.random.default_rng(seed)
    theta = rng.standard_normal(n) if error is None else error
    true = rng.normal(0.0, 0.05, (count, way.shape[1]))
    runs = []
    for u in true:
        root = rng.normal(size=(n, n)) * 30.0
        H = root @ root.T
        runs.append(RunLikelihood(H, H @ (theta + way @ u) + root @ rng.standard_normal(n)))
    return runs, way, true


def test_values_of_runs_are_those_of_least_squares_with_shared_errors() -> None:
    runs, way, _ = _runs(0, 5, None)
    n, p = way.shape
    precision = np.zeros((n + 5 * p, n + 5 * p))
    linear = np.zeros(n + 5 * p)
    precision[:n, :n] = np.eye(n)
    for r, (H, h) in enumerate(runs):
        J = np.zeros((n, n + 5 * p))
        J[:, :n] = np.eye(n)
        J[:, n + r * p : n + (r + 1) * p] = way
        precision += J.T @ H @ J
        linear += J.T @ h
    exact = np.linalg.solve(precision, linear)
    value, sd, centre = values_of_runs(runs, way)
    assert centre == pytest.approx(exact[:n], abs=1e-6)
    assert value.ravel() == pytest.approx(exact[n:], abs=1e-6)
    joint = np.linalg.inv(precision)[n:, n:]
    apart = np.eye(5) - 1.0 / 5.0
    for k in range(p):  # of differences between runs, which are all that a trend is made of
        exact_variance = np.diag(apart @ joint[k::p, k::p] @ apart)
        ours = np.diag(apart @ np.diag(sd[:, k] ** 2) @ apart)
        assert ours.sum() == pytest.approx(exact_variance.sum(), rel=0.5)


def test_an_error_of_the_given_values_is_no_change() -> None:
    n = len(_runs(1, 1, None)[1])
    far = np.full(n, 2.0)
    near, way, true = _runs(1, 12, np.zeros(n))
    shifted, _, _ = _runs(1, 12, far)
    one, sd, _ = values_of_runs(near, way)
    other, _, _ = values_of_runs(shifted, way)
    apart = (other - other.mean(axis=0)) - (one - one.mean(axis=0))
    assert np.abs(apart).max() < 3.0 * sd.max()
    off = (one - one.mean(axis=0)) - (true - true.mean(axis=0))
    assert np.sqrt(np.mean((off / sd) ** 2)) < 1.3


def test_the_committed_calibration_holds_and_a_short_one_agrees() -> None:
    kept = json.loads(Path(RESULTS).read_text(encoding="utf-8"))
    for kind in ("prior", "other"):
        assert kept[kind]["seasons"] == 2000
        assert kept[kind]["expected calibration error"] <= 0.03
        assert 0.03 <= kept[kind]["false alarms at 5 %"]["share"] <= 0.07
    _, way, _ = _runs(0, 1, None)
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(3, len(way), len(way))) * 300.0
    precisions = roots @ np.swapaxes(roots, 1, 2)
    chances, changed, alarms = [], [], []
    for number in range(60):
        season = simulate_season(np.random.default_rng([9, number]), precisions, way, "prior")
        value, sd, _ = values_of_runs(season.runs, way)
        trend = find_trend(season.time, value[:, 0], sd[:, 0], seed=number)
        assert trend is not None
        chances.append(1.0 - trend.no_change)
        changed.append(season.kind != "none")
        if season.kind == "none":
            alarms.append(trend.p_value < 0.05)
    assert calibration_error(np.array(chances), np.array(changed)) < 0.15
    assert np.mean(alarms) < 0.2
    assert np.mean(np.array(chances)[np.array(changed)]) > 0.6
