"""Dampers of a form that no listed effect has get a free law."""

from __future__ import annotations

from bayes_asv.diagnosis.workflow import diagnose
from tests.battery.cases import case


def test_a_progressive_damper_is_a_curve() -> None:
    one = case("progressive_damper-4000", 58, 0, "test")
    diagnosis = diagnose(one.recordings, one.holdout, one.vehicle, 0)
    assert [str(effect.site) for effect in diagnosis.named] == ["damper_curve@rear"]
    assert diagnosis.unexplained is not None
    assert not diagnosis.unexplained.present
    error = (diagnosis.errors or {})["holdout"]
    assert error.closed is not None
    assert error.closed > 0.95
    (rear,) = diagnosis.dampers
    assert rear.element == "rear"
    assert diagnosis.quantities_after is not None
    assert diagnosis.quantities_after["c_r"].shape == rear.equal_power.shape
