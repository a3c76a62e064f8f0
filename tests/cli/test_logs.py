"""From the file of a foreign logger to a report: inspect, convert, calibrate and ``--channels``."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pymupdf
import pytest

from bayes_asv.domain.vehicle_file import parse_channel_map
from bayes_asv.io import read_log, read_recording
from tests.cli.conftest import Check, Command, Said
from tests.rig.car import baja as rig_baja
from tests.rig.run import drive
from tests.rig.sensors import SensorSpec
from tests.rig.terrain import parking_stops

ROOT = Path(__file__).parents[2]
G = 9.80665
LOGS = ROOT.parent / "shared" / "data" / "logs"


def _arduino(folder: Path, seconds: float = 3.0) -> Path:
    """Write a drive as a sketch writes it: ms; counts of g with gravity; one sensor upside down."""
    run = drive(rig_baja(), parking_stops(), 3.2, 400.0, seconds, SensorSpec(delay=(0.0,) * 4), 3)
    g = run.channels / G + 1.0
    g[3] *= -1.0
    rows = [
        ";".join([f"{1000.0 * t:.1f}", *(f"{value:.4f}" for value in row)]).replace(".", ",")
        for t, row in zip(run.time, g.T[:, [1, 0, 3, 2]], strict=True)
    ]
    file = folder / "run.csv"
    file.write_text("\n".join(rows) + "\n", "utf-8")
    return file


def test_three_commands_lead_from_an_arduino_file_to_a_report(
    invoke: Command, tmp_path: Path, baja: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commands are those of the page, the car is the rig's, which is the shipped vehicle."""
    page = (ROOT / "docs" / "channel-map.md").read_text("utf-8")
    found = re.search(r"```sh\n(.*?)```", page, re.DOTALL)
    assert found is not None
    commands = [shlex.split(line)[1:] for line in found[1].splitlines()]
    assert [words[0] for words in commands] == ["inspect", "estimate", "report"]
    _arduino(tmp_path)
    # the logger of this test has no filter and no range of its own
    tables = baja.read_text("utf-8").partition("[sensors")[0]
    (tmp_path / "car.toml").write_text(tables, "utf-8")
    monkeypatch.chdir(tmp_path)
    for words in commands:
        said = invoke(*words)
        assert said.status == 0, said
    answer = json.loads((tmp_path / "estimate.json").read_text("utf-8"))
    truth = rig_baja()
    for name, value in (("c_f", truth.c_f), ("c_r", truth.c_r)):
        low, high = answer["parameters"][name]["eti95"]
        assert low < float(value) / (4.4482216152605 / 0.0254) < high
    with pymupdf.open(tmp_path / "report.pdf") as pages:
        text = pages[0].get_text()
    assert "run.csv" in " ".join(" ".join(p.get_text() for p in pymupdf.open("report.pdf")).split())
    assert "damper" in text


def test_the_map_in_the_vehicle_file_needs_no_option(
    invoke: Command, tmp_path: Path, baja: Path
) -> None:
    log = _arduino(tmp_path)
    mapped, rec = tmp_path / "channels.toml", tmp_path / "rec.csv"
    assert invoke("inspect", log, "-o", mapped).status == 0
    assert invoke("convert", log, "--channels", mapped, "-o", rec).status == 0
    car = tmp_path / "car.toml"
    car.write_text(baja.read_text("utf-8") + mapped.read_text("utf-8"), "utf-8")
    by_map = invoke("modes", log, "-v", car, "--json", "-")
    by_conversion = invoke("modes", rec, "-v", baja, "--json", "-")
    spectrum = _of_recording(by_map)
    assert spectrum == _of_recording(by_conversion)
    # a recording of this package needs no map, even where the vehicle file has one
    assert _of_recording(invoke("modes", rec, "-v", car, "--json", "-")) == spectrum


def _of_recording(said: Said) -> object:
    """Spectra of the channels that `modes` computed."""
    assert said.status == 0, said
    channels = json.loads(said.out)["recording"]["channels"]
    assert channels
    return channels


def test_convert_keeps_every_reading(invoke: Command, tmp_path: Path) -> None:
    log = _arduino(tmp_path)
    mapped, rec = tmp_path / "channels.toml", tmp_path / "rec.csv"
    invoke("inspect", log, "-o", mapped)
    invoke("convert", log, "--channels", mapped, "-o", rec)
    recording = read_recording(rec)
    lines = log.read_text("utf-8").splitlines()
    rows = [[float(cell) for cell in line.replace(",", ".").split(";")] for line in lines]
    time, fc, fw, rc, rw = np.array(rows).T
    assert recording.time == pytest.approx((time - time[0]) / 1000.0)
    for values, raw, sign in zip(recording.values, (fw, fc, rw, rc), (1, 1, 1, -1), strict=True):
        assert np.std(values - sign * raw * G) < 1e-9
        assert abs(float(np.median(values))) < 0.5


