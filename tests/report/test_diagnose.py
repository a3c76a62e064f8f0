"""A diagnosis in words, tables, figures, pages and back from a file."""

from __future__ import annotations

import copy
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pymupdf
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.content import content, limits
from bayes_asv.report.diagnose_figures import diagnose_figures
from bayes_asv.report.diagnose_tables import effect_table, gap_table, model_table, moved_table
from bayes_asv.report.diagnose_words import (
    closed_words,
    diagnose_headline,
    diagnose_steps,
    diagnosis_lines,
    effects_lines,
)
from bayes_asv.report.html import html_report
from bayes_asv.report.pdf import pdf_report
from bayes_asv.report.saved import read_saved
from bayes_asv.report.svg import style
from tests.report.conftest import DATA, HOSTILE, load

Document = dict[str, Any]


def told(verdict: str = "named") -> Document:
    """Tell of a front damper with unlike bound and rebound, or of what the verdict says."""
    document: Document = json.loads((DATA / "diagnosis.json").read_text(encoding="utf-8"))
    document["verdict"] = verdict
    if verdict != "named":
        document["effects"], document["laws"] = [], {}
        document["parameters_after"] = document["parameters_before"]
        document["gap"]["holdout"] = None
    if verdict == "unexplained":
        document["unexplained"].update(present=True, score=12.0)
    if verdict == "agreement":
        document["p_value"] = 0.4
        document["disagreement"].update(time=[], time_run=[], frequency=[], state=None)
    if verdict == "refused":
        document.update(
            reasons=["run.csv is too short; record two seconds"], parameters_before={},
            parameters_after={}, residuals=[], map=None, disagreement=None,
        )  # fmt: skip
        document["gap"]["fit"] = None
    return document


def test_whatever_shows_that_something_is_left_is_told() -> None:
    document = told("unexplained")
    signs = {"score": 12.0, "p_decoy": 1e-4, "rival": -3.0, "p_jitter": 1e-4, "p_memory": 1e-4,
             "ended": "hysteresis"}  # fmt: skip
    silent = {
        "ended": "",
        "score": 0.0,
        "p_decoy": 0.5,
        "rival": None,
        "p_jitter": 0.5,
        "p_memory": 0.5,
    }
    document["unexplained"].update(silent, like="a seat", jitters="rear_wheel", swollen=[])

    def shown() -> str:
        return next(line for line in diagnosis_lines(document) if line.startswith("What shows it"))

    assert "several faint signs" in shown()
    for name, value in signs.items():
        document["unexplained"].update({**silent, name: value})
        assert "several faint signs" not in shown(), name


VERDICTS = ("named", "agreement", "unexplained", "refused")


@pytest.fixture
def named() -> Document:
    return told()


def test_the_headline_says_what_and_how_much_of_the_gap(named: Document) -> None:
    assert diagnose_headline(named) == (
        "Missing: bound and rebound rates that differ at the front. "
        "With it the gap on what was held out falls from 17.7 to 1.04 in/s²; sensor noise alone "
        "leaves 0.999."
    )
    named["gap"]["holdout"].update(after=20.0, closed=-0.3, worse=True)
    assert diagnose_headline(named).endswith("But the gap grew on what was held out.")
    named["gap"]["holdout"] = None
    assert "the gap on the runs fitted falls from" in diagnose_headline(named)
    named["effects"][0]["probability"] = 0.02
    assert diagnose_headline(named).startswith("Perhaps missing: bound and rebound rates")
    named["unexplained"]["present"] = True
    assert "Something else is left without a name." in diagnose_headline(named)


@pytest.mark.parametrize(
    ("share", "words"), [(0.99949, "> 99.9 %"), (0.9989, "99.8 %"), (0.5, "50.0 %"), (None, "–")]
)
def test_a_share_of_a_gap_is_never_rounded_up(share: float | None, words: str) -> None:
    assert closed_words(share) == words


