"""Words for the moment, against formulas of their own."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bayes_asv.live.bands import Z95, normal_below
from bayes_asv.live.metadata import scene
from bayes_asv.live.words import card, consistency, travel
from tests.live.made_up import BAJA

FRONT, REAR, PITCH = scene(BAJA, "x", None).parameters


@given(st.floats(-5.0, 5.0), st.floats(0.01, 3.0))
def test_probability_is_that_of_a_normal_variable(distance: float, sd: float) -> None:
    assert normal_below(distance, sd) == pytest.approx(stats.norm.cdf(distance / sd), abs=1e-12)


def test_interval_is_that_of_a_log_normal_variable() -> None:
    assert pytest.approx(stats.norm.ppf(0.975), abs=1e-12) == Z95
    low, high = stats.lognorm(s=0.02, scale=5.76).ppf([0.025, 0.975])
    said = card(FRONT, 5.76, 0.02)
    assert said.interval == f"{low:.1f} to {high:.1f}"
    assert said.width == f"± {50.0 * (high - low) / 5.76:.1f} %"


@pytest.mark.parametrize(
    ("parameter", "share", "log_sd", "sense", "tone", "chance"),
    [
        (FRONT, 0.8, 0.01, "20 % softer than nominal", "below", "virtually certain below"),
        (REAR, 1.25, 0.02, "25 % stiffer than nominal", "above", "virtually certain above"),
        (PITCH, 1.10, 0.01, "10 % larger than nominal", "above", "virtually certain above"),
        (REAR, 1.00, 0.02, "agrees with nominal", "good", "about as likely as not"),
        (FRONT, 0.9, 1.10, "too uncertain to tell from nominal", "muted", "about as likely"),
    ],
)
def test_a_card_says_how_a_parameter_stands_to_nominal(
    parameter: object, share: float, log_sd: float, sense: str, tone: str, chance: str
) -> None:
    said = card(parameter, share * parameter.nominal, log_sd)  # type: ignore[attr-defined, arg-type]
    assert (said.sense, said.tone) == (sense, tone)
    assert said.chance.startswith(chance)


def test_what_is_hardly_known_is_told_in_few_digits() -> None:
    said = card(FRONT, 7.2, 1.1)
    assert said.value == "7.2 lbf·s/in"
    assert said.interval == "0.83 to 62"
    assert said.width == "within a factor 8.6"


@pytest.mark.parametrize("median", [math.nan, -1.0, math.inf])
def test_a_card_of_nothing(median: float) -> None:
    assert card(FRONT, median, 0.1).tone == "muted"
    assert card(FRONT, median, 0.1).value == "–"


@pytest.mark.parametrize(
    ("values", "short", "words"),
    [
        ((1.0, 0.8, 1.2, True, 1.0), "consistent", "as large as the filter expects"),
        ((4.0, 0.8, 1.2, False, 1.0), "errors too large", "are 2 times as large as expected"),
        ((4.0, 0.8, 1.2, False, 1.62), "errors too large", "widens its noise 1.62 times"),
        ((0.25, 0.8, 1.2, False, 1.0), "errors too small", "are 50 % of what is expected"),
        ((1.1, 0.8, 1.2, False, 1.3), "recovering", "back to what is expected"),
        ((math.nan, 0.8, 1.2, True, 1.0), "settling", "Too few readings"),
    ],
)
def test_the_filter_is_judged(
    values: tuple[float, float, float, bool, float], short: str, words: str
) -> None:
    said = consistency(*values)
    assert said.short == short
    assert words in said.long


def test_travel_is_told_with_the_stops_that_were_reached() -> None:
    watched = scene(BAJA, "x", None)
    assert watched.limits[0] == (None, None)
    assert watched.limits[1] == pytest.approx((-4.0, 6.0))
    front, rear = travel(watched, (-2.0, 1.0, -4.1, 3.0))
    assert front == "−2.0 to 1.0 in"
    assert rear == "−4.1 to 3.0 in, bump limit reached"
    assert travel(watched, (math.nan,) * 4) == ("", "")


def test_an_si_car_is_shown_in_si() -> None:
    watched = scene(replace(BAJA, units="SI"), "x", None)
    assert [p.unit for p in watched.parameters] == ["N·s/m", "N·s/m", "kg·m²"]
    assert watched.deflection == ("mm", 0.001)
    assert watched.limits[1] == pytest.approx((-101.6, 152.4))
    assert watched.parameters[0].nominal == pytest.approx(7.2 * 4.4482216152605 / 0.0254)


def test_names_from_files_are_made_fit_to_print() -> None:
    watched = scene(replace(BAJA, name="\x1b[31m\u202eevil\n"), "/x/\x07y.csv", None)
    assert "\x1b" not in watched.vehicle
    assert "\u202e" not in watched.vehicle
    assert "\x07" not in watched.source
