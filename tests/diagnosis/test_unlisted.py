"""What has no name is told from what has one before names pile up in its place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis.jitter import _likeliest
from bayes_asv.diagnosis.workflow import diagnose
from tests.battery.cases import case


@pytest.mark.parametrize(
    ("name", "number", "words"),
    [
        ("bouc_wen-4000", 0, "hysteresis at the front"),
        ("bouc_wen-400", 0, "hysteresis at the front"),
    ],
)
def test_no_name_is_given_where_a_thing_without_one_explains_more(
    name: str, number: int, words: str
) -> None:
    """Four names stood for the first, none of them true, and with it two for the second."""
    one = case(name, 58, number, "test")
    found = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert found.verdict == "unexplained"
    assert found.named == ()
    assert found.left is not None
    assert found.left.like == words


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
    assert _likeliest(squared, steep, float(squared.mean())) == pytest.approx(expected, abs=0.05)
