"""Spread of an effect's parameters over the formulas that nature may have chosen."""

from __future__ import annotations

import json

import pytest

from bayes_asv.models.effects import EFFECTS
from bayes_asv.models.effects.base import Parameter
from benchmarks.law_forms import FORMS, RESULTS, spreads

# Below this the formula hardly matters, beside the other errors of an effect's parameters.
_NEGLIGIBLE = 0.01


def _of(effect: str, parameter: str) -> Parameter:
    return next(p for p in EFFECTS[effect].parameters if p.name == parameter)


def test_the_spreads_of_effects_are_the_published_ones() -> None:
    published = json.loads(RESULTS.read_text("utf-8"))["spreads"]
    assert set(published) == set(FORMS)
    for effect, parameters in published.items():
        for name, spread in parameters.items():
            stated = _of(effect, name).form_spread
            if spread < _NEGLIGIBLE:
                assert stated == 0.0
            else:
                assert stated == pytest.approx(spread, rel=0.3)


def test_a_fit_to_other_forms_spreads_as_much() -> None:
    found = spreads(40, seed=2)
    for effect, name in (("coulomb_friction", "force"), ("progressive_spring", "kappa")):
        assert found[effect][name] == pytest.approx(_of(effect, name).form_spread, rel=0.5)
