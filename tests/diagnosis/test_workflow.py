"""From recordings to named effects: drives of the rig, each with one fault or two.

The diagnoses are judged as those of the battery are, whose long form is in `benchmarks.battery`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, tolerance_evidence
from bayes_asv.diagnosis.workflow import DiagnosisResult, diagnose
from bayes_asv.report.documents.diagnose import diagnose_document
from bayes_asv.report.sections.diagnosis import diagnosis_lines
from benchmarks.battery.judge import Judged, judge
from benchmarks.battery.run import Result
from benchmarks.calibration.store import About
from tests.battery.cases import Case, case


@cache
def diagnosed(name: str) -> tuple[Case, DiagnosisResult]:
    """One fitted recording, one held out."""
    one = case(name, 3, 0)
    return one, diagnose(one.recordings[:1], one.holdout, one.vehicle, 1)


def judged(one: Case, diagnosis: DiagnosisResult) -> Judged:
    document = diagnose_document(diagnosis).to_dict()
    assert document["schema"] == "bayes_asv/diagnose/1"
    return judge(Result("", 0, "", "", 0.0, document, About(1, "", "")), one.truth)


def test_a_car_without_a_fault_agrees() -> None:
    one, diagnosis = diagnosed("null/bump~baja")
    assert diagnosis.verdict == "agreement"
    assert diagnosis.named == ()
    assert diagnosis.p_value > 0.05
    assert judged(one, diagnosis).covered_after
    assert diagnosis.errors is not None
    for error in diagnosis.errors.values():
        assert error.before == pytest.approx(error.floor, rel=0.15)


def test_a_recording_that_no_car_fits_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that has left all cars was diagnosed, and its intervals were drawn for ever."""
    one = case("null/bump~baja", 3, 0)

    def diverged(*given: Any) -> ModelEvidence:
        found = tolerance_evidence(*given)
        return replace(found, by_scale=np.full_like(found.by_scale, -np.inf))

    monkeypatch.setattr("bayes_asv.diagnosis.model_assessment.tolerance_evidence", diverged)
    refused = diagnose(one.recordings[:1], one.holdout, one.vehicle, 1)
    assert refused.verdict == "refused"
    (reason,) = refused.reasons
    assert "the fit of the half car diverges" in reason
    assert one.recordings[0].source in reason


def test_a_hidden_effect_is_named_and_the_simulation_error_falls() -> None:
    one, diagnosis = diagnosed("bound_rebound@rear-4000/bump~baja")
    assert diagnosis.verdict == "named"
    first = diagnosis.named[0]
    assert str(first.placed) == "bound_rebound@rear"
    assert first.probability > 0.9
    assert diagnosis.errors is not None
    assert (diagnosis.errors["holdout"].closed or 0.0) > 0.85
    assert not diagnosis.errors["holdout"].worse
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.present
    assert diagnosis.quantities_before is not None
    assert diagnosis.quantities_after is not None
    low, high = one.truth.meant["c_r"]
    interval = np.quantile(diagnosis.quantities_after["c_r"], [0.025, 0.975])
    assert interval[0] < high
    assert interval[1] > low
    judgement = judged(one, diagnosis)
    assert judgement.class_right
    assert judgement.probabilities[0][0] > 0.9
    assert judgement.gap is not None
    assert judgement.gap.closed == pytest.approx(diagnosis.errors["holdout"].closed, rel=1e-12)
    assert not judgement.gap.worse


def test_the_document_and_its_text_agree() -> None:
    _, diagnosis = diagnosed("bound_rebound@rear-4000/bump~baja")
    document = diagnose_document(diagnosis)
    assert document.schema_name == "bayes_asv/diagnose/1"
    effect = document.effects[0]
    assert (effect.name, effect.where) == ("bound_rebound", "rear")
    assert effect.parameters["ratio"].eti95[0] < effect.parameters["ratio"].mean
    text = " ".join(diagnosis_lines(document))
    assert "Rear damper: rebound damping is " in text
    assert "held-out runs" in text


def test_a_fault_in_the_held_out_run_alone_is_unexplained() -> None:
    """It came between the drives: the fitted runs do not show it."""
    sound = case("null/bump~baja", 3, 0)
    _, agreement = diagnosed("null/bump~baja")
    assert agreement.unexplained is not None
    assert not agreement.unexplained.present
    faulty = case("bound_rebound@rear-4000/bump~baja", 3, 0)
    diagnosis = diagnose(sound.recordings[:1], faulty.recordings[:1], sound.vehicle, 1)
    assert diagnosis.named == ()
    assert diagnosis.unexplained is not None
    assert diagnosis.unexplained.present
    assert diagnosis.verdict == "unexplained"


def test_a_damper_in_a_soft_mount_is_not_taken_for_a_sensor_lag_alone() -> None:
    """They differ by a twentieth of their energy."""
    one = case("maxwell_mount-400", 41, 1)
    diagnosis = diagnose(one.recordings, one.holdout, one.vehicle, 1)
    judgement = judged(one, diagnosis)
    assert judgement.class_right
    assert not judgement.confidently_wrong


def test_a_pulse_is_not_named_where_something_remains_beside_it() -> None:
    """Filled gaps of all channels are partly explained by a force pulse."""
    one = case("null/bump~baja", 5, 0)
    run = one.recordings[0]
    values = run.values.copy()
    at = int(np.argmax(np.abs(values[run.channels.index("rear_wheel")])))
    for begin in (at - 30, at + 20):
        ends = values[:, [begin, begin + 25]]
        values[:, begin : begin + 25] = np.linspace(ends[:, 0], ends[:, 1], 25, axis=1)
    wrong = (replace(run, values=values), *one.recordings[1:])
    diagnosis = diagnose(wrong, one.holdout, one.vehicle, 1)
    assert diagnosis.unexplained is not None
    assert diagnosis.unexplained.present
    assert all(e.placed.run is None for e in diagnosis.named)


def test_a_force_pulse_keeps_its_time_when_engine_tones_are_removed() -> None:
    """The filter takes a quarter of a second off the beginning; the pulse came 0.9 s after it."""
    one = case("pair-400", 44, 1)
    engine, pulse = one.truth.effects
    assert (engine.name, pulse.name) == ("engine_vibration", "external_force")
    diagnosis = diagnose(one.recordings, one.holdout, one.vehicle, 1)
    assert diagnosis.engine is not None
    frequency = diagnosis.engine.frequency.value
    assert frequency == pytest.approx(engine.parameters["frequency"], rel=0.03)
    assert [e.placed.effect.name for e in diagnosis.named] == ["external_force"]
    assert diagnosis.effect_draws is not None
    start = diagnosis.effect_draws[str(diagnosis.named[0].placed)]["start"]
    assert float(np.mean(start)) == pytest.approx(pulse.parameters["start"], abs=0.03)
    assert diagnosis.errors is not None
    assert (diagnosis.errors["fit"].closed or 0.0) > 0.85  # the pulse acts in its own run
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.present
