"""``bayes-asv plan`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command

QUICK = ("--rate", 400, "--road", "bump", "--speed-limit", "8 mph")


def test_a_plan_names_a_drive_and_writes_it_down(
    invoke: Command, baja: Path, tmp_path: Path
) -> None:
    file = tmp_path / "plan.json"
    said = invoke("plan", "-v", baja, *QUICK, "--want", "4 %", "--want", "k_g=0.5", "--json", file)
    assert (said.status, said.err) == (0, "")
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["verdict"] == "ok"
    assert document["recommended"]["words"] in said.out
    assert document["want_percent"] == pytest.approx({"c_f": 4.0, "c_r": 4.0, "i": 4.0, "k_g": 0.5})
    assert {drive["rate"] for drive in document["drives"]} == {400.0}
    assert max(drive["speed"]["value"] for drive in document["drives"]) == 8.0
    assert "No drive can separate" in said.out
    assert all(len(line) < 200 for line in said.out.splitlines())


def test_what_no_drive_can_give_leaves_with_three_and_the_json(invoke: Command, baja: Path) -> None:
    said = invoke("plan", "-v", baja, *QUICK, "--want", 0.2, "--json", "-")
    assert said.status == 3
    document = json.loads(said.out)
    assert document["verdict"] == "refused"
    assert document["recommended"] is None
    assert document["nearest"]["drive"] is not None
    assert any("measure the sprung mass to" in reason for reason in document["reasons"])
    needed = next(x for x in document["limits"] if x["parameter"] == "c_f")["needed_percent"]
    assert 0.0 < needed["m"] <= 0.21
    drive = document["drives"][document["nearest"]["drive"]]
    assert drive["passes_needed"]["c_f"] is None
    assert "however often you drive" in drive["why_never"]["c_f"]
    assert "Nearest:" in said.err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--want", "c_q=3"), "c_f, c_r, i, k_g"),
        (("--want", "0"), "percentage between"),
        (("--want", "nan"), "percentage between"),
        (("--want", "c_f"), "percentage between"),
        (("--speed-limit", "fast"), "write '12 mph'"),
        (("--speed-limit", "3 kg"), "write '12 mph'"),
        (("--speed-limit", "0.1 mph"), "no drive of the plan is that slow"),
        (("--speed-limit", "-3 mph"), "above zero"),
        (("--tyre-rate", "300 lbf"), "write '300 lbf/in'"),
        (("--tyre-rate", "0 lbf/in"), "above zero"),
        (("--tyre-rate", "1 lbf/in", *QUICK), "have a static deflection of"),
        (("--unsprung", "65 lb"), "write '65 lbm'"),
        (("--unsprung", "0.0001 lbm", *QUICK), "check the units of masses"),
        (("--rate", "1"), "--rate"),
        (("--road", "beach"), "--road"),
        (("--passes", "0"), "--passes"),
    ],
)
def test_wrong_usage_is_one_line(
    invoke: Command, refuse: Check, baja: Path, words: tuple[object, ...], told: str
) -> None:
    assert refuse(invoke("plan", "-v", baja, *words), told)


def test_a_vehicle_file_is_read_first_and_never_written_over(
    invoke: Command, refuse: Check, baja: Path
) -> None:
    assert refuse(invoke("plan", "-v", "nothing.toml"), "nothing.toml")
    assert refuse(invoke("plan", "-v", baja, "--json", baja), "is read by this command")
