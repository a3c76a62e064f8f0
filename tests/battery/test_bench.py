"""Sealing, running, going on, refusing to mix, and the page; by diagnosers that know nothing."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from benchmarks.battery import peek
from benchmarks.battery import run as run_module
from benchmarks.battery import seal as seal_module
from benchmarks.battery.__main__ import chosen, main
from benchmarks.battery.cells import CELLS, Cell, Group, in_turn
from benchmarks.battery.lines import append, read, write
from benchmarks.battery.page import judged, write_page
from benchmarks.battery.run import LOOSE, PACKED, Result, diagnose_all, load
from benchmarks.battery.seal import Answer, Key, answers, forget, seal
from benchmarks.battery.summary import by_group, confusion, naming
from benchmarks.battery.tables import _SHOWN, by_strength, short_answer
from benchmarks.calibration.store import About
from tests.battery.cases import case
from tests.battery.effects import EFFECTS, places
from tests.battery.names import STRENGTHS, parse
from tests.battery.outside import OUTSIDE
from tests.battery.truth import TrueEffect, Truth

TOLD = About(1, "abc1234", "bayes_asv 0, Python 3")
SHORT = Group("null", "Nothing wrong")
CELL = Cell(SHORT, "null/bump~baja", 2)
STAND_IN = "tests.battery.stand_in:"


@pytest.fixture(scope="module", autouse=True)
def _each_case_once() -> Iterator[None]:
    """Making a case takes a second, and every test here wants the same ones."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (run_module, seal_module):
            patch.setattr(module, "make_case", lambda *given: case(*given[:4]))
        yield


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the answers of two cases, sealed."""
    folder = tmp_path_factory.mktemp("sealed")
    assert len(seal(folder, [CELL], "dev", 5)) == 2
    return folder


def copied(sealed: Path, folder: Path) -> dict[Key, Answer]:
    for path in sealed.glob("answers-*"):
        (folder / path.name).write_bytes(path.read_bytes())
    return answers(folder, "dev", 5)


def run(folder: Path, there: dict[Key, Answer], which: str = "agrees", **more: Any) -> int:
    return diagnose_all(folder, [CELL], there, TOLD, diagnoser=STAND_IN + which, **more)


# --- sealing -----------------------------------------------------------------------------------


def test_answers_are_sealed_once(sealed: Path) -> None:
    files = list(sealed.glob("*"))
    assert len(files) == 1
    assert seal(sealed, [CELL], "dev", 5) == answers(sealed, "dev", 5)
    assert list(sealed.glob("*")) == files
    assert answers(sealed, "dev", 6) == {}
    assert answers(sealed, "test", 5) == {}
    for (name, number), answer in answers(sealed, "dev", 5).items():
        assert (answer.truth.name, answer.truth.number) == (name, number)
        assert answer.seal in files[0].name


def test_a_seal_that_was_broken_is_noticed(sealed: Path, tmp_path: Path) -> None:
    copied(sealed, tmp_path)
    (path,) = tmp_path.glob("answers-*")
    head, *lines = read(path)
    lines[0]["truth"]["kind"] = "clutter"
    write(path, [head, *lines])
    with pytest.raises(InputError, match="is not what was sealed"):
        answers(tmp_path, "dev", 5)


def test_a_seal_may_be_broken_on_purpose_and_half_done_work_goes_on(
    sealed: Path, tmp_path: Path
) -> None:
    copied(sealed, tmp_path)
    (path,) = tmp_path.glob("answers-*")
    _, first, _ = read(path)
    forget(tmp_path, [CELL.name])
    assert answers(tmp_path, "dev", 5) == {}
    append(tmp_path / "answers.jsonl", [first])
    told: list[str] = []
    seal(tmp_path, [CELL], "dev", 5, progress=lambda _share, words: told.append(words))
    assert told == ["answers: 1 of 1"]  # the other one was there
    assert len(answers(tmp_path, "dev", 5)) == 2


# --- running -----------------------------------------------------------------------------------


def test_a_run_goes_on_where_it_was_and_refuses_to_mix(sealed: Path, tmp_path: Path) -> None:
    there = copied(sealed, tmp_path)
    assert run(tmp_path, there, runs=1) == 1
    assert run(tmp_path, there) == 1
    assert run(tmp_path, there) == 0
    results = load(tmp_path)
    assert set(results) == {(CELL.name, 0), (CELL.name, 1)}
    one = results[CELL.name, 0]
    assert one.document["verdict"] == "agreement"
    assert "curves" not in one.document
    assert one.seal == there[CELL.name, 0].seal
    assert one.begun >= there[CELL.name, 0].sealed
    with pytest.raises(InputError, match="of commit abc1234, seed 1; add --fresh"):
        diagnose_all(tmp_path, [CELL], there, replace(TOLD, commit="def"),
                     diagnoser=STAND_IN + "agrees")  # fmt: skip


@pytest.mark.parametrize(
    ("which", "why"), [("breaks", "ZeroDivisionError: of a det"), ("is_no_number", "ValueError")]
)
def test_a_diagnosis_that_breaks_down_is_a_result(
    sealed: Path, tmp_path: Path, which: str, why: str
) -> None:
    there = copied(sealed, tmp_path)
    run(tmp_path, there, which, runs=1)
    document = load(tmp_path)[CELL.name, 0].document
    assert document["verdict"] == "error"
    assert why in document["reasons"][0]


def test_a_rig_that_has_changed_is_noticed(sealed: Path, tmp_path: Path) -> None:
    there = {key: replace(a, digest="0" * 64) for key, a in copied(sealed, tmp_path).items()}
    with pytest.raises(InputError, match="no longer what was sealed"):
        run(tmp_path, there, runs=1)


def test_an_ablation_is_passed_on(sealed: Path, tmp_path: Path) -> None:
    run(tmp_path, copied(sealed, tmp_path), ablation="whitening", runs=1)
    assert load(tmp_path)[CELL.name, 0].document["reasons"] == ["whitening"]
    with pytest.raises(InputError, match="leaves nothing out"):
        run(tmp_path, {}, "dice", ablation="whitening")
    with pytest.raises(InputError, match="cannot be found"):
        diagnose_all(tmp_path, [CELL], {}, TOLD, diagnoser="tests.battery.nowhere:f")


def test_lines_survive_a_kill_and_tell_what_is_broken(tmp_path: Path) -> None:
    path = tmp_path / LOOSE
    append(path, [{"a": 1}])
    with path.open("ab") as file:
        file.write(b'{"a": 2')
    assert read(path) == [{"a": 1}]
    append(path, [{"a": 3}])
    assert read(path) == [{"a": 1}, {"a": 3}]
    path.write_bytes(b"[]\n")
    with pytest.raises(InputError, match="no object"):
        read(path)
    path.write_bytes(b"{\n")
    with pytest.raises(InputError, match="no JSON"):
        read(path)
    packed = tmp_path / PACKED
    packed.write_bytes(gzip.compress(b"{}\n")[:-4])
    with pytest.raises(InputError, match="cannot be unpacked"):
        read(packed)
    packed.write_bytes(gzip.compress(b'{"name": "null"}\n'))
    path.unlink()
    with pytest.raises(InputError, match="no result"):
        load(tmp_path)


# --- the page ----------------------------------------------------------------------------------


def made_up(cell: Cell, number: int) -> Truth:
    """A truth without a drive."""
    what = parse(cell.name)
    rng = np.random.default_rng([number, len(cell.name)])
    kinds = {"pair": ["sensor_gain", "bump_stop"], "single": ["sensor_lag"]}
    names = kinds.get(what.kind, [what.kind] if what.kind in (*EFFECTS, *OUTSIDE) else [])
    size = 1.5 if what.kind == "pair" and number % 2 else 3.0
    effects = tuple(
        TrueEffect(n, str(rng.choice(places(n))) if n in EFFECTS else "rear",
                   {_SHOWN[n][0]: 3.0} if n in EFFECTS else {}, size, 1.0, what.strength,
                   0.6 * what.strength)
        for n in names
    )  # fmt: skip
    kind = "single" if what.kind in EFFECTS else "outside" if what.kind in OUTSIDE else what.kind
    car = {"c_f": 1000.0, "c_r": 1200.0, "i": 80.0}
    meant = {k: (v, v) for k, v in car.items()}
    return Truth(cell.name, 1, number, "test", kind, what.modifier, what.strength, effects, car,
                 meant, "bump", "rough", "formula", 1.0, 0, False)  # fmt: skip


def said(truth: Truth, rng: np.random.Generator) -> dict[str, Any]:
    """A document that is right nine times of ten, and says so."""
    right = rng.random() < 0.9
    effects: list[dict[str, Any]] = [
        {"name": e.name if right else "sensor_drift", "where": e.where or None,
         "probability": 0.9, "indistinguishable_from": []}
        for e in truth.effects if e.name in EFFECTS
    ]  # fmt: skip
    units = {"c_f": "N*s/m", "c_r": "N*s/m", "i": "kg*m^2"}
    parameters = {
        k: {"unit": units[k], "eti95": [0.97 * v, 1.02 * v]} for k, v in truth.car.items()
    }
    outside = truth.kind == "outside"
    verdict = "named" if effects else ("unexplained" if outside and right else "agreement")
    gap = {"before": 2.0, "after": 1.02 if effects and right else 2.0, "floor": 1.0}
    return {"verdict": verdict, "effects": effects, "unexplained": {"present": False},
            "gap": {"holdout": gap}, "parameters_before": {k: v | {"eti95": [0.0, 1.0]}
            for k, v in parameters.items()}, "parameters_after": parameters}  # fmt: skip


@pytest.fixture(scope="module")
def results() -> tuple[dict[Key, Result], dict[Key, Answer]]:
    """A whole battery of made-up results."""
    rng = np.random.default_rng(9)
    found, sealed = {}, {}
    for cell in CELLS:
        for number in range(min(cell.runs, 20)):
            key = (cell.name, number)
            truth = made_up(cell, number)
            sealed[key] = Answer(truth, "d", "5ea1", "2030-01-01T00:00:00Z")
            found[key] = Result(*key, "5ea1", "2030-01-02T00:00:00Z", 7.0, said(truth, rng), TOLD)
    return found, sealed


def test_what_nine_of_ten_say_is_counted(
    results: tuple[dict[Key, Result], dict[Key, Answer]],
) -> None:
    cases = judged(*results)
    groups = {group.key: there for group, there in by_group(cases).items()}
    assert {key for key, there in groups.items() if there} == {g.key for g in by_group(cases)}
    one = naming(groups["single"])
    assert one.first.of == 8 * (4 * len(EFFECTS) - 2)
    low, high = one.first.interval
    assert low < 0.9 + 0.1 / len(EFFECTS) < high  # where drift is true it is always said
    assert one.confidently_wrong.share == pytest.approx(1.0 - one.first.share)
    rows, columns, shares = confusion(by_group(cases), 400.0)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    named = [row.split(" ")[0] for row in rows]
    for name in EFFECTS:
        assert shares[named.index(name), columns.index(name)] >= 0.5
    assert rows[-1].startswith("nothing")
    assert shares[-1, columns.index("agreement")] == 1.0
    words = short_answer(cases)
    assert re.search(r"false alarms: no fault \| 0 \(0–16\) % \| 20 \|", words)
    assert re.search(r"closed, median \| 98\.7 \(98\.7–98\.7\) %", words)
    counts = [re.search(rf"two effects{what} \|.*\| (\d+) \|", words) for what in (
        ": both found", ", both beyond two tolerances: both found")]  # fmt: skip
    assert [int(found[1]) for found in counts if found] == [60, 30]
    assert "coverage of the 95 % interval of i, before naming | 0 (0–" in words
    assert len(by_strength(cases).splitlines()) == 2 + 2 * len(STRENGTHS) + 2


def test_the_page_shows_what_was_found(
    results: tuple[dict[Key, Result], dict[Key, Answer]], tmp_path: Path
) -> None:
    whole, sealed = results
    found = {key: r for key, r in whole.items() if sealed[key].truth.strength in (0.0, 400.0)}
    folder, docs = tmp_path / "results", tmp_path / "docs"
    docs.mkdir()
    plain = [r.__dict__ | {"about": TOLD.__dict__} for r in found.values()]
    append(folder / LOOSE, plain)
    append(folder / "ablations" / "whitening" / LOOSE, plain[:60])
    write_page(folder, docs, sealed)
    assert [p.name for p in folder.glob("runs*")] == [PACKED]
    page = (docs / "battery.md").read_text(encoding="utf-8")
    assert "| sensor_gain: factor, % | 2e+02 |" in page
    assert "| maxwell_mount | 5 |" in page
    assert "| whitening | 60 |" in page
    assert "answers `5ea1`, sealed 2030-01-01T00:00:00Z" in page
    assert "of the full battery were not run" in page
    targets = re.findall(r"\]\((battery/[^)]+)\)", page)
    assert len(targets) == 3  # naming, one confusion matrix, reliability
    for target in targets:
        assert (docs / target).stat().st_size > 2000
    assert load(folder) == found


def test_answers_sealed_after_the_fact_are_refused(
    results: tuple[dict[Key, Result], dict[Key, Answer]],
) -> None:
    found, sealed = results
    key = next(iter(found))
    late = sealed | {key: replace(sealed[key], sealed="2030-01-03T00:00:00Z")}
    with pytest.raises(InputError, match="no answer that was sealed before it"):
        judged(found, late)
    with pytest.raises(InputError, match="no answer that was sealed before it"):
        judged(found, sealed | {key: replace(sealed[key], seal="0")})


def test_a_look_at_the_last_results(
    sealed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--out", str(tmp_path), "--seed", "5"]
    assert peek.main(where) == 0
    assert "holds no runs" in capsys.readouterr().out
    run(tmp_path, copied(sealed, tmp_path), "dice")
    assert peek.main([*where, "--cases", "null"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert all(re.search(r"null -> named \w+ 0\.\d\d! \d", line) for line in lines)
    assert peek.main([*where, "--wrong"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    (tmp_path / LOOSE).write_bytes(b"{\n")
    assert peek.main(where) == 2
    assert "no JSON" in capsys.readouterr().err


def test_group_lines_tell_every_group(
    results: tuple[dict[Key, Result], dict[Key, Answer]],
) -> None:
    lines = peek.group_lines(judged(*results))
    assert any(line.startswith("single-400") for line in lines)
    assert any(line.startswith("outside-4000") and "flagged" in line for line in lines)
    assert all("without answer" not in line for line in lines)


# --- the command line --------------------------------------------------------------------------


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert {cell.name for cell in chosen(["null", "bound_rebound"])} == {
        "null", *(f"bound_rebound-{s:g}" for s in STRENGTHS)
    }  # fmt: skip
    assert all(cell.group.key == "outside" for cell in chosen(["outside"]))
    assert [cell.name for cell in chosen(["sensor_gain-400"])] == ["sensor_gain-400"]
    assert main(["--list"]) == 0
    assert capsys.readouterr().out.count("\n") == len(CELLS)
    assert main(["--cells", "moon"]) == 2
    assert "no cell begins with 'moon'; see --list" in capsys.readouterr().err
    assert main(["--report", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 2
    assert "holds no runs" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--runs", "0"])


def test_one_command_seals_and_runs(tmp_path: Path) -> None:
    words = ["--cells", "null", "--runs", "1", "--set", "dev", "--processes", "1",
             "--out", str(tmp_path), "--diagnoser", STAND_IN + "dice"]  # fmt: skip
    assert main(words) == 0
    assert main(words) == 0  # nothing left to do
    (sealed,) = tmp_path.glob("answers-*")
    (line,) = read(tmp_path / LOOSE)
    assert line["seal"] in sealed.name
    assert main([*words, "--fresh"]) == 0
    assert list(tmp_path.glob("answers-*")) == [sealed]
    assert json.dumps(read(tmp_path / PACKED)) == "[]"


def test_half_of_the_battery_is_half_of_everything() -> None:
    order = in_turn(CELLS)
    assert len(set(order)) == len(order) == sum(cell.runs for cell in CELLS)
    half = order[: len(order) // 2]
    for cell in CELLS:
        assert abs(sum(name == cell.name for name, _ in half) - cell.runs / 2) <= 1.0
    assert in_turn(CELLS[:2], 2) == [("null", 0), ("lifting", 0), ("null", 1), ("lifting", 1)]


def test_cells_are_names_of_cases() -> None:
    assert len({cell.name for cell in CELLS}) == len(CELLS)
    for cell in CELLS:
        parse(cell.name)
    single = [parse(cell.name) for cell in CELLS if cell.group.key == "single"]
    assert {(one.kind, one.strength) for one in single} == {
        (name, strength) for name in EFFECTS for strength in STRENGTHS
    } - {("spring_rate", 4000.0), ("weight_distribution", 4000.0)}
    outside = {parse(cell.name).kind for cell in CELLS if cell.group.key == "outside"}
    assert outside == set(OUTSIDE)
    assert len(outside) >= 8
    assert set(_SHOWN) == set(EFFECTS)
