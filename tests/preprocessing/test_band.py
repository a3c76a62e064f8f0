"""A band of a recording against the whole of it, and against the rig's truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binom

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import MISSING, VALUE
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.free_simulation import simulate_free, unexplained_in_band
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.preprocessing.band import check_band, low_pass, low_pass_recording
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import EXACT, INCH, as_recording, case, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    Engine,
    RigCar,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
)

Array = NDArray[np.float64]

BELOW = 8.0
NAMES = ("c_f", "c_r", "i")


def _made(signal: Array, rate: float = 400.0) -> Recording:
    """The same signal (4, N), m/s², on all four channels' stamps."""
    return Recording(np.arange(signal.shape[1]) / rate, signal, ("m/s^2",) * 4, (), "made.csv")


def _plain() -> Vehicle:
    """A car whose sensors have no filter, no delay and no rails."""
    car = vehicle(EXACT)
    sensors = {
        name: replace(s, bandwidth=None, delay=0.0, low=-np.inf, high=np.inf, resolution=None)
        for name, s in car.sensors.items()
    }
    return replace(car, sensors=sensors)


def _band(recording: Recording, car: Vehicle, below: float = BELOW) -> PreparedRecording:
    return low_pass_recording(prepare(recording, car, car_model("half", car)), below)


@settings(deadline=None, max_examples=60)
@given(below=st.floats(2.0, 40.0), ratio=st.floats(4.0, 200.0))
def test_the_filter_passes_the_band_and_nothing_beyond(below: float, ratio: float) -> None:
    rate = ratio * below
    weights = low_pass(below, rate)
    assert weights == pytest.approx(weights[::-1])
    gain = np.abs(np.fft.rfft(weights, 1 << 14))
    frequency = np.fft.rfftfreq(1 << 14, 1.0 / rate)
    assert gain[0] == pytest.approx(1.0)
    assert np.abs(gain[frequency <= 0.6 * below] - 1.0).max() < 0.006
    assert gain[frequency >= 1.4 * below].max() < 0.006


def test_a_slow_motion_stays_and_a_fast_one_goes() -> None:
    time = np.arange(1600) / 400.0
    slow = np.sin(2.0 * np.pi * 3.0 * time)
    fast = 5.0 * np.sin(2.0 * np.pi * 15.0 * time + 1.0)
    line = _band(_made(np.tile(slow + fast, (4, 1))), _plain())
    at = line.times[0]
    for c in range(4):
        assert line.values[c] == pytest.approx(np.sin(2.0 * np.pi * 3.0 * at), abs=0.04)
    used = line.kind[:, 0] == VALUE
    assert np.diff(line.instants[used]) == pytest.approx(1.0 / (2.0 * BELOW), abs=1e-9)
    assert line.reading[used, 0] == pytest.approx(
        np.sin(2.0 * np.pi * 3.0 * line.instants[used]), abs=0.04
    )


def test_delays_and_clocks_are_honoured_before_the_filter() -> None:
    stamps = np.arange(1600) / 400.0
    late, fast = 0.004, 200e-6
    taken = (stamps, stamps + late, stamps / (1.0 + fast), stamps)
    signal = np.stack([np.sin(2.0 * np.pi * 4.0 * t) for t in taken])
    told = (("delay front_chassis", f"{late} s"), ("clock rear_wheel", f"{fast * 1e6} ppm"))
    line = _band(replace(_made(signal), metadata=told), _plain())
    for c in range(4):
        assert line.values[c] == pytest.approx(np.sin(2.0 * np.pi * 4.0 * line.times[c]), abs=0.01)


def test_noise_levels_are_those_of_the_filtered_readings() -> None:
    car = _plain()
    level = 0.3
    car = replace(car, sensors={n: replace(s, noise=level) for n, s in car.sensors.items()})
    noise = level * np.random.default_rng(1).normal(size=(4, 40000))
    line = _band(_made(noise), car)
    used = line.kind[:, 0] == VALUE
    # 1600 readings: 2 % at one deviation
    assert line.noise[1] == pytest.approx(np.std(line.reading[used, 0]), rel=0.08)
    assert line.noise[0] == level  # a density, over the wheel's own samples
    assert line.process_noise[5:, 0] == pytest.approx(1.0 / 400.0)


def test_the_same_car_moves_in_the_band() -> None:
    truth, _, recording = case("rough", 3, EXACT, seconds=4.0)
    line = _band(recording, vehicle(EXACT))
    car = np.array([truth.c_f, truth.c_r, truth.i, truth.m, truth.l, truth.wdf, truth.k_f,
                    truth.k_r])  # fmt: skip
    assert np.all(unexplained_in_band(line, simulate_free(line, car), BELOW) < 0.01)


@settings(deadline=None, max_examples=5)
@given(excess=st.floats(0.0, 50.0))
def test_what_a_clipped_reading_hid_does_not_matter(excess: float) -> None:
    _, _, recording = case("bump", 2, EXACT, seconds=4.0)
    car = _plain()
    rail = float(np.sort(recording.values[1])[-3]) * INCH
    narrow = replace(car.sensor("front_chassis"), high=rail)
    car = replace(car, sensors={**car.sensors, "front_chassis": narrow})
    values = recording.values.copy()
    values[1, values[1] * INCH >= rail] += excess
    line, other = (_band(r, car) for r in (recording, replace(recording, values=values)))
    assert line.reading == pytest.approx(other.reading)
    there = line.kind[:, 0] == VALUE
    clipped = recording.time[recording.values[1] * INCH >= rail]
    near = np.min(np.abs(line.instants[:, None] - clipped), axis=1)
    assert not there[near < 1.9 / BELOW].any()
    assert there.any()
    assert (line.kind[:, 1] == VALUE).sum() > there.sum()


