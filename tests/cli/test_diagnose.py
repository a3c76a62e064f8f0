"""``diagnose`` from the shell, what ``report`` makes of it, and ``estimate`` with effects."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from bayes_asv.diagnosis.workflow import DiagnosisResult
from bayes_asv.report.schema import read_saved
from tests.cli.conftest import ROOT, Check, Command, Said, Saved

DATA = Path(__file__).parents[1] / "report" / "data"


class Diagnosed(NamedTuple):
    """One diagnosis: what was said, its file and its document."""

    said: Said
    file: Path
    document: dict[str, Any]


@pytest.fixture(scope="session")
def valved() -> tuple[Path, Path]:
    """Return two drives of a car whose front damper differs in bound and rebound."""
    folder = ROOT / "data" / "recordings"
    return folder / "valved-bump-400hz.csv", folder / "valved-stops-400hz.csv"


@pytest.fixture(scope="session")
def diagnosed(
    run: Command, valved: tuple[Path, Path], baja: Path, tmp_path_factory: pytest.TempPathFactory
) -> Diagnosed:
    """Diagnose once, in a process of its own."""
    file = tmp_path_factory.mktemp("diagnose") / "d.json"
    fit, held = valved
    said = run("diagnose", fit, "--holdout", held, "-v", baja, "--json", file)
    return Diagnosed(said, file, json.loads(file.read_text(encoding="utf-8")))


def test_it_names_the_hidden_effect_and_nothing_on_standard_error(diagnosed: Diagnosed) -> None:
    assert (diagnosed.said.status, diagnosed.said.err) == (0, "")
    first, *others = diagnosed.said.sentences
    assert first.startswith("Front damper: rebound damping is 1.")
    assert any(line.startswith("Simulation error on held-out runs: ") for line in others)
    assert "\x1b" not in diagnosed.said.out


def test_same_seed_same_answer_whatever_the_threads(
    diagnosed: Diagnosed,
    run: Command,
    valved: tuple[Path, Path],
    baja: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    fit, held = valved
    said = run("diagnose", fit, "--holdout", held, "-v", baja, "--json", "-")
    again = json.loads(said.out)
    assert again.pop("seconds") > 0.0
    assert again == {k: v for k, v in diagnosed.document.items() if k != "seconds"}


def test_the_readme_shows_what_it_says(diagnosed: Diagnosed) -> None:
    """Word for word; digits may differ in the last place from machine to machine."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").split("## Finding what is missing")[1]
    shown = readme.split("```text\n")[1].split("```")[0]
    numbers = re.compile(r"\d+(\.\d+)?")
    assert numbers.sub("#", shown) == numbers.sub("#", diagnosed.said.out)
    told, found = ([float(x[0]) for x in numbers.finditer(t)] for t in (shown, diagnosed.said.out))
    assert found == pytest.approx(told, rel=0.02)


def test_the_document_keeps_its_promised_keys(diagnosed: Diagnosed) -> None:
    document = diagnosed.document
    assert document["schema"] == "bayes_asv/diagnose/1"
    assert document["verdict"] == "named"
    assert document["seed"] == 0
    effect = document["effects"][0]
    assert (effect["name"], effect["where"]) == ("bound_rebound", "front")
    assert effect["parameters"]["ratio"]["mean"] == pytest.approx(1.5, rel=0.05)
    for key in ("fit", "holdout"):
        part = document["gap"][key]
        assert part["floor"] <= 1.1 * part["after"]
        assert part["after"] < 0.2 * part["before"]
    assert set(document["disagreement"]) >= {"channel", "axle", "time", "frequency", "state"}
    assert isinstance(document["unexplained"]["present"], bool)
    assert document["runs"] == {
        "fit": ["valved-bump-400hz.csv"], "holdout": ["valved-stops-400hz.csv"]
    }  # fmt: skip