def test_lines_name_effect_size_rates_gap_and_parameters(named: Document) -> None:
    text = "\n".join(diagnosis_lines(named))
    ratio = named["effects"][0]["parameters"]["ratio"]["mean"]
    assert f"ratio {ratio:.4f} (95 %: " in text
    rates = named["laws"]["front"]["rates"]
    assert rates["rebound"]["mean"] / rates["bound"]["mean"] == pytest.approx(ratio, rel=0.01)
    assert "The front damper in lbf·s/in: bound 4.6" in text
    assert "Gap on runs that were held out: 17.7 in/s² before" in text
    assert "Front damping rate: 5.7" in text


def test_gaps_are_told_to_three_digits_with_their_zeros(named: Document) -> None:
    named["gap"]["fit"] |= {"before": 12.24, "after": 1.0013, "floor": 0.9996}
    named["gap"]["holdout"] |= {"before": 1234.0, "after": 0.0504, "floor": 0.0}
    text = "\n".join(diagnosis_lines(named))
    assert "12.2 in/s² before, 1.00 after; sensor noise alone leaves 1.00." in text
    assert "1230 in/s² before, 0.0504 after; sensor noise alone leaves 0." in text


def test_what_cannot_be_told_apart_comes_with_the_drive_that_would(named: Document) -> None:
    effect = named["effects"][0]
    effect["indistinguishable_from"] = [{"name": "coulomb_friction", "where": "front"}]
    line = diagnosis_lines(named)[0]
    assert "these drives cannot tell it from coulomb friction at the front. This would: a" in line
    step = diagnose_steps(named)[0]
    assert step.startswith("To tell bound and rebound rates that differ at the front from coulomb")
    assert effect["drive"] in step


def test_steps_name_the_command_or_where_to_look(named: Document) -> None:
    assert any("--with bound_rebound@front" in step for step in diagnose_steps(named))
    (step,) = [s for s in diagnose_steps(told("unexplained")) if s.startswith("Look for")]
    assert re.search(r"between \d\S* and \d\S* Hz and from \d\.\d+ to \d\.\d+ s of valved", step)
    assert any("--holdout" in s for s in diagnose_steps(told("unexplained")))


def test_what_is_no_part_of_the_car_is_proved_by_a_drive(named: Document) -> None:
    engine = {
        **named["effects"][0],
        "name": "engine_vibration",
        "title": "an engine that shakes the frame",
        "where": None,
        "drive": "the same drive with the engine off",
    }
    proof = "To prove an engine that shakes the frame: the same drive with the engine off."
    assert diagnose_steps({**named, "effects": [engine]})[0] == proof
    both = diagnose_steps({**named, "effects": [engine, *named["effects"]]})
    assert both[0] == proof
    assert any("--with bound_rebound@front" in step for step in both)
    assert not any("engine_vibration" in step for step in both)


def test_where_nothing_has_a_name_no_part_is_to_be_mended() -> None:
    chance = told("unexplained")
    chance["unexplained"] = {**chance["unexplained"], "present": False}
    chance["gap"].update(fit=None, holdout=None)
    again, nearer = diagnose_steps(chance)
    assert again.startswith("Drive the same again")
    assert nearer.startswith("Calibrate")
    assert "part" not in again + nearer
    assert "no more than a little of everything" in diagnose_headline(chance)
    assert "No effect stands out." in diagnosis_lines(chance)[0]


def test_tables_hold_the_numbers_of_the_document(named: Document) -> None:
    effects, gaps, moved = effect_table(named), gap_table(named), moved_table(named)
    assert effects is not None
    assert gaps is not None
    assert moved is not None
    assert effects["rows"][0][:3] == [
        "bound and rebound rates that differ at the front", "> 99.9 %", "ratio",
    ]  # fmt: skip
    for row, key in zip(gaps["rows"], ("fit", "holdout"), strict=True):
        shown = [float(cell) for cell in row[1:4]]
        part = named["gap"][key]
        assert shown == pytest.approx([part["before"], part["after"], part["floor"]], rel=0.006)
    assert len(moved["rows"]) == 6
    assert effect_table(told("agreement")) is None


