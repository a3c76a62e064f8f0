"""Tones are found where there are some, cut out without harm, and cost honesty nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import sosfreqz

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Unsprung
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.preprocessing.tone_removal import (
    Notch,
    band_pass_filter,
    engine_tones,
    find_tones,
    main_tones,
    notch_filter,
    notched,
    own_modes,
)
from benchmarks.resampled_exports import declared, export, heavy
from tests.posterior.cases import DECLARED, EXACT, as_recording, case, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, Engine, RigCar, SensorSpec, baja, draw, drive


def test_white_noise_has_no_tones() -> None:
    rng = np.random.default_rng(1)
    assert sum(bool(find_tones(rng.normal(size=(800, 2)), 400.0)) for _ in range(200)) <= 1


def test_a_tone_is_found_where_it_is() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(800) / 400.0
    nu = rng.normal(size=(800, 2))
    nu[:, 1] += 3.0 * np.sin(2.0 * math.pi * 31.3 * t)
    nu[5, 0] = math.nan
    found = find_tones(nu, 400.0)
    (frequency,) = main_tones(found)
    assert frequency == pytest.approx(31.3, abs=0.5)


@settings(max_examples=25, deadline=None)
@given(frequency=st.floats(6.0, 180.0), width=st.floats(0.5, 8.0))
def test_a_notch_is_as_wide_as_it_says_and_leaves_rest_alone(
    frequency: float, width: float
) -> None:
    sections = notch_filter([Notch(frequency, width)], 400.0)
    _, at = sosfreqz(sections, [0.0, 2.0 * math.pi * frequency / 400.0])
    assert abs(at[0]) == pytest.approx(1.0, abs=1e-9)
    assert abs(at[1]) < 1e-6
    grid = np.linspace(0.0, math.pi, 20_000)
    _, response = sosfreqz(sections, grid)
    lost = grid * 200.0 / math.pi
    passband = np.median(np.abs(response) ** 2)
    band = lost[np.abs(response) ** 2 < 0.5 * passband]
    if frequency > 8.0 * width and frequency < 200.0 - 8.0 * width:
        assert np.ptp(band) == pytest.approx(2.0 * width, rel=0.3)


def _line(recording: Recording) -> PreparedRecording:
    car = vehicle(EXACT)
    return prepare(recording, car, car_model("half", car))


@pytest.fixture(scope="module")
def plain() -> PreparedRecording:
    _, _, recording = case("rough", 4, EXACT)
    return _line(recording)


@given(st.floats(5.0, 1000.0), st.floats(30.0, 800.0))
def test_a_filter_knows_the_end_of_its_band(frequency: float, rate: float) -> None:
    """A tone above half the rate is left alone, and one just below is passed."""
    (section,) = notch_filter([Notch(frequency, 5.0)], rate)
    assert np.all(np.isfinite(section))
    if frequency >= 0.5 * rate:
        assert section.tolist() == [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    assert np.all(np.isfinite(band_pass_filter(Notch(frequency, 5.0), rate)))


def test_notches_cost_width_but_do_not_move_the_answer(plain: PreparedRecording) -> None:
    """A common filter leaves the relation between wheels and chassis as it is."""
    car = vehicle(EXACT)
    whole = best_fit((plain,), car)
    recording = notched(plain, [Notch(40.0, 3.0), Notch(21.0, 2.0)])
    assert recording.removed_band is not None
    assert 0.85 < recording.removed_band.retained_power < 0.96
    assert recording.instants[0] - plain.instants[0] > 0.2  # the filters had to settle
    part = best_fit((recording,), car)
    sd = part.mode.sd[:3]
    # The noise is estimated again, from what is left: by itself that moves widths by 2 to 4 %.
    assert np.all(sd > 0.94 * whole.mode.sd[:3])
    assert np.all(sd < 1.6 * whole.mode.sd[:3])
    # The two share most of their noise: they differ by the deviation of what one lacks.
    apart = part.mode.z[:3] - whole.mode.z[:3]
    lacking = np.sqrt(sd**2 - np.minimum(whole.mode.sd[:3], 0.95 * sd) ** 2)
    assert np.all(np.abs(apart) < 4.0 * lacking + 0.3 * sd)


def test_missing_and_clipped_readings_do_not_spoil_the_filters(plain: PreparedRecording) -> None:
    sensors = replace(SensorSpec(), jitter=2e-4, dropped=0.02)
    _, _, recording = case("rough", 4, EXACT, sensors=sensors)
    line = notched(_line(recording), [Notch(40.0, 3.0)])
    same = notched(plain, [Notch(40.0, 3.0)])
    at = np.isfinite(line.values[0])
    reference = same.wheels[0].spline(line.times[0, at])
    inside = (line.times[0, at] > 0.5) & (line.times[0, at] < 1.8)
    left = line.values[0, at][inside] - reference[inside]
    assert np.std(left) < 0.1 * np.std(reference[inside])
    clipped = plain.clipped.copy()
    clipped[1, 400] = True
    there = notched(replace(plain, clipped=clipped), [Notch(40.0, 3.0)])
    assert there.readings == same.readings - 1


def test_an_engine_does_not_move_the_answer() -> None:
    """Forty drives a terrain are in the benchmark; here the worst kind: a strong, fast engine."""
    rng = np.random.default_rng(46)
    z = []
    for seed in range(8):
        car = draw(baja(), rng, EXACT)
        engine = Engine(frequency=rng.uniform(25.0, 48.0), amplitude=140.0, seed=seed)
        run = drive(
            car, TERRAINS["bump"](seed), DEFAULT_SPEEDS["bump"], 400.0, 2.0, SensorSpec(), seed,
            forces=(engine,),
        )  # fmt: skip
        nominal = vehicle(EXACT)
        lines, reasons, _ = prepare_runs((as_recording(run, "engine.csv"),), nominal)
        assert not reasons
        fit = best_fit(lines, nominal)
        assert not fit.reasons
        assert any("shakes the frame" in w for w in fit.warnings)
        tones = main_tones(fit.space.recordings[0].notches)
        assert any(abs(f - engine.frequency) < 0.05 * engine.frequency for f in tones)
        found = fit.space.cars(fit.mode.z[None])[0]
        for k, name in enumerate(("c_f", "c_r", "i")):
            sd = fit.space.log_deviation(fit.mode.covariance, name)
            z.append(math.log(found[k] / getattr(car, name)) / sd)
    # Without the notches the worst of these errs by more than thirty deviations.
    assert np.max(np.abs(z)) < 5.0
    assert np.sqrt(np.mean(np.square(z))) < 1.7


def test_time_goes_by_from_the_beginning_of_the_record_not_of_what_a_filter_left(
    plain: PreparedRecording,
) -> None:
    recording = notched(plain, [Notch(40.0, 3.0)])
    assert plain.elapsed[0] == pytest.approx(plain.instants[0] - plain.start_time)
    assert recording.elapsed[0] == pytest.approx(recording.instants[0] - plain.start_time)
    assert recording.elapsed[-1] == pytest.approx(plain.elapsed[-1])
    twice = notched(recording, [Notch(25.0, 3.0)])
    assert twice.elapsed[-1] == pytest.approx(plain.elapsed[-1])


_T = np.arange(1000) / 400.0


def _noisy(seed: int, signal: NDArray[np.float64]) -> list[float]:
    """Frequencies of tones that pass for an engine's, of a signal in white noise."""
    nu = np.random.default_rng(seed).normal(size=(len(_T), 2)) + signal[:, None]
    modes = [(2.0, 0.5), (3.0, 0.8), (12.0, 0.12)]
    return [n.frequency for n in engine_tones(find_tones(nu, 400.0), [nu], 400.0, modes)]


