"""The battery: sealing, running, resuming, and the page, with diagnosers that do not diagnose."""

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
from benchmarks.battery.json_lines import append, read, write
from benchmarks.battery.page import judged, write_page
from benchmarks.battery.run import LOOSE, PACKED, Result, diagnose_all, load
from benchmarks.battery.seal import Answer, Key, answers, forget, seal
from benchmarks.battery.summary import by_group, confusion, naming
from benchmarks.battery.tables import _SHOWN, by_strength, short_answer
from benchmarks.calibration.store import About
from tests.battery.cases import case
from tests.battery.effects import EFFECTS, places
from tests.battery.names import STRENGTHS, parse
from tests.battery.truth import TrueEffect, Truth
from tests.battery.unlisted_faults import UNLISTED_FAULTS

ABOUT = About(1, "abc1234", "bayes_asv 0, Python 3")
SHORT = Group("null", "Nothing wrong")
CELL = Cell(SHORT, "null/bump~baja", 2)
FAKE = "tests.battery.fake_diagnosers:"


@pytest.fixture(scope="module", autouse=True)
def _each_case_once() -> Iterator[None]:
    """Making a case takes a second, and all tests here use the same ones."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (run_module, seal_module):
            patch.setattr(module, "make_case", lambda *given: case(*given[:4]))
        yield


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sealed answers of two cases."""
    folder = tmp_path_factory.mktemp("sealed")
    assert len(seal(folder, [CELL], "dev", 5)) == 2
    return folder


def copied(sealed: Path, folder: Path) -> dict[Key, Answer]:
    for path in sealed.glob("answers-*"):
        (folder / path.name).write_bytes(path.read_bytes())
    return answers(folder, "dev", 5)


def run(
    folder: Path, known_answers: dict[Key, Answer], which: str = "agreement", **more: Any
) -> int:
    return diagnose_all(folder, [CELL], known_answers, ABOUT, diagnoser=FAKE + which, **more)


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


def test_a_changed_answer_is_detected(sealed: Path, tmp_path: Path) -> None:
    copied(sealed, tmp_path)
    (path,) = tmp_path.glob("answers-*")
    head, *lines = read(path)
    lines[0]["truth"]["kind"] = "clutter"
    write(path, [head, *lines])
    with pytest.raises(InputError, match="does not match its seal"):
        answers(tmp_path, "dev", 5)


def test_answers_can_be_deleted_and_incomplete_work_is_resumed(
    sealed: Path, tmp_path: Path
) -> None:
    copied(sealed, tmp_path)
    (path,) = tmp_path.glob("answers-*")
    _, first, _ = read(path)
    forget(tmp_path, [CELL.name])
    assert answers(tmp_path, "dev", 5) == {}
    append(tmp_path / "answers.jsonl", [first])
    messages: list[str] = []
    seal(tmp_path, [CELL], "dev", 5, progress=lambda _share, text: messages.append(text))
    assert messages == ["answers: 1 of 1"]  # the other one was made before
    assert len(answers(tmp_path, "dev", 5)) == 2


# --- running -----------------------------------------------------------------------------------


def test_a_run_resumes_and_does_not_mix_commits(sealed: Path, tmp_path: Path) -> None:
    known_answers = copied(sealed, tmp_path)
    assert run(tmp_path, known_answers, runs=1) == 1
    assert run(tmp_path, known_answers) == 1
    assert run(tmp_path, known_answers) == 0
    results = load(tmp_path)
    assert set(results) == {(CELL.name, 0), (CELL.name, 1)}
    one = results[CELL.name, 0]
    assert one.document["verdict"] == "agreement"
    assert "curves" not in one.document
    assert one.seal == known_answers[CELL.name, 0].seal
    assert one.begun >= known_answers[CELL.name, 0].sealed
    with pytest.raises(InputError, match="of commit abc1234, seed 1; add --fresh"):
        diagnose_all(tmp_path, [CELL], known_answers, replace(ABOUT, commit="def"),
                     diagnoser=FAKE + "agreement")  # fmt: skip


@pytest.mark.parametrize(
    ("which", "why"), [("raises", "ZeroDivisionError: of a det"), ("not_a_number", "ValueError")]
)
def test_an_exception_of_the_diagnosis_is_a_result(
    sealed: Path, tmp_path: Path, which: str, why: str
) -> None:
    known_answers = copied(sealed, tmp_path)
    run(tmp_path, known_answers, which, runs=1)
    document = load(tmp_path)[CELL.name, 0].document
    assert document["verdict"] == "error"
    assert why in document["reasons"][0]


