"""``asv.fleet``: recordings of every fate, runs that are killed, and the page of a season."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bayes_asv as asv
from bayes_asv.analysis.trends import Coordinates
from bayes_asv.domain.channel_map import ChannelMap, MappedChannel
from bayes_asv.library import fleet as fleet_module
from bayes_asv.library.fleet import Fleet
from bayes_asv.models.cars import car_model
from bayes_asv.report.documents.fleet import SeasonFile, fleet_document, season_extract
from bayes_asv.report.render import html_report, pdf_report
from bayes_asv.report.schema import FleetDocument
from bayes_asv.report.sections.fleet import fleet_steps
from tests.cli.conftest import Check, Command, baja, refuse
from tests.live.conftest import browser

__all__ = ["baja", "browser", "refuse"]

START = datetime(2026, 4, 25, 9, 0)


def _idle(*_: object) -> None:
    raise AssertionError("nothing was to be done")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, stops: asv.Recording) -> Path:
    """Return a season of one good recording and four that are at fault."""
    path = tmp_path_factory.mktemp("season")
    (path / "2026-05-03").mkdir()
    dated = replace(stops, metadata=(*stops.metadata, ("date", "2026-05-01 10:30")))
    dated.to_csv(path / "good.csv")
    shutil.copy(path / "good.csv", path / "good again.csv")
    asv.Recording(stops.time[:90], stops.values[:, :90], stops.units).to_csv(
        path / "2026-05-03" / "short.csv"
    )
    (path / "broken.csv").write_text("time [s],front_wheel [g]\n0,one\n", encoding="utf-8")
    (path / "binary.csv").write_bytes(bytes(range(256)))
    os.utime(path / "binary.csv", (1.7e9, 1.7e9))
    return path


@pytest.fixture(scope="module")
def season(folder: Path, car: asv.Vehicle) -> Fleet:
    """Estimate it."""
    calls: list[tuple[float, str]] = []
    found = asv.fleet(
        str(folder / "**" / "*.csv"), car, output=folder / "out.parquet", seed=1, jobs=1,
        progress=lambda share, words: calls.append((share, words)),
    )  # fmt: skip
    assert [share for share, _ in calls] == sorted(share for share, _ in calls)
    assert calls[-1][0] == 1.0
    assert "5 of 5 recordings" in calls[-1][1]
    return found


def test_every_file_has_a_verdict(season: Fleet) -> None:
    files = {Path(file.file).name: file for file in season.files}
    verdicts = {name: file.verdict for name, file in files.items()}
    both = {verdicts.pop("good.csv"), verdicts.pop("good again.csv")}
    assert both == {"ok", "duplicate"}
    assert verdicts == {
        "short.csv": "refused", "broken.csv": "unreadable", "binary.csv": "unreadable",
    }  # fmt: skip
    assert files["short.csv"].reason.startswith("short.csv is too short")
    assert files["broken.csv"].reason.startswith("broken.csv:1: column rear_wheel is missing")
    assert season.document.counts == {"unreadable": 2, "ok": 1, "duplicate": 1, "refused": 1}
    dates = {name: (file.date, file.date_from) for name, file in files.items()}
    assert dates["good again.csv"] == ("2026-05-01T10:30:00", "metadata")
    assert dates["short.csv"] == ("2026-05-03T00:00:00", "name")
    assert dates["binary.csv"][1] == "file"
    assert dates["binary.csv"][0].startswith("2023-11-1")
    assert season.verdict == "ok"
    assert "a trend needs 4 recordings" in season.warnings[0]
    assert "too few" in str(season)
    good = next(file for file in season.files if file.verdict == "ok")
    low, high = good.parameters["c_f"].eti95
    assert low < 5.76 < high  # the true rate of this simulated car
    saved = json.loads(season.answer(good).read_text(encoding="utf-8"))
    assert saved["schema"] == "bayes_asv/estimate/1"
    assert saved["recorded"] == "2026-05-01T10:30:00"


def test_the_table_is_parquet_or_csv(
    season: Fleet,
    folder: Path,
    car: asv.Vehicle,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from pyarrow import parquet

    table = parquet.read_table(folder / "out.parquet")
    assert table.num_rows == 5
    assert str(table.schema.field("date").type).startswith("timestamp")
    assert table.to_pandas()["c_f_mean"].notna().sum() == 1
    assert list(season.summary().columns) == table.column_names
    shutil.copytree(season.folder, tmp_path / "copy.fleet")
    monkeypatch.setattr("bayes_asv.batch.workers.run_tasks", _idle)
    again = asv.fleet(str(folder / "**" / "*.csv"), car, output=tmp_path / "copy.csv", seed=1)
    with (tmp_path / "copy.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [file.verdict for file in again.files]
    assert again.to_dict()["files"] == season.to_dict()["files"]


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the recordings that a season gives to its workers, which answer none of them."""
    names: list[str] = []

    def run(workers: object, function: Callable[..., Any], tasks: Any, finished: Any) -> None:
        for task in tasks:
            names.append(Path(task.path).name)
            finished(task, fleet_module._Answer(None, {"verdict": "unreadable", "reason": "x"}))

    monkeypatch.setattr("bayes_asv.batch.workers.run_tasks", run)
    return names


