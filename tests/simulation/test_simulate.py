"""Simulated recordings: roads, sensors, seeds."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import accelerations
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle
from bayes_asv.shipped import shipped
from bayes_asv.simulation import ROADS
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate

G = 9.80665


@pytest.fixture(scope="module")
def baja() -> Vehicle:
    return read_vehicle(shipped("vehicles", "baja2008.toml"))


@pytest.fixture(scope="module")
def ideal(baja: Vehicle) -> Vehicle:
    return replace(baja, sensors={})


@pytest.mark.parametrize("name", ROADS)
def test_every_road_excites_the_car_without_clipping(baja: Vehicle, name: str) -> None:
    drive = simulate(baja, road(name, np.random.default_rng(0)), seconds=2.5)
    acc = accelerations(drive.recording, baja)
    assert drive.recording.units == ("counts",) * 4
    for c in range(4):
        counts = drive.recording.values[c]
        assert counts.min() > 0
        assert counts.max() < 1023
    assert np.std(acc[0]) > 0.1 * G
    assert 0.005 < np.max(np.abs(drive.deflection)) < 0.16


def test_rear_hub_follows_the_front_a_wheelbase_later(ideal: Vehicle) -> None:
    way = road("bump", np.random.default_rng(0))
    drive = simulate(ideal, way, seconds=2.5)
    lag = ideal.l.value / way.speed
    front, rear = drive.truth[0], drive.truth[2]
    late = np.interp(drive.time, drive.time + lag, front, left=0.0)
    np.testing.assert_allclose(rear, late, atol=0.02 * np.max(np.abs(front)))


def test_the_hub_acceleration_is_the_road_s_second_derivative(ideal: Vehicle) -> None:
    way = road("rollers", np.random.default_rng(0))
    drive = simulate(ideal, way, seconds=2.5)
    again = np.cumsum(np.cumsum(drive.truth[0])) * (drive.time[1] - drive.time[0]) ** 2
    height = way.height(way.speed * (drive.time - 0.5))
    assert np.max(np.abs(again - height)) < 0.02 * np.max(height)


def test_noise_has_the_declared_deviation_and_correlation(baja: Vehicle) -> None:
    noisy = Sensor(noise=0.05, bandwidth=50.0)
    still = road("bump", np.random.default_rng(0), speed=0.1)
    car = replace(baja, sensors=dict.fromkeys(CHANNELS, noisy))
    drive = simulate(car, still, seconds=20.0)
    noise_free = simulate(
        replace(car, sensors=dict.fromkeys(CHANNELS, replace(noisy, noise=None))),
        still,
        seconds=20.0,
    )
    x = accelerations(drive.recording, car)[0] - accelerations(noise_free.recording, car)[0]
    assert x.std() == pytest.approx(0.05, rel=0.05)
    assert np.mean(x[1:] * x[:-1]) / x.var() == pytest.approx(0.456, abs=0.05)


def test_band_limited_noise_stays_in_its_band(ideal: Vehicle) -> None:
    drive = simulate(ideal, road("noise", np.random.default_rng(2)), seconds=30.0)
    x = drive.truth[0][drive.time > 3.0]
    power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    frequency = np.fft.rfftfreq(len(x), drive.time[1] - drive.time[0])
    assert power[(frequency > 0.4) & (frequency < 20.5)].sum() > 0.999 * power.sum()


def test_seeds(baja: Vehicle) -> None:
    way = road("rough", np.random.default_rng(1))
    one, two, three = (simulate(baja, way, seed=s).recording.values for s in (1, 1, 2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, three)


def test_an_unknown_road_is_an_error_that_lists_the_roads() -> None:
    with pytest.raises(ValueError, match="stops"):
        road("moon", np.random.default_rng(0))
