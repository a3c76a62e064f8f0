"""Results on disk, what is concluded from them, and the command line."""

from __future__ import annotations

import gzip
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from benchmarks.calibration.__main__ import chosen, main
from benchmarks.calibration.bench import about, work
from benchmarks.calibration.cells import CELLS, GROUPS, MODEL, NAMES, Cell, Group
from benchmarks.calibration.run import LOG_LIKELIHOOD, NOT_CONVERGED, Row
from benchmarks.calibration.store import About, append, drop, load, pack
from benchmarks.calibration.summary import summaries, verdicts
from benchmarks.calibration.tables import deviating

TOLD = About(1, "abc1234", "none")


def _rows(rng: np.random.Generator, count: int, narrow: float = 1.0, start: int = 0) -> list[Row]:
    """Rows with uniform places, or with those of intervals too narrow by a factor."""
    from scipy.special import ndtr

    out = []
    for k in range(count):
        z = rng.standard_normal(len(NAMES)) / narrow
        out.append(
            Row(
                run=start + k,
                places={n: round(float(ndtr(x)), 4) for n, x in zip(NAMES, z, strict=True)},
                widths=dict.fromkeys(NAMES, 0.0111),
                bounds=dict.fromkeys(NAMES, 0.01),
                effective=300.0,
                how="512",
            )
        )
    return out


def test_what_was_stored_comes_back(tmp_path: Path) -> None:
    rows = _rows(np.random.default_rng(0), 5)
    rows[1] = Row(1, reasons=("too short; drive on",), clipped=7)
    rows[2] = replace(rows[2], checked={"c_f": (0.25, 0.011)}, colour=3, how="ensembles")
    append(tmp_path, "one", rows[:3], TOLD)
    append(tmp_path, "two", rows[:1], TOLD)
    append(tmp_path, "one", rows[3:], TOLD)
    found = load(tmp_path)
    assert found["one"].rows == tuple(rows)
    assert found["one"].about == (TOLD,)
    pack(tmp_path)
    assert not (tmp_path / "runs.jsonl").exists()
    assert load(tmp_path) == found
    first = (tmp_path / "runs.jsonl.gz").read_bytes()
    pack(tmp_path)
    assert (tmp_path / "runs.jsonl.gz").read_bytes() == first
    drop(tmp_path, ["one"])
    assert set(load(tmp_path)) == {"two"}


def test_half_a_line_of_a_killed_bench_is_done_again(tmp_path: Path) -> None:
    rows = _rows(np.random.default_rng(0), 4)
    append(tmp_path, "one", rows[:2], TOLD)
    with (tmp_path / "runs.jsonl").open("a") as file:
        file.write('{"cell":"one","seed":1,"comm')
    assert load(tmp_path)["one"].rows == tuple(rows[:2])
    append(tmp_path, "one", rows[2:], TOLD)
    assert load(tmp_path)["one"].rows == tuple(rows)


@pytest.mark.parametrize("text", [b"{}\n", b"nonsense\n", b'{"cell":"one","seed":1}\n'])
def test_files_that_are_no_results_are_named(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "runs.jsonl").write_bytes(text)
    with pytest.raises(InputError, match="holds a line that is no result"):
        load(tmp_path)
    (tmp_path / "runs.jsonl").unlink()
    (tmp_path / "runs.jsonl.gz").write_bytes(gzip.compress(text)[:-5])
    with pytest.raises(InputError, match="cannot be unpacked"):
        load(tmp_path)


def test_a_bench_goes_on_where_it_was_and_refuses_to_mix(tmp_path: Path) -> None:
    cell = Cell(
        Group("short", "Short"), "rough", rate=200.0, runs=3, checked=0, seconds=1.0, exact=True
    )
    assert work([cell], tmp_path, TOLD, 1, runs=2) == 2
    assert work([cell], tmp_path, TOLD, 1) == 1
    assert work([cell], tmp_path, TOLD, 1) == 0
    assert [row.run for row in load(tmp_path)["short-rough"].rows] == [0, 1, 2]
    with pytest.raises(InputError, match="are of commit abc1234, seed 1; add --fresh"):
        work([cell], tmp_path, replace(TOLD, seed=2), 1)
    assert work([cell], tmp_path, replace(TOLD, seed=2), 1, runs=1, fresh=True) == 1
    assert load(tmp_path)["short-rough"].about == (replace(TOLD, seed=2),)


def _full(tmp_path: Path, narrow: dict[str, float], count: int = 300) -> None:
    rng = np.random.default_rng(4)
    for cell in CELLS:
        if cell.terrain != MODEL:
            append(tmp_path, cell.name, _rows(rng, count, narrow.get(cell.name, 1.0)), TOLD)


