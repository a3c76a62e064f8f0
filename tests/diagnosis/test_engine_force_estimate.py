"""How strongly and how fast an engine shakes, held against the rig's engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.diagnosis.engine_force_estimate import Measured, shaking
from bayes_asv.models.half_car import HalfCar
from bayes_asv.posterior.fitted_model import base, setting
from bayes_asv.posterior.map_fit import lay_out
from bayes_asv.preprocessing.tone_removal import notch_of
from tests.battery.cases import case


def measured(name: str, frequency: float | None = None) -> tuple[Measured, Measured, float, float]:
    """Frequency and amplitude as measured, and as they are."""
    one = case(name, 93)
    true = {e.name: e.parameters for e in one.truth.effects}.get("engine_vibration", {})
    where = setting(one.vehicle, lay_out(one.recordings, one.vehicle)[0])
    tone = notch_of(frequency or true["frequency"])
    return *shaking(where, base(where), [tone]), tone.frequency, true.get("amplitude", 0.0)


@pytest.mark.parametrize("place", ["front", "rear", "both"])
def test_an_engine_is_measured_wherever_it_shakes(place: str) -> None:
    """Of 24 such engines, seed 93, 23 forces and 20 speeds lay within their intervals."""
    frequency, amplitude, true, force = measured(f"engine_vibration@{place}-400")
    assert frequency.low < frequency.value < frequency.high
    assert frequency.value == pytest.approx(true, abs=0.4)
    assert amplitude.low < force < amplitude.high
    assert amplitude.value == pytest.approx(force, rel=0.15)


def test_noise_alone_is_no_force() -> None:
    _, amplitude, _, _ = measured("null", 30.0)
    assert amplitude.low == 0.0
    assert amplitude.value < 0.5 * measured("engine_vibration@front-400")[1].value


def test_other_tones_of_an_engine_are_no_noise() -> None:
    """Orders one and a half, two and two and a half: taken for noise they took half the force."""
    one = case("null", 93)
    rng = np.random.default_rng(3)
    force, orders = 0.3, (40.0, 30.0, 50.0)
    runs = []
    for run in one.recordings:
        values = run.values.copy()
        for frequency in orders:
            phase = 2.0 * np.pi * (frequency * run.time + rng.uniform())
            values[[1, 3]] += force * np.sin(phase)
        runs.append(replace(run, values=values))
    where = setting(one.vehicle, lay_out(runs, one.vehicle)[0])
    tones = [notch_of(f) for f in orders]
    stage = base(where)
    both = shaking(where, stage, tones)[1].value
    (alone,) = {shaking(where, stage, tones[:1])[1].value}
    assert both > 1.3 * alone
    car = HalfCar(*stage.space.cars(stage.mode.z[None])[0])
    behind_pole = np.hypot(1.0, 40.0 / 50.0)
    assert both == pytest.approx(force * behind_pole * car.m, rel=0.35)
