"""Dampers and springs of forms that no listed effect has get a free law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis import model_assessment
from bayes_asv.diagnosis.forward_selection import start_selection
from bayes_asv.diagnosis.free_laws import with_free_laws
from bayes_asv.diagnosis.holdout_validation import Split, validate
from bayes_asv.diagnosis.misspecification_test import misspecification_tests
from bayes_asv.diagnosis.model_assessment import assess
from bayes_asv.diagnosis.model_comparison import draw_dampers, draw_springs
from bayes_asv.diagnosis.unlisted_fault_models import UnnamedCause
from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.recording import Recording
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_linear_car
from bayes_asv.report.documents.diagnose import diagnose_document
from bayes_asv.report.sections.diagnosis import findings
from benchmarks.real_dampers import FILES, drawn, measured
from tests.battery.cases import case
from tests.diagnosis.models import ignore_progress, prepared
from tests.posterior.cases import DECLARED, as_recording, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    CurveSpring,
    LinearDamper,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
)

_DYNO = Path(__file__).parents[3] / "shared" / "data" / "dyno"


def test_a_progressive_damper_is_a_curve() -> None:
    """Where the selection stops for an unlisted fault."""
    one = case("progressive_damper-4000", 58, 0, "test")
    dataset = prepared(one.recordings[:1], one.vehicle)
    linear = assess(dataset, fit_linear_car(dataset), 0)
    stopped = replace(start_selection(linear), stopped_by="an unlisted fault")
    holdout = prepared(one.holdout, one.vehicle)
    selection = with_free_laws(stopped, linear, holdout, 0, ignore_progress)
    split = Split(dataset, holdout, linear.model)
    validated = validate(selection, split, split, None, 0, ignore_progress)
    names = [str(effect.placed) for effect in validated.selection.effects]
    assert names == ["damper_curve@rear"]
    found = validated.selection.assessed
    assert not misspecification_tests(found.denoised, found.evidence, 0).present
    error = validated.errors["holdout"]
    assert error.closed is not None
    assert error.closed > 0.95
    (rear,), rates = draw_dampers(found.on_inputs_as_read, found.evidence, 0)
    assert rear.element == "rear"
    assert rates["c_r"].shape == rear.equal_power.shape
    assert draw_springs(found.on_inputs_as_read, found.evidence, 0) == ()
    # an unlisted force at the rear takes power there, one at the front or of a sensor does not
    speed = (np.array([0.1, -0.3, 0.2]), np.array([-0.2, 0.4]))
    force = tuple(-70.0 * v for v in speed)
    here = UnnamedCause("a force", "", 1.0, ("force", "velocity"), force, speed, "rear")
    causes = here, replace(here, element="front"), replace(here, element=None)
    (total,), both = draw_dampers(found.on_inputs_as_read, found.evidence, 0, causes)
    assert total.equal_power == pytest.approx(rear.equal_power + 70.0)
    assert both["c_r"] == pytest.approx(rates["c_r"] + 70.0)
    assert both["zeta_r"] / rates["zeta_r"] == pytest.approx(both["c_r"] / rates["c_r"])


def test_the_rate_of_a_real_damper_holds_where_an_unlisted_force_is_added() -> None:
    """Its force lags velocity; where that is not named, it is in the model without a name."""
    if not all((_DYNO / name).exists() for name in FILES):
        pytest.skip("../shared/data/dyno is not there")
    _, runs, about = drawn(69, [measured(_DYNO / name) for name in FILES])
    fit, held = (as_recording(run, f"{k}.csv") for k, run in enumerate(runs))
    diagnosis = diagnose([fit], [held], vehicle(DECLARED), 69)
    cause = diagnosis.unnamed[0]
    assert (cause.kind, cause.element) == ("a damper in a soft mount", "front")
    assert -0.2 * about["c_f"] < cause.equal_power < 0.0
    assert diagnosis.quantities_after is not None
    low, high = np.quantile(diagnosis.quantities_after["c_f"], [0.025, 0.975])
    assert low < about["c_f"] < high


def test_a_law_with_which_the_fit_diverges_is_no_law(monkeypatch: pytest.MonkeyPatch) -> None:
    one = case("progressive_damper-4000", 58, 0, "test")
    dataset = prepared(one.recordings[:1], one.vehicle)
    linear = assess(dataset, fit_linear_car(dataset), 0)
    nothing = replace(linear.evidence, by_scale=np.full_like(linear.evidence.by_scale, -np.inf))
    tried = []

    def with_law(given: Any, placed_effects: Any, model: Any) -> tuple[Dataset, FittedModel]:
        tried.extend(placed_effects)
        return dataset, linear.model

    monkeypatch.setattr("bayes_asv.diagnosis.free_laws.with_effects", with_law)
    monkeypatch.setattr(model_assessment, "tolerance_evidence", lambda *given: nothing)
    monkeypatch.setattr("bayes_asv.diagnosis.free_laws.select_effects", None)  # would start there
    stopped = replace(start_selection(linear), stopped_by="an unlisted fault")
    assert with_free_laws(stopped, linear, None, 0, ignore_progress) is stopped
    assert tried


def test_a_spring_that_is_stiffer_beyond_a_play_is_a_curve() -> None:
    """Its slope grows by 70 % between 5 and 10 mm to either side, and is constant beyond."""
    rng = np.random.default_rng([0, 78])
    car = draw(baja(), rng, DECLARED)
    delta = np.linspace(-0.25, 0.25, 5001)
    slope = 1.0 + 0.7 * np.clip((np.abs(delta) - 0.005) / 0.005, 0.0, 1.0)
    force = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(delta))])
    force = car.k_r * (force - force[2500])
    spring = CurveSpring(tuple(delta[::4]), tuple(force[::4]))
    car = replace(car, rear_law=(spring, LinearDamper(car.c_r)))
    runs: list[Recording] = []
    for terrain in ("stops", "bump", "stops"):
        declared = draw_biases(SensorSpec(), rng)
        road, seed = (int(v) for v in rng.integers(2**31, size=2))
        speed = DEFAULT_SPEEDS[terrain]
        run = drive(car, TERRAINS[terrain](road), speed, 400.0, 2.0, declared, seed)
        runs.append(as_recording(run, f"{terrain}-{len(runs)}.csv"))
    diagnosis = diagnose(runs[:2], runs[2:], vehicle(DECLARED), 0)
    assert [str(effect.placed) for effect in diagnosis.named] == ["spring_curve@rear"]
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.present
    error = (diagnosis.errors or {})["holdout"]
    assert error.closed is not None
    assert error.closed > 0.95
    document = diagnose_document(diagnosis, runs)
    assert document.laws["rear"].spring is not None
    assert any("Rear spring: grows stiffer with travel; " in line for line in findings(document))