def test_a_gap_is_not_filled_with_guesses() -> None:
    _, _, recording = case("rough", 2, EXACT, seconds=4.0)
    values = recording.values.copy()
    values[3, 800:802] = np.nan  # 7 ms: a spline crosses it
    values[3, 1000:1012] = np.nan  # 30 ms
    line = _band(replace(recording, values=values), vehicle(EXACT))
    whole = _band(recording, vehicle(EXACT))
    lost = line.instants[(line.kind[:, 1] == MISSING) & (whole.kind[:, 1] == VALUE)]
    assert lost.min() > recording.time[1000] - 2.1 / BELOW
    assert lost.max() < recording.time[1012] + 2.1 / BELOW
    both = (line.kind[:, 1] == VALUE) & (whole.kind[:, 1] == VALUE)
    error = np.abs(line.reading[both, 1] - whole.reading[both, 1])
    assert error.max() < 0.02 * np.std(whole.reading[both, 1])


def test_a_band_without_the_cars_own_motion_is_refused() -> None:
    car = car_model("half", vehicle(EXACT))
    with pytest.raises(InputError, match=r"--below 2: .* give at least 3\.6"):
        check_band(2.0, car)
    with pytest.raises(InputError):
        check_band(float("nan"), car)
    check_band(3.6, car)


def test_a_record_too_short_for_the_filter_is_refused() -> None:
    _, _, recording = case("rough", 2, EXACT, seconds=2.0)
    _, reasons, _ = prepare_runs((recording,), vehicle(EXACT), 4.0)
    assert len(reasons) == 1
    assert "too short for the motion below 4 Hz" in reasons[0]


def _shaken(number: int) -> tuple[RigCar, Recording]:
    """Four seconds of rough road with an engine on the frame, 16 Hz and up."""
    rng = np.random.default_rng([number, 77])
    car = draw(baja(), rng, EXACT)
    sensors = draw_biases(SensorSpec(), rng)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    engine = Engine(frequency=32.0, amplitude=600.0, seed=number)
    where = TERRAINS["rough"](road)
    run = drive(car, where, DEFAULT_SPEEDS["rough"], 200.0, 4.0, sensors, noise, forces=(engine,))
    return car, as_recording(run, f"rough-{number}.csv")


def _fit(recording: Recording, below: float | None) -> MapFit:
    lines, reasons, _ = prepare_runs((recording,), vehicle(EXACT), below)
    assert not reasons
    return best_fit(lines, vehicle(EXACT))


def _answers(fit: MapFit) -> tuple[Array, Array]:
    """Logarithms of c_f, c_r, i at the mode, and their deviations."""
    mode = np.log(fit.space.cars(fit.mode.z[None])[0, :3])
    return mode, np.array([fit.space.log_deviation(fit.mode.covariance, n) for n in NAMES])


def _swaying(number: int) -> tuple[RigCar, Recording]:
    """Rough road, and on the frame a slow motion that no wheel caused."""
    car, _, recording = case("rough", number, EXACT, rate=100.0, seconds=7.0)
    rng = np.random.default_rng([number, 5])
    values = recording.values.copy()
    for c in (1, 3):
        slow = np.convolve(rng.normal(size=(values.shape[1],)), np.hanning(25), "same")
        values[c] += 0.2 * values[c].std() * slow / slow.std()
    return car, replace(recording, values=values)


@pytest.mark.parametrize(
    ("made", "below", "runs"), [(_shaken, BELOW, 40), (_swaying, 6.0, 20)], ids=["above", "inside"]
)
def test_what_no_half_car_does_leaves_the_answer_honest(
    made: Callable[[int], tuple[RigCar, Recording]], below: float, runs: int
) -> None:
    z = np.empty((runs, 3))
    for number in range(runs):
        car, recording = made(number)
        mode, sd = _answers(_fit(recording, below))
        z[number] = (mode - np.log([getattr(car, name) for name in NAMES])) / sd
    covered = np.count_nonzero(np.abs(z) < 1.96, axis=0)
    # An honest interval fails this once in a thousand; one half as wide nearly always: it would
    # cover 67 %, and 40 runs ask for 80 %.
    assert np.all(covered >= binom(runs, 0.95).ppf(1e-3 / 3.0))
    assert np.all(np.abs(z.mean(axis=0)) < 3.5 / np.sqrt(runs))


def test_a_band_agrees_with_the_whole_where_nothing_is_above_it() -> None:
    for number in range(2):
        _, _, recording = case("rough", number, EXACT, seconds=4.0)
        (whole, own), (mode, sd) = (_answers(_fit(recording, hz)) for hz in (None, BELOW))
        # What the band leaves out was information, so that its deviation is the larger one.
        assert np.all(sd > 0.8 * own)
        assert np.all(np.abs(mode - whole) < 3.5 * np.sqrt(sd**2 + own**2))
