"""Leaving a part of the diagnosis out."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pkgutil import resolve_name
from typing import Any

import pytest

from bayes_asv.domain.errors import InputError
from benchmarks.battery.ablations import ABLATIONS, without
from benchmarks.battery.diagnoser import DEFAULT, resolve
from tests.battery.cases import case

NAME = "coulomb_friction-400/rough~baja"
SEED = 1


@lru_cache
def said(ablation: str | None) -> Mapping[str, Any]:
    made = case(NAME, SEED, 0)
    return resolve(DEFAULT, ablation)(made.recordings, made.holdout, made.vehicle, SEED)


@pytest.mark.parametrize("name", ABLATIONS)
def test_a_part_is_back_when_the_case_is_done(name: str) -> None:
    places = {f"bayes_asv.diagnosis.{p}": new for p, new in ABLATIONS[name].replaced.items()}
    before = {place: resolve_name(place) for place in places}
    with without(name):
        assert all(resolve_name(place) is new for place, new in places.items())
    assert all(resolve_name(place) is old for place, old in before.items())
    assert all(before[place] is not new for place, new in places.items())


@pytest.mark.parametrize("name", ["quiet_wheels", "tolerances", "slack"])
def test_the_diagnosis_does_without_it(name: str) -> None:
    whole, less = said(None), said(name)
    left, still_left = whole["unexplained"], less["unexplained"]
    assert (less["p_none"] != whole["p_none"]) == (name != "slack")
    assert (still_left["p_memory"] != left["p_memory"]) == (name != "tolerances")
    assert (still_left["like"] == "") == (name == "slack")


def test_an_unknown_part_is_told_before_the_work_begins() -> None:
    with pytest.raises(InputError, match="no part 'whitening'; name one of quiet_wheels"):
        resolve(DEFAULT, "whitening")