def test_a_changed_rig_is_detected(sealed: Path, tmp_path: Path) -> None:
    known_answers = {
        key: replace(a, digest="0" * 64) for key, a in copied(sealed, tmp_path).items()
    }
    with pytest.raises(InputError, match="no longer the sealed case"):
        run(tmp_path, known_answers, runs=1)


def test_an_ablation_is_passed_on(sealed: Path, tmp_path: Path) -> None:
    run(tmp_path, copied(sealed, tmp_path), ablation="whitening", runs=1)
    assert load(tmp_path)[CELL.name, 0].document["reasons"] == ["whitening"]
    with pytest.raises(InputError, match="does not support ablations"):
        run(tmp_path, {}, "random_name", ablation="whitening")
    with pytest.raises(InputError, match="cannot be found"):
        diagnose_all(tmp_path, [CELL], {}, ABOUT, diagnoser="tests.battery.nowhere:f")


def test_json_lines_survive_an_interruption_and_report_errors(tmp_path: Path) -> None:
    path = tmp_path / LOOSE
    append(path, [{"a": 1}])
    with path.open("ab") as file:
        file.write(b'{"a": 2')
    assert read(path) == [{"a": 1}]
    append(path, [{"a": 3}])
    assert read(path) == [{"a": 1}, {"a": 3}]
    path.write_bytes(b"[]\n")
    with pytest.raises(InputError, match="not an object"):
        read(path)
    path.write_bytes(b"{\n")
    with pytest.raises(InputError, match="not JSON"):
        read(path)
    packed = tmp_path / PACKED
    packed.write_bytes(gzip.compress(b"{}\n")[:-4])
    with pytest.raises(InputError, match="cannot be unpacked"):
        read(packed)
    packed.write_bytes(gzip.compress(b'{"name": "null"}\n'))
    path.unlink()
    with pytest.raises(InputError, match="not a result"):
        load(tmp_path)


# --- the page ----------------------------------------------------------------------------------


def artificial_truth(cell: Cell, number: int) -> Truth:
    """An artificial truth."""
    what = parse(cell.name)
    rng = np.random.default_rng([number, len(cell.name)])
    kinds = {"pair": ["sensor_gain", "bump_stop"], "single": ["sensor_lag"]}
    names = kinds.get(what.kind, [what.kind] if what.kind in (*EFFECTS, *UNLISTED_FAULTS) else [])
    size = 1.5 if what.kind == "pair" and number % 2 else 3.0
    effects = tuple(
        TrueEffect(n, str(rng.choice(places(n))) if n in EFFECTS else "rear",
                   {_SHOWN[n][0]: 3.0} if n in EFFECTS else {}, size, 1.0, what.strength,
                   0.6 * what.strength)
        for n in names
    )  # fmt: skip
    kind = (
        "single"
        if what.kind in EFFECTS
        else "outside"
        if what.kind in UNLISTED_FAULTS
        else what.kind
    )
    car = {"c_f": 1000.0, "c_r": 1200.0, "i": 80.0}
    meant = {k: (v, v) for k, v in car.items()}
    return Truth(cell.name, 1, number, "test", kind, what.modifier, what.strength, effects, car,
                 meant, "bump", "rough", "formula", 1.0, 0, False)  # fmt: skip


def document_of(truth: Truth, rng: np.random.Generator) -> dict[str, Any]:
    """A document that is correct, with its probability of 0.9, in nine cases of ten."""
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
    """Artificial results of a complete battery."""
    rng = np.random.default_rng(9)
    results_by_key, sealed = {}, {}
    for cell in CELLS:
        for number in range(min(cell.runs, 20)):
            key = (cell.name, number)
            truth = artificial_truth(cell, number)
            sealed[key] = Answer(truth, "d", "5ea1", "2030-01-01T00:00:00Z")
            results_by_key[key] = Result(
                *key, "5ea1", "2030-01-02T00:00:00Z", 7.0, document_of(truth, rng), ABOUT
            )
    return results_by_key, sealed