def test_the_curve_is_that_of_the_simulated_damper(diagnosed: Diagnosed) -> None:
    """Forces of the found damper against the rig's, whose form is another one, within 3 %."""
    curve = diagnosed.document["laws"]["front"]["damper"]
    truth = json.loads(
        (ROOT / "data/recordings/valved-bump-400hz.truth.json").read_text(encoding="utf-8")
    )
    damper = truth["car"]["front_law"][1]
    c, ratio, blend = damper["c"], damper["ratio"], damper["blend"]
    for velocity, force in zip(curve["velocity"], curve["after"]["median"], strict=True):
        v = velocity * 0.0254
        if abs(v) < 0.15:
            continue
        beyond = (v * v + blend * blend) ** 0.5 - blend
        true = c * v + c * (ratio - 1.0) / (ratio + 1.0) * beyond
        assert force * 4.4482216152605 == pytest.approx(true, rel=0.03)


def test_what_it_saved_is_reported(diagnosed: Diagnosed, invoke: Command, tmp_path: Path) -> None:
    assert read_saved(diagnosed.file).to_dict() == diagnosed.document
    output = tmp_path / "x.html"
    said = invoke("report", "--from", diagnosed.file, "-o", output)
    assert (said.status, said.err) == (0, "")
    assert said.out.splitlines()[0].startswith("The linear half car lacks unequal compression")
    assert "Missing force of the linear half car" in output.read_text(encoding="utf-8")


def test_a_report_of_both_holds_both_and_can_be_saved(
    diagnosed: Diagnosed, invoke: Command, tmp_path: Path
) -> None:
    output, kept = tmp_path / "x.html", tmp_path / "both.json"
    estimate = DATA / "refused.json"  # the quickest to draw
    said = invoke(
        "report", "--from", diagnosed.file, "--from", estimate, "-o", output, "--json", kept
    )
    assert said.status == 3
    text = output.read_text(encoding="utf-8")
    assert "What is missing?" in text
    assert "Verdict: refused" in text
    assert read_saved(kept).to_dict()["diagnosis"] == diagnosed.document


def test_a_saved_diagnosis_of_other_recordings_is_refused(
    diagnosed: Diagnosed, invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path
) -> None:
    said = invoke(
        "report", stops, "-v", baja, "--from", diagnosed.file, "-o", tmp_path / "x.html"
    )  # fmt: skip
    assert refuse(said, "d.json", "was made of other recordings")
    assert list(tmp_path.iterdir()) == []


