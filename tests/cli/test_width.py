"""The error budget on its way from the recording to the command line's answer."""

from __future__ import annotations

import pytest

from tests.cli.conftest import Saved


def test_the_document_holds_a_budget_of_every_answer(saved: Saved) -> None:
    width = saved.document["width"]
    for name in ("c_f", "c_r", "i", "k_g"):
        budget = width[name]
        assert sum(budget["shares"].values()) == pytest.approx(1.0, abs=1e-6)
        # the budget is that of the most probable values, the draws are those of the whole
        assert budget["sd_percent"] == pytest.approx(budget["posterior_sd_percent"], rel=0.1)
        p = saved.document["parameters"][name]
        assert budget["posterior_sd_percent"] == pytest.approx(100.0 * p["sd"] / p["mean"], rel=0.1)
    assert width["c_f"]["shares"]["m"] > 0.8
    assert width["c_f"]["runs_to_halve"] is None
    assert width["c_f"]["halve"][0]["what"] == "m"
    assert width["k_g"]["halve"][0]["what"] == "runs"
    assert {"gain front_wheel", "delay rear_chassis", "given l"} <= set(width["faults"])


def test_the_command_says_what_to_weigh(saved: Saved) -> None:
    (line,) = [text for text in saved.said.sentences if text.startswith("Next: Weigh")]
    assert "to ±0.4" in line
    assert "halves the uncertainty of the front damping rate" in line
