"""What a report says of an error budget."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.budget_tables import budget_table, fault_table
from bayes_asv.report.budget_words import (
    fault_words,
    halving_lines,
    remedy_sentence,
    sd_words,
    width_limits,
    width_steps,
)
from bayes_asv.report.content import content, limits
from bayes_asv.report.html import Document
from bayes_asv.report.plots_budget import budget_bars
from bayes_asv.report.saved import read_saved
from bayes_asv.report.svg import style
from bayes_asv.report.words import next_steps

MASS = {
    "what": "m", "now_sd_percent": 1.0, "needed_sd_percent": 0.4697, "now_sd": 0.01294,
    "needed_sd": 0.006078, "unit": "lbf*s^2/in",
}  # fmt: skip
SPRING = {**MASS, "what": "k_f", "needed_sd_percent": 1.5, "needed_sd": 1.5, "unit": "lbf/in"}


@pytest.fixture
def document(documents: dict[str, Document]) -> Document:
    return documents["budget"]


def only(document: Document, name: str) -> Document:
    """Leave one answer in the budget."""
    out = copy.deepcopy(document)
    for other in {"c_f", "c_r", "i", "k_g"} - {name}:
        del out["width"][other]
    out["width"]["faults"] = {}
    return out


def test_the_first_page_names_what_makes_the_width(document: Document) -> None:
    mass, noise, wheelbase, sensor = limits(document)
    assert mass == (
        "The sprung mass, given to ±1 %, makes 91 to 92 % of the variance of the front damping "
        "rate, the rear damping rate and the pitch inertia: were it exact, they would be known to "
        "±0.14 %, ±0.11 % and ±0.089 % instead of ±0.97 %, ±0.97 % and ±0.97 %."
    )
    assert noise.startswith(
        "The noise of the recordings makes 100 % of the variance of the radius of gyration; the "
        "largest part, "
    )
    assert wheelbase == (
        "The wheelbase is given as exact: with one 1 % larger the pitch inertia would come out "
        "2 % too low (2.1 of its deviations)."
    )
    assert sensor.startswith("Of sensor faults that the residuals would not show, a ")


def test_without_a_budget_nothing_is_guessed(documents: dict[str, Document]) -> None:
    for kind in ("us", "refused", "not_converged"):
        document = documents[kind]
        assert width_limits(document) == []
        assert width_steps(document) == []
        assert budget_table(document) is None
        assert fault_table(document) is None
        assert not any("mass" in limit for limit in limits(document))


def test_the_next_step_is_the_measure_that_halves(document: Document) -> None:
    (step,) = width_steps(document)
    assert re.fullmatch(
        r"Weigh the car to ±0\.4\d % \(±2\.\d lbm; now ±1 %\): that halves the "
        r"uncertainty of the front damping rate, the rear damping rate and the pitch inertia\.",
        step,
    )
    assert step in next_steps(document)
    needed = min(
        document["width"][name]["halve"][0]["measures"][0]["needed_sd_percent"]
        for name in ("c_f", "c_r", "i")
    )
    assert sd_words(needed) in step  # the tightest of the three


def test_a_narrow_answer_asks_for_nothing(document: Document) -> None:
    assert width_steps(only(document, "k_g")) == []
    assert "radius of gyration" in halving_lines(only(document, "k_g"))[0].lower()


def test_a_wide_answer_gets_the_computed_advice_alone(document: Document) -> None:
    document["parameters"]["c_f"]["sd"] = 0.3 * document["parameters"]["c_f"]["mean"]
    steps = next_steps(document)
    assert any(step.startswith("Weigh the car") for step in steps)
    assert not any("add a recording over a higher" in step for step in steps)


@pytest.mark.parametrize(
    ("measures", "names", "runs", "text"),
    [
        ([MASS], ["c_f"], 1,
         "Weigh the car to ±0.47 % (±2.3 lbm; now ±1 %): that halves the uncertainty of "
         "the front damping rate."),
        ([{"what": "runs", "further": 4}], ["k_g"], 1,
         "Record four more runs like this one: that halves the uncertainty of the radius of "
         "gyration."),
        ([{"what": "runs", "further": 1}], ["k_g"], 3,
         "Record one more run like these: that halves the uncertainty of the radius of gyration."),
        ([MASS, SPRING, {"what": "runs", "further": 12}], ["c_f", "i"], 2,
         "Weigh the car to ±0.47 % (±2.3 lbm; now ±1 %), measure the front spring rate "
         "to ±1.5 % (±1.5 lbf/in; now ±1 %) and record 12 more runs like these: that halves the "
         "uncertainty of the front damping rate and the pitch inertia."),
    ],
)  # fmt: skip
def test_remedies_in_words(
    measures: list[Document], names: list[str], runs: int, text: str
) -> None:
    assert remedy_sentence(measures, names, runs) == text


def test_what_would_halve_each_width(document: Document) -> None:
    lines = halving_lines(document)
    assert len(lines) == 4
    assert lines[0].startswith("Front damping rate, now ±0.97 %: weigh the car to ±0.47 %")
    assert lines[0].endswith("No number of further runs would.")
    assert lines[3].endswith("Nothing that could be weighed or measured would.")
    document["width"]["c_f"]["halve"] = [{"measures": [MASS, SPRING]}]
    assert halving_lines(document)[0].endswith("No single one of these would do.")
    document["width"]["c_f"]["halve"] = []
    assert "nothing that could be weighed, measured or driven" in halving_lines(document)[0]


@pytest.mark.parametrize(
    ("kind", "where", "size", "shows", "whole", "brief"),
    [
        ("gain", "front_wheel", 0.01, False,
         "a front wheel sensor that reads 1 % too much", "front wheel: 1 % too much"),
        ("delay", "rear_chassis", 7.3e-5, True,
         "a rear chassis sensor sampled 0.073 ms later", "rear chassis: ≤ 0.073 ms later"),
        ("bandwidth", "rear_wheel", 0.041, True,
         "a rear wheel sensor of 4.1 % more bandwidth", "rear wheel: ≤ 4.1 % more bandwidth"),
        ("place", "front_chassis", 0.0254, False,
         "a front chassis sensor 1 in ahead of its axle", "front chassis: 1 in ahead of axle"),
        ("given", "l", 0.01, False, "one 1 % larger", "wheelbase: 1 % larger"),
    ],
)  # fmt: skip
def test_faults_in_words(
    document: Document, kind: str, where: str, size: float, shows: bool, whole: str, brief: str
) -> None:
    fault = {"kind": kind, "where": where, "size": size, "larger_shows": shows}
    assert fault_words(fault, document) == whole
    assert fault_words(fault, document, brief=True) == brief


def test_places_are_told_in_the_units_of_the_car(document: Document) -> None:
    document["vehicle"]["units"] = "SI"
    fault = {"kind": "place", "where": "rear_chassis", "size": 0.0254, "larger_shows": False}
    assert fault_words(fault, document) == "a rear chassis sensor 25 mm ahead of its axle"


def test_the_table_has_every_share_that_matters(document: Document) -> None:
    table = budget_table(document)
    assert table is not None
    names = [row[0] for row in table["rows"]]
    assert names[:2] == ["As it is", "Sprung mass"]
    assert names[-1] == "Twice as many runs"
    assert "Wheelbase" not in names  # exact: it has no share
    for column in range(1, 5):
        shares = [float(m[1]) for row in table["rows"] if (m := re.match(r"(\d+) %", row[column]))]
        assert 95.0 <= sum(shares) <= 103.0  # rounded, and without what is below one percent
    assert table["rows"][1][1] == "91 % (±0.14 %)"


def test_under_a_colour_the_recordings_are_one_source(document: Document) -> None:
    document["width"]["white"] = False
    for name in ("c_f", "c_r", "i", "k_g"):
        document["width"][name]["noises"] = {}
        document["width"][name]["better_sd_percent"] = {}
    table = budget_table(document)
    assert table is not None
    names = [row[0] for row in table["rows"]]
    assert "Recordings" in names
    assert not any("wheel" in name for name in names)
    assert "Motion that the half car does not explain makes 100 % of the variance of the " in (
        " ".join(width_limits(document))
    )
    with style():
        bars = budget_bars(document)
    assert bars is not None
    assert bars.wide


def test_a_budget_that_the_draws_contradict_is_not_told(document: Document) -> None:
    document["width"]["c_f"]["posterior_sd_percent"] = 3.0
    text = " ".join(width_limits(document))
    assert "What makes the front damping rate as uncertain as the draws say cannot be told" in text
    assert "the variance of the rear damping rate and the pitch inertia" in text
    table = budget_table(document)
    assert table is not None
    assert "front damping rate" not in table["columns"]


def test_every_fault_has_a_row_with_its_sign(document: Document) -> None:
    table = fault_table(document)
    assert table is not None
    faults = document["width"]["faults"]
    assert len(table["rows"]) == len(faults) == 15
    for row, fault in zip(table["rows"], faults.values(), strict=True):
        for cell, name in zip(row[1:], ("c_f", "c_r", "i", "k_g"), strict=True):
            shift = fault["shift"][name]
            found = re.fullmatch(r"([+−]?)([\d.]+) % \((\d+\.\d) sd\)", cell)
            assert found, cell
            assert float(found[2]) == pytest.approx(abs(shift["percent"]), rel=0.06, abs=0.006)
            assert float(found[3]) == pytest.approx(abs(shift["sd"]), abs=0.051)
            if found[1]:
                assert (found[1] == "−") == (shift["percent"] < 0.0)


def test_the_report_holds_tables_figure_and_remedies(document: Document) -> None:
    page, pictures = content(document)
    titles = [section["title"] for section in page["sections"]]
    for title in (
        "What makes each answer as wide as it is",
        "What an undeclared fault would do",
        "What would halve each width",
        "What the uncertainty of each answer is made of",
    ):
        assert title in titles
    assert "width" in pictures
    assert [limit.replace("\u00a0", " ") for limit in page["limits"]] == limits(document)


def test_a_saved_budget_is_read_again(document: Document, tmp_path: Path) -> None:
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    assert read_saved(file) == document


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
    document: Document, tmp_path: Path, path: tuple[str, ...], value: Any
) -> None:
    part = document["width"]
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_saved(file)
    assert "width." + path[0] in str(caught.value)


def test_foreign_words_in_a_budget_stay_words(document: Document) -> None:
    share = document["width"]["c_f"]["shares"]
    share["<script>\x1b"] = 2.0
    text = " ".join(limits(document))
    assert "The <script>� makes 200 % of the variance of the front damping rate." in text
    assert "\x1b" not in text
