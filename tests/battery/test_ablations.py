"""Ablations: each replaces a part of the diagnosis, and only while a case is diagnosed."""

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

NAME = "coulomb_friction-400/bump~baja"
SEED = 1


@lru_cache
def diagnosed(ablation: str | None) -> Mapping[str, Any]:
    one = case(NAME, SEED, 0)
    return resolve(DEFAULT, ablation)(one.recordings[:1], one.holdout, one.vehicle, SEED)


@pytest.mark.parametrize("name", ABLATIONS)
def test_an_ablation_is_undone_after_the_case(name: str) -> None:
    places = {f"bayes_asv.diagnosis.{p}": new for p, new in ABLATIONS[name].replaced.items()}
    before = {place: resolve_name(place) for place in places}
    with without(name):
        assert all(resolve_name(place) is new for place, new in places.items())
    assert all(resolve_name(place) is old for place, old in before.items())
    assert all(before[place] is not new for place, new in places.items())


@pytest.mark.parametrize("name", ["tolerances", "unlisted_faults"])
def test_an_ablation_changes_the_diagnosis(name: str) -> None:
    complete, ablated = diagnosed(None), diagnosed(name)
    before, after = complete["unexplained"], ablated["unexplained"]
    assert (ablated["p_none"] != complete["p_none"]) == (name != "unlisted_faults")
    assert (after["p_memory"] != before["p_memory"]) == (name != "tolerances")
    assert (after["like"] == "") == (name == "unlisted_faults")


def test_an_unknown_ablation_is_reported_before_the_work_begins() -> None:
    with pytest.raises(InputError, match="no part 'whitening'; name one of denoising"):
        resolve(DEFAULT, "whitening")
