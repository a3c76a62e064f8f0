"""A diagnosis in words, tables, figures, pages and back from a file."""

from __future__ import annotations

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
from bayes_asv.models.effects import EFFECTS
from bayes_asv.report import svg
from bayes_asv.report.page import limits, report_page
from bayes_asv.report.render import html_report, pdf_report
from bayes_asv.report.schema import DiagnoseDocument, EstimateDocument, read_saved
from bayes_asv.report.schema.parts import EffectName
from bayes_asv.report.sections import effects, localization
from bayes_asv.report.sections.diagnosis import (
    diagnosis_headline,
    diagnosis_lines,
    diagnosis_steps,
)
from bayes_asv.report.sections.effects import effect_lines, effect_sentence
from bayes_asv.report.sections.simulation_error import reduction_text
from tests.report.conftest import (
    DATA,
    HOSTILE,
    Data,
    data,
    figures,
    load,
    panel_keys,
    sections_of,
    table,
)

NAME = "unequal compression and rebound damping at the front axle"


def saved(verdict: str = "named") -> Data:
    """Data of a front damper with unequal compression and rebound, or of another verdict."""
    document: Data = json.loads((DATA / "diagnosis.json").read_text(encoding="utf-8"))
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


def told(verdict: str = "named") -> DiagnoseDocument:
    return DiagnoseDocument.model_validate(saved(verdict))


def test_all_evidence_of_something_unexplained_is_stated() -> None:
    data = saved("unexplained")
    signs = {"score": 12.0, "p_decoy": 1e-4, "rival": -3.0, "p_jitter": 1e-4, "p_memory": 1e-4,
             "ended": "hysteresis", "missing_bits": ["rear_wheel"],
             "outlier": {"p": 1e-5, "channel": "rear_wheel", "source": "a.csv", "time": 1.25,
                         "readings": 4}}  # fmt: skip
    silent = {"ended": "", "score": 0.0, "p_decoy": 0.5, "rival": None, "p_jitter": 0.5,
              "p_memory": 0.5, "missing_bits": [], "outlier": None}  # fmt: skip
    data["unexplained"].update(silent, like="a seat", jitters="rear_wheel", swollen=[])

    def evidence() -> str:
        lines = diagnosis_lines(DiagnoseDocument.model_validate(data))
        return next(line for line in lines if line.startswith("Evidence: "))

    assert "several weak signs" in evidence()
    for name, value in signs.items():
        data["unexplained"].update({**silent, name: value})
        assert "several weak signs" not in evidence(), name
    data["unexplained"].update(silent, score=12.0, axle="rear", ended="")
    force = "an unknown force at the rear axle"
    assert f"{force} explains the recordings better by 12 nats" in evidence()
    data["unexplained"].update(signs, score=0.0)
    assert "4 readings of rear wheel at 1.25 s in a.csv fit badly" in evidence()
    data["unexplained"].update(silent, score=12.0, axle="rear")
    # documents of earlier versions
    data["unexplained"]["ended"] = "a force of free course at the rear"
    assert evidence() == f"Evidence: {force} explains the data better than any listed effect."


VERDICTS = ("named", "agreement", "unexplained", "refused")


@pytest.fixture
def named() -> DiagnoseDocument:
    return told()


def test_the_headline_says_what_and_how_far_the_error_falls(named: DiagnoseDocument) -> None:
    assert diagnosis_headline(named) == (
        f"The linear half car lacks {NAME}. With it the simulation error on held-out runs falls "
        "from 17.7 to 1.04 in/s²; sensor noise alone leaves 0.999."
    )
    error = named.gap.holdout
    assert error is not None
    error.after, error.closed, error.worse = 20.0, -0.3, True
    worse = "But the simulation error on held-out runs increased."
    assert diagnosis_headline(named).endswith(worse)
    named.gap.holdout = None
    assert "the simulation error on the fitted runs falls from" in diagnosis_headline(named)
    named.effects[0].probability = 0.02
    assert diagnosis_headline(named).startswith("The linear half car may lack unequal compression")
    named.effects[0].probability = 0.8
    assert diagnosis_headline(named).startswith("The linear half car probably lacks unequal")
    named.unexplained.present = True
    assert "Something else remains unexplained." in diagnosis_headline(named)


def test_a_headline_holds_few_effects(named: DiagnoseDocument) -> None:
    named.effects = named.effects * 5
    assert "2 further effects were named. With them the " in diagnosis_headline(named)


