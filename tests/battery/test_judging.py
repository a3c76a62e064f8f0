"""Judgement of documents against truths: names, places, classes, errors and intervals."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from bayes_asv.domain.errors import InputError
from benchmarks.battery.intervals import Share, bootstrap, count_true
from benchmarks.battery.judge import Judged, judge
from benchmarks.battery.reliability import bins, calibration_error
from benchmarks.battery.run import Result
from benchmarks.calibration.store import About
from tests.battery.truth import TrueEffect, Truth, from_dict, to_dict

ABOUT = About(1, "abc1234", "none")
CAR = {"c_f": 1260.9, "c_r": 1751.3, "i": 70.7, "m": 226.6, "l": 1.73, "wdf": 0.47,
       "k_f": 17513.0, "k_r": 17513.0}  # fmt: skip


def effect(name: str, where: str, **more: Any) -> TrueEffect:
    return TrueEffect(name, where, {"force": 5.0}, 5.0, 1.5, 400.0, 300.0, **more)


def truth(*effects: TrueEffect, kind: str = "single") -> Truth:
    meant = {"c_f": (1260.9, 1260.9), "c_r": (1720.0, 1751.3), "i": (70.7, 70.7)}
    return Truth("bound_rebound-400", 1, 0, "test", kind, "", 400.0, effects, CAR, meant, "bump",
                 "rough", "formula", 1.0, 0, False)  # fmt: skip


def entry(name: str, where: str | None, p: float, *also: tuple[str, str | None]) -> dict[str, Any]:
    others = [{"name": n, "where": w} for n, w in also]
    return {"name": name, "where": where, "probability": p, "indistinguishable_from": others,
            "parameters": {}}  # fmt: skip


def judged(
    truly: Truth, *effects: dict[str, Any], unexplained: bool = False, **more: Any
) -> Judged:
    verdict = "named" if effects else ("unexplained" if unexplained else "agreement")
    document = {"verdict": verdict, "effects": list(effects),
                "unexplained": {"present": unexplained}, **more}  # fmt: skip
    return judge(Result(truly.name, 0, "", "", 3.0, document, ABOUT), truly)


REAR = truth(effect("bound_rebound", "rear"))
BOTH = truth(effect("bound_rebound", "both"))


def test_the_right_name_at_the_right_place() -> None:
    one = judged(REAR, entry("bound_rebound", "rear", 0.98))
    assert (one.name_right, one.first_right, one.class_right) == (True, True, True)
    assert one.found == (True,)
    assert (one.extra, one.confidently_wrong) == (0, False)
    assert one.probabilities == ((0.98, True),)
    assert one.said == "bound_rebound"


def test_the_right_name_at_another_place_is_wrong() -> None:
    one = judged(REAR, entry("bound_rebound", "front", 0.95))
    assert (one.name_right, one.first_right, one.class_right) == (True, False, False)
    assert one.confidently_wrong
    assert one.extra == 1
    assert not judged(REAR, entry("bound_rebound", "both", 0.95)).class_right


def test_an_indistinguishable_truth_makes_the_class_right_but_not_the_name() -> None:
    one = judged(REAR, entry("damper_fade", "rear", 0.95, ("bound_rebound", "rear")))
    assert (one.name_right, one.first_right, one.class_right) == (False, False, True)
    assert (one.found, one.extra, one.confidently_wrong) == ((True,), 0, False)


def test_an_effect_on_both_axles_may_be_two_entries() -> None:
    halves = (entry("bound_rebound", "front", 0.9), entry("bound_rebound", "rear", 0.8))
    one = judged(BOTH, *halves)
    assert one.first_right
    assert one.class_right
    assert one.extra == 0
    assert one.probabilities == ((0.9, True), (0.8, True))
    half = judged(BOTH, halves[0])
    assert half.name_right
    assert not half.first_right
    assert half.found == (False,)
    assert judged(BOTH, entry("bound_rebound", "both", 0.9)).first_right


def test_the_order_matters_for_the_first_name_only() -> None:
    pair = truth(effect("bound_rebound", "rear"), effect("sensor_gain", "front_wheel"), kind="pair")
    one = judged(pair, entry("sensor_lag", "front_wheel", 0.5),
                 entry("sensor_gain", "front_wheel", 0.9),
                 entry("bound_rebound", "rear", 0.9))  # fmt: skip
    assert not one.class_right
    assert one.found == (True, True)
    assert one.extra == 1
    assert not one.confidently_wrong


def test_an_effect_without_a_place_is_null_or_left_out() -> None:
    shifted = truth(effect("weight_distribution", ""))
    assert judged(shifted, entry("weight_distribution", None, 0.9)).first_right
    bare = {"name": "weight_distribution", "probability": 0.9}
    assert judged(shifted, bare).first_right
    vibrating = truth(effect("engine_vibration", "rear_chassis"))
    assert judged(vibrating, entry("engine_vibration", None, 0.9)).first_right
    assert not judged(vibrating, entry("engine_vibration", "front_chassis", 0.9)).first_right
    assert not judged(REAR, entry("bound_rebound", None, 0.9)).first_right


def test_an_unlisted_fault_is_never_rightly_named() -> None:
    outside = truth(effect("maxwell_mount", "rear"), kind="outside")
    confident = judged(outside, entry("progressive_spring", "rear", 0.97))
    assert confident.confidently_wrong
    assert not confident.flagged
    cautious = judged(outside, entry("progressive_spring", "rear", 0.97), unexplained=True)
    assert cautious.flagged
    assert not cautious.confidently_wrong
    assert judged(outside, entry("maxwell_mount", "rear", 0.99)).extra == 1
    assert judged(outside, unexplained=True).said == "unexplained"


@pytest.mark.parametrize(
    ("gap", "share", "worse"),
    [
        ({"before": 2.0, "after": 1.0, "floor": 1.0}, 1.0, False),
        ({"before": 2.0, "after": 2.0, "floor": 1.0}, 0.0, False),
        ({"before": 2.0, "after": None, "floor": 1.0}, 0.0, False),
        ({"before": 2.0, "after": 2.5, "floor": 1.0}, -0.75, True),
        ({"before": 2.0, "after": 2.5, "floor": 1.0, "worse": False}, -0.75, False),
        ({"before": 2.0, "after": 2.01, "floor": 1.0, "worse": True}, None, True),
    ],
)
def test_share_of_the_error_that_is_removed(
    gap: dict[str, Any], share: float | None, worse: bool
) -> None:
    one = judged(REAR, entry("bound_rebound", "rear", 0.9), gap={"fit": gap, "holdout": gap})
    assert one.gap is not None
    assert one.gap.worse is worse
    if share is not None:
        assert one.gap.closed == pytest.approx(share)


def test_an_error_at_the_floor_has_no_share() -> None:
    one = judged(REAR, gap={"holdout": {"before": 1.0, "after": 0.9, "floor": 1.1}})
    assert one.gap is not None
    assert np.isnan(one.gap.closed)
    assert judged(REAR, gap={"holdout": None}).gap is None
    assert judged(REAR).gap is None


def test_intervals_of_any_unit_are_compared_with_the_true_span() -> None:
    pounds = {"c_f": {"unit": "lbf*s/in", "eti95": [7.1, 7.3]},  # 1243 to 1278 N s/m
              "c_r": {"unit": "N*s/m", "eti95": [1600.0, 1725.0]},
              "i": {"unit": "kg*m^2", "eti95": [71.0, 75.0]}}  # fmt: skip
    one = judged(REAR, parameters_before={}, parameters_after=pounds)
    assert one.covered_before == {}
    assert one.covered_after == {"c_f": True, "c_r": True, "i": False}
    assert one.width_after["i"] == pytest.approx(4.0 / 3.919928 / 70.7)
    below = pounds | {"c_r": {"unit": "N*s/m", "eti95": [1600.0, 1719.0]}}
    assert not judged(REAR, parameters_before=below).covered_before["c_r"]


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"verdict": "named", "effects": [{"where": "front", "probability": 0.5}]},
        {"verdict": "named", "effects": [{"name": "sensor_gain", "probability": None}]},
        {"verdict": "agreement", "parameters_after": {"c_f": {"unit": "", "eti95": ["a", "b"]}}},
        {"verdict": "agreement", "gap": {"holdout": {"before": "x", "floor": 1.0}}},
    ],
)
def test_invalid_documents_are_reported(document: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="document that cannot be read"):
        judge(Result("null", 3, "", "", 0.0, document, ABOUT), REAR)


def test_an_exception_is_judged_as_well() -> None:
    broken = Result("null", 0, "", "", 1.0, {"verdict": "error", "reasons": ["x"]}, ABOUT)
    one = judge(broken, REAR)
    assert (one.verdict, one.said, one.found, one.first_right) == (
        "error",
        "error",
        (False,),
        False,
    )


def test_truths_survive_serialisation() -> None:
    import json

    one = truth(effect("external_force", "both", run=1))
    assert from_dict(json.loads(json.dumps(to_dict(one)))) == one
    with pytest.raises(TypeError):
        from_dict(to_dict(one) | {"colour": "red"})


# --- intervals and reliability -----------------------------------------------------------------


@given(of=st.integers(1, 200), share=st.floats(0.0, 1.0))
def test_wilson_interval_agrees_with_scipy(of: int, share: float) -> None:
    hits = round(share * of)
    other = binomtest(hits, of).proportion_ci(0.95, "wilson")
    assert Share(hits, of).interval == pytest.approx((other.low, other.high), abs=1e-6)


def test_the_interval_without_cases_is_complete() -> None:
    assert Share(0, 0).interval == (0.0, 1.0)
    assert np.isnan(Share(0, 0).share)
    assert count_true([True, False, True]) + Share(1, 2) == Share(3, 5)


def test_the_bootstrap_of_a_mean_agrees_with_its_standard_error() -> None:
    x = np.random.default_rng(3).standard_normal(400)
    low, high = bootstrap(x, lambda v: np.asarray(v.mean(axis=-1)))
    assert high - low == pytest.approx(2.0 * 1.96 * x.std() / 20.0, rel=0.1)
    assert low < x.mean() < high


def test_the_calibration_error_detects_overconfidence() -> None:
    """Seed 11; a calibrated set exceeds its 95 % quantile in one seed of twenty."""
    rng = np.random.default_rng(11)
    p = rng.uniform(0.2, 1.0, 2000)
    calibrated = [(float(v), bool(rng.random() < v)) for v in p]
    overconfident = [(float(v), bool(rng.random() < v**3)) for v in p]
    for b in bins(calibrated):
        low, high = binom.interval(0.999, b.right.of, b.mean)
        assert low <= b.right.hits <= high
    error, chance = calibration_error(calibrated)
    assert error < chance < 0.04
    worse, same = calibration_error(overconfident)
    assert worse > 0.1
    assert same == pytest.approx(chance, rel=0.2)
    assert sum(b.right.of for b in bins(overconfident)) == 2000


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), max_size=60))
def test_every_probability_is_in_one_bin(pairs: list[tuple[float, bool]]) -> None:
    found = bins(pairs)
    assert sum(b.right.of for b in found) == len(pairs)
    assert sum(b.right.hits for b in found) == sum(yes for _, yes in pairs)
    means = [b.mean for b in found]
    assert all(b > a for a, b in pairwise(means))
    assert len(found) <= 10


def test_equal_probabilities_are_one_bin() -> None:
    pairs = [(0.9, k % 3 > 0) for k in range(90)] + [(0.2, False)] * 5
    assert [(b.right.hits, b.right.of) for b in bins(pairs)] == [(60, 95)] or [
        (b.right.hits, b.right.of) for b in bins(pairs)
    ] == [(0, 5), (60, 90)]


def test_refused_cases_do_not_count_as_false_alarms() -> None:
    from benchmarks.battery.summary import false_alarm

    null = truth(kind="null")
    cases = [judged(null), judged(null, unexplained=True)]
    cases += [replace(cases[0], verdict="refused"), replace(cases[0], verdict="error")]
    assert false_alarm(cases) == Share(2, 3)
