"""Tones are found where there are some, cut out without harm, and cost honesty nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import sosfreqz

from bayes_asv.domain.recording import Recording
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.map_fit import best_fit, lay_out
from bayes_asv.preprocessing.timeline import PreparedRecording, prepare
from bayes_asv.preprocessing.tone_removal import (
    Notch,
    find_tones,
    main_tones,
    notch_filter,
    notched,
    passing,
)
from tests.posterior.cases import EXACT, as_recording, case, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, Engine, SensorSpec, baja, draw, drive


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
    assert np.all(np.isfinite(passing(Notch(frequency, 5.0), rate)))


def test_notches_cost_width_but_do_not_move_the_answer(plain: PreparedRecording) -> None:
    """A common filter leaves the relation between wheels and chassis as it is."""
    car = vehicle(EXACT)
    whole = best_fit((plain,), car)
    line = notched(plain, [Notch(40.0, 3.0), Notch(21.0, 2.0)])
    assert line.cut is not None
    assert 0.85 < line.cut.left < 0.96
    assert line.instants[0] - plain.instants[0] > 0.2  # the filters had to settle
    part = best_fit((line,), car)
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
        lines, reasons, _ = lay_out((as_recording(run, "engine.csv"),), nominal)
        assert not reasons
        fit = best_fit(lines, nominal)
        assert not fit.reasons
        assert any("shakes the frame" in w for w in fit.warnings)
        tones = main_tones(fit.space.timelines[0].notches)
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
    line = notched(plain, [Notch(40.0, 3.0)])
    assert plain.elapsed[0] == 0.0
    assert line.elapsed[0] == pytest.approx(line.instants[0] - plain.instants[0])
    assert line.elapsed[-1] == pytest.approx(plain.elapsed[-1])
    twice = notched(line, [Notch(25.0, 3.0)])
    assert twice.elapsed[-1] == pytest.approx(plain.elapsed[-1])
