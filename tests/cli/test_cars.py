"""Cars beyond the half car as a person runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command

ROLL = Path(__file__).parents[2] / "data" / "vehicles" / "baja2008_roll.toml"


@pytest.mark.parametrize(
    ("car", "slowest", "undamped"),
    [
        ("quarter", 1.881, ["bounce", "hop", "bounce", "hop"]),
        ("half4", 1.899, ["bounce", "pitch", "front hop", "rear hop"]),
        ("roll", 2.027, ["bounce", "pitch", "roll"]),
    ],
)
def test_modes_of_each_car(
    invoke: Command, tmp_path: Path, car: str, slowest: float, undamped: list[str]
) -> None:
    file = tmp_path / "modes.json"
    said = invoke("modes", "-v", ROLL, "--car", car, "--json", file)
    assert (said.status, said.err) == (0, "")
    document = json.loads(file.read_text(encoding="utf-8"))
    assert (document["schema"], document["car"]) == ("bayes_asv/car_modes/1", car)
    assert document["modes"][0]["natural_hz"] == pytest.approx(slowest, abs=5e-4)
    assert sorted(mode["kind"] for mode in document["undamped"]) == sorted(undamped)
    for mode in document["modes"]:
        assert max(part["size"] for part in mode["shape"].values()) == pytest.approx(1.0)
        assert 0.0 < mode["energy_share"] <= 1.0
    assert f"{slowest:.3f} Hz" in said.out


def test_the_whole_car_has_seven(invoke: Command) -> None:
    said = invoke("modes", "-v", ROLL, "--car", "full7", "--json", "-")
    document = json.loads(said.out)
    kinds = sorted(mode["kind"] for mode in document["undamped"])
    assert kinds == sorted(
        ["bounce", "pitch", "roll", "front hop", "rear hop", "front tramp", "rear tramp"]
    )
    assert "Without damping" in said.err


def test_what_is_missing_is_said_in_one_line(
    invoke: Command, refuse: Check, baja: Path, stops: Path, tmp_path: Path
) -> None:
    assert refuse(invoke("modes", "-v", baja, "--car", "quarter"), "[unsprung]: is missing")
    assert refuse(invoke("modes", "-v", baja, "--car", "roll"), "[roll]: is missing")
    assert refuse(invoke("modes", stops, "-v", ROLL, "--car", "roll"), "need the half car")
    assert refuse(
        invoke("simulate", "-v", baja, "--car", "roll", "-o", tmp_path / "x.csv"), "[roll]"
    )
    assert refuse(
        invoke("simulate", "-v", ROLL, "--skew", "20 in", "-o", tmp_path / "x.csv"),
        "--skew needs --car roll",
    )
    assert refuse(
        invoke("estimate", stops, "-v", ROLL, "--car", "roll"),
        "lacks the channel front_left_wheel, which the roll car needs",
    )
    assert refuse(
        invoke("estimate", stops, "-v", ROLL, "--car", "roll", "--below", "10"),
        "--below needs the half car",
    )
    text = ROLL.read_text(encoding="utf-8")
    for old, new, fault in (
        ("front_track = { value = 52", "front_track = { value = -52", "[roll] front_track"),
        ("front_track =", "front_trak =", "did you mean front_track?"),
        ("front_mass         =", "front_weight =", "[unsprung] front_weight"),
        ("[roll]\n", "[roll]\nfront_mass = 1\n", "move it to [unsprung]"),
    ):
        path = tmp_path / "at_fault.toml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        assert refuse(invoke("modes", "-v", path, "--car", "full7"), fault)


def test_from_a_simulated_drive_to_the_worn_side(
    invoke: Command, refuse: Check, tmp_path: Path
) -> None:
    drive, answer = tmp_path / "drive.csv", tmp_path / "answer.json"
    said = invoke(
        "simulate", "-v", ROLL, "--car", "roll", "--set", "c_rr=0.8", "--road", "bump",
        "--seconds", "2", "--skew", "24 in", "-o", drive, "--json", tmp_path / "truth.json",
    )  # fmt: skip
    assert said.status == 0
    true = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))["truth"]
    said = invoke("estimate", drive, "-v", ROLL, "--car", "roll", "--json", answer)
    assert said.status == 0
    assert "rear right 20 % softer than nominal" in said.out.splitlines()[0]
    document = json.loads(answer.read_text(encoding="utf-8"))
    assert document["schema"] == "bayes_asv/estimate_roll/1"
    for name in ("c_fl", "c_fr", "c_rl", "c_rr", "i", "i_roll"):
        low, high = document["parameters"][name]["si"]["eti95"]
        assert low < true[name] < high
    rear = document["left_over_right"]["rear"]
    assert rear["eti95"][0] < 1.25 < rear["eti95"][1]
    assert rear["p_left_softer"] < 0.01
    assert refuse(
        invoke("estimate", drive, "-v", ROLL),
        "lacks the channel front_wheel, which the half car needs",
        "--car",
    )
    assert refuse(invoke("greybox", drive, "-v", ROLL), "use bayes-asv estimate --car roll")