def test_wheels_hop_as_a_mass_between_tyre_and_body() -> None:
    car = car_model("half", vehicle(EXACT))
    wheels = Unsprung(40.0, 55.0, 350e3, 420e3, 300.0, 500.0)
    nominal = {parameter.name: parameter.nominal for parameter in car.parameters}
    found = own_modes(car, wheels)
    assert found[:-2] == own_modes(car)
    for (frequency, ratio), axle in zip(found[-2:], ("front", "rear"), strict=True):
        mass = getattr(wheels, f"{axle}_mass")
        damping = getattr(wheels, f"{axle}_tyre_damping") + nominal[f"c_{axle[0]}"]
        rate = getattr(wheels, f"{axle}_tyre_rate") + nominal[f"k_{axle[0]}"]
        root = np.roots([mass, damping, rate])[0]
        assert frequency == pytest.approx(abs(root) / (2.0 * math.pi))
        assert ratio == pytest.approx(-root.real / abs(root))


def test_what_no_engine_turns_at_is_no_engine() -> None:
    """A line below idle, one at a mode of the wheels, a shock, an image of the logger's rate."""
    burst = 60.0 * np.exp(-(((_T - 1.2) / 0.08) ** 2)) * np.sin(2.0 * math.pi * 25.0 * _T)
    for seed in range(5):
        for frequency in (5.5, 7.0, 12.0, 197.0, 100.0):
            assert _noisy(seed, 4.0 * np.sin(2.0 * math.pi * frequency * _T + 1.0)) == []
        assert _noisy(seed, burst) == []


