"""What a report says of one run against another and of replicated recordings."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.page import limits
from bayes_asv.report.render import html_report
from bayes_asv.report.schema import EstimateDocument, read_saved
from bayes_asv.report.sections import predictive_checks, run_consistency
from bayes_asv.report.sections.blocks import Figure
from bayes_asv.report.sections.run_consistency import consistency_lines, consistency_steps
from bayes_asv.report.sections.sampling import sampling_lines
from bayes_asv.report.sections.verdict import headline, next_steps, verdict_lines
from tests.report.conftest import (
    DATA,
    HOSTILE,
    Data,
    data,
    figures,
    figures_of,
    load,
    table,
    without_pictures,
)

SOURCES = ("stops.csv", "bump.csv")
RUNS, CHECKS = "Consistency of the runs", "Posterior predictive checks"
check_limits = predictive_checks.SECTION.limits


def saved(verdict: str) -> Data:
    """Two runs of one car that agree, or the front damper of one 5 % stiffer."""
    parts: Data = json.loads((DATA / "agreement.json").read_text(encoding="utf-8"))
    document = data("two_runs")
    document["agreement"] = parts[verdict]
    for run, checks, alone, source in zip(
        document["runs"], parts["checks"], parts[verdict]["runs"], SOURCES, strict=True
    ):
        run["checks"] = checks
        alone["source"] = run["source"] = source
    if verdict == "disagree":
        document["parameters"] = parts["parameters"]
        document["warnings"] = [parts["warning"]]
        document["diagnostics"]["sampler"] = "random effects"
    return document


@pytest.fixture
def apart() -> EstimateDocument:
    return EstimateDocument.model_validate(saved("disagree"))


@pytest.fixture
def alike() -> EstimateDocument:
    return EstimateDocument.model_validate(saved("agree"))


def forest_plot(document: EstimateDocument) -> Figure:
    return figures_of(run_consistency.SECTION, document)["agreement"]


def with_residual(document: EstimateDocument) -> EstimateDocument:
    """The same with a far too large residual of one run's front chassis."""
    out = document.model_copy(deep=True)
    for check in out.runs[1].checks:
        if check.channel == "front_chassis" and check.of == "residual":
            times = 20.0 if check.band == [0.5, 5.0] else 3.0
            check.observed = times * check.replicated.median
            check.p, check.p_family = 0.0025, 0.00125
    return out


def test_consistent_runs_are_one_sentence(alike: EstimateDocument) -> None:
    lines = consistency_lines(alike)
    assert lines == ["The 2 runs are consistent (p = 0.81)."]
    assert lines[0] in verdict_lines(alike)
    assert not headline(alike).startswith("The runs")
    assert consistency_steps(alike) == []


def test_inconsistent_runs_are_in_the_headline(apart: EstimateDocument) -> None:
    assert headline(apart).startswith("The runs are not consistent. ")
    lines = verdict_lines(apart)
    assert sum("the runs do not agree: the front damping rate" in line for line in lines) == 1
    assert next_steps(apart)[0].startswith("Find out what changed between the runs")
    assert limits(apart)[0].startswith("The runs do not agree: the front damping rate differs")


def test_what_is_unknown_is_not_stated() -> None:
    unknown = saved("agree")
    unknown["agreement"].update(verdict="unknown", p=None)
    lines = consistency_lines(EstimateDocument.model_validate(unknown))
    assert lines[0].startswith("The consistency of the runs could not be tested")
    for kind in ("us", "refused", "not_converged"):
        document = load(kind)
        assert consistency_lines(document) == []
        assert table(document, RUNS) is None
        assert table(document, CHECKS) is None
        assert check_limits(document) == []
        with without_pictures():
            assert "agreement" not in figures(document)
        assert not any("mean car" in line for line in sampling_lines(document.diagnostics))


def test_an_unconverged_estimate_says_nothing_about_runs(apart: EstimateDocument) -> None:
    apart.verdict = "not_converged"
    assert "runs" not in headline(apart)
    assert consistency_steps(apart) == []