def test_only_what_is_not_there_is_done(
    season: Fleet,
    folder: Path,
    car: asv.Vehicle,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    done: list[str],
) -> None:
    def again(vehicle: asv.Vehicle, **options: Any) -> list[str]:
        done.clear()
        asv.fleet(str(folder / "**" / "*.csv"), vehicle, output=tmp_path / "out.parquet", **options)
        return sorted(done)

    shutil.copytree(season.folder, tmp_path / "out.fleet")
    (tmp_path / "out.fleet" / "index.sqlite").unlink()  # which is made anew from the answers
    renamed = replace(car, source="other.toml", sha256="")
    assert again(renamed, seed=1) == ["binary.csv", "broken.csv"]
    assert again(renamed, seed=1) == []
    assert len(again(car, seed=2)) == 4
    assert len(again(car, seed=1, below=20.0)) == 4
    heavier = replace(car, m=replace(car.m, value=1.01 * car.m.value))
    assert len(again(heavier, seed=1)) == 4
    monkeypatch.setattr(fleet_module, "__version__", "9.9")
    assert len(again(car, seed=1)) == 4


def test_an_answer_by_another_channel_map_is_none(
    folder: Path, car: asv.Vehicle, tmp_path: Path, done: list[str]
) -> None:
    def again(mapped: ChannelMap | None) -> list[str]:
        done.clear()
        vehicle = replace(car, channel_map=mapped)
        asv.fleet(folder / "good.csv", vehicle, output=tmp_path / "out.csv")
        return done

    names = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
    straight = ChannelMap(tuple(MappedChannel(name, (name,)) for name in names))
    upside_down = ChannelMap(tuple(MappedChannel(name, (name,), scale=-1.0) for name in names))
    for mapped in (None, straight, upside_down):
        assert again(mapped) == ["good.csv"]
        assert again(mapped) == []
    assert again(replace(straight, source="another file")) == []