def test_an_engine_keeps_its_half_orders_and_its_tone_at_a_mode() -> None:
    """Idling at 700 rev/min, with orders 0.5, 1 and 2, of which 1 is at the mode of the wheels."""
    drift = 1.0 + 0.01 * np.sin(2.0 * math.pi * 0.5 * _T)
    turns = np.cumsum(11.67 * drift) / 400.0
    signal = sum(
        (a * np.sin(2.0 * math.pi * order * turns + order) for order, a in
         ((0.5, 3.0), (1.0, 4.0), (2.0, 5.0))), start=np.zeros(len(_T)),
    )  # fmt: skip
    for seed in range(3):
        found = _noisy(seed, signal)
        for order in (0.5, 1.0, 2.0):
            assert any(abs(f / order - 11.67) < 0.1 * 11.67 for f in found)


def _wrong(car: RigCar) -> dict[str, RigCar]:
    """The car as it is given, with mistakes."""
    return {
        "right": car,
        "half the springs": replace(car, k_f=0.5 * car.k_f, k_r=0.5 * car.k_r),
        "twice the mass": replace(car, m=2.0 * car.m),
        "weight at the other axle": replace(car, wdf=1.0 - car.wdf + 0.1),
    }


@pytest.mark.parametrize("terrain", ["bump", "stops"])
@pytest.mark.parametrize("nominal", [baja(), heavy()], ids=lambda car: car.name[:5])
def test_a_run_over_a_bump_has_no_engine(terrain: str, nominal: RigCar) -> None:
    """Right and wrong inputs, channels of the two axles exchanged, one late, one held."""
    run = drive(nominal, TERRAINS[terrain](5), DEFAULT_SPEEDS[terrain], 400.0, 2.5, SensorSpec(), 5)
    plain = as_recording(run, "plain.csv")
    late = plain.values.copy()
    late[1, 4:] = late[1, :-4]
    stamps, held = export(plain.time, plain.values, "held", 400, 800)
    runs = [
        *((plain, car) for car in _wrong(nominal).values()),
        (replace(plain, values=plain.values[[2, 3, 0, 1]]), nominal),
        (replace(plain, values=late), nominal),
        (replace(plain, time=stamps, values=held), nominal),
    ]
    for recording, given_car in runs:
        car = declared(given_car, SensorSpec(), DECLARED)
        lines, reasons, _ = prepare_runs((recording,), car)
        if reasons:
            continue
        assert not any("shakes the frame" in w for w in best_fit(lines, car).warnings)