def test_statistics_of_a_diagnosis_that_is_right_in_nine_of_ten(
    results: tuple[dict[Key, Result], dict[Key, Answer]],
) -> None:
    cases = judged(*results)
    groups = {group.key: known_answers for group, known_answers in by_group(cases).items()}
    assert {key for key, known_answers in groups.items() if known_answers} == {
        g.key for g in by_group(cases)
    }
    one = naming(groups["single"])
    assert one.first.of == 8 * (4 * len(EFFECTS) - 2)
    low, high = one.first.interval
    assert low < 0.9 + 0.1 / len(EFFECTS) < high  # it is always right where drift is true
    assert one.confidently_wrong.share == pytest.approx(1.0 - one.first.share)
    rows, columns, shares = confusion(by_group(cases), 400.0)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    named = [row.split(" ")[0] for row in rows]
    for name in EFFECTS:
        assert shares[named.index(name), columns.index(name)] >= 0.5
    assert rows[-1].startswith("nothing")
    assert shares[-1, columns.index("agreement")] == 1.0
    text = short_answer(cases)
    assert re.search(r"false alarms: no fault \| 0 \(0–16\) % \| 20 \|", text)
    assert re.search(r"closed, median \| 98\.7 \(98\.7–98\.7\) %", text)
    counts = [re.search(rf"two effects{what} \|.*\| (\d+) \|", text) for what in (
        ": both found", ", both beyond two tolerances: both found")]  # fmt: skip
    assert [int(results_by_key[1]) for results_by_key in counts if results_by_key] == [60, 30]
    assert "coverage of the 95 % interval of i, before naming | 0 (0–" in text
    assert len(by_strength(cases).splitlines()) == 2 + 2 * len(STRENGTHS) + 2


def test_the_page_has_the_results(
    results: tuple[dict[Key, Result], dict[Key, Answer]], tmp_path: Path
) -> None:
    whole, sealed = results
    results_by_key = {
        key: r for key, r in whole.items() if sealed[key].truth.strength in (0.0, 400.0)
    }
    folder, docs = tmp_path / "results", tmp_path / "docs"
    docs.mkdir()
    plain = [r.__dict__ | {"about": ABOUT.__dict__} for r in results_by_key.values()]
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
    assert load(folder) == results_by_key


def test_answers_sealed_after_their_results_are_refused(
    results: tuple[dict[Key, Result], dict[Key, Answer]],
) -> None:
    results_by_key, sealed = results
    key = next(iter(results_by_key))
    late = sealed | {key: replace(sealed[key], sealed="2030-01-03T00:00:00Z")}
    with pytest.raises(InputError, match="no answer that was sealed before it"):
        judged(results_by_key, late)
    with pytest.raises(InputError, match="no answer that was sealed before it"):
        judged(results_by_key, sealed | {key: replace(sealed[key], seal="0")})


def test_the_last_results_are_printed(
    sealed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--out", str(tmp_path), "--seed", "5"]
    assert peek.main(where) == 0
    assert "has no runs" in capsys.readouterr().out
    run(tmp_path, copied(sealed, tmp_path), "random_name")
    assert peek.main([*where, "--cases", "null"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert all(re.search(r"null -> named \w+ 0\.\d\d! \d", line) for line in lines)
    assert peek.main([*where, "--wrong"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    (tmp_path / LOOSE).write_bytes(b"{\n")
    assert peek.main(where) == 2
    assert "not JSON" in capsys.readouterr().err


def test_every_group_has_a_line(
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
    assert "has no runs" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--runs", "0"])


def test_one_command_seals_and_runs(tmp_path: Path) -> None:
    text = ["--cells", "null", "--runs", "1", "--set", "dev", "--processes", "1",
             "--out", str(tmp_path), "--diagnoser", FAKE + "random_name"]  # fmt: skip
    assert main(text) == 0
    assert main(text) == 0  # nothing is left to do
    (sealed,) = tmp_path.glob("answers-*")
    (line,) = read(tmp_path / LOOSE)
    assert line["seal"] in sealed.name
    assert main([*text, "--fresh"]) == 0
    assert list(tmp_path.glob("answers-*")) == [sealed]
    assert json.dumps(read(tmp_path / PACKED)) == "[]"


def test_half_of_the_battery_is_half_of_every_cell() -> None:
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
    assert outside == set(UNLISTED_FAULTS)
    assert len(outside) >= 8
    assert set(_SHOWN) == set(EFFECTS)