_SCRIPT = """
import sys, time
import bayes_asv as asv
from bayes_asv.library import fleet

if __name__ == "__main__":
    car = asv.read_vehicle(asv.example("baja2008.toml"))
    asv.fleet(sys.argv[1], car, output=sys.argv[2], jobs=2, progress=False)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_killed_run_continues_and_leaves_no_process(
    tmp_path: Path, stops: asv.Recording, car: asv.Vehicle
) -> None:
    for k in range(12):  # too short, so that an estimate is a refusal and takes no time
        part = slice(3 * k, 3 * k + 90)
        run = asv.Recording(stops.time[part], stops.values[:, part], stops.units)
        run.to_csv(tmp_path / f"run{k:02d}-2026-05-03.csv")
    script, output = tmp_path / "run.py", tmp_path / "out.csv"
    script.write_text(_SCRIPT, encoding="utf-8")
    command = [sys.executable, str(script), str(tmp_path / "*.csv"), str(output)]
    answers = tmp_path / "out.fleet" / "answers"
    parent = subprocess.Popen(command, stderr=subprocess.PIPE)
    children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")
    while len(list(answers.glob("*.json"))) < 2:
        assert parent.poll() is None, parent.stderr and parent.stderr.read()
        time.sleep(0.005)
    pids = [int(pid) for pid in children.read_text().split()] if children.exists() else []
    parent.send_signal(signal.SIGKILL)
    parent.communicate()
    kept = {path.name: path.stat().st_mtime_ns for path in answers.glob("*.json")}
    assert 2 <= len(kept) < 12
    deadline = time.monotonic() + 5.0
    while any(_alive(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [pid for pid in pids if _alive(pid)]
    assert not output.exists()
    subprocess.run(command, check=True, capture_output=True)
    after = {path.name: path.stat().st_mtime_ns for path in answers.glob("*.json")}
    assert len(after) == 12
    assert {name: after[name] for name in kept} == kept
    with output.open(encoding="utf-8") as file:
        assert [row["verdict"] for row in csv.DictReader(file)] == ["refused"] * 12


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def _document(
    car: asv.Vehicle, count: int, change: dict[str, np.ndarray[Any, Any]]
) -> FleetDocument:
    """Make a season of fabricated answers, in which dampers change as given (logarithms)."""
    coordinates = Coordinates(car_model("half", car))
    rng = np.random.default_rng(2)
    files, extracts = [], {}
    names = ("c_f", "c_r", "i")
    for k in range(count):
        day = START + timedelta(days=2 * k)
        u = rng.normal(0.0, 0.01, 3)
        for name, level in change.items():
            u[names.index(name)] += level[k]
        H = 1e6 * np.eye(len(coordinates.directions))
        key = f"{k:032d}"
        files.append(SeasonFile(f"season/{day:%Y-%m-%d}/run<{k}>.csv", key * 2, key))
        nominal = (7.2, 10.0, 626.0)
        extracts[key] = {
            "verdict": "ok", "reason": "", "recorded": "", "car": "half",
            "parameters": {
                name: {"mean": x, "sd": 0.01 * x, "eti95": [0.98 * x, 1.02 * x]}
                for name, x in zip(names, nominal * np.exp(u), strict=True)
            },
            "precision": H.tolist(), "linear": (H @ (coordinates.directions @ u)).tolist(),
        }  # fmt: skip
    files += [SeasonFile("season/x.csv", "", "", "cannot be read (no permission)")]
    files += [SeasonFile("season/y-2026-05-05.csv", "b", "killed")]
    return fleet_document(files, extracts, {"killed": "its process was killed twice"}, car, 1)


@pytest.fixture(scope="module")
def changed(car: asv.Vehicle) -> FleetDocument:
    """Return a season in which the front damper falls at the eighth recording, the rear slowly."""
    fall = np.where(np.arange(16) < 8, 0.0, np.log(0.88))
    return _document(car, 16, {"c_f": fall, "c_r": np.linspace(0.0, -0.15, 16)})


def test_a_season_says_what_changed_and_when(changed: FleetDocument, car: asv.Vehicle) -> None:
    found = Fleet(changed, Path("season.fleet"))
    front, rear = found["c_f"], found["c_r"]
    assert (front.kind, rear.kind) == ("sudden", "gradual")
    (change,) = front.changes
    assert (change.after[:10], change.before[:10]) == ("2026-05-09", "2026-05-11")
    assert change.eti95[0] < 0.88 < change.eti95[1]
    assert rear.gradual.eti95[0] < np.exp(-0.15) < rear.gradual.eti95[1]
    assert front.latest.mean == pytest.approx(7.2 * 0.88, rel=0.02)
    assert front.latest.sd / front.latest.mean == pytest.approx(0.01, rel=0.3)
    first, second, *others = found.lines()
    assert first.startswith("Front damper: fell by 12 % between 9 and 11 May 2026 (95 %: 1")
    assert second.startswith("Rear damper: fell gradually by 1")
    assert "from 25 April 2026 to 25 May 2026" in second
    assert "18 recordings (16 estimated, 1 unreadable, 1 failed)" in others[0]
    assert "Failed: season/y-2026-05-05.csv: its process was killed twice." in others
    assert fleet_steps(changed)[0].startswith("Find out what happened to the front damper between")
    assert repr(found).startswith("<Fleet 'ok': 16 ok")
    assert "<td>2026-05-09</td>" in found._repr_html_()
    assert FleetDocument.model_validate(json.loads(found.to_json())) == changed
    with pytest.raises(KeyError, match="there are c_f, c_r"):
        found["i"]
    same = Fleet(_document(car, 6, {}), Path("x"))
    assert str(same).startswith("Front damper: no change (probability ")


def test_the_page_is_whole_and_fits(changed: FleetDocument, browser: Any, tmp_path: Path) -> None:
    text = html_report(changed)
    assert "run<1>" not in text
    assert "run&lt;1&gt;.csv" in text
    tags: list[str] = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attrs: tags.append(tag)  # type: ignore[method-assign]
    parser.feed(text)
    assert "script" not in tags
    assert tags.count("figure") == 1
    page = tmp_path / "season.html"
    page.write_text(text, encoding="utf-8")
    for width in (1280, 390):
        browser.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500},
        )
        browser.get(page.as_uri())
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        for picture in browser.find_elements("css selector", "figure svg"):
            assert 300 <= picture.rect["width"] <= width
    assert not [row for row in browser.get_log("browser") if row["level"] == "SEVERE"]
    assert pdf_report(changed).startswith(b"%PDF")


def test_a_season_without_an_answer_is_refused(car: asv.Vehicle) -> None:
    document = fleet_document([SeasonFile("a.csv", "", "", "cannot be read")], {}, {}, car, 0)
    found = Fleet(document, Path("x"))
    assert found.verdict == "refused"
    assert "No answer" in str(found)
    assert "no recording has a verdict" in found.reasons[0]
    assert "No answer" in html_report(document)
    with pytest.raises(KeyError, match="no recording has a verdict"):
        found["c_f"]


def test_the_extract_is_that_of_the_estimate(car: asv.Vehicle, result: asv.Estimate) -> None:
    made = season_extract(result.document, "", car)
    draws = {name: x.ravel() for name, x in result.engine.draws.items()}
    whole = Coordinates(car_model("half", car)).likelihood(draws)
    assert made["verdict"] == "ok"
    ours, all_draws = np.array(made["precision"]), whole.precision
    assert np.diag(ours) == pytest.approx(np.diag(all_draws), rel=0.25)
    doubtful = result.document.model_copy(update={"doubt": "the input is wrong"})
    assert season_extract(doubtful, "", car)["verdict"] == "doubtful"


def test_wrong_use_is_told(
    car: asv.Vehicle, folder: Path, tmp_path: Path, invoke: Command, refuse: Check, baja: Path
) -> None:
    good = folder / "good.csv"
    with pytest.raises(asv.InputError, match=r"end the name in \.parquet or \.csv"):
        asv.fleet(good, car, output=tmp_path / "x.txt")
    with pytest.raises(asv.InputError, match="the pattern fits none"):
        asv.fleet(str(tmp_path / "*.csv"), car, output=tmp_path / "x.csv")
    with pytest.raises(asv.InputError, match="give 1 or more"):
        asv.fleet(good, car, output=tmp_path / "x.csv", jobs=0)
    with pytest.raises(asv.InputError, match="its folder does not exist"):
        asv.fleet(good, car, output=tmp_path / "no" / "x.csv")
    with pytest.raises(TypeError, match="read the file first"):
        asv.fleet(good, "car.toml", output=tmp_path / "x.csv")  # type: ignore[arg-type]
    assert refuse(invoke("fleet", good, "-v", baja), "--output")
    assert refuse(invoke("fleet", good, "-v", baja, "-o", good), "is read by this command")


def test_the_command_writes_table_page_and_json(
    folder: Path, tmp_path: Path, invoke: Command, baja: Path
) -> None:
    short = folder / "2026-05-03" / "short.csv"
    output, told = tmp_path / "s.csv", tmp_path / "s.json"
    said = invoke("fleet", short, "-v", baja, "-o", output, "--json", told, "--jobs", 1)
    assert said.status == 3
    assert "No answer: no recording of this season has a verdict" in said.out
    assert f"Table: {output}. Page: {tmp_path / 's.html'}." in said.err
    document = json.loads(told.read_text(encoding="utf-8"))
    assert document["schema"] == "bayes_asv/fleet/1"
    assert document["files"][0]["verdict"] == "refused"
    assert (tmp_path / "s.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize("name", ["=cmd|x", "+1", "-1", "@a", "\t=1"])
def test_a_file_name_is_no_formula_of_a_spreadsheet(name: str) -> None:
    from bayes_asv.library.fleet import _spreadsheet_safe

    assert _spreadsheet_safe(name) == f"'{name}"
    assert _spreadsheet_safe("run=1.csv") == "run=1.csv"
    assert _spreadsheet_safe(-1.5) == -1.5
