"""``bayes-asv modes`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command


def test_modes_of_the_nominal_car(invoke: Command, baja: Path, tmp_path: Path) -> None:
    file = tmp_path / "modes.json"
    said = invoke("modes", "-v", baja, "--json", file)
    assert (said.status, said.err) == (0, "")
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["schema"] == "bayes_asv/modes/1"
    slow, fast = document["modes"]
    assert (slow["natural_hz"], fast["natural_hz"]) == pytest.approx((2.03, 2.99), abs=0.005)
    assert (slow["ratio"], fast["ratio"]) == pytest.approx((0.54, 0.82), abs=0.005)
    assert max(part["size"] for part in slow["shape"].values()) == pytest.approx(1.0)
    assert document["recording"] is None
    assert "2.027 Hz" in said.out
    assert "App. C.1" in said.out


def test_a_recording_brings_its_spectrum(invoke: Command, baja: Path, stops: Path) -> None:
    said = invoke("modes", stops, "-v", baja, "--json", "-")
    assert said.status == 0
    spectrum = json.loads(said.out)["recording"]
    assert spectrum["source"] == stops.name
    assert list(spectrum["channels"]) == [
        "front_wheel", "front_chassis", "rear_wheel", "rear_chassis",
    ]  # fmt: skip
    wheel = spectrum["channels"]["front_wheel"]
    assert len(wheel["frequency_hz"]) == len(wheel["density"])
    assert all(0.0 < f < 30.0 for f in wheel["peaks_hz"])
    assert "Spectrum of stops-400hz.csv" in said.err


def test_wrong_usage_is_one_line(
    invoke: Command, refuse: Check, baja: Path, stops: Path, tmp_path: Path
) -> None:
    assert refuse(invoke("modes", "-v", "nothing.toml"), "nothing.toml")
    assert refuse(invoke("modes", "nothing.csv", "-v", baja), "nothing.csv")
    assert refuse(invoke("modes", "-v", baja, "--json", baja), "is read by this command")
    short = tmp_path / "short.csv"
    short.write_text("\n".join(stops.read_text(encoding="utf-8").splitlines()[:20]) + "\n")
    assert refuse(invoke("modes", short, "-v", baja), "fewer than 32 readings")
