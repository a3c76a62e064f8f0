"""What a report says of one run against another and of replicated recordings."""

from __future__ import annotations

import copy
import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.consistency_tables import agreement_table, check_table
from bayes_asv.report.consistency_words import (
    agreement_lines,
    agreement_steps,
    band_words,
    by_distance,
    check_limits,
    independent_lines,
    spread_words,
)
from bayes_asv.report.content import limits
from bayes_asv.report.figures import figures
from bayes_asv.report.html import Document, html_report
from bayes_asv.report.plots_consistency import forest
from bayes_asv.report.saved import read_saved
from bayes_asv.report.words import headline, next_steps, verdict_lines
from tests.report.conftest import DATA, HOSTILE, load

SOURCES = ("stops.csv", "bump.csv")


def told(verdict: str) -> Document:
    """Two runs of one car that agree, or the front damper of one 5 % stiffer."""
    data: dict[str, Any] = json.loads((DATA / "agreement.json").read_text(encoding="utf-8"))
    document = load("two_runs")
    document["agreement"] = data[verdict]
    for run, checks, alone, source in zip(
        document["runs"], data["checks"], data[verdict]["runs"], SOURCES, strict=True
    ):
        run["checks"] = checks
        alone["source"] = run["source"] = source
    if verdict == "disagree":
        document["parameters"] = data["parameters"]
        document["warnings"] = [data["warning"]]
        document["diagnostics"]["sampler"] = "random effects"
    return document


@pytest.fixture
def apart() -> Document:
    return told("disagree")


@pytest.fixture
def alike() -> Document:
    return told("agree")


def spoilt(document: Document) -> Document:
    """The same with far too much left of one run's front chassis."""
    out = copy.deepcopy(document)
    for check in out["runs"][1]["checks"]:
        if check["channel"] == "front_chassis" and check["of"] == "residual":
            times = 20.0 if check["band"] == [0.5, 5.0] else 3.0
            check.update(observed=times * check["replicated"]["median"], p=0.0025, p_family=0.00125)
    return out


def test_runs_that_agree_are_said_to_in_one_sentence(alike: Document) -> None:
    lines = agreement_lines(alike)
    assert lines == [
        "The 2 runs agree: of runs of an unchanged car, 81 % would differ more than these do."
    ]
    assert lines[0] in verdict_lines(alike)
    assert not headline(alike).startswith("The runs")
    assert agreement_steps(alike) == []


def test_runs_that_disagree_are_told_first(apart: Document) -> None:
    assert headline(apart).startswith("The runs do not agree. ")
    lines = verdict_lines(apart)
    assert sum("the runs do not agree: the front damping rate" in line for line in lines) == 1
    assert next_steps(apart)[0].startswith("Find out what changed between the runs")
    assert limits(apart)[0].startswith("The runs do not agree: the front damping rate differs")


def test_what_cannot_be_told_is_not_told(alike: Document) -> None:
    alike["agreement"].update(verdict="unknown", p=None)
    assert agreement_lines(alike)[0].startswith("Whether the runs agree cannot be told")
    for kind in ("us", "refused", "not_converged"):
        document = load(kind)
        assert agreement_lines(document) == []
        assert agreement_table(document) is None
        assert check_table(document) is None
        assert check_limits(document) == []
        assert forest(document) is None
        assert independent_lines(document["diagnostics"]) == []


def test_an_answer_that_did_not_converge_does_not_pose_as_a_finding(apart: Document) -> None:
    apart["verdict"] = "not_converged"
    assert "runs" not in headline(apart)
    assert agreement_steps(apart) == []


def test_the_table_holds_each_runs_own_value(apart: Document, alike: Document) -> None:
    table = agreement_table(apart)
    assert table is not None
    rows = {row[0]: row[1:] for row in table["rows"]}
    assert list(rows) == [
        "stops.csv", "bump.csv", "all, if alike", "mean car", "a run to come",
        "spread from run to run", "probability, if alike",
    ]  # fmt: skip
    own = [float(rows[source][0].split(" ± ")[0]) for source in SOURCES]
    assert own[1] / own[0] == pytest.approx(1.05, rel=0.005)
    assert rows["spread from run to run"][0] == spread_words(
        apart["agreement"]["spread_percent"]["c_f"]
    )
    assert rows["probability, if alike"][0] == "< 0.1 %"
    table = agreement_table(alike)
    assert table is not None
    assert [row[0] for row in table["rows"]][2:] == ["all, if alike", "probability, if alike"]
    alike["agreement"]["runs"][0]["parameters"]["c_f"].pop("own")
    table = agreement_table(alike)
    assert table is not None
    assert table["rows"][0][1] == "–"


