"""What has no name is told from what has one before names pile up in its place."""

from __future__ import annotations

import pytest

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