@pytest.mark.parametrize(
    ("share", "words"), [(0.99949, "> 99.9 %"), (0.9989, "99.8 %"), (0.5, "50.0 %"), (None, "–")]
)
def test_a_reduction_is_never_rounded_up(share: float | None, words: str) -> None:
    assert reduction_text(share) == words


def test_lines_name_effect_rates_error_and_parameters(named: DiagnoseDocument) -> None:
    text = "\n".join(diagnosis_lines(named))
    ratio = named.effects[0].parameters["ratio"].mean
    assert text.startswith(f"Front damper: rebound damping is {ratio:.4f} (95 %: ")
    assert ") times compression damping; probability > 99.9 %.\n" in text
    rates = named.laws["front"].rates
    assert rates is not None
    assert rates.rebound.mean / rates.bound.mean == pytest.approx(ratio, rel=0.01)
    assert "Front damper: compression 4.6" in text
    assert "Simulation error on held-out runs: 17.7 in/s² before" in text
    assert "Front damping rate: 5.7" in text


def test_an_uncertain_effect_is_qualified(named: DiagnoseDocument) -> None:
    effect = named.effects[0]
    effect.probability = 0.8
    assert effect_sentence(effect).startswith("Probable: Front damper: rebound damping is ")
    effect.probability = 0.3
    assert effect_sentence(effect).startswith("Possible: Front damper: rebound damping is ")
    effect.where = "both"
    assert effect_sentence(effect).startswith("Possible: Both dampers: rebound damping is ")


def test_every_listed_effect_is_stated_with_all_its_numbers(named: DiagnoseDocument) -> None:
    value = named.effects[0].parameters["ratio"]
    for effect in EFFECTS.values():
        shown = {p.name: value for p in effect.parameters if not p.shape}
        where = next((w for w in effect.allowed_places if w), None)
        sentence = effect_sentence(
            named.effects[0].model_copy(
                update={"name": effect.name, "where": where, "title": effect.title,
                        "parameters": shown}
            )
        )  # fmt: skip
        assert sentence.count("(95 %: ") == len(shown), sentence
        assert "{" not in sentence


def test_an_effect_without_a_sentence_of_its_own_is_stated(named: DiagnoseDocument) -> None:
    effect = named.effects[0].model_copy(update={"name": "other", "title": "something else"})
    assert effect_sentence(effect).startswith("Something else at the front axle: ratio 1.4")


def test_errors_have_three_digits_with_their_zeros(named: DiagnoseDocument) -> None:
    fit, held = named.gap.fit, named.gap.holdout
    assert fit is not None
    assert held is not None
    fit.before, fit.after, fit.floor = 12.24, 1.0013, 0.9996
    held.before, held.after, held.floor = 1234.0, 0.0504, 0.0
    text = "\n".join(diagnosis_lines(named))
    assert "12.2 in/s² before, 1.00 in/s² after; sensor noise alone leaves 1.00 in/s²." in text
    assert "1230 in/s² before, 0.0504 in/s² after; sensor noise alone leaves 0 in/s²." in text


def test_indistinguishable_effects_come_with_the_drive_that_separates_them(
    named: DiagnoseDocument,
) -> None:
    effect = named.effects[0]
    effect.indistinguishable_from = [EffectName(name="coulomb_friction", where="front")]
    line = diagnosis_lines(named)[0]
    assert "cannot distinguish it from coulomb friction at the front axle; to tell them" in line
    step = diagnosis_steps(named)[0]
    assert step.startswith(f"To distinguish {NAME} from coulomb")
    assert effect.drive in step


def test_steps_name_the_command_or_where_to_look(named: DiagnoseDocument) -> None:
    assert any("--with bound_rebound@front" in step for step in diagnosis_steps(named))
    (step,) = [s for s in diagnosis_steps(told("unexplained")) if s.startswith("Look for")]
    assert re.search(r"between \d\S* and \d\S* Hz and from \d\.\d+ to \d\.\d+ s of valved", step)
    assert any("--holdout" in s for s in diagnosis_steps(told("unexplained")))


def test_what_is_no_part_of_the_car_is_confirmed_by_a_drive(named: DiagnoseDocument) -> None:
    engine = named.effects[0].model_copy(
        update={
            "name": "engine_vibration", "title": "an engine that shakes the frame", "where": None,
            "drive": "the same drive with the engine off",
        }
    )  # fmt: skip
    proof = "To confirm an engine that shakes the frame: the same drive with the engine off."
    damper = named.effects
    named.effects = [engine]
    assert diagnosis_steps(named)[0] == proof
    named.effects = [engine, *damper]
    both = diagnosis_steps(named)
    assert both[0] == proof
    assert any("--with bound_rebound@front" in step for step in both)
    assert not any("engine_vibration" in step for step in both)


