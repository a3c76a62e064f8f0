"""What a report says of an error budget."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.page import limits, report_page
from bayes_asv.report.schema import EstimateDocument, read_saved
from bayes_asv.report.schema.estimate import Fault, Measure
from bayes_asv.report.sections import uncertainty_budget, undeclared_faults
from bayes_asv.report.sections.blocks import Text
from bayes_asv.report.sections.uncertainty_budget import budget_steps, remedy_sentence, sd_text
from bayes_asv.report.sections.undeclared_faults import fault_text
from bayes_asv.report.sections.verdict import next_steps
from tests.report.conftest import (
    blocks,
    data,
    figures_of,
    load,
    sections_of,
    table,
    without_pictures,
)

ANSWERS = ("c_f", "c_r", "i", "k_g")
TITLE, FAULTS = "Uncertainty budget", "Effect of undeclared faults"

MASS = {
    "what": "m", "now_sd_percent": 1.0, "needed_sd_percent": 0.4697, "now_sd": 0.01294,
    "needed_sd": 0.006078, "unit": "lbf*s^2/in",
}  # fmt: skip
SPRING = {**MASS, "what": "k_f", "needed_sd_percent": 1.5, "needed_sd": 1.5, "unit": "lbf/in"}


@pytest.fixture
def document() -> EstimateDocument:
    return load("budget")


def only(name: str) -> EstimateDocument:
    """Leave one answer in the budget."""
    saved = data("budget")
    for other in {*ANSWERS} - {name}:
        del saved["width"][other]
    saved["width"]["faults"] = {}
    return EstimateDocument.model_validate(saved)


def halving_lines(document: EstimateDocument) -> list[str]:
    (text,) = [
        block for block in uncertainty_budget.SECTION.content(document) if isinstance(block, Text)
    ]
    assert text.title == "How to halve each uncertainty"
    return list(text.lines)


def budget_limits(document: EstimateDocument) -> list[str]:
    return [
        *uncertainty_budget.SECTION.limits(document), *undeclared_faults.SECTION.limits(document)
    ]  # fmt: skip


def test_the_first_page_names_the_main_causes(document: EstimateDocument) -> None:
    mass, noise, wheelbase, sensor = limits(document)
    assert mass == (
        "The sprung mass, given to ±1 %, causes 91 to 92 % of the variance of the front damping "
        "rate, the rear damping rate and the pitch inertia: if it were exact, they would be known "
        "to ±0.14 %, ±0.11 % and ±0.089 % instead of ±0.97 %, ±0.97 % and ±0.97 %."
    )
    assert noise.startswith(
        "Noise in the recordings causes 100 % of the variance of the radius of gyration; the "
        "largest part, "
    )
    assert wheelbase == (
        "The wheelbase is given as exact: if it were 1 % larger, the pitch inertia would be "
        "2 % too low (2.1 sd)."
    )
    assert sensor.startswith("Of the sensor faults that the residuals would not show, a ")


def test_without_a_budget_nothing_is_guessed() -> None:
    for kind in ("us", "refused", "not_converged"):
        document = load(kind)
        assert budget_limits(document) == []
        assert budget_steps(document) == []
        assert table(document, TITLE) is None
        assert table(document, FAULTS) is None
        assert not any("mass" in limit for limit in limits(document))


def test_the_next_step_is_the_measure_that_halves(document: EstimateDocument) -> None:
    (step,) = budget_steps(document)
    assert re.fullmatch(
        r"Weigh the car to ±0\.4\d % \(±2\.\d lbm; now ±1 %\): this halves the "
        r"uncertainty of the front damping rate, the rear damping rate and the pitch inertia\.",
        step,
    )
    assert step in next_steps(document)
    assert document.width is not None
    needed = min(
        document.width.entries[name].halve[0].measures[0].needed_sd_percent
        for name in ("c_f", "c_r", "i")
    )
    assert sd_text(needed) in step  # the tightest of the three


def test_a_narrow_answer_asks_for_nothing() -> None:
    assert budget_steps(only("k_g")) == []
    assert "radius of gyration" in halving_lines(only("k_g"))[0].lower()


def test_a_wide_answer_gets_the_computed_advice_alone(document: EstimateDocument) -> None:
    document.parameters["c_f"].sd = 0.3 * document.parameters["c_f"].mean
    steps = next_steps(document)
    assert any(step.startswith("Weigh the car") for step in steps)
    assert not any("recording over a higher" in step for step in steps)


@pytest.mark.parametrize(
    ("measures", "names", "runs", "text"),
    [
        ([MASS], ["c_f"], 1,
         "Weigh the car to ±0.47 % (±2.3 lbm; now ±1 %): this halves the uncertainty of "
         "the front damping rate."),
        ([{"what": "runs", "further": 4}], ["k_g"], 1,
         "Record four more runs like this one: this halves the uncertainty of the radius of "
         "gyration."),
        ([{"what": "runs", "further": 1}], ["k_g"], 3,
         "Record one more run like these: this halves the uncertainty of the radius of gyration."),
        ([MASS, SPRING, {"what": "runs", "further": 12}], ["c_f", "i"], 2,
         "Weigh the car to ±0.47 % (±2.3 lbm; now ±1 %), measure the front spring rate "
         "to ±1.5 % (±1.5 lbf/in; now ±1 %) and record 12 more runs like these: this halves the "
         "uncertainty of the front damping rate and the pitch inertia."),
    ],
)  # fmt: skip
def test_remedies_in_words(
    measures: list[dict[str, Any]], names: list[str], runs: int, text: str
) -> None:
    assert remedy_sentence([Measure(**m) for m in measures], names, runs) == text


def test_what_would_halve_each_uncertainty() -> None:
    saved = data("budget")
    lines = halving_lines(EstimateDocument.model_validate(saved))
    assert len(lines) == 4
    assert lines[0].startswith("Front damping rate, now ±0.97 %: weigh the car to ±0.47 %")
    assert lines[0].endswith("No number of further runs is enough.")
    assert lines[3].endswith("No measurement of a given value is enough.")
    saved["width"]["c_f"]["halve"] = [{"measures": [MASS, SPRING]}]
    lines = halving_lines(EstimateDocument.model_validate(saved))
    assert lines[0].endswith("No single measure is enough.")
    saved["width"]["c_f"]["halve"] = []
    lines = halving_lines(EstimateDocument.model_validate(saved))
    assert "no measurement and no number of further runs is enough" in lines[0]


@pytest.mark.parametrize(
    ("kind", "where", "size", "shows", "whole", "brief"),
    [
        ("gain", "front_wheel", 0.01, False,
         "a front wheel sensor that reads 1 % too much", "front wheel: 1 % too much"),
        ("delay", "rear_chassis", 7.3e-5, True,
         "a rear chassis sensor sampled 0.073 ms later", "rear chassis: ≤ 0.073 ms later"),
        ("bandwidth", "rear_wheel", 0.041, True,
         "a rear wheel sensor with 4.1 % more bandwidth", "rear wheel: ≤ 4.1 % more bandwidth"),
        ("place", "front_chassis", 0.0254, False,
         "a front chassis sensor 1 in ahead of its axle", "front chassis: 1 in ahead of axle"),
        ("given", "l", 0.01, False, "1 % larger", "wheelbase: 1 % larger"),
    ],
)  # fmt: skip
def test_faults_in_words(
    kind: str, where: str, size: float, shows: bool, whole: str, brief: str
) -> None:
    fault = Fault(kind=kind, where=where, size=size, larger_shows=shows, shift={})
    assert fault_text(fault, "US") == whole
    assert fault_text(fault, "US", brief=True) == brief


def test_places_are_in_the_units_of_the_car() -> None:
    fault = Fault(kind="place", where="rear_chassis", size=0.0254, larger_shows=False, shift={})
    assert fault_text(fault, "SI") == "a rear chassis sensor 25 mm ahead of its axle"


def test_the_table_has_every_share_that_matters(document: EstimateDocument) -> None:
    budget = table(document, TITLE)
    assert budget is not None
    names = [row[0] for row in budget.rows]
    assert names[:2] == ["Standard deviation", "Sprung mass"]
    assert names[-1] == "Twice as many runs"
    assert "Wheelbase" not in names  # exact: it has no share
    for column in range(1, 5):
        shares = [float(m[1]) for row in budget.rows if (m := re.match(r"(\d+) %", row[column]))]
        assert 95.0 <= sum(shares) <= 103.0  # rounded, and without what is below one percent
    assert budget.rows[1][1] == "91 % (±0.14 %)"


def test_with_coloured_residuals_the_recordings_are_one_source() -> None:
    saved = data("budget")
    saved["width"]["white"] = False
    for name in ANSWERS:
        saved["width"][name]["noises"] = {}
        saved["width"][name]["better_sd_percent"] = {}
    document = EstimateDocument.model_validate(saved)
    budget = table(document, TITLE)
    assert budget is not None
    names = [row[0] for row in budget.rows]
    assert "Recordings" in names
    assert not any("wheel" in name for name in names)
    assert "Motion that the model does not explain causes 100 % of the variance of the " in (
        " ".join(budget_limits(document))
    )
    assert figures_of(uncertainty_budget.SECTION, document)["width"].panels[0].wide


def test_a_budget_that_the_draws_contradict_is_left_out() -> None:
    saved = data("budget")
    saved["width"]["c_f"]["posterior_sd_percent"] = 3.0
    document = EstimateDocument.model_validate(saved)
    text = " ".join(budget_limits(document))
    assert "The uncertainty of the front damping rate cannot be divided among its sources" in text
    assert "the variance of the rear damping rate and the pitch inertia" in text
    budget = table(document, TITLE)
    assert budget is not None
    assert "front damping rate" not in budget.columns


def test_every_fault_has_a_row_with_its_sign(document: EstimateDocument) -> None:
    found = table(document, FAULTS)
    assert found is not None
    assert document.width is not None
    assert len(found.rows) == len(document.width.faults) == 15
    for row, fault in zip(found.rows, document.width.faults.values(), strict=True):
        for cell, name in zip(row[1:], ANSWERS, strict=True):
            shift = fault.shift[name]
            match = re.fullmatch(r"([+−]?)([\d.]+) % \((\d+\.\d) sd\)", cell)
            assert match, cell
            assert float(match[2]) == pytest.approx(abs(shift.percent), rel=0.06, abs=0.006)
            assert float(match[3]) == pytest.approx(abs(shift.sd), abs=0.051)
            if match[1]:
                assert (match[1] == "−") == (shift.percent < 0.0)


def test_the_report_holds_tables_figure_and_remedies(document: EstimateDocument) -> None:
    with without_pictures():
        page, pictures = report_page(document)
    titles = [section["title"] for section in sections_of(page)]
    for title in (TITLE, FAULTS, "How to halve each uncertainty", "Sources of uncertainty"):
        assert title in titles
    assert "width" in pictures
    shown = [limit.replace("\u00a0", " ") for limit in page["limits"]]
    assert shown == limits(document, "precision")
    assert set(shown) <= set(limits(document))


def test_a_saved_budget_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(data("budget")), encoding="utf-8")
    assert read_saved(file).to_dict() == data("budget")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("c_f", "sd_percent"), -1.0),
        (("c_f", "shares"), {}),
        (("c_f", "halve"), [{"measures": []}]),
        (("c_f", "halve"), [{"measures": [{"what": "luck"}]}]),
        (("runs",), "two"),
        (("faults", "gain front_wheel", "kind"), "magic"),
        (("faults", "gain front_wheel", "where"), "roof"),
        (("faults", "gain front_wheel", "size"), 0.0),
    ],
)
def test_a_broken_budget_is_refused_by_its_key(
    tmp_path: Path, path: tuple[str, ...], value: Any
) -> None:
    saved = copy.deepcopy(data("budget"))
    part = saved["width"]
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(saved), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_saved(file)
    assert "width." + path[0] in str(caught.value)


def test_foreign_words_in_a_budget_stay_words() -> None:
    saved = data("budget")
    saved["width"]["c_f"]["shares"]["<script>\x1b"] = 2.0
    document = EstimateDocument.model_validate(saved)
    text = " ".join(limits(document))
    assert "The <script>� causes 200 % of the variance of the front damping rate." in text
    assert "\x1b" not in text
    with without_pictures():
        assert blocks(document)