def test_the_forest_has_a_row_a_run(apart: Document, alike: Document) -> None:
    for document in (apart, alike):
        panel = forest(document)
        assert panel is not None
        assert panel.wide
        ET.fromstring(panel.svg)
    apart.update(draws={}, runs=[])
    assert [figure.key for figure in figures(apart)] == ["agreement"]
    far = copy.deepcopy(apart)
    for p in far["parameters"].values():
        p["nominal"] = 1e6
    assert forest(far) != forest(apart)
    many = copy.deepcopy(apart)
    many["agreement"]["runs"] = many["agreement"]["runs"] * 40
    panel = forest(many)
    assert panel is not None
    assert len(panel.svg) < 400_000


def test_checks_of_one_run_stand_in_full_and_of_several_in_brief(alike: Document) -> None:
    table = check_table(alike)
    assert table is not None
    assert len(table["rows"]) == 2  # the farthest out of each
    spoilt_table = check_table(spoilt(alike))
    assert spoilt_table is not None
    marked = [row for row in spoilt_table["rows"] if row[-1].endswith("✱")]
    assert len(marked) == 3
    assert marked[0][0] == "bump.csv: front residual, rms, body band (0.5 to 5 Hz)"
    alike["runs"] = alike["runs"][:1]
    table = check_table(alike)
    assert table is not None
    assert len(table["rows"]) == 20


def test_a_recording_that_the_model_would_not_make_limits_the_answer(alike: Document) -> None:
    assert check_limits(alike) == []
    (sentence,) = check_limits(spoilt(alike))
    assert sentence.startswith(
        "Predictive check: more of the front chassis' motion is left unexplained in 1 of 2 "
        "recordings than the half car and its sensors would make, most clearly in the body band "
        "(0.5 to 5 Hz) in bump.csv: "
    )
    assert sentence.endswith("(probability 0.1 %, all checks of a run counted).")
    assert sentence in limits(spoilt(alike))
    reading = spoilt(alike)
    for check in reading["runs"][1]["checks"]:
        check["of"] = "reading"
    reading["runs"] = reading["runs"][1:]
    (sentence,) = check_limits(reading)
    assert sentence.startswith("Predictive check: more was measured at the front chassis than ")


def test_checks_are_ordered_by_how_far_out_they_are(alike: Document) -> None:
    ordered = by_distance(spoilt(alike)["runs"][1]["checks"])
    assert ordered[0]["band"] == [0.5, 5.0]
    assert [c["p_family"] for c in ordered] == sorted(c["p_family"] for c in ordered)
    assert band_words(ordered[0]) == "rms, body band (0.5 to 5 Hz)"


def test_a_report_of_it_is_whole(apart: Document) -> None:
    apart["draws"] = {}
    page = html_report(apart)
    assert "<span>The runs do not agree.</span>" in page
    assert "One run against another" in page
    assert "Would the model make such recordings?" in page
    assert len(re.findall(r'id="agreement"', page)) == 1
    assert "draws are of a mean car" in page
    assert "ensembles" not in page


def test_foreign_names_stay_names(apart: Document) -> None:
    for run in (*apart["agreement"]["runs"], *apart["runs"]):
        run["source"] = HOSTILE
    panel, table, checks = forest(apart), agreement_table(apart), check_table(spoilt(apart))
    assert panel is not None
    assert "<script>alert" not in panel.svg
    assert table is not None
    assert checks is not None
    for row in (*table["rows"], *checks["rows"]):
        assert all(cell.isprintable() for cell in row)
    assert all(sentence.isprintable() for sentence in check_limits(spoilt(apart)))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (lambda d: d["agreement"].update(verdict="perhaps"), "agreement.verdict"),
        (lambda d: d["agreement"]["mean_car"].pop("c_r"), "agreement"),
        (lambda d: d["agreement"]["next_run"].clear(), "agreement"),
        (lambda d: d["agreement"]["runs"][0]["parameters"].update(x={}), "agreement.runs.0"),
        (lambda d: d["runs"][0]["checks"][0].update(p=1.5), "runs.0.checks.0.p"),
        (lambda d: d["runs"][1]["checks"][3]["replicated"].pop("eti95"), "runs.1.checks.3"),
    ],
    ids=["verdict", "no mean car", "no run to come", "odd quantity", "probability", "no range"],
)
def test_a_broken_saved_comparison_is_named(
    apart: Document, tmp_path: Path, change: Any, key: str
) -> None:
    path = tmp_path / "saved.json"
    path.write_text(json.dumps(apart), encoding="utf-8")
    assert read_saved(path)["agreement"]["verdict"] == "disagree"
    change(apart)
    path.write_text(json.dumps(apart), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(key)):
        read_saved(path)
