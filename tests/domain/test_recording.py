"""Recordings: shapes, accelerations from counts, and sample times."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.channels import CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import (
    Recording,
    accelerations,
    declared_rate,
    nominal_rate,
    require_half_car,
    sample_times,
    timing,
)
from bayes_asv.domain.vehicle import Sensor, Vehicle, read_vehicle

VEHICLES = Path(__file__).parents[2] / "data" / "vehicles"
INCH = 0.0254
COUNTS = ("counts",) * 4
METRIC = ("m/s^2",) * 4


@pytest.fixture
def baja() -> Vehicle:
    return read_vehicle(VEHICLES / "baja2008.toml")


def make(
    units: tuple[str, ...] = METRIC, metadata: tuple[tuple[str, str], ...] = (), n: int = 5
) -> Recording:
    values = np.arange(4.0 * n).reshape(4, n)
    return Recording(np.arange(n) / 400, values, units, metadata)


def test_arrays_are_copied_and_read_only() -> None:
    time, values = np.arange(3.0), np.zeros((4, 3))
    recording = Recording(time, values, ("g",) * 4)
    time[0] = values[0, 0] = 7.0
    assert recording.time[0] == 0.0
    assert recording.values[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        recording.time[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        recording.values[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        recording.source = "x"  # type: ignore[misc]


def test_each_channel_is_converted_from_its_own_unit(baja: Vehicle) -> None:
    values = np.array([[1.0, 2.0], [1.0, 2.0], [1.0, math.nan], [570.0, 0.0]])
    recording = Recording(np.arange(2.0), values, ("in/s^2", "g", "m/s^2", "counts"))
    sensor = baja.sensor("rear_chassis")
    assert sensor.counts_scale is not None
    expected = np.array(
        [
            [INCH, 2 * INCH],
            [9.80665, 2 * 9.80665],
            [1.0, math.nan],
            [(570.0 - 636) * sensor.counts_scale, -636 * sensor.counts_scale],
        ]
    )
    np.testing.assert_allclose(accelerations(recording, baja), expected, rtol=1e-15)


def test_extreme_counts_reach_the_limits_of_the_range(baja: Vehicle) -> None:
    ends = np.tile([0.0, 1023.0], (4, 1))
    result = accelerations(Recording(np.arange(2.0), ends, ("counts",) * 4), baja)
    for row, sensor in zip(result, baja.sensors_of(CHANNELS), strict=True):
        np.testing.assert_allclose(row, [sensor.low, sensor.high], rtol=1e-12)


def test_counts_need_zero_and_scale(baja: Vehicle) -> None:
    for sensor, missing in (
        (Sensor(counts_scale=0.1), "zero_counts"),
        (Sensor(zero_counts=512.0), "counts_scale"),
    ):
        car = dataclasses.replace(baja, sensors=dict.fromkeys(CHANNELS, sensor))
        with pytest.raises(InputError, match=rf"\[sensors.front_wheel\]: has no {missing}.*add"):
            accelerations(make(COUNTS), car)
    # where nothing is in counts nothing is needed
    accelerations(make(), dataclasses.replace(baja, sensors={}))


def test_gaps_do_not_change_the_rate() -> None:
    time = np.delete(np.arange(200) / 400, slice(50, 90))
    recording = Recording(time, np.zeros((4, time.size)), ("g",) * 4)
    assert nominal_rate(recording) == pytest.approx(400.0)


@pytest.mark.parametrize(("text", "rate"), [("400 Hz", 400.0), ("0.8 kHz", 800.0), ("50", 50.0)])
def test_declared_rate(text: str, rate: float) -> None:
    assert declared_rate(make(metadata=(("sample_rate", text),))) == pytest.approx(rate)
    assert declared_rate(make()) is None


@pytest.mark.parametrize("text", ["fast", "-400 Hz", "0", "400 s", "1e300 Hz", "nan", ""])
def test_implausible_rates_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="# sample_rate"):
        declared_rate(make(metadata=(("sample_rate", text),)))


def test_delays_of_the_recording_override_those_of_the_vehicle(baja: Vehicle) -> None:
    recording = make(metadata=(("delay front_chassis", "0.44 ms"),))
    stamps = sample_times(recording, baja)
    for row, delay in enumerate((0.0, 0.00044, 0.0, 0.000675)):
        np.testing.assert_array_equal(stamps[row], recording.time + delay)


def test_recording_may_declare_zero_delay(baja: Vehicle) -> None:
    recording = make(metadata=(("delay rear_chassis", "0 s"),))
    np.testing.assert_array_equal(sample_times(recording, baja)[3], recording.time)


def test_a_fast_clock_is_corrected_from_the_first_stamp(baja: Vehicle) -> None:
    car = dataclasses.replace(baja, sensors={})
    time = 100.0 + np.arange(1001.0)
    recording = Recording(
        time,
        np.zeros((4, time.size)),
        ("g",) * 4,
        (("clock rear", "48.3 ppm"), ("clock rear_wheel", "-20 ppm")),
    )
    front_wheel, front_chassis, rear_wheel, rear_chassis = sample_times(recording, car)
    np.testing.assert_array_equal(front_wheel, time)
    np.testing.assert_array_equal(front_chassis, time)
    # a clock that is fast by 48.3 ppm says 1000 s when 999.9517 s have gone
    np.testing.assert_allclose(rear_chassis, 100.0 + np.arange(1001.0) / (1 + 48.3e-6), rtol=1e-15)
    assert rear_chassis[-1] - 100.0 == pytest.approx(999.9517023, abs=1e-6)
    assert rear_wheel[-1] - 100.0 == pytest.approx(1000.0 / (1 - 20e-6))
    assert rear_wheel[0] == rear_chassis[0] == 100.0


def test_front_clock_applies_to_both_front_channels() -> None:
    assert timing(make(metadata=(("clock front", "10 ppm"),))).clock == pytest.approx(
        (1e-5, 1e-5, 0.0, 0.0)
    )


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("delay front_chasis", "0 s", "did you mean front_chassis"),
        ("delay rear", "0 s", "there is no channel 'rear'"),
        ("delay front_wheel", "0 m", "not a unit of time"),
        ("delay front_wheel", "soon", "not a number"),
        ("delay front_wheel", "3 hours", "not a plausible delay"),
        ("clock middle", "3 ppm", "there is no channel"),
        ("clock rear", "3 s", "not a unit of a dimensionless ratio"),
        ("clock rear", "1e9 ppm", "not a plausible clock error"),
    ],
)
def test_unreadable_timing_is_refused(key: str, value: str, said: str) -> None:
    with pytest.raises(InputError, match=f"# {key}: .*{said}"):
        timing(make(metadata=((key, value),)))


def test_other_metadata_are_ignored() -> None:
    said = timing(make(metadata=(("clock", "internal"), ("delayed", "yes"), ("note", "x"))))
    assert said.delay == (None,) * 4
    assert said.clock == (0.0,) * 4


@pytest.mark.parametrize(
    ("time", "shape", "said"),
    [
        ([0.0, 1.0, 1.0], (4, 3), "row 3: time does not increase"),
        ([0.0, 2.0, 1.0], (4, 3), "row 3: time does not increase"),
        ([0.0, math.nan, 1.0], (4, 3), "row 2: time"),
        ([0.0, math.inf], (4, 2), "row 2: time"),
        ([0.0, 1e300], (4, 2), "a stamp is beyond"),
        ([0.0], (4, 1), "at least two"),
        ([0.0, 1.0], (4, 3), "do not match"),
        ([0.0, 1.0], (3, 2), "do not match"),
    ],
)
def test_invalid_recordings_are_refused(
    time: list[float], shape: tuple[int, int], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        Recording(np.array(time), np.zeros(shape), ("g",) * 4)


def test_wrong_units_and_infinite_readings() -> None:
    with pytest.raises(InputError, match=r"front_wheel: .*not a unit of acceleration.*or counts"):
        make(units=("m",) * 4)
    for huge in (math.inf, -1e300):
        with pytest.raises(InputError, match="a reading is beyond"):
            Recording(np.arange(2.0), np.full((4, 2), huge), ("g",) * 4)


def test_white_space_in_metadata_is_collapsed() -> None:
    recording = make(metadata=(("a  key", " two\nlines\t"), ("a key", "last")))
    assert recording.metadata == (("a key", "two lines"), ("a key", "last"))
    assert recording.get("a key") == "last"
    assert recording.get("none") is None
    with pytest.raises(InputError, match="without '='"):
        make(metadata=(("a=b", "c"),))


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        (ROLL_CHANNELS, "has the seven channels of the roll car"),
        (CHANNELS[:3], "lacks the channel rear_chassis"),
        ((*CHANNELS, "front_travel"), "has the channel front_travel, which is not used here"),
    ],
)
def test_the_half_car_has_four_channels(channels: tuple[str, ...], said: str) -> None:
    units = tuple("m" if name.endswith("travel") else "m/s^2" for name in channels)
    values = np.zeros((len(channels), 3))
    recording = Recording(np.arange(3.0), values, units, source="a.csv", channels=channels)
    with pytest.raises(InputError, match=f"a.csv: {said}"):
        require_half_car(recording)
    require_half_car(make())
