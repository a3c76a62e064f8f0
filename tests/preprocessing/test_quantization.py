"""Coarse converters while nothing moves, on the rig's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.diagnosis.model_assessment import assess
from bayes_asv.diagnosis.residual_tests import whiteness_test
from bayes_asv.diagnosis.score_test import _spurious_slope
from bayes_asv.domain.vehicle import Sensor, read_vehicle
from bayes_asv.filters.kalman import MISSING
from bayes_asv.posterior.effects import sensor_corrections
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.quantization import (
    is_slow,
    is_stationary,
    missing_bit,
    noise_level,
    offset,
    quiet_level,
    spurious_drift,
    with_noise_of_still_wheels,
    without_standstill,
)
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from tests.cli.conftest import ROOT
from tests.posterior.cases import DECLARED, INCH, case, vehicle
from tests.rig import SensorSpec

_LOUD = (4.0 * INCH, 2.0 * INCH, 4.0 * INCH, 2.0 * INCH)
# what the data sheets of the 2008 car's sensors say; its converter has ten bits
_REAL = replace(SensorSpec(), noise=(0.855 * INCH, 0.513 * INCH, 0.855 * INCH, 0.513 * INCH))


def _line(terrain: str, seed: int, sensors: SensorSpec, seconds: float = 2.5) -> PreparedRecording:
    _, _, recording = case(terrain, seed, DECLARED, seconds=seconds, sensors=sensors)
    recordings, reasons, _ = prepare_runs([recording], vehicle(DECLARED, sensors))
    assert not reasons
    return recordings[0]


@given(noise=st.floats(0.1, 0.8), seed=st.integers(0, 50))
def test_the_mean_error_of_a_standing_reading_stays_within_its_offset(
    noise: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    level = rng.uniform(-0.5, 0.5)
    read = np.round(level + noise * rng.standard_normal(20_000))
    assert abs(read.mean() - level) < offset(1.0, noise) + 0.06 * noise + 0.01


def test_a_car_that_waits_on_a_coarse_converter_has_nothing_missing() -> None:
    """On each of these drives p is 0.005 if every reading is believed."""
    for seed in (1003, 1008, 1009):
        line = _line("stops" if seed % 2 == 0 else "bump", seed, _REAL)
        where = make_dataset(vehicle(DECLARED, _REAL), (line,))
        model = assess(where, fit_linear_car(where), 0)
        assert model.p_value > 0.05
        assert whiteness_test(model.model)[1] > 1e-3


def test_the_spurious_drift_of_a_travel_sensor_is_that_of_its_converter() -> None:
    """As an effect its size is that of an accelerometer; what it does to a reading is in metres."""
    car = read_vehicle(ROOT / "data" / "vehicles" / "baja2008.toml")
    coarse = dict.fromkeys(("front_travel", "rear_travel"), Sensor(noise=1e-4, resolution=0.002))
    car = replace(car, sensors={**car.sensors, **coarse})
    channels = ("front_wheel", "rear_wheel", *coarse)
    ground = road("bump", np.random.default_rng(3))
    drive = simulate(car, ground, seconds=3.0, seed=3, channels=channels)
    (recording,), reasons, _ = prepare_runs([drive.recording], car)
    assert not reasons
    known = sensor_corrections(recording, car, recording.reading)
    for c in recording.outputs:
        drift = spurious_drift(recording, c)
        assert drift > 0.0
        slope = _spurious_slope(recording, recording.channels[c].name)
        of_reading = slope * np.ptp(known.ramp[c])
        assert of_reading == pytest.approx(drift * np.ptp(recording.instants), rel=0.01)


def test_the_longer_a_car_waits_the_less_it_says() -> None:
    """On this drive p is 0.0001 if its wait is listened to."""
    line = _line("stops", 1009, _REAL, seconds=6.0)
    where = make_dataset(vehicle(DECLARED, _REAL), (line,))
    assert assess(where, fit_linear_car(where), 0).p_value > 0.05


def test_a_wheel_that_moves_is_believed_and_one_that_waits_is_doubted() -> None:
    line = _line("stops", 1000, _REAL)
    doubted = with_noise_of_still_wheels(line)
    assert doubted.standstill_noise is not None
    front = np.abs(line.wheels[0].spline(line.instants))
    moving = np.convolve(front > 100.0 * INCH, np.ones(9), "same") > 8
    assert np.count_nonzero(moving) > 20
    assert np.all(doubted.standstill_noise[moving, 0] == 0.0)
    assert np.mean(doubted.standstill_noise[: len(front) // 20, 0] > 0.0) > 0.9
    assert doubted.noise_spread == pytest.approx(line.process_noise)
    assert with_noise_of_still_wheels(doubted).process_noise == pytest.approx(doubted.process_noise)


def test_a_car_is_not_listened_to_while_it_waits() -> None:
    line = _line("bump", 1000, _REAL, seconds=6.0)
    heard = np.any(without_standstill(line).kind != MISSING, axis=1)
    still = np.all([is_stationary(line, c) for c in range(4)], axis=0)
    assert 0.2 < np.mean(heard) < 0.7
    assert np.all(still[~heard])
    first, last = line.instants[heard][[0, -1]]
    inside = (line.instants >= first) & (line.instants <= last)
    assert np.array_equal(without_standstill(line).kind[inside], line.kind[inside])
    assert 0.45 < last - line.instants[~still][-1] < 0.51
    fine = _line("stops", 1000, SensorSpec(noise=_LOUD))
    assert without_standstill(fine) is fine


@pytest.mark.parametrize(
    ("slope", "remembers"), [(0.05, True), (0.2, True), (0.5, True), (3.0, False)]
)
def test_errors_of_a_converter_remember_while_little_moves(slope: float, remembers: bool) -> None:
    """Saw teeth: the errors of readings one after the other go together, unlike those of a quick
    motion, whose speed is never the same."""
    rng = np.random.default_rng(0)
    n = 40_000
    speed = slope * (1.0 + 0.4 * np.sin(0.01 * np.arange(n)))
    motion = np.cumsum(speed)
    error = np.round(motion + 0.19 * rng.standard_normal(n)) - motion
    error -= error.mean()
    largest = max(
        abs(float(error[lag:] @ error[:-lag])) / float(error @ error) for lag in range(1, 4)
    )
    assert (largest > 0.05) == remembers


def test_what_crawls_is_not_asked_whether_it_remembers(monkeypatch: pytest.MonkeyPatch) -> None:
    line = _line("bump", 1001, _REAL)
    slow = is_slow(line, 1)
    assert np.all(slow[is_stationary(line, 1)])
    assert 0.1 < np.mean(slow & ~is_stationary(line, 1)) < 0.9
    stage = fit_linear_car(make_dataset(vehicle(DECLARED, _REAL), (line,)))
    monkeypatch.setattr(
        "bayes_asv.diagnosis.residual_tests.is_slow",
        lambda line, c: np.ones(len(line.instants), bool),
    )
    assert whiteness_test(stage) == (0.0, 1.0)


def test_noise_that_covers_the_steps_is_believed_as_it_is() -> None:
    line = _line("stops", 1000, SensorSpec(noise=_LOUD))
    same = with_noise_of_still_wheels(line)
    assert np.array_equal(same.process_noise, line.process_noise)


def test_motion_below_an_empty_band_is_no_noise() -> None:
    """Motion up to 6 Hz in readings at 30 Hz, which third differences take for noise."""
    _, _, recording = case("bump", 1, DECLARED)
    (line,), _, _ = prepare_runs((recording,), vehicle(DECLARED))
    rng = np.random.default_rng(2)
    spectrum = np.zeros(801, complex)
    spectrum[1:320] = rng.normal(size=319) + 1j * rng.normal(size=319)
    motion = np.fft.irfft(spectrum)
    motion *= 0.5 / motion.std()
    white = 0.02 * rng.normal(size=len(motion))

    def level(readings: NDArray[np.float64]) -> float:
        values = np.tile(np.round(readings, 6), (len(line.values), 1))
        return noise_level(
            replace(
                line,
                values=values,
                quantization_steps=0.0 * line.quantization_steps,
                noise_prior_centre=None,
            ),
            0,
        )

    assert quiet_level(motion, 1e-6) > 0.02
    assert level(motion) == pytest.approx(0.005)  # the least that is believed
    assert level(motion + white) == pytest.approx(quiet_level(motion + white, 1e-6), rel=1e-3)


@given(
    bit=st.integers(1, 9),
    set_always=st.booleans(),
    seed=st.integers(0, 2**32),
    unit=st.sampled_from([1.0, 0.0254, 9.80665]),
)
def test_a_bit_that_never_changes_is_found_with_its_weight(
    bit: int, set_always: bool, seed: int, unit: float
) -> None:
    rng = np.random.default_rng(seed)
    time = np.arange(1000) / 400.0
    signal = 2.0**bit * (12.0 * np.sin(2.0 * np.pi * 2.3 * time) + rng.normal(size=1000))
    codes = 2**14 + np.round(signal).astype(int)
    without = codes | 2**bit if set_always else codes & ~(2**bit)
    step = 0.004 * unit
    assert missing_bit(without * step, 0.0) == pytest.approx(2**bit * step, rel=0.02)
    assert missing_bit(codes * step, 0.0) == 0.0


@given(signal=st.lists(st.floats(-10.0, 10.0), max_size=40))
def test_few_readings_have_no_missing_bit(signal: list[float]) -> None:
    assert missing_bit(np.array(signal), 0.0) >= 0.0
    assert missing_bit(np.full(100, 1.3), 0.01) == 0.0
