"""Mistakes of nominal damping that are possible, not probable: they are stated and counted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.analysis.nominal_values import nominal_damping
from bayes_asv.domain.vehicle import Nominal, Vehicle
from bayes_asv.estimation import estimate
from bayes_asv.models.cars import car_model
from bayes_asv.report.documents.estimate import estimate_document
from bayes_asv.report.documents.track import track_document
from bayes_asv.report.sections.verdict import headline, next_steps
from bayes_asv.tracking.track import track
from tests.analysis.test_input_mistakes import with_nominal, worn
from tests.posterior.cases import DECLARED, vehicle

FRONT, REAR = -0.2, 0.28  # logarithms of estimated over nominal damping


def exchanged() -> Vehicle:
    """Return a car whose nominal front rate is 1.5 times the rear one."""
    car = vehicle(DECLARED)
    return with_nominal(car, c_r=car.c_f.value / 1.5 / car.c_r.value)


def test_probabilities_are_those_of_simulated_cars() -> None:
    """Dampers and vehicle files are drawn as stated, and those kept that look like this one."""
    car = exchanged()
    model = car_model("half", car)
    nominal = model.nominal
    values = {
        name: float(nominal[name][0]) * math.exp(log)
        for name, log in (("c_f", FRONT), ("c_r", REAR))
    }
    found = nominal_damping(model, values)
    rng, count = np.random.default_rng(7), 3_000_000
    stiffer = rng.random((count, 2)) < 0.2 / 0.55
    wear = np.abs(rng.normal(size=(count, 2))) * np.where(stiffer, 0.2, -0.35)
    wear = np.where(rng.random((count, 2)) < 0.5, 0.1 * rng.normal(size=(count, 2)), wear)
    moved = np.zeros((count, 2))
    kind = rng.integers(0, 5, count)
    mistaken = rng.random(count) < 0.1
    one = rng.integers(0, 2, count)
    side = np.where(rng.random(count) < 0.5, 1.0, -1.0)
    ratio = rng.uniform(0.35, 0.9, count)
    moved[kind == 0] = (side * math.log(2.0))[kind == 0, None]
    moved[kind == 1] = math.log(12.0)  # all units are too far away to matter
    moved[kind == 2] = 2.0 * np.log(ratio)[kind == 2, None]
    moved[kind == 3, one[kind == 3]] = math.log(2.0)
    moved[kind == 4] = np.array([-1.0, 1.0]) * math.log(1.5)
    observed = wear + np.where(mistaken[:, None], moved, 0.0)
    like = np.all(np.abs(observed - [FRONT, REAR]) < 0.03, axis=1)
    assert like.sum() > 1000
    assert found.probability == pytest.approx(mistaken[like].mean(), abs=0.04)
    assert 0.05 < found.probability < 0.5
    assert found.mistakes[0].words == "front and rear nominal damping are exchanged"


def test_nothing_is_counted_that_is_not_reported() -> None:
    model = car_model("half", vehicle(DECLARED))
    values = {name: float(x[0]) for name, x in model.nominal.items()}
    found = nominal_damping(model, {**values, "c_f": 0.8 * values["c_f"]})
    assert not found.mistakes
    assert found.probability_below("c_f", 0.999) == 0.999


def test_a_possible_mistake_is_in_the_headline_and_in_the_probability() -> None:
    recording, car = worn(6)
    fitted = estimate([recording], car, seed=1)
    front, rear = (float(np.median(fitted.draws[name])) for name in ("c_f", "c_r"))
    given = replace(car, c_f=Nominal(0.9 * rear), c_r=Nominal(1.05 * front))  # nearly exchanged
    for document in (
        estimate_document(estimate([recording], given, seed=1)),
        track_document(track(recording, given)),
    ):
        (mistake,) = document.nominal_mistakes
        assert mistake.words == "front and rear nominal damping are exchanged"
        assert 0.1 < mistake.probability < 0.45
        softer = document.parameters["c_f"].p_below_nominal
        assert softer == pytest.approx(1.0 - 0.5 * mistake.probability, abs=0.02)
        assert document.parameters["zeta_f"].p_below_nominal == pytest.approx(softer, abs=0.02)
        told = headline(document)
        assert "Front damper: 2" in told
        assert "Or front and rear nominal damping are exchanged (probability" in told
        assert next_steps(document)[0].startswith("Check the nominal damping: give the rate")