def test_the_table_holds_each_runs_own_value(
    apart: EstimateDocument, alike: EstimateDocument
) -> None:
    found = table(apart, RUNS)
    assert found is not None
    rows = {row[0]: row[1:] for row in found.rows}
    assert list(rows) == [
        "stops.csv", "bump.csv", "all, if consistent", "mean car", "prediction for a run",
        "spread from run to run", "p-value",
    ]  # fmt: skip
    own = [float(rows[source][0].split(" ± ")[0]) for source in SOURCES]
    assert own[1] / own[0] == pytest.approx(1.05, rel=0.005)
    assert apart.agreement is not None
    spread = apart.agreement.spread_percent["c_f"]
    numbers = [float(x) for x in re.findall(r"[\d.]+", rows["spread from run to run"][0])]
    assert numbers == pytest.approx([spread.median, *spread.eti95], rel=0.05)
    assert rows["p-value"][0] == "< 0.1 %"
    found = table(alike, RUNS)
    assert found is not None
    assert [row[0] for row in found.rows][2:] == ["all, if consistent", "p-value"]
    assert alike.agreement is not None
    alike.agreement.runs[0].parameters["c_f"].own = None
    found = table(alike, RUNS)
    assert found is not None
    assert found.rows[0][1] == "–"


def test_the_forest_plot_has_a_row_a_run(apart: EstimateDocument, alike: EstimateDocument) -> None:
    for document in (apart, alike):
        (panel,) = forest_plot(document).panels
        assert panel.wide
        ET.fromstring(panel.svg)
    far = apart.model_copy(deep=True)
    for p in far.parameters.values():
        p.nominal = 1e6
    assert forest_plot(far) != forest_plot(apart)
    assert apart.agreement is not None
    apart.agreement.runs = apart.agreement.runs * 40
    (panel,) = forest_plot(apart).panels
    assert len(panel.svg) < 400_000


def test_checks_of_one_run_stand_in_full_and_of_several_in_brief(alike: EstimateDocument) -> None:
    found = table(alike, CHECKS)
    assert found is not None
    assert len(found.rows) == 2  # the smallest p-value of each
    found = table(with_residual(alike), CHECKS)
    assert found is not None
    marked = [row for row in found.rows if row[-1].endswith("✱")]
    assert len(marked) == 3
    assert marked[0][0] == "bump.csv: front residual, rms, body band (0.5 to 5 Hz)"
    alike.runs = alike.runs[:1]
    found = table(alike, CHECKS)
    assert found is not None
    assert len(found.rows) == 20


def test_a_recording_that_the_model_would_not_produce_limits_the_answer(
    alike: EstimateDocument,
) -> None:
    assert check_limits(alike) == []
    (sentence,) = check_limits(with_residual(alike))
    assert sentence.startswith(
        "Posterior predictive check: the front chassis residual is larger in 1 of 2 recordings "
        "than the model and its sensors produce, most clearly in the body band (0.5 to 5 Hz) "
        "of bump.csv: "
    )
    assert sentence.endswith("(p = 0.0013, corrected for all checks of a run).")
    assert sentence in limits(with_residual(alike))
    reading = with_residual(alike)
    reading.runs = reading.runs[1:]
    for check in reading.runs[0].checks:
        check.of = "reading"
    (sentence,) = check_limits(reading)
    assert sentence.startswith(
        "Posterior predictive check: the front chassis reading has more motion than "
    )


def test_a_report_of_it_is_whole(apart: EstimateDocument) -> None:
    apart.draws = {}
    page = html_report(apart)
    assert "<span>The runs are not consistent.</span>" in page
    assert RUNS in page
    assert CHECKS in page
    assert len(re.findall(r'id="agreement"', page)) == 1
    assert "draws are of a mean car" in page
    assert "ensembles" not in page


def test_foreign_names_stay_names(apart: EstimateDocument) -> None:
    assert apart.agreement is not None
    for alone, run in zip(apart.agreement.runs, apart.runs, strict=True):
        alone.source = run.source = HOSTILE
    runs, checks = table(apart, RUNS), table(with_residual(apart), CHECKS)
    assert "<script>alert" not in forest_plot(apart).panels[0].svg
    assert runs is not None
    assert checks is not None
    for row in (*runs.rows, *checks.rows):
        assert all(cell.isprintable() for cell in row)
    assert all(sentence.isprintable() for sentence in check_limits(with_residual(apart)))


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
def test_a_broken_saved_comparison_is_named(tmp_path: Path, change: Any, key: str) -> None:
    path, document = tmp_path / "saved.json", saved("disagree")
    path.write_text(json.dumps(document), encoding="utf-8")
    assert read_saved(path).to_dict()["agreement"]["verdict"] == "disagree"
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(key)):
        read_saved(path)
