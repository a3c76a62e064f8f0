"""Recordings so far from the model that what is fitted to them is no car: refused, and said why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis import forward_selection, model_assessment, workflow
from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.errors import FitError
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from tests.battery.cases import case
from tests.posterior.cases import prepared

DRIVES = Path(__file__).resolve().parents[3] / "shared" / "data" / "roomster"
ERROR = FitError("run.csv", "the fit is no car", "check the channels")


def _raise(*_: Any, **__: Any) -> Any:
    raise ERROR


@pytest.mark.skipif(not DRIVES.is_dir(), reason="the road drives do not travel with the project")
def test_a_body_that_shakes_by_itself_is_refused_with_the_band_that_serves() -> None:
    """Above 4 Hz the body of this car has a motion of its own, far above the sensors' noise."""
    car = read_vehicle(DRIVES / "roomster.toml")
    recording = prepared(read_recording(DRIVES / "drive08_1.csv"), car)
    reasons = workflow._explains_too_little(fit_linear_car(make_dataset(car, (recording,))))
    assert "too little to trust any answer" in reasons[0]
    assert "try 'bayes-asv estimate --below 4'" in reasons[-1]


def test_a_model_that_explains_less_than_half_of_the_motion_is_refused() -> None:
    one = case("null/bump~baja", 3, 0)
    recording = prepared(one.recordings[0], one.vehicle)
    fit = fit_linear_car(make_dataset(one.vehicle, (recording,)))
    assert workflow._explains_too_little(fit) == ()
    z = fit.mode.z.copy()
    z[:3] += 4.0  # dampers and inertia of another car
    (reason, *_) = workflow._explains_too_little(replace(fit, mode=replace(fit.mode, z=z)))
    assert "explains only" in reason


@pytest.mark.parametrize("step", ["validate", "draw_dampers"])
def test_a_diagnosis_without_a_car_has_a_document(
    monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    one = case("null/bump~baja", 3, 0)
    monkeypatch.setattr(workflow, step, _raise)
    found = diagnose(one.recordings[:1], one.holdout, one.vehicle, 1)
    assert found.verdict == "refused"
    assert found.reasons == ("the fit is no car (run.csv); check the channels",)


def test_an_estimate_without_a_car_has_a_document(monkeypatch: pytest.MonkeyPatch) -> None:
    one = case("null/bump~baja", 3, 0)
    monkeypatch.setattr("bayes_asv.estimation._add_checks", _raise)
    found = estimate(one.recordings[:1], one.vehicle)
    assert found.verdict == "refused"
    assert found.reasons == ("the fit is no car (run.csv); check the channels",)
    assert found.seconds > 0.0


def test_an_effect_with_which_the_simulation_diverges_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = case("bound_rebound@rear-4000/bump~baja", 3, 0)
    assess, given_up = model_assessment.assess, []

    def diverges(dataset: Any, model: Any, seed: int) -> Any:
        if any(str(placed) == "bound_rebound@rear" for placed in model.placed_effects):
            given_up.append(model)
            raise ERROR
        return assess(dataset, model, seed)

    monkeypatch.setattr(forward_selection, "assess", diverges)
    found = diagnose(one.recordings[:1], one.holdout, one.vehicle, 1)
    assert given_up
    assert found.verdict in ("named", "unexplained")
    assert "bound_rebound@rear" not in [str(one.placed) for one in found.named]
    assert found.quantities_after is not None
    assert np.all(np.isfinite(found.quantities_after["c_f"]))
