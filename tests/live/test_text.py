"""Texts of the views, compared with independent formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.text import consistency_text, normal_below, parameter_card, travel_text
from tests.live.synthetic import BAJA

FRONT, REAR, PITCH = view_metadata(BAJA, "x", None).parameters


@given(st.floats(-5.0, 5.0), st.floats(0.01, 3.0))
def test_normal_probability(distance: float, sd: float) -> None:
    assert normal_below(distance, sd) == pytest.approx(stats.norm.cdf(distance / sd), abs=1e-12)


def test_log_normal_interval() -> None:
    assert pytest.approx(stats.norm.ppf(0.975), abs=1e-12) == NORMAL_975
    low, high = stats.lognorm(s=0.02, scale=5.76).ppf([0.025, 0.975])
    card = parameter_card(FRONT, 5.76, 0.02)
    assert card.interval == f"{low:.1f} to {high:.1f}"
    assert card.width == f"± {50.0 * (high - low) / 5.76:.1f} %"


@pytest.mark.parametrize(
    ("parameter", "share", "log_sd", "sense", "tone", "chance"),
    [
        (FRONT, 0.8, 0.01, "20 % softer than nominal", "below", "virtually certain below"),
        (REAR, 1.25, 0.02, "25 % stiffer than nominal", "above", "virtually certain above"),
        (PITCH, 1.10, 0.01, "10 % larger than nominal", "above", "virtually certain above"),
        (REAR, 1.00, 0.02, "agrees with nominal", "good", "about as likely as not"),
        (FRONT, 0.9, 1.10, "too uncertain to compare with nominal", "muted", "about as likely"),
    ],
)
def test_comparison_with_nominal(
    parameter: object, share: float, log_sd: float, sense: str, tone: str, chance: str
) -> None:
    card = parameter_card(parameter, share * parameter.nominal, log_sd)  # type: ignore[attr-defined, arg-type]
    assert (card.sense, card.tone) == (sense, tone)
    assert card.chance.startswith(chance)


def test_uncertain_parameters_have_few_digits() -> None:
    card = parameter_card(FRONT, 7.2, 1.1)
    assert card.value == "7.2 lbf·s/in"
    assert card.interval == "0.83 to 62"
    assert card.width == "within a factor 8.6"


@pytest.mark.parametrize("median", [math.nan, -1.0, math.inf])
def test_card_without_an_estimate(median: float) -> None:
    assert parameter_card(FRONT, median, 0.1).tone == "muted"
    assert parameter_card(FRONT, median, 0.1).value == "–"


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
def test_consistency_texts(
    values: tuple[float, float, float, bool, float], short: str, words: str
) -> None:
    card = consistency_text(*values)
    assert card.short == short
    assert words in card.long


def test_travel_and_the_stops_reached() -> None:
    metadata = view_metadata(BAJA, "x", None)
    assert metadata.limits[0] == (None, None)
    assert metadata.limits[1] == pytest.approx((-4.0, 6.0))
    front, rear = travel_text(metadata, (-2.0, 1.0, -4.1, 3.0))
    assert front == "−2.0 to 1.0 in"
    assert rear == "−4.1 to 3.0 in, bump limit reached"
    assert travel_text(metadata, (math.nan,) * 4) == ("", "")


def test_display_in_si_units() -> None:
    metadata = view_metadata(replace(BAJA, units="SI"), "x", None)
    assert [p.unit for p in metadata.parameters] == ["N·s/m", "N·s/m", "kg·m²"]
    assert metadata.deflection == ("mm", 0.001)
    assert metadata.limits[1] == pytest.approx((-101.6, 152.4))
    assert metadata.parameters[0].nominal == pytest.approx(7.2 * 4.4482216152605 / 0.0254)


def test_names_are_printable() -> None:
    metadata = view_metadata(replace(BAJA, name="\x1b[31m\u202eevil\n"), "/x/\x07y.csv", None)
    assert "\x1b" not in metadata.vehicle
    assert "\u202e" not in metadata.vehicle
    assert "\x07" not in metadata.source
