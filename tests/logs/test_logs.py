"""What a log holds, what its channels probably are, and static calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log, LoggedChannel
from bayes_asv.domain.units import STANDARD_GRAVITY as GRAVITY
from bayes_asv.domain.vehicle_file import parse_channel_map
from bayes_asv.io import read_log
from bayes_asv.logs.calibration import calibrate_axes, calibrate_values, plateaus
from bayes_asv.logs.facts import channel_facts, rest_level
from bayes_asv.logs.names import meaning
from bayes_asv.logs.proposal import Proposal, map_text, propose
from tests.rig.car import baja
from tests.rig.run import drive
from tests.rig.sensors import SensorSpec
from tests.rig.terrain import bump

LOGS = Path(__file__).parents[3] / "shared" / "data" / "logs"
Array = NDArray[np.float64]


def _proposals(log: Log) -> dict[str, Proposal]:
    found = propose(log, [channel_facts(one) for one in log.channels])
    return {one.channel.channel: one for one in found}


def _log(rate: float, **columns: tuple[str, Array]) -> Log:
    return Log(
        tuple(
            LoggedChannel(name.replace("_", " "), unit, np.arange(len(values)) / rate, values)
            for name, (unit, values) in columns.items()
        ),
        "test",
        "folder/run.csv",
    )


@pytest.mark.parametrize(
    ("name", "unit", "expected"),
    [
        ("Susp Pos FL", "mm", ("deflection", "suspension", "front", "left")),
        ("Damper Pos RR", "in", ("deflection", "suspension", "rear", "right")),
        ("Acc Hub Front", "g", ("acceleration", "wheel", "front", None)),
        ("accelRearChassis", "m/s^2", ("acceleration", "body", "rear", None)),
        ("LF_upright_az", "G", ("acceleration", "wheel", "front", "left")),
        ("IMU PitchRate", "deg/s", ("angular_rate", "body", None, None)),
        ("G Force Vert", "G", ("acceleration", None, None, None)),
        ("fork", "counts", ("deflection", "suspension", "front", None)),
        ("Lap Distance", "m", (None, None, None, None)),
    ],
)
def test_names_of_real_loggers(name: str, unit: str, expected: tuple[str | None, ...]) -> None:
    says = meaning(name, unit)
    assert (says.quantity, says.part, says.axle, says.side) == expected


@pytest.mark.parametrize("name", ["Ride Height FL", "Tyre Temp FL", "Brake Pressure Front"])
def test_names_of_other_things(name: str) -> None:
    assert meaning(name, "mm").other


def test_facts_of_a_channel() -> None:
    rng = np.random.default_rng(1)
    time = np.delete(np.arange(4000) / 400.0, slice(1000, 1100))
    values = 1.0 + 0.01 * rng.standard_normal(time.size)
    values[500:900] += np.sin(0.3 * np.arange(400))
    values = np.round(values / 0.005) * 0.005
    facts = channel_facts(LoggedChannel("a", "g", time, values))
    assert facts.rate == pytest.approx(400.0)
    assert facts.gaps == 1
    assert facts.longest_gap == pytest.approx(101 / 400.0)
    assert facts.rest == pytest.approx(1.0, abs=0.005)
    assert facts.noise == pytest.approx(0.01, rel=0.3)
    assert facts.step == pytest.approx(0.005)
    assert facts.low < 0.0 < 1.9 < facts.high


def test_a_channel_of_one_reading_has_facts() -> None:
    facts = channel_facts(LoggedChannel("a", "g", np.zeros(1), np.ones(1)))
    assert (facts.readings, facts.rest, facts.noise) == (1, 1.0, 0.0)


@given(st.permutations(range(4)), st.integers(0, 15), st.sampled_from([1.0, GRAVITY]))
def test_four_unnamed_accelerations_are_told_apart(
    order: list[int], signs: int, size: float
) -> None:
    """Gravity gives sign and unit, the readings give the places."""
    upside_down = [bool(signs >> k & 1) for k in range(4)]
    columns = {}
    for place, k in enumerate(order):
        upright = (_RUN[k] / GRAVITY + 1.0) * size
        columns[f"column {place + 1}"] = ("", -upright if upside_down[k] else upright)
    found = _proposals(_log(400.0, **columns))
    for k, name in enumerate(("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")):
        one = found[name].channel
        assert one.columns == (f"column {order.index(k) + 1}",)
        assert one.unit == ("g" if size == 1.0 else "m/s^2")
        assert one.scale == (-1.0 if upside_down[k] else 1.0)
        assert one.offset * one.scale == pytest.approx(size, rel=0.05)


def _rig_run() -> Array:
    run = drive(baja(), bump(), 3.0, 400.0, 3.0, SensorSpec(), 1)
    return np.asarray(run.channels, dtype=float)


_RUN = _rig_run()


@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.3),
    st.sampled_from(["g", "m/s^2", ""]),
)
def test_three_axes_show_the_direction_of_up(direction: tuple[float, ...], unit: str) -> None:
    up = np.array(direction) / np.linalg.norm(direction)
    rng = np.random.default_rng(1)
    size = GRAVITY if unit == "m/s^2" else 1.0
    vertical = 1.0 + 0.2 * np.sin(np.arange(2000) / 40.0) * (np.arange(2000) > 1000)
    axes = size * (up[:, None] * vertical + 0.001 * rng.standard_normal((3, 2000)))
    found = _proposals(
        _log(200.0, **{f"acc {k}": (unit, v) for k, v in zip("xyz", axes, strict=True)})
    )
    text = map_text(tuple(found.values()), _log(200.0, a=("", vertical)), None)
    if unit:
        assert "folder" not in text
    one = found["body_vertical"].channel
    given_axis = dict(
        zip(one.columns, one.axis or (one.scale,), strict=True)
    )  # one axis alone where the tilt is small
    weights = np.array([given_axis.get(f"acc {k}", 0.0) for k in "xyz"])
    assert weights @ up > np.cos(np.radians(2.6))
    recovered = weights @ axes - (one.offset * (one.scale if not one.axis else 1.0))
    assert recovered == pytest.approx(size * (vertical - 1.0), abs=0.02 * size)


def test_left_and_right_become_their_mean_and_one_side_stands_for_both() -> None:
    rng = np.random.default_rng(2)
    pots = rng.standard_normal((3, 500))
    found = _proposals(
        _log(
            100.0, Susp_Pos_FL=("mm", pots[0] + 5.0), Susp_Pos_FR=("mm", pots[1] + 7.0),
            Susp_Pos_RL=("mm", pots[2]), Engine_RPM=("rpm", pots[0]),
        )
    )  # fmt: skip
    assert set(found) == {"front_travel", "rear_travel"}
    assert found["front_travel"].channel.columns == ("Susp Pos FL", "Susp Pos FR")
    assert found["front_travel"].channel.axis == (0.5, 0.5)
    assert found["front_travel"].channel.offset == pytest.approx(6.0, abs=0.3)
    assert "left side stands for both" in found["rear_travel"].why


@pytest.mark.parametrize(
    ("file", "rate", "expected"),
    [
        ("motec_sample1.ld", None, {"front_travel", "rear_travel", "body_vertical"}),
        ("sufni_00648.SST", None, {"front_travel", "rear_travel"}),
        ("picoquake_car_vibration.csv", None, {"body_vertical", "body_pitch_rate"}),
        ("teensy_accelerometer.csv", None, {"body_vertical"}),
        ("stm32_suspension.csv", 100.0, {"front_travel", "rear_travel"}),
        ("racechrono_v3.csv", None, set()),
        ("endaq_SSX70065.IDE", None, {"body_vertical"}),
        ("labview_raw1.tdms", None, set()),
        ("suspension_project_1.mat", None, set()),
    ],
)
def test_real_logs(file: str, rate: float | None, expected: set[str]) -> None:
    if not (LOGS / file).exists():
        pytest.skip(f"{file} is not here")
    log = read_log(LOGS / file, rate)
    found = _proposals(log)
    assert set(found) == expected
    text = map_text(tuple(found.values()), log, rate)
    if expected:
        written = parse_channel_map(text.encode(), "map.toml")
        assert [one.channel for one in written.channels] == list(found)


def test_positions_of_a_static_test_are_found() -> None:
    rng = np.random.default_rng(3)
    levels = [1.0, -1.0, 0.0, 0.7]
    values: list[float] = []
    for level in levels:
        values += [level] * 400 + list(level + np.cumsum(0.3 * rng.standard_normal(100)))
    reading = np.array(values) + 0.002 * rng.standard_normal(len(values))
    held = plateaus(np.arange(reading.size) / 200.0, reading[None])
    assert [mean[0] for _, _, mean in held] == pytest.approx(levels, abs=0.02)


@given(st.integers(0, 2**32 - 1), st.integers(8, 20))
def test_six_positions_give_offset_and_scale_of_three_axes(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    offset, sensitivity = rng.uniform(-0.1, 0.1, 3), rng.uniform(0.9, 1.1, 3)
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    tilted = faces[rng.permutation(np.arange(count) % 6)] + 0.1 * rng.standard_normal((count, 3))
    gravity = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)  # g
    readings = offset + sensitivity * gravity + 1e-4 * rng.standard_normal((count, 3))
    found = calibrate_axes(readings, GRAVITY, "test")
    for k, axis in enumerate(found.axes):
        assert axis.offset == pytest.approx(offset[k], abs=1e-3)
        assert axis.scale == pytest.approx(GRAVITY / sensitivity[k], rel=1e-3)
        assert 0.0 < axis.scale_sd < 0.01
    assert found.residual < 0.01


def test_deviations_of_a_calibration_are_those_of_repeated_tests() -> None:
    rng = np.random.default_rng(5)
    faces = np.concatenate([np.eye(3), -np.eye(3), np.ones((1, 3)) / 3**0.5] * 2)
    tests = [
        calibrate_axes(faces + 1e-3 * rng.standard_normal(faces.shape), GRAVITY, "test").axes[0]
        for _ in range(200)
    ]
    spread = np.std([axis.scale for axis in tests])
    assert np.sqrt(np.mean([axis.scale_sd**2 for axis in tests])) == pytest.approx(spread, rel=0.2)


def test_the_level_at_rest_is_found_beside_a_gap_of_years() -> None:
    """The memory follows the readings, not the time between them."""
    time = np.concatenate([np.arange(400) / 400.0, 1e15 + np.arange(400)])
    values = np.where(np.arange(800) < 200, 1.0, np.sin(np.arange(800)))
    assert rest_level(time, values) == 1.0


def test_known_values_give_a_line() -> None:
    known = [0.0, 25.0, 50.0, 75.0]
    readings = np.array([512.0 + value / 0.125 for value in known]) + np.array([1, -1, 1, -1])
    found = calibrate_values(readings, known, "test")
    slope, offset = np.polyfit(known, readings, 1)
    assert found.axes[0].offset == pytest.approx(offset)
    assert found.axes[0].scale == pytest.approx(1.0 / slope)
    assert found.largest >= found.residual > 0.0


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        (np.eye(3), "three axes need six"),
        (np.tile([0.0, 0.0, 1.0], (8, 1)), "six faces"),
        (np.tile(np.concatenate([np.eye(3)[:1], -np.eye(3)[:1]]), (4, 1)), "six faces"),
    ],
)
def test_positions_that_determine_nothing_are_refused(positions: Array, words: str) -> None:
    with pytest.raises(InputError) as caught:
        calibrate_axes(positions, GRAVITY, "held.csv")
    assert words in str(caught.value)