def test_every_figure_is_there_and_named(named: Document) -> None:
    drawn = diagnose_figures(named)
    assert [f.key for f in drawn] == ["gap", "laws", "moved", "plane", "left-0", "leftband-0"]
    assert diagnose_figures(named) == drawn  # the same document, the same bytes
    for picture in (p for f in drawn for p in f.panels):
        root = ET.fromstring(picture.svg)
        assert root.get("aria-label") == picture.alt
        ids = [e.get("id") for e in root.iter() if e.get("id")]
        assert all(str(i).startswith(picture.key) for i in ids)
        assert len(picture.svg) < 250_000
    assert diagnose_figures(told("refused")) == []
    unexplained = {**told("unexplained"), "residuals": [], "map": None}
    assert [f.key for f in diagnose_figures(unexplained)] == ["gap"]


def test_the_axes_say_which_way_is_positive(named: Document, monkeypatch: Any) -> None:
    """Text is drawn as paths, so the axes themselves are asked."""
    from bayes_asv.report import plots_diagnosis, plots_disagreement

    seen: list[str] = []

    def spy(figure: Any, *rest: Any, **more: Any) -> None:
        seen.extend(f"{a.get_xlabel()} | {a.get_ylabel()}" for a in figure.axes)

    monkeypatch.setattr(plots_diagnosis, "panel", spy)
    monkeypatch.setattr(plots_disagreement, "panel", spy)
    with style():
        plots_diagnosis.laws(named)
        plots_disagreement.planes(named)
    assert seen[0] == (
        "suspension velocity [in/s], extension + | front damper force [lbf]\nagainst extension +"
    )
    assert all(text.count("extension +") == 2 for text in seen)


def test_the_curve_is_the_law_with_its_parameters(named: Document) -> None:
    """The told curve against the law written out again, with the told mean values."""
    curve = named["laws"]["front"]["damper"]
    velocity = np.array(curve["velocity"])
    c = named["parameters_after"]["c_f"]["mean"]
    ratio = named["effects"][0]["parameters"]["ratio"]["mean"]
    share = (ratio - 1.0) / (ratio + 1.0)
    sharp = c * velocity * (1.0 + share * np.sign(velocity))  # the corner's rounding left out
    low, high = (np.array(side) for side in curve["after"]["band95"])
    far = np.abs(velocity) > 10.0
    assert far.sum() > 5
    assert np.all((low <= sharp) & (sharp <= high) | ~far)
    before = np.array(curve["before"]["median"])
    assert before == pytest.approx(named["parameters_before"]["c_f"]["median"] * velocity, rel=1e-4)


def _once(monkeypatch: pytest.MonkeyPatch, document: Document) -> tuple[Document, Document]:
    """Draw once for HTML and PDF: drawing takes longer than all else."""
    drawn = content(document)
    for module in ("html", "pdf"):
        monkeypatch.setattr(f"bayes_asv.report.{module}.content", lambda _: drawn)
    return drawn