def test_inspect_says_what_is_there_and_what_is_missing(invoke: Command, tmp_path: Path) -> None:
    file = LOGS / "picoquake_car_vibration.csv"
    if not file.exists():
        pytest.skip(f"{file.name} is not here")
    said = invoke("inspect", file, "--json", tmp_path / "facts.json")
    assert said.status == 0
    assert "minus a_z is up, tilted by 24.0°" in said.out
    assert "Missing: the acceleration of front wheel and rear wheel" in said.out
    facts = json.loads((tmp_path / "facts.json").read_text("utf-8"))
    assert facts["schema"] == "bayes_asv/inspect/1"
    assert [one["rate"] for one in facts["channels"]] == pytest.approx([2000.0] * 6)


def test_a_map_that_a_person_corrected_is_not_overwritten(
    invoke: Command, refuse: Check, tmp_path: Path
) -> None:
    log, mapped = _arduino(tmp_path), tmp_path / "channels.toml"
    mapped.write_text("mine", "utf-8")
    refuse(invoke("inspect", log, "-o", mapped), "channels.toml", "exists already")
    assert mapped.read_text("utf-8") == "mine"


def test_a_foreign_log_without_a_map_names_the_next_command(
    invoke: Command, refuse: Check, tmp_path: Path, baja: Path
) -> None:
    said = invoke("estimate", _arduino(tmp_path), "-v", baja)
    assert refuse(said, "bayes-asv inspect", "--channels channels.toml")


def test_an_unfilled_map_is_refused_with_the_key(
    invoke: Command, refuse: Check, tmp_path: Path
) -> None:
    log = tmp_path / "pots.csv"
    log.write_text(
        "time [s],Damper Front,Damper Rear\n"
        + "".join(f"{0.01 * k:.2f},{500 + k % 7},{510 - k % 5}\n" for k in range(200)),
        "utf-8",
    )
    mapped = tmp_path / "channels.toml"
    assert invoke("inspect", log, "-o", mapped).status == 0
    assert "# scale = " in mapped.read_text("utf-8")
    said = invoke("convert", log, "--channels", mapped, "-o", tmp_path / "rec.csv")
    refuse(said, "[channels.front_travel]", "add unit")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), ("--columns",)),
        (("--columns", "az"), ("value of each position",)),
        (("--columns", "az", "--values", "1 g"), ("2 still positions, but 1 values",)),
        (("--columns", "az", "--values", "1 kg, 2 kg"), ("no unit of",)),
        (("--columns", "az", "--angles", "up, down"), ("--angles takes numbers",)),
        (("--columns", "ay", "--values", "1 g, -1 g"), ("no column 'ay'",)),
        (("--columns", "az,az"), ("2 columns cannot be calibrated",)),
    ],
)
def test_wrong_use_of_calibrate(
    invoke: Command,
    refuse: Check,
    tmp_path: Path,
    words: tuple[str, ...],
    expected: tuple[str, ...],
) -> None:
    refuse(invoke("calibrate", _held(tmp_path), *words), *expected)


def _held(folder: Path) -> Path:
    """Write a log of an accelerometer that was turned over after three seconds."""
    rng = np.random.default_rng(1)
    values = np.repeat([1.03, -0.97], 300) + 0.002 * rng.standard_normal(600)
    rows = "".join(f"{0.01 * k:.2f},{value:.5f}\n" for k, value in enumerate(values))
    file = folder / "held.csv"
    file.write_text("time [s],az [g]\n" + rows, "utf-8")
    return file


@pytest.mark.parametrize("option", [("--values", "1 g, -1 g"), ("--angles", "0, 180")])
def test_what_calibrate_prints_belongs_into_the_map(
    invoke: Command, tmp_path: Path, option: tuple[str, str]
) -> None:
    held = _held(tmp_path)
    said = invoke("calibrate", held, "--columns", "az", *option)
    assert said.status == 0
    mapped = parse_channel_map(f"[channels.front_wheel]\n{said.out}".encode(), "map.toml")
    levels = mapped.recording(read_log(held)).values[0].reshape(2, 300).mean(axis=1)
    assert levels == pytest.approx([0.0, -2.0 * G], abs=0.01)


def test_names_of_a_foreign_log_reach_no_terminal_and_no_spreadsheet(
    invoke: Command, tmp_path: Path
) -> None:
    """Escape sequences are not printed, and a cell that a spreadsheet would compute not written."""
    log, mapped = tmp_path / "evil.csv", tmp_path / "channels.toml"
    names = "\x1b[2J\x1b]0;x\x07 fw,=cmd|calc!A1,+rw,@rc"
    log.write_text(
        f"time [s],{names}\n"
        + "".join(f"{0.01 * k:.2f},{k % 7},{k % 5},{k % 3},{k % 4}\n" for k in range(200)),
        "utf-8",
    )
    said = invoke("inspect", log, "-o", mapped)
    assert all(ch.isprintable() or ch == "\n" for ch in said.out + said.err)
    mapped.write_text(
        "".join(
            f'[channels.{channel}]\ncolumn = "{column}"\nunit = "g"\n'
            for channel, column in (
                ("front_wheel", "=cmd|calc!A1"), ("rear_wheel", "+rw"), ("rear_chassis", "@rc"),
            )
        ),
        "utf-8",
    )  # fmt: skip
    written = tmp_path / "rec.csv"
    assert invoke("convert", log, "--channels", mapped, "-o", written).status == 0
    cells = [c for line in written.read_text("utf-8").splitlines() for c in line.split(",")]
    assert not [cell for cell in cells if cell[:1] in ("=", "+", "@", "\t")]