def test_where_nothing_is_named_no_part_is_to_be_inspected() -> None:
    chance = told("unexplained")
    chance.unexplained.present = False
    chance.gap.fit = chance.gap.holdout = None
    again, nearer = diagnosis_steps(chance)
    assert again.startswith("Repeat the drive")
    assert nearer.startswith("Calibrate")
    assert "part" not in again + nearer
    assert "within the usual tolerances" in diagnosis_headline(chance)
    assert "No effect stands out." in diagnosis_lines(chance)[0]


def test_tables_hold_the_numbers_of_the_document(named: DiagnoseDocument) -> None:
    found, errors = table(named, "Named effects"), table(named, "Simulation error")
    parameters = table(named, "Parameters before and after")
    assert found is not None
    assert errors is not None
    assert parameters is not None
    assert list(found.rows[0][:3]) == [NAME, "> 99.9 %", "ratio"]
    for row, error in zip(errors.rows, (named.gap.fit, named.gap.holdout), strict=True):
        assert error is not None
        shown = [float(cell) for cell in row[1:4]]
        assert shown == pytest.approx([error.before, error.after, error.floor], rel=0.006)
    assert len(parameters.rows) == 6
    assert table(told("agreement"), "Named effects") is None


def test_every_figure_is_there_and_named(named: DiagnoseDocument) -> None:
    drawn = figures(named)
    assert list(drawn) == ["laws", "gap", "moved", "plane", "left-0"]
    assert figures(named) == drawn  # the same document, the same bytes
    for picture in (p for f in drawn.values() for p in f.panels):
        root = ET.fromstring(picture.svg)
        assert root.get("aria-label") == picture.alt
        ids = [e.get("id") for e in root.iter() if e.get("id")]
        assert all(str(i).startswith(picture.key) for i in ids)
        assert len(picture.svg) < 250_000
    assert figures(told("refused")) == {}
    unexplained = {**saved("unexplained"), "residuals": [], "map": None}
    assert list(figures(DiagnoseDocument.model_validate(unexplained))) == ["gap"]


