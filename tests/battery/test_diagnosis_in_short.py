"""Three cases of the battery with the real diagnosis, which it must get right.

Seed 1 throughout.  A diagnosis with false alarms of 5 % fails the first of these once in twenty
seeds by chance; the others are far from any edge (noncentrality 4000).
"""

from __future__ import annotations

from functools import lru_cache

from benchmarks.battery.diagnoser import DEFAULT, resolve
from benchmarks.battery.judge import Judged, judge
from benchmarks.battery.run import Result
from benchmarks.calibration.store import About
from tests.battery.cases import case

SEED = 1


@lru_cache
def judged(name: str) -> Judged:
    case_made = case(name, SEED, 0)
    document = resolve(DEFAULT)(case_made.recordings, case_made.holdout, case_made.vehicle, SEED)
    assert document["schema"] == "bayes_asv/diagnose/1"
    return judge(Result(name, 0, "", "", 0.0, document, About(SEED, "", "")), case_made.truth)


def test_a_car_without_a_fault_agrees() -> None:
    one = judged("null/rough~baja")
    assert one.verdict == "agreement"
    assert one.named == ()
    assert one.covered_after


def test_a_large_effect_is_named_and_reduces_the_error() -> None:
    one = judged("bound_rebound@rear-4000/rough~baja")
    assert one.verdict == "named"
    assert one.class_right
    assert one.probabilities[0][0] > 0.9
    assert one.gap is not None
    assert one.gap.closed > 0.8
    assert not one.gap.worse


def test_an_unlisted_fault_is_not_confidently_named() -> None:
    one = judged("maxwell_mount-4000/rough~baja")
    assert one.verdict in ("named", "unexplained")
    assert not one.confidently_wrong
