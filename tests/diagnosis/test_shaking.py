"""How strongly and how fast an engine shakes, held against the rig's engine."""

from __future__ import annotations

import pytest

from bayes_asv.diagnosis.shaking import Measured, shaking
from bayes_asv.inference.bestfit import lay_out
from bayes_asv.inference.stage import base, setting
from bayes_asv.inference.tones import notch_of
from tests.battery.cases import case


def measured(name: str, frequency: float | None = None) -> tuple[Measured, Measured, float, float]:
    """Frequency and amplitude as measured, and as they are."""
    one = case(name, 93)
    true = {e.name: e.parameters for e in one.truth.effects}.get("engine_vibration", {})
    where = setting(one.vehicle, lay_out(one.recordings, one.vehicle)[0])
    tone = notch_of(frequency or true["frequency"])
    return *shaking(where, base(where), tone), tone.frequency, true.get("amplitude", 0.0)


@pytest.mark.parametrize("place", ["front", "rear", "both"])
def test_an_engine_is_measured_wherever_it_shakes(place: str) -> None:
    """Of 24 such engines, seed 93, 22 lay within the interval of either; see docs/method.md."""
    frequency, amplitude, true, force = measured(f"engine_vibration@{place}-400")
    assert frequency.low < frequency.value < frequency.high
    assert frequency.value == pytest.approx(true, abs=0.4)
    assert amplitude.low < force < amplitude.high
    assert amplitude.value == pytest.approx(force, rel=0.15)


def test_noise_alone_is_no_force() -> None:
    _, amplitude, _, _ = measured("null", 30.0)
    assert amplitude.low == 0.0
    assert amplitude.value < 0.5 * measured("engine_vibration@front-400")[1].value


def test_a_recording_too_slow_to_hold_a_tone_says_nothing_of_its_force() -> None:
    frequency, amplitude, _, _ = measured("null", 260.0)
    assert frequency.value == 260.0
    assert amplitude == (0.0, 0.0, 0.0)
