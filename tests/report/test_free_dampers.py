"""A damper with a free curve: its rates are told, and nothing is said of a nominal one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.analysis.curve_shapes import CurveShape
from bayes_asv.analysis.damping_rates import DampingRates
from bayes_asv.estimation import estimate
from bayes_asv.report.documents.estimate import estimate_document
from bayes_asv.report.page import report_page
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.sections.effects import damper_lines
from bayes_asv.report.sections.verdict import verdict_lines
from tests.posterior.cases import DECLARED, case, vehicle
from tests.report.conftest import without_pictures


@pytest.fixture(scope="module")
def document() -> EstimateDocument:
    """An estimate whose front damper is said to have a free curve."""
    _, _, recording = case("bump", 3, DECLARED)
    found = estimate([recording], vehicle(DECLARED))
    draws = np.random.default_rng(1).normal(1.0, 0.01, 400)
    rates = DampingRates(
        "front",
        "c_f",
        np.ones(400),
        True,
        0.2,
        2000.0 * draws,
        900.0 * draws,
        800.0 * draws,
        1000.0 * draws,
        (
            CurveShape("digressive", "both", 0.98, 0.4 * draws),
            CurveShape("unequal_sides", "both", 0.89, np.exp(np.linspace(-1.2, 0.6, 400))),
        ),
        np.linspace(-0.5, 0.5, 5),
        np.outer(900.0 * draws, np.linspace(-0.5, 0.5, 5)),
    )
    return estimate_document(replace(found, dampers=(rates,)))


def test_its_rates_are_stated(document: EstimateDocument) -> None:
    shape, sides, line = damper_lines(document.dampers)
    assert shape.startswith("Front damper: digressive; its slope in fast motion is 0.3997 (95 %: ")
    assert shape.endswith("times that in slow motion (probability 98 %).")
    # the mean of a ratio is geometric; an interval around one leaves the stronger side open
    assert sides.startswith("Front damper: its sides differ, but it is open which is the stronger ")
    assert "in extension is 0.74 (95 %: " in sides
    assert line.startswith("Front damper: ")
    assert "of equal power at the speeds driven" in line
    assert "in compression and" in line
    with without_pictures():
        page = str(report_page(document)[0])
    assert "Damping rates" in page
    assert "slope at rest" in page


def test_no_verdict_is_given_on_it(document: EstimateDocument) -> None:
    lines = verdict_lines(document)
    assert lines[0].startswith("Front damper: a free curve, without a single rate. Rear damper: ")
    front = next(line for line in lines if line.startswith("The front damping rate"))
    assert "nominal" not in front
    assert not any("need no attention" in line for line in lines)
    assert document.parameters["zeta_f"].withheld
    assert not document.parameters["c_r"].withheld
