"""Simulated sensors against the formulas of filter, noise, saturation and quantization."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.channels import CHANNELS, channel
from bayes_asv.domain.recording import accelerations
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.planning.measurement import (
    DEFAULT_NOISE,
    filter_motion,
    reading_extremes,
    simulate_recording,
    with_default_noise,
)
from bayes_asv.planning.ride_simulation import Motion
from bayes_asv.shipped import shipped

FOUR = [channel(name) for name in CHANNELS]
FREQUENCY, AMPLITUDE = 6.0, 20.0  # Hz, m/s²


@pytest.fixture(scope="module")
def baja() -> Vehicle:
    return read_vehicle(shipped("vehicles", "baja2008.toml"))


def _sine(seconds: float) -> Motion:
    time = np.arange(-0.25, seconds + 0.06, 5e-4)
    wave = AMPLITUDE * np.sin(2.0 * math.pi * FREQUENCY * time)
    still = np.zeros((2, len(time)))
    return Motion(time, np.stack([wave, 0.5 * wave, wave, 0.5 * wave]), still, np.zeros(2))


def test_a_sine_passes_one_pole_and_a_delay(baja: Vehicle) -> None:
    sensor = Sensor(bandwidth=15.0, delay=0.002)
    plain = replace(baja, sensors=dict.fromkeys(CHANNELS, sensor))
    read = simulate_recording(plain, filter_motion(plain, _sine(2.0), FOUR), 400.0, 2.0, 1)
    assert read.units == ("m/s^2",) * 4
    late = read.time > 0.5  # the filter has settled
    ratio = FREQUENCY / 15.0
    gain, lag = 1.0 / math.hypot(1.0, ratio), math.atan(ratio)
    angle = 2.0 * math.pi * FREQUENCY * (read.time[late] + 0.002) - lag
    # straight lines over 0.5 ms lose (ωh)²/12 = 3e-5 of a sine
    assert read.values[0, late] == pytest.approx(AMPLITUDE * gain * np.sin(angle), abs=2e-3)


def test_an_accelerometer_without_a_bandwidth_is_like_the_slowest_of_the_others(
    baja: Vehicle,
) -> None:
    """A sensor of another quantity has no filter."""
    sensors = {
        "front_wheel": Sensor(bandwidth=15.0),
        "front_chassis": Sensor(bandwidth=60.0),
        "rear_wheel": Sensor(),
        "front_travel": Sensor(),
    }
    motion, channels = _sine(1.0), [channel(name) for name in sensors]
    wave = motion.signals[0]
    alike = replace(motion, signals=np.stack([wave] * len(channels)))
    filtered = filter_motion(replace(baja, sensors=sensors), alike, channels)
    slow, quick, unknown, travel = (filtered.channel(c, motion.time) for c in range(4))
    assert np.max(np.abs(quick - slow)) > 0.05 * AMPLITUDE
    np.testing.assert_allclose(unknown, slow)
    np.testing.assert_allclose(travel, wave, atol=1e-9)


def test_saturation_counts_and_quantization(baja: Vehicle) -> None:
    read = simulate_recording(baja, filter_motion(baja, _sine(1.0), FOUR), 400.0, 1.0, 1)
    assert read.units == ("counts",) * 4
    assert np.all(read.values == np.rint(read.values))
    tight = replace(
        baja, sensors=dict.fromkeys(CHANNELS, Sensor(low=-5.0, high=7.0, resolution=0.5))
    )
    got = accelerations(
        simulate_recording(tight, filter_motion(tight, _sine(1.0), FOUR), 400.0, 1.0, 1), tight
    )
    assert (got.min(), got.max()) == (-5.0, 7.0)
    assert np.all(got / 0.5 == np.rint(got / 0.5))
    assert reading_extremes(filter_motion(tight, _sine(1.0), FOUR), 1.0)[0] == pytest.approx(
        [-20.0, 20.0], rel=1e-3
    )


@pytest.mark.parametrize("bandwidth", [None, 50.0])
def test_noise_has_its_deviation_and_correlation(baja: Vehicle, bandwidth: float | None) -> None:
    """20000 samples: deviation to 1.5 %, correlation to 0.02, four deviations each."""
    sensor = Sensor(noise=0.3, bandwidth=bandwidth)
    noisy = replace(baja, sensors=dict.fromkeys(CHANNELS, sensor))
    motion = _sine(50.0)
    still = replace(motion, signals=np.zeros_like(motion.signals))
    got = simulate_recording(noisy, filter_motion(noisy, still, FOUR), 400.0, 50.0, 5).values
    correlation = 0.0 if bandwidth is None else math.exp(-2.0 * math.pi * bandwidth / 400.0)
    for row in got:
        assert np.std(row) == pytest.approx(0.3, rel=0.045)
        assert np.corrcoef(row[1:], row[:-1])[0, 1] == pytest.approx(correlation, abs=0.03)
    assert np.abs(np.corrcoef(got) - np.eye(4)).max() < 0.05
    again = simulate_recording(noisy, filter_motion(noisy, still, FOUR), 400.0, 50.0, 5).values
    assert np.array_equal(got, again)


def test_a_default_noise_is_used_only_where_none_is_declared(baja: Vehicle) -> None:
    assert with_default_noise(baja, FOUR) == (baja, ())
    first = replace(baja.sensor("front_wheel"), noise=None)
    bare = replace(baja, sensors={**baja.sensors, "front_wheel": first, "front_chassis": Sensor()})
    filled, missing = with_default_noise(bare, FOUR)
    assert missing == ("front_wheel", "front_chassis")
    assert filled.sensor("front_chassis").noise == DEFAULT_NOISE["acceleration"]
    noise = filled.sensor("front_wheel").noise
    assert noise is not None
    assert noise < DEFAULT_NOISE["acceleration"]  # its quantization is declared and adds to it
    assert filled.sensors_of(CHANNELS[2:]) == baja.sensors_of(CHANNELS[2:])