def test_the_axes_say_which_way_is_positive(
    named: DiagnoseDocument, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Text is drawn as paths, so the axes themselves are asked."""
    seen: list[str] = []

    def spy(figure: Any, *rest: Any, **more: Any) -> svg.Panel:
        seen.extend(f"{a.get_xlabel()} | {a.get_ylabel()}" for a in figure.axes)
        return svg.Panel("", "", "")

    monkeypatch.setattr(svg, "panel", spy)
    named.residuals = []
    with svg.style():
        for section in (effects.SECTION, localization.SECTION):
            assert list(section.content(named))
    assert seen[0] == (
        "suspension velocity [in/s], extension + | front damper force [lbf]\nagainst extension +"
    )
    assert all(text.count("extension +") == 2 for text in seen)


def test_the_curve_is_the_law_with_its_parameters(named: DiagnoseDocument) -> None:
    """The told curve against the law written out again, with the told mean values."""
    curve = named.laws["front"].damper
    assert curve is not None
    velocity = np.array(curve.velocity)
    c = named.parameters_after["c_f"].mean
    ratio = named.effects[0].parameters["ratio"].mean
    share = (ratio - 1.0) / (ratio + 1.0)
    sharp = c * velocity * (1.0 + share * np.sign(velocity))  # the corner's rounding left out
    low, high = (np.array(side) for side in curve.after.band95)
    far = np.abs(velocity) > 10.0
    assert far.sum() > 5
    assert np.all((low <= sharp) & (sharp <= high) | ~far)
    median = named.parameters_before["c_f"].median
    assert median is not None
    assert np.array(curve.before.median) == pytest.approx(median * velocity, rel=1e-4)


def _once(monkeypatch: pytest.MonkeyPatch, document: DiagnoseDocument) -> dict[str, Any]:
    """Draw once for HTML and PDF: drawing takes longer than all else."""
    drawn = report_page(document)
    monkeypatch.setattr("bayes_asv.report.render.report_page", lambda _: drawn)
    return {**drawn[0], "pictures": drawn[1]}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_pages_of_every_verdict(verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    document = told(verdict)
    page = _once(monkeypatch, document)
    shown = [s for s in sections_of(page) if s["kind"] == "figure"]
    shown += [page["overview"]] if page["overview"] else []
    assert panel_keys(page) == set(page["pictures"])
    html = html_report(document)
    for line in page["headline"]:
        assert line.replace(">", "&gt;").replace("'", "&#39;") in html
    assert ("What to do instead" in html) == (verdict == "refused")
    assert html.count("<figure") == len(shown)
    with pymupdf.open(stream=pdf_report(document), filetype="pdf") as paper:
        text = " ".join(p.get_text() for p in paper)
    assert ("Missing force of the linear half car" in text) == (verdict != "refused")
    assert ("fitted runs" in text) == (verdict != "refused")


def test_an_estimate_contains_its_diagnosis(named: DiagnoseDocument) -> None:
    estimate = data("us")
    del estimate["runs"], estimate["draws"]  # whose figures have tests of their own
    alone = EstimateDocument.model_validate(estimate)
    document = alone.model_copy(update={"diagnosis": named})
    page, pictures = report_page(document)
    plain, before = report_page(alone)
    assert set(before) < set(pictures)
    assert "What is missing?" in [s["title"] for s in page["sections"]]
    assert page["appendix"][-1]["title"] == "Provenance"
    assert "What is missing?" not in [s["title"] for s in sections_of(plain)]
    assert any(f"but the recordings show {NAME}." in x for x in limits(document))
    refused = alone.model_copy(update={"diagnosis": told("refused")})
    (text,) = [s for s in report_page(refused)[0]["sections"] if s["title"] == "What is missing?"]
    assert "Why: run.csv is too short; record two seconds." in text["lines"]
    agreement = load("us").model_copy(update={"diagnosis": told("agreement")})
    assert not any("the recordings show" in x for x in limits(agreement))
    with_effect = document.model_copy(update={"effects": named.effects})
    assert not any("the recordings show" in x for x in limits(with_effect))


def test_effects_of_an_estimate_are_stated(named: DiagnoseDocument) -> None:
    (line,) = effect_lines(named.effects)
    assert line.startswith("In the model: Front damper: rebound damping is 1.4")
    document = load("us")
    assert table(document, "Effects in the model") is None
    document.effects = [*named.effects]
    found = table(document, "Effects in the model")
    assert found is not None
    assert found.rows[0][1] == "ratio"


def test_foreign_text_stays_text(monkeypatch: pytest.MonkeyPatch) -> None:
    data = saved()
    data["vehicle"]["name"] = data["residuals"][0]["source"] = HOSTILE
    data["warnings"] = [HOSTILE]
    data["effects"][0].update(name="other", title=HOSTILE, drive=HOSTILE, run=HOSTILE)
    data["effects"][0]["indistinguishable_from"] = [{"name": HOSTILE[:60], "where": "rear"}]
    data["effects"][0]["parameters"][HOSTILE] = data["effects"][0]["parameters"]["ratio"]
    data["disagreement"]["time_run"] = [HOSTILE] * len(data["disagreement"]["time"])
    data["preflight"] = [{"name": HOSTILE, "source": HOSTILE, "samples": 3}]
    document = DiagnoseDocument.model_validate(data)
    _once(monkeypatch, document)
    html = html_report(document)
    assert "<script" not in html
    assert "\x1b" not in html
    assert pdf_report(document).startswith(b"%PDF")
    assert "\x1b" not in "".join(diagnosis_lines(document))


def _set(*path: str | int, to: Any) -> Callable[[Data], None]:
    def change(document: Data) -> None:
        inside: Any = document
        for key in path[:-1]:
            inside = inside[key]
        inside[path[-1]] = to

    return change


BROKEN: dict[str, tuple[Callable[[Data], None], str]] = {
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
    document = saved()
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
    file.write_text(json.dumps(saved(verdict)), encoding="utf-8")
    assert read_saved(file).to_dict() == saved(verdict)


def test_a_broken_diagnosis_inside_an_estimate_is_found(tmp_path: Path) -> None:
    broken = saved()
    broken["gap"]["fit"]["before"] = "much"
    file = tmp_path / "d.json"
    file.write_text(json.dumps({**data("us"), "diagnosis": broken}), encoding="utf-8")
    with pytest.raises(InputError, match=r"diagnosis\.gap\.fit\.before"):
        read_saved(file)
