"""What the wheels can explain, against relations made to measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import coherence as by_scipy
from scipy.signal import lfilter, welch

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.data_checks import coherence, suggest_band
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from tests.posterior.cases import EXACT, case, vehicle

Array = NDArray[np.float64]

RATE = 100.0


def _plain() -> Vehicle:
    car = vehicle(EXACT)
    sensors = {
        name: replace(s, bandwidth=None, delay=0.0, low=-np.inf, high=np.inf)
        for name, s in car.sensors.items()
    }
    return replace(car, sensors=sensors)


def _prepared(recording: Recording, car: Vehicle) -> PreparedRecording:
    return prepare(recording, car, car_model("half", car))


def _line(values: Array) -> PreparedRecording:
    time = np.arange(values.shape[1]) / RATE
    return _prepared(Recording(time, values, ("m/s^2",) * 4, (), "made.csv"), _plain())


def test_both_wheels_together_explain_what_they_cause() -> None:
    rng = np.random.default_rng(3)
    front, rear, noise = rng.normal(size=(3, 12000))
    chassis = lfilter([0.5, 0.3], [1.0, -0.6], front) + lfilter([1.0], [1.0, 0.4], rear)
    noisy = chassis + 0.5 * chassis.std() * noise
    seen = coherence(_line(np.stack([front, noisy, rear, chassis])), 2.0)
    assert seen is not None
    explained = seen.explained(0.0, 50.0)
    # 12000 samples and two inputs: the share errs by less than a percent.
    assert explained[0] == pytest.approx(1.0 / 1.25, abs=0.02)
    assert explained[1] > 0.995


def test_wheels_that_cause_nothing_explain_nothing() -> None:
    found = []
    for seed in range(40):
        values = np.random.default_rng(seed).normal(size=(4, 2000))
        seen = coherence(_line(values), 2.0)
        assert seen is not None
        found.append(seen.explained(0.0, 50.0))
    # Ten windows and two inputs would explain a fifth of anything; that is made good.
    assert np.mean(found) == pytest.approx(0.0, abs=0.02)


def test_one_wheel_alone_is_the_usual_coherence() -> None:
    rng = np.random.default_rng(4)
    front, rear, noise = rng.normal(size=(3, 20000))
    chassis = lfilter([1.0], [1.0, -0.8], front) + noise
    seen = coherence(_line(np.stack([front, chassis, rear, noise])), 1.0)
    assert seen is not None
    frequency, usual = by_scipy(front, chassis, RATE, nperseg=100)
    _, power = welch(chassis, RATE, nperseg=100)
    for low in (2.5, 10.5, 30.5):
        band = (frequency > low) & (frequency <= low + 5.0)
        wanted = np.average(usual[band], weights=power[band])
        assert seen.explained(low, low + 5.0)[0] == pytest.approx(wanted, abs=0.02)


def test_a_short_record_says_nothing() -> None:
    assert coherence(_line(np.random.default_rng(5).normal(size=(4, 700))), 2.0) is None


def test_a_band_is_named_only_where_the_wheels_explain_it() -> None:
    _, _, recording = case("rough", 1, EXACT, rate=RATE, seconds=30.0)
    car = vehicle(EXACT)
    line = _prepared(recording, car)
    poor, good = np.array([0.1, 0.4]), np.array([0.08, 0.08])
    (said,) = suggest_band(line, poor, 7.0)
    assert "explains only 90 and 60 %" in said
    assert said.endswith("try 'bayes-asv estimate --below 5'")
    assert suggest_band(line, good, 7.0) == []  # little is left, so there is nothing to mend
    values = recording.values.copy()
    values[[1, 3]] = values[[1, 3], ::-1]  # as much motion, and none of it from the wheels
    assert suggest_band(_prepared(replace(recording, values=values), car), poor, 7.0) == []
    short = replace(recording, time=recording.time[:400], values=recording.values[:, :400])
    assert suggest_band(_prepared(short, car), poor, 7.0) == []
