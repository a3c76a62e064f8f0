"""``bayes-asv watch`` from the shell: alarm in words and exit status 5, or none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Check, Command

ROUGH = ROOT / "data" / "recordings" / "rough-400hz.csv"


def test_a_worn_damper_raises_the_alarm(invoke: Command, baja: Path, tmp_path: Path) -> None:
    """The shipped car has lost a fifth at the front."""
    said = invoke("watch", ROUGH, "-v", baja, "--below", "90", "--json", tmp_path / "w.json")
    assert said.status == 5
    assert said.out.startswith("ALARM: the front damper is below 90 % of its nominal rate")
    document = json.loads((tmp_path / "w.json").read_text(encoding="utf-8"))
    assert document["schema"] == "bayes_asv/watch/1"
    assert document["verdict"] == "alarm"
    alarm = document["alarm"]
    assert alarm["axle"] == "front"
    assert alarm["probability"] > 0.99
    assert alarm["eti95"][0] < 0.8 < alarm["eti95"][1]
    assert alarm["time"] - alarm["since"] >= 1.0
    assert alarm["time"] < 2.5  # it ends there and then


def test_no_alarm_where_there_is_nothing_to_raise_it(
    invoke: Command, baja: Path, tmp_path: Path
) -> None:
    said = invoke("watch", ROUGH, "-v", baja, "--below", "70", "--json", tmp_path / "w.json")
    assert said.status == 0
    assert said.out.startswith("No alarm in 2")
    document = json.loads((tmp_path / "w.json").read_text(encoding="utf-8"))
    assert document["verdict"] == "ok"
    assert document["alarm"] is None
    assert document["probability"]["front"] < 0.01


def test_what_is_too_short_is_refused(invoke: Command, baja: Path) -> None:
    said = invoke("watch", ROUGH, "-v", baja, "--below", "90", "--hold", "600")
    assert said.status == 0  # nothing could have been held for so long
    assert "No alarm" in said.out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "either a recording or --port"),
        (("REC", "--port", "COM3"), "either a recording or --port"),
        (("REC", "--keep", "x.txt"), "--keep belongs to --port"),
        (("REC", "--below", "0"), "--below"),
        (("REC", "--sure", "101"), "--sure"),
        (("none.csv",), "no such file"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    invoke: Command, refuse: Check, baja: Path, words: tuple[str, ...], expected: str
) -> None:
    given = [ROUGH if word == "REC" else word for word in words]
    assert refuse(invoke("watch", *given, "-v", baja), expected)


def test_a_port_that_is_not_there(
    invoke: Command, refuse: Check, baja: Path, tmp_path: Path
) -> None:
    said = invoke("watch", "--port", tmp_path / "none", "--keep", tmp_path / "k.txt", "-v", baja)
    assert refuse(said)
    assert not (tmp_path / "k.txt").exists()
