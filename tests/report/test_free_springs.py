"""A spring with a free curve: its shape is stated in words, and its force is drawn with a band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.analysis.curve_shapes import CurveShape
from bayes_asv.analysis.spring_curves import SpringCurve
from bayes_asv.estimation import estimate
from bayes_asv.report.documents.estimate import estimate_document
from bayes_asv.report.page import report_page
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.sections.effects import spring_lines
from tests.posterior.cases import DECLARED, case, vehicle
from tests.report.conftest import without_pictures


@pytest.fixture(scope="module")
def document() -> EstimateDocument:
    """An estimate whose front spring is said to have a free curve."""
    _, _, recording = case("bump", 3, DECLARED)
    found = estimate([recording], vehicle(DECLARED))
    draws = np.random.default_rng(1).normal(1.0, 0.01, 400)
    deflection = np.linspace(-0.04, 0.02, 7)
    curve = SpringCurve(
        element="front",
        parameter="k_f",
        travel=(0.04, 0.02),
        at_rest=17000.0 * draws,
        compression=21000.0 * draws,
        extension=16000.0 * draws,
        shapes=(
            CurveShape("stiffening", "compression", 0.98, 1.6 * draws),
            CurveShape("unequal_sides", "both", 0.9, 0.8 * draws),
        ),
        deflection=deflection,
        force=np.outer(17000.0 * draws, deflection),
    )
    return estimate_document(replace(found, springs=(curve,)))


def test_its_shape_and_stiffness_are_stated(document: EstimateDocument) -> None:
    stiffer, sides, line = spring_lines(document.springs)
    assert stiffer.startswith("Front spring: grows stiffer with travel in compression; far from ")
    assert "times as stiff as near rest (probability 98 %)." in stiffer
    assert sides.startswith("Front spring: its force in extension is 0.7993 ")
    assert "at rest; force over deflection is" in line
    assert "1.6 in of compression" in line


def test_it_is_drawn(document: EstimateDocument) -> None:
    with without_pictures():
        page = str(report_page(document)[0])
    assert "Force of the spring" in page
    assert "Stiffness" in page
    spring = document.springs[0]
    assert len(spring.deflection) == len(spring.median) == len(spring.band95[0]) == 7
    assert spring.unit == "in"


def test_a_curve_of_another_length_is_refused(document: EstimateDocument) -> None:
    saved = document.to_dict()
    saved["springs"][0]["median"] = [0.0]
    with pytest.raises(ValueError, match="springs"):
        EstimateDocument.model_validate(saved)