def test_calibrated_runs_meet_every_demand(tmp_path: Path) -> None:
    """Seed 4; of so many families of tests at 5 % one may reject by chance."""
    _full(tmp_path, {})
    found = summaries(load(tmp_path))
    assert len(found) == len(CELLS) - 1
    held = verdicts(found)
    assert {v.group.key for v in held} == {g.key for g in GROUPS if g.rule != "none"}
    assert all(v.settled for v in held)
    missed = [v for v in held if not v.met]
    assert len(missed) <= 1, missed


def test_intervals_that_are_too_narrow_are_named(tmp_path: Path) -> None:
    _full(tmp_path, {"declared-400-rough": 0.8, "declared-800-stops": 0.7, "engine-bump": 0.7})
    found = summaries(load(tmp_path))
    missed = {(v.group.key, v.asked.split(",")[0]) for v in verdicts(found) if not v.met}
    assert ("declared-400", "coverage 95 % on bump") in missed
    assert ("declared-800", "coverage of 95 % intervals at least 92 % on stops") in missed
    assert ("engine", "coverage of 95 % intervals at least 90 % on every terrain") in missed
    named = deviating(found)
    assert any("400 Hz, rough, c_f" in line and "too narrow" in line for line in named)
    assert not any("rollers" in line and "800 Hz" in line for line in named)


def test_refused_runs_and_wide_intervals_are_counted(tmp_path: Path) -> None:
    rows = _rows(np.random.default_rng(1), 30)
    rows = [replace(row, widths=dict.fromkeys(NAMES, 0.02)) for row in rows]
    rows += [Row(30, reasons=("too short",)), Row(31, reasons=(NOT_CONVERGED,), how="ensembles")]
    append(tmp_path, "declared-400-bump", rows, TOLD)
    one = summaries(load(tmp_path))["declared-400-bump"]
    assert (one.runs, one.answered, one.not_converged) == (32, 30, 1)
    assert one.ratio["c_f"] == pytest.approx(2.0)
    narrow = [v for v in verdicts({"declared-400-bump": one}) if "the bound" in v.asked]
    assert [(v.met, v.settled, v.runs) for v in narrow] == [(False, False, 30)]


def test_the_page_shows_what_was_found(tmp_path: Path) -> None:
    folder, docs = tmp_path / "results", tmp_path / "docs"
    docs.mkdir()
    rng = np.random.default_rng(2)
    for name in ("declared-400-bump", "declared-400-stops", "engine-rough"):
        append(folder, name, _rows(rng, 40, 0.5 if "bump" in name else 1.0), TOLD)
    model = [
        replace(row, places=row.places | {LOG_LIKELIHOOD: 0.5}, bounds={}) for row in _rows(rng, 40)
    ]
    append(folder, "model-mixed", model, TOLD)
    assert main(["--report", "--out", str(folder), "--docs", str(docs)]) == 0
    page = (docs / "calibration.md").read_text(encoding="utf-8")
    assert "| bump, c_f | 40 |" in page
    assert "too few runs (40)" in page
    assert "Engine on the frame: rough | 40 of 40 |" in page
    assert "too narrow (adjusted p" in page
    assert re.search(r"\| log-likelihood \| .* \| \*\*yes\*\* \|", page)
    assert "commit abc1234" in page
    for target in re.findall(r"\]\((calibration/[^)]+)\)", page):
        assert (docs / target).stat().st_size > 2000
    table = (folder / "coverage.csv").read_text(encoding="utf-8").splitlines()
    assert len(table) == 1 + 3 * 4 * 4
    assert all(len(line.split(",")) == len(table[0].split(",")) for line in table)


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert chosen(["engine", "declared-400-bump"]) == tuple(
        cell for cell in CELLS if cell.name.startswith("engine") or cell.name == "declared-400-bump"
    )
    assert main(["--list"]) == 0
    assert capsys.readouterr().out.count("\n") == len(CELLS)
    assert main(["--cells", "moon"]) == 2
    assert "no cell begins with 'moon'; see --list" in capsys.readouterr().err
    assert main(["--report", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 2
    assert "holds no runs" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--runs", "0"])


def test_cells_have_names_and_streams_of_their_own() -> None:
    assert len({cell.name for cell in CELLS}) == len(CELLS)
    first = {float(cell.random(1, run).random()) for cell in CELLS for run in range(3)}
    assert len(first) == 3 * len(CELLS)
    assert about(7).seed == 7
    assert "numpy" in about(7).versions
