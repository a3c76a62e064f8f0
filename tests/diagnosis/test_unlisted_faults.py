"""What has no name is told from what has one before names pile up in its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis import forward_selection as growing
from bayes_asv.diagnosis.forward_selection import Selection, begun, grow
from bayes_asv.diagnosis.model_search import asked
from bayes_asv.diagnosis.timing_jitter_test import _likeliest
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, allowed
from bayes_asv.diagnosis.unlisted_faults_test import Nameless
from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.posterior.fitted_model import Dataset, base, setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case
from tests.battery.vehicles import Fleet


@pytest.mark.parametrize(
    ("name", "seed", "number", "words"),
    [
        ("bouc_wen-4000", 58, 0, "hysteresis at the front"),
        ("bouc_wen-400", 58, 0, "hysteresis at the front"),
        # the first asks for less than no bend of a damper's curve, the second sits between axles
        ("progressive_damper-4000", 58, 0, "a damper that stiffens with speed at the rear"),
        ("compliant_seat-4000", 58, 0, "a mass on a spring near the middle"),
        # at 187 Hz, above what the car excites
        ("bracket_resonance-400", 66, 1, "a mounting that rings near 240 Hz (rear chassis)"),
    ],
)
def test_no_name_is_given_where_a_thing_without_one_explains_more(
    name: str, seed: int, number: int, words: str
) -> None:
    """They had one to four names each, none of them true."""
    one = case(name, seed, number, "test")
    found = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert found.verdict == "unexplained"
    assert found.named == ()
    assert found.left is not None
    assert found.left.like == found.left.ended == words
    assert found.left.failed == ()


def test_pushes_one_after_the_other_are_a_force_of_free_course() -> None:
    """A kerb under one wheel, no two moments alike, had four names that all failed the proof."""
    grown = _grown("one_sided_kerb-4000", 72, 0, "test")
    assert grown.nameless == "a force of free course at the rear"
    assert grown.named == ()


def test_a_push_is_not_a_force_of_free_course() -> None:
    grown = _grown("external_force-4000", 5, 0, "dev")
    assert [n.site.effect.name for n in grown.named] == ["external_force"]
    assert grown.nameless == ""


def test_what_would_have_to_be_less_than_nothing_imitates_nothing() -> None:
    """A tolerance that is as large as one may be still imitates: what is left of it is its own."""
    one = case("null", 5, 0, "dev")
    where = setting(one.vehicle, lay_out(one.recordings, one.vehicle)[0])
    model = asked(where, base(where), 1)
    tolerances = np.flatnonzero([c.tolerance for c in model.found.candidates])
    signed = np.array([model.found.candidates[k].signed for k in tolerances])
    own = np.diag(model.found.gram)
    pull = np.zeros_like(own)
    less, more = tolerances[signed][0], tolerances[~signed][0]
    pull[less], pull[more] = -30.0 - own[less], 30.0 * (1.0 + own[more])
    found = replace(model.found, pull=pull, gram=np.diag(own))
    granted = allowed(model.stage, found, rough=True)
    assert granted.amount > 0.0
    left = found.rows[tolerances[tolerances != less]]
    np.testing.assert_array_equal(granted.rows, granted.amount * left)


def _grown(name: str, seed: int, number: int, fleet: Fleet) -> Selection:
    one = case(name, seed, number, fleet)
    where = setting(one.vehicle, lay_out(one.recordings, one.vehicle)[0])
    return grow(begun(asked(where, base(where), 1)), 1, lambda share, words: None)


def test_what_has_a_name_is_named() -> None:
    grown = _grown("bound_rebound-400", 5, 0, "dev")
    assert [n.site.effect.name for n in grown.named] == ["bound_rebound"]
    assert grown.nameless == ""


@pytest.mark.parametrize("sites", [0, 1])
def test_what_is_on_trial_is_not_named_where_the_next_has_no_name(
    monkeypatch: pytest.MonkeyPatch, sites: int
) -> None:
    """Two dampers of 4000, each of which a little of everything explains: the first is on trial."""

    def nameless(_: Dataset, allowed: ModelEvidence) -> Nameless:
        return Nameless(np.inf if len(allowed.stage.sites) == sites else -np.inf, "a ghost")

    monkeypatch.setattr(growing, "without_a_name", nameless)
    grown = _grown("pair-4000", 56, 1, "test")
    assert grown.nameless == "a ghost"
    assert all(n.probability < 0.2 for n in grown.named)


@given(seed=st.integers(0, 2**32), louder=st.floats(1.0, 30.0), level=st.floats(0.5, 2.0))
def test_a_variance_that_grows_has_its_likeliest_level_and_growth(
    seed: int, louder: float, level: float
) -> None:
    """With slopes of nought and one the likeliest variances are the means of two groups."""
    rng = np.random.default_rng(seed)
    quiet, loud = level * rng.normal(size=600) ** 2, louder * level * rng.normal(size=200) ** 2
    squared, steep = np.concatenate([quiet, loud]), np.repeat([0.0, 1.0], [600, 200])
    groups = (quiet, loud) if loud.mean() > quiet.mean() else (squared,)
    expected = sum(0.5 * len(g) * (np.log(g.mean()) + 1.0) for g in groups)
    assert _likeliest(squared, steep) == pytest.approx(expected, abs=0.05)