@pytest.mark.parametrize("verdict", VERDICTS)
def test_pages_of_every_verdict(verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    page, pictures = _once(monkeypatch, told(verdict))
    figures = [s for s in page["sections"] if s["kind"] == "figure"]
    asked = {p["key"] for s in figures for p in s["panels"]}
    assert asked | {c["gauge"] for c in page["cards"]} - {""} == set(pictures)
    html = html_report({})
    for line in page["headline"]:
        assert line.replace(">", "&gt;").replace("'", "&#39;") in html
    assert ("What to do instead" in html) == (verdict == "refused")
    assert html.count("<figure") == len(figures)
    with pymupdf.open(stream=pdf_report({}), filetype="pdf") as paper:
        text = " ".join(p.get_text() for p in paper)
    assert ("Where the linear half car lacks force" in text) == (verdict != "refused")
    assert ("runs fitted" in text) == (verdict != "refused")


def test_an_estimate_tells_its_diagnosis(named: Document) -> None:
    estimate = load("us")
    del estimate["runs"], estimate["draws"]  # whose figures have tests of their own
    document = {**estimate, "diagnosis": named}
    page, pictures = content(document)
    plain, before = content(estimate)
    assert set(before) < set(pictures)
    titles = [s.get("title") for s in page["sections"]]
    assert titles.index("What is missing?") < titles.index("Where this comes from")
    assert "What is missing?" not in [s.get("title") for s in plain["sections"]]
    assert any("these recordings need more: bound and rebound" in x for x in limits(document))
    assert not any("need more" in x for x in limits({**load("us"), "diagnosis": told("agreement")}))
    assert "Figures of what is missing" in titles


def test_effects_of_an_estimate_are_told(named: Document) -> None:
    effect = {k: named["effects"][0][k] for k in ("name", "where", "title", "parameters")}
    (line,) = effects_lines([effect])
    assert line.startswith("In the model: bound and rebound rates that differ at the front: ratio")
    table = model_table({"effects": [effect]})
    assert table is not None
    assert table["rows"][0][1] == "ratio"
    assert model_table({}) is None


def test_foreign_text_stays_text(named: Document, monkeypatch: pytest.MonkeyPatch) -> None:
    named["vehicle"]["name"] = named["residuals"][0]["source"] = HOSTILE
    named["warnings"] = [HOSTILE]
    named["effects"][0].update(title=HOSTILE, drive=HOSTILE, run=HOSTILE)
    named["effects"][0]["indistinguishable_from"] = [{"name": HOSTILE[:60], "where": "rear"}]
    named["effects"][0]["parameters"][HOSTILE] = named["effects"][0]["parameters"]["ratio"]
    named["disagreement"]["time_run"] = [HOSTILE] * len(named["disagreement"]["time"])
    named["preflight"] = [{"name": HOSTILE, "source": HOSTILE, "samples": 3}]
    _once(monkeypatch, named)
    html = html_report({})
    assert "<script" not in html
    assert "\x1b" not in html
    assert pdf_report({}).startswith(b"%PDF")
    assert "\x1b" not in "".join(diagnosis_lines(named))


def _set(*path: str | int, to: Any) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        inside: Any = document
        for key in path[:-1]:
            inside = inside[key]
        inside[path[-1]] = to

    return change


BROKEN: dict[str, tuple[Callable[[Document], None], str]] = {
    "unknown verdict": (_set("verdict", to="great"), "verdict"),
    "named nothing": (_set("effects", to=[]), "does not say what"),
    "refused without a reason": (_set("verdict", to="refused"), "without a reason"),
    "no front damper": (_set("parameters_after", to={}), "no parameter c_f"),
    "no gap": (_set("gap", "fit", to=None), "no gap"),
    "a negative gap": (_set("gap", "fit", "before", to=-1.0), "gap.fit.before"),
    "probability of 2": (_set("effects", 0, "probability", to=2.0), "effects.0.probability"),
    "effect on the roof": (_set("effects", 0, "where", to="roof"), "effects.0.where"),
    "ends swapped": (
        _set("effects", 0, "parameters", "ratio", "eti95", to=[2.0, 1.0]),
        "effects.0.parameters.ratio",
    ),
    "curve too short": (_set("laws", "front", "damper", "velocity", to=[0.0]), "differ in length"),
    "nothing against": (_set("laws", "front", "damper", "velocity", to=None), "to draw it against"),
    "residual too short": (_set("residuals", 0, "time", to=[0.0, 1.0]), "differ in length"),
    "cell without force": (_set("map", "rear", 0, "force", to=None), "map.rear.0.force"),
    "number beyond": (_set("parameters_after", "c_f", "mean", to=8e52), "parameters_after.c_f"),
    "runs as a text": (_set("runs", "fit", to="run"), "runs.fit"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_file_is_refused_in_one_sentence(tmp_path: Path, kind: str) -> None:
    change, expected = BROKEN[kind]
    document = copy.deepcopy(told())
    change(document)
    file = tmp_path / "d.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_saved(file)
    assert expected in str(caught.value)
    assert "bayes-asv diagnose --json" in str(caught.value)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_what_was_saved_is_read_back(tmp_path: Path, verdict: str) -> None:
    file = tmp_path / "d.json"
    file.write_text(json.dumps(told(verdict)), encoding="utf-8")
    assert read_saved(file) == told(verdict)


def test_a_broken_diagnosis_inside_an_estimate_is_found(tmp_path: Path, named: Document) -> None:
    named["gap"]["fit"]["before"] = "much"
    file = tmp_path / "d.json"
    file.write_text(json.dumps({**load("us"), "diagnosis": named}), encoding="utf-8")
    with pytest.raises(InputError, match=r"diagnosis\.gap\.fit\.before"):
        read_saved(file)
