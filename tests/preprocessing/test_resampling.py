"""Resampled channels are recognised and undone; what a sensor gave is left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import filtfilt, firwin

from bayes_asv.domain.recording import Recording
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording
from bayes_asv.preprocessing.resampling import at_own_rate, find_resampling
from benchmarks.resampled_exports import export, widths
from tests.posterior.cases import DECLARED, case, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, Engine, SensorSpec, baja, drive, table51

Array = NDArray[np.float64]

_SHIPPED = Path(__file__).parents[2] / "data" / "recordings"
_SHARED = Path(__file__).parents[3] / "shared" / "data"


def _exported(recording: Recording, how: str, new: int, decimals: int = 4) -> Recording:
    rate = round(1.0 / float(recording.time[1] - recording.time[0]))
    time, values = export(recording.time, recording.values, how, rate, new)
    return replace(recording, time=time, values=np.round(values, decimals))


@pytest.mark.parametrize("terrain", ["bump", "stops", "rough"])
@pytest.mark.parametrize(
    ("how", "rate", "new", "words"),
    [
        ("held", 400, 800, "held at 800 Hz"),
        ("held", 400, 1000, "held at 1000 Hz"),
        ("linear", 400, 1000, "interpolated linearly to 1000 Hz"),
        ("linear", 800, 1000, "interpolated linearly to 1000 Hz"),
        ("cubic", 400, 1000, "interpolated by a cubic spline to 1000 Hz"),
        ("cubic", 400, 500, "interpolated by a cubic spline to 500 Hz"),
    ],
)
def test_the_readings_before_an_export_come_back(
    terrain: str, how: str, rate: int, new: int, words: str
) -> None:
    _, _, recording = case(terrain, 3, DECLARED, float(rate))
    exported = _exported(recording, how, new)
    back = at_own_rate(exported)
    rows = min(len(back.time), len(recording.time))
    assert rows >= len(recording.time) - 1
    np.testing.assert_allclose(back.time[:rows], recording.time[:rows], atol=1e-9)
    # Rounding to 1e-4 in/s² passes from rows to the samples between them, most at the ends.
    np.testing.assert_allclose(back.values[:, :rows], recording.values[:, :rows], atol=2e-2)
    (warning,) = back.warnings
    assert words in warning
    assert f"read at {rate} Hz" in warning
    assert at_own_rate(back) is back


def test_one_channel_alone_keeps_the_rows_of_the_others() -> None:
    _, _, fast = case("bump", 3, DECLARED, 800.0)
    _, held = export(fast.time[::2], fast.values[:, ::2], "held", 400, 800)
    values = fast.values[:, : held.shape[1]].copy()
    values[1] = held[1]
    mixed = replace(fast, time=fast.time[: held.shape[1]], values=values)
    back = at_own_rate(mixed)
    assert np.array_equal(back.time, mixed.time)
    assert np.isfinite(back.values[1]).tolist() == [k % 2 == 0 for k in range(len(back.time))]
    np.testing.assert_array_equal(back.values[[0, 2, 3]], mixed.values[[0, 2, 3]])
    assert "front chassis of" in back.warnings[0]


def test_an_export_that_was_cut_afterwards_and_lost_rows_comes_back() -> None:
    _, _, recording = case("rough", 3, DECLARED)
    exported = _exported(recording, "linear", 1000)
    kept = np.arange(7, len(exported.time))
    kept = kept[(kept < 900) | (kept > 903)]
    cut = replace(exported, time=exported.time[kept], values=exported.values[:, kept])
    back = at_own_rate(cut)
    at = np.searchsorted(recording.time, back.time - 1e-6)
    np.testing.assert_allclose(back.time, recording.time[at], atol=1e-9)
    np.testing.assert_allclose(back.values, recording.values[:, at], atol=1e-2)
    assert len(back.time) > 0.98 * len(recording.time) - 8


@pytest.mark.parametrize("how", ["sinc", "fir"])
def test_a_low_passed_channel_is_thinned_to_twice_its_bandwidth(how: str) -> None:
    sensors = replace(SensorSpec(), adc=None)
    _, _, recording = case("stops", 3, DECLARED, sensors=sensors)
    exported = _exported(recording, how, 1000 if how == "sinc" else 400)
    own = 400.0 if how == "sinc" else 160.0
    back = at_own_rate(exported)
    rate = (len(back.time) - 1) / float(np.ptp(back.time))
    assert 0.6 * own < rate < 1.1 * own
    assert "low-passed at" in back.warnings[0]
    assert np.isin(back.time, exported.time).all()


@pytest.mark.parametrize("narrow", [0, 3])
def test_of_several_bandwidths_the_smallest_is_taken_for_all_channels(narrow: int) -> None:
    """A program filters all channels alike."""
    sensors = replace(SensorSpec(), adc=None)
    _, _, recording = case("stops", 3, DECLARED, seconds=4.0, sensors=sensors)
    values = recording.values.copy()
    for c in range(4):
        end = 0.2 if c == narrow else 0.4
        values[c] = np.round(filtfilt(firwin(65, end), np.ones(1), values[c]), 4)
    low_passed = replace(recording, values=values)
    alone = [find_resampling(values) for values in low_passed.values]
    shares = [float(one.ratio) for one in alone if one is not None]
    assert len(shares) == 4
    assert sorted(shares)[1] > 1.5 * shares[narrow]
    kept = np.isfinite(at_own_rate(low_passed).values).mean(axis=1)
    assert kept == pytest.approx([1.0] * 4)
    count = len(at_own_rate(low_passed).time)
    assert count == pytest.approx(shares[narrow] * len(recording.time), rel=0.02)


@pytest.mark.parametrize("terrain", ["bump", "stops", "rough", "rollers", "washboard", "flat"])
@pytest.mark.parametrize(
    "sensors",
    [
        SensorSpec(),
        SensorSpec.clean(),
        SensorSpec.ideal(),
        replace(SensorSpec(), noise=(0.001,) * 4, adc=None),
        replace(SensorSpec(), bandwidth=(15.0,) * 4, noise_kind="white"),
        replace(SensorSpec(), dropped=0.02),
    ],
)
def test_what_a_sensor_gave_is_left_alone(terrain: str, sensors: SensorSpec) -> None:
    for seed, rate in enumerate((100.0, 400.0, 1000.0)):
        engines = (Engine(frequency=0.25 * rate, amplitude=200.0, seed=seed),) if seed else ()
        run = drive(
            (baja, table51)[seed % 2](), TERRAINS[terrain](seed), DEFAULT_SPEEDS[terrain], rate,
            2.5, sensors, seed, forces=engines,
        )  # fmt: skip
        for values in (run.channels, np.round(run.channels / 9.81, 2)):
            plain = Recording(run.time, values, ("m/s^2",) * 4)
            assert at_own_rate(plain) is plain


@pytest.mark.parametrize("step", [1e-6, 0.02, 0.08], ids=["fine", "noise of 1.5", "noise of 0.4"])
def test_a_steady_slow_motion_is_not_taken_for_noise(step: float) -> None:
    # A smooth road moves the wheels up to 15 Hz and no further; the sensor's noise is 40 dB below.
    rng = np.random.default_rng(3)
    rate, rows = 400, 4096
    found = 0
    for _ in range(10):
        spectrum = np.fft.rfft(rng.normal(0.0, 1.0, rows))
        spectrum[np.fft.rfftfreq(rows, 1.0 / rate) > 15.0] = 0.0
        motion = np.fft.irfft(spectrum, rows)
        motion *= 0.3 / motion.std()
        time = np.arange(rows) / rate
        bumps = 20.0 * np.sin(50.0 * time) * np.exp(-(((time - 5.0) / 0.3) ** 2))
        reading = motion + bumps + rng.normal(0.0, 0.03, rows)
        found += find_resampling(np.round(reading / step) * step) is not None
    assert found == 0


@pytest.mark.parametrize("rows", [2, 8, 59, 60, 65, 130, 250])
def test_short_and_empty_channels_are_left_alone(rows: int) -> None:
    rng = np.random.default_rng(5)
    values = rng.standard_normal((4, rows))
    values[1] = 0.0
    values[2] = np.nan
    values[3, rows // 2 :] = 1.0
    short = Recording(np.arange(rows) / 100.0, values, ("m/s^2",) * 4)
    assert at_own_rate(short) is short


def test_a_coarse_potentiometer_is_left_alone() -> None:
    """Steps of 1 mm while it moves by a few: most readings repeat."""
    rng = np.random.default_rng(4)
    time = np.arange(1600) / 400.0
    travel = 0.02 * np.exp(-time) * np.sin(2.0 * np.pi * 1.7 * time)
    for noise in (0.0, 1e-4, 1e-3):
        noisy = travel + noise * rng.standard_normal(len(time))
        assert find_resampling(np.rint(noisy / 1e-3) * 1e-3) is None


@pytest.mark.parametrize("path", sorted(_SHIPPED.glob("*.csv")), ids=lambda path: path.stem)
def test_shipped_recordings_are_left_alone(path: Path) -> None:
    recording = read_recording(path)
    assert at_own_rate(recording) is recording


@pytest.mark.parametrize("folder", ["roomster", "silverbox", "dyno"])
def test_real_recordings_are_left_alone(folder: str) -> None:
    paths = [p for p in sorted((_SHARED / folder).glob("*.csv")) if not p.name.startswith("t1")]
    if not paths:
        pytest.skip(f"../shared/data/{folder} is not there")
    for path in paths:
        recording = read_recording(path)
        assert at_own_rate(recording) is recording


def test_an_export_gives_no_narrower_intervals() -> None:
    """All kinds of exports are in ``benchmarks/resampled_exports.py``."""
    _, _, recording = case("bump", 6, DECLARED)
    car = vehicle(DECLARED)
    before = widths(estimate([recording], car))
    exported = _exported(recording, "linear", 1000)
    result = estimate([exported], car)
    assert any("interpolated linearly" in warning for warning in result.warnings)
    for name, width in widths(result).items():
        assert width > 0.95 * before[name]