def test_a_report_asks_what_it_is_not_given(
    invoke: Command,
    saved: Saved,
    stops: Path,
    baja: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The wiring alone: what a diagnosis finds is asked above."""
    asked: list[tuple[int, int]] = []

    def quick(
        runs: Any, holdout: Any, car: Any, seed: int, progress: Any, which: str
    ) -> DiagnosisResult:
        assert which == "half"
        asked.append((len(runs), len(holdout)))
        return DiagnosisResult("refused", ("it was asked; ask no more",), (), (), car, seed)

    monkeypatch.setattr("bayes_asv.diagnosis.workflow.diagnose", quick)
    words = ("report", stops, "-v", baja, "--from", saved.json_file, "-o", tmp_path / "x.html")
    assert invoke(*words).status == 0
    assert asked == [(1, 0)]
    assert "it was asked" in (tmp_path / "x.html").read_text(encoding="utf-8")
    assert invoke(*words, "--no-diagnosis").status == 0
    assert asked == [(1, 0)]
    assert "it was asked" not in (tmp_path / "x.html").read_text(encoding="utf-8")


def test_one_axle_is_diagnosed_and_reported(
    invoke: Command, refuse: Check, baja: Path, tmp_path: Path
) -> None:
    drive, answer, page = (tmp_path / name for name in ("drive.csv", "d.json", "x.html"))
    words = ("simulate", "--car", "quarter-front", "-v", baja, "--seconds", "1.5", "-o", drive)
    assert invoke(*words).status == 0
    said = invoke("diagnose", drive, "-v", baja, "--json", answer)
    assert (said.status, said.err) == (0, "")
    assert "The linear quarter-front car agrees with the measurement" in said.out
    document = json.loads(answer.read_text(encoding="utf-8"))
    assert (document["schema"], document["car"]) == ("bayes_asv/diagnose/1", "quarter-front")
    assert set(document["parameters_after"]) == {"c_f", "zeta_f"}
    assert invoke("report", "--from", answer, "-o", page).status == 0
    assert "Missing force of the linear quarter-front car" in page.read_text(encoding="utf-8")
    said = invoke("diagnose", drive, "--car", "half", "-v", baja)
    assert refuse(said, "rear_wheel", "--car")


def test_two_of_a_kind_are_refused(diagnosed: Diagnosed, invoke: Command, refuse: Check) -> None:
    said = invoke("report", *2 * ("--from", diagnosed.file), "-o", "x.html")
    assert refuse(said, "one diagnosis", "--from once for each")


def test_a_recording_that_cannot_answer(
    invoke: Command, valved: tuple[Path, Path], baja: Path, tmp_path: Path
) -> None:
    """A fifth of a second of one drive: refused, status 3, and the document is still written."""
    lines = valved[0].read_text(encoding="utf-8").splitlines()
    short = tmp_path / "short.csv"
    short.write_text("\n".join(lines[:83]) + "\n", encoding="utf-8")
    file = tmp_path / "d.json"
    said = invoke("diagnose", short, "-v", baja, "--json", file)
    assert said.status == 3
    document = read_saved(file).to_dict()
    assert document["verdict"] == "refused"
    assert document["reasons"]
    assert said.out.startswith("No answer: these recordings do not allow a diagnosis.\nWhy: ")
    told = invoke("report", "--from", file, "-o", tmp_path / "x.html")
    assert told.status == 3
    assert "What to do instead" in (tmp_path / "x.html").read_text(encoding="utf-8")


def test_one_recording_is_proved_on_its_second_half(
    invoke: Command, bump: Path, baja: Path, tmp_path: Path
) -> None:
    file = tmp_path / "d.json"
    said = invoke("diagnose", bump, "-v", baja, "--json", file)
    assert (said.status, said.err) == (0, "")
    document = read_saved(file).to_dict()
    assert document["effects"] == []  # nothing is hidden in it
    assert document["gap"]["holdout"]["after"] == pytest.approx(
        document["gap"]["holdout"]["floor"], rel=0.15
    )
    note = "the second half of bump-400hz.csv is held out for the validation"
    assert document["warnings"] == [note]
    assert said.sentences[-1] == f"Note: {note}."
    assert document["runs"] == {"fit": ["bump-400hz.csv"], "holdout": ["bump-400hz.csv"]}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("diagnose", "{fit}"), ("--vehicle", "bayes-asv diagnose --help")),
        (("diagnose", "-v", "{car}"), ("REC", "bayes-asv diagnose --help")),
        (("diagnose", "{fit}", "--holdout", "{fit}", "-v", "{car}"), ("each recording once",)),
        (("diagnose", "{fit}", "--holdout", "no.csv", "-v", "{car}"), ("no.csv",)),
        (("diagnose", "{fit}", "-v", "{car}", "--json", "{fit}"), ("would be replaced",)),
        (("estimate", "{fit}", "-v", "{car}", "--with", "rust@rear"), ("is not an effect", "stop")),
        (
            ("estimate", "{fit}", "-v", "{car}", "--with", "bound_rebound"),
            ("is not a place for it", "use bound_rebound@front"),
        ),
        (
            ("estimate", "{fit}", "-v", "{car}", "--with", "bound_rebound@rear", "--below", "9"),
            ("whole band", "bayes-asv estimate --help"),
        ),
        (("estimate", "{fit}", "-v", "{car}", "--model", "best"), ("auto",)),
    ],
    ids=lambda value: " ".join(value)[:50] if isinstance(value, tuple) else None,
)
def test_what_is_wrong_is_said_in_one_sentence(
    invoke: Command,
    refuse: Check,
    valved: tuple[Path, Path],
    baja: Path,
    words: tuple[str, ...],
    expected: tuple[str, ...],
) -> None:
    assert refuse(invoke(*(w.format(fit=valved[0], car=baja) for w in words)), *expected)
