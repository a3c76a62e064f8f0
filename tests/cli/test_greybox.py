"""``bayes-asv greybox`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command


def test_both_ways_side_by_side(invoke: Command, baja: Path, stops: Path, tmp_path: Path) -> None:
    file = tmp_path / "greybox.json"
    said = invoke("greybox", stops, "-v", baja, "--json", file)
    assert (said.status, said.err) == (0, "")
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["schema"] == "bayes_asv/greybox/1"
    deflection, integrated = document["estimates"]
    assert (deflection["coordinates"], integrated["coordinates"]) == ("deflection", "integrated")
    assert deflection["parameters"]["c_f"]["value"] == pytest.approx(5.76, rel=0.01)
    assert deflection["parameters"]["c_f"]["unit"] == "lbf*s/in"
    assert deflection["parameters"]["i"]["value"] == pytest.approx(669.8, rel=0.01)
    assert len(deflection["correlation"]) == 3
    assert set(integrated["fit_percent"]) == {"pitch", "pitch_rate", "heave", "heave_rate"}
    assert len(integrated["independence"]) == 8
    for way in document["estimates"]:
        assert way["bic"] > way["aic"]
    assert "In deflections" in said.out
    assert "the reference's method" in said.out
    assert "too small" in said.out


def test_what_cannot_answer_leaves_with_three_and_the_json(
    invoke: Command, baja: Path, stops: Path, tmp_path: Path
) -> None:
    quiet = tmp_path / "quiet.csv"
    quiet.write_text("\n".join(stops.read_text(encoding="utf-8").splitlines()[:130]) + "\n")
    said = invoke("greybox", quiet, "-v", baja, "--json", "-")
    assert said.status == 3
    document = json.loads(said.out)
    assert document["verdict"] == "refused"
    assert document["reasons"]
    assert "Reason:" in said.err


def test_wrong_usage_is_one_line(invoke: Command, refuse: Check, baja: Path, stops: Path) -> None:
    assert refuse(invoke("greybox", stops, "-v", baja, "--remove", "wishes"), "--remove")
    assert refuse(invoke("greybox", stops, "-v", baja, "--coordinates", "polar"), "--coordinates")
    assert refuse(invoke("greybox", stops, "-v", baja, "--json", stops), "is read by this command")
    assert refuse(invoke("greybox", "nothing.csv", "-v", baja), "nothing.csv")
