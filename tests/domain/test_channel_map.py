"""Channel maps: arithmetic of a channel, unequal rates, files that read back, and faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.channel_map import ChannelMap, MappedChannel, read_channel_map
from bayes_asv.domain.channels import KNOWN_CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log, LoggedChannel
from bayes_asv.domain.vehicle import read_vehicle, to_toml
from bayes_asv.domain.vehicle_file import parse_channel_map

VEHICLE = Path(__file__).parents[2] / "data" / "vehicles" / "baja2008.toml"


def _log(**columns: tuple[str, float, list[float]]) -> Log:
    """Make a log of columns with unit, rate (Hz) and readings."""
    return Log(
        tuple(
            LoggedChannel(name, unit, np.arange(len(values)) / rate, np.array(values))
            for name, (unit, rate, values) in columns.items()
        ),
        "test",
        "run.csv",
        metadata=(("driver", "me"), ("delay front_wheel", "1 s")),
    )


def _values(log: Log, one: MappedChannel) -> NDArray[np.float64]:
    values: NDArray[np.float64] = ChannelMap((one,)).recording(log).values[0]
    return values


def test_offset_sign_scale_and_unit() -> None:
    log = _log(a=("g", 100.0, [1.0, 1.5, -1.0]))
    assert _values(log, MappedChannel("front_wheel", ("a",), offset=1.0)) == pytest.approx(
        [0.0, 0.5 * 9.80665, -2.0 * 9.80665]
    )
    upside_down = MappedChannel("front_wheel", ("a",), unit="m/s^2", offset=1.0, scale=-2.0)
    assert _values(log, upside_down) == pytest.approx([0.0, -1.0, 4.0])


def test_three_axes_give_the_component_along_up() -> None:
    up = np.array([0.48, -0.6, 0.64])
    vertical = np.array([1.0, 1.7, 0.4])  # g
    across = np.array([0.0, 0.3, -0.2])[:, None] * np.array([0.8, 0.64, 0.0])  # not along up
    axes = (vertical[:, None] * up + across - (across @ up)[:, None] * up).T
    log = _log(**{k: ("g", 100.0, list(v)) for k, v in zip("xyz", axes, strict=True)})
    one = MappedChannel("front_chassis", ("x", "y", "z"), axis=tuple(up), offset=1.0)
    assert _values(log, one) == pytest.approx(9.80665 * (vertical - 1.0))


def test_a_curve_is_followed_and_continued_straight() -> None:
    log = _log(a=("V", 100.0, [0.0, 1.0, 1.5, 2.0, 4.0, 5.0]))
    curve = ((1.0, -10.0), (2.0, 0.0), (4.0, 40.0))
    one = MappedChannel("front_travel", ("a",), unit="mm", curve=curve)
    assert _values(log, one) == pytest.approx([-0.02, -0.01, -0.005, 0.0, 0.04, 0.06])


@given(
    st.floats(0.3, 1.2), st.floats(-0.4, 0.4), st.lists(st.floats(-0.08, 0.08), min_size=2)
)  # fmt: skip
def test_a_varying_motion_ratio_is_inverted(
    middle: float, slope: float, wheel: list[float]
) -> None:
    """The damper moves by the integral of the ratio; here the ratio is a straight line."""
    wheel_travel = np.array(wheel)
    table = ((-0.1, middle - 0.1 * slope), (0.1, middle + 0.1 * slope))
    damper = middle * wheel_travel + 0.5 * slope * wheel_travel**2
    log = _log(a=("m", 100.0, list(damper)))
    one = MappedChannel("rear_travel", ("a",), motion_ratio=table)
    assert _values(log, one) == pytest.approx(wheel_travel, abs=1e-6)
    constant = MappedChannel("rear_travel", ("a",), motion_ratio=middle)
    assert _values(log, constant) == pytest.approx(damper / middle)


def test_unequal_rates_keep_their_own_stamps() -> None:
    log = _log(
        slow=("g", 100.0, [float(k) for k in range(11)]),
        fast=("g", 400.0, [float(k) for k in range(41)]),
    )
    recording = ChannelMap.from_names({"front_wheel": "fast", "front_chassis": "slow"}).recording(
        log
    )
    assert recording.channels == ("front_wheel", "front_chassis")
    assert recording.time == pytest.approx(np.arange(41) / 400.0)
    assert np.isfinite(recording.values[0]).all()
    there = np.isfinite(recording.values[1])
    assert np.flatnonzero(there).tolist() == list(range(0, 41, 4))
    assert recording.values[1][there] == pytest.approx(9.80665 * np.arange(11))


def test_delays_reach_the_recording_and_those_of_the_log_do_not() -> None:
    one = MappedChannel("front_wheel", ("a",), delay=0.008)
    recording = ChannelMap((one,)).recording(_log(a=("g", 100.0, [0.0, 1.0])))
    assert recording.metadata == (("driver", "me"), ("delay front_wheel", "0.008 s"))


_SIZE = st.floats(1e-6, 1e6, exclude_min=True)
_SCALE = _SIZE | _SIZE.map(lambda size: -size)
# Letters drawn one by one: of whole texts and numbers a filter would reject too many.
_PRINTABLE = st.characters(exclude_categories=("C", "Z"), include_characters=" ")
_TEXT = st.text(_PRINTABLE, min_size=1, max_size=20)


@st.composite
def _mapped(draw: st.DrawFn) -> MappedChannel:
    name = draw(st.sampled_from(KNOWN_CHANNELS))
    columns = tuple(draw(st.lists(_TEXT, min_size=1, max_size=3)))
    ratio: float | tuple[tuple[float, float], ...] = 1.0
    if name.endswith("travel"):
        ratio = draw(st.sampled_from([1.0, 0.62]) | st.just(((-0.04, 0.5), (0.04, 0.7))))
    curve = draw(st.sampled_from([(), ((1.0, 2.0), (2.0, 4.5))]))
    linear = {} if curve else {"offset": draw(st.just(0.0) | _SCALE), "scale": draw(_SCALE)}
    return MappedChannel(
        name, columns, draw(st.just("") | _TEXT), draw(st.sampled_from(["", "g", "mm"])),
        tuple(draw(st.sampled_from([(), (1.0,) * len(columns)]))), curve=curve, motion_ratio=ratio,
        delay=draw(st.none() | st.floats(-0.9, 0.9)),
        position=draw(st.floats(-3, 3)) if name == "body_vertical" else None, **linear,
    )  # fmt: skip


@given(_mapped(), st.none() | st.floats(0.1, 1e5))
def test_a_map_reads_back(one: MappedChannel, rate: float | None) -> None:
    written = ChannelMap((one,), rate)
    again = parse_channel_map(written.to_toml().encode(), "map.toml")
    assert again.channels == written.channels
    assert again.rate == rate
    car = read_vehicle(VEHICLE).with_channel_map(written)
    assert car.channel_map == written


def test_the_map_may_stand_in_the_vehicle_file(tmp_path: Path) -> None:
    tables = '[channels.body_vertical]\ncolumn = "az"\nposition = "0.6 m"\n'
    tables += '[channels.front_wheel]\ncolumn = "FL"\nsign = -1\n'
    file = tmp_path / "car.toml"
    file.write_text(VEHICLE.read_text("utf-8") + tables, "utf-8")
    car = read_vehicle(file)
    assert car.channel_map is not None
    assert [one.channel for one in car.channel_map.channels] == ["front_wheel", "body_vertical"]
    assert car.channel_map.by_name["front_wheel"].scale == -1.0
    assert car.channel("body_vertical").position == pytest.approx(0.6)
    file.write_text(to_toml(car), "utf-8")
    assert read_vehicle(file) == car


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# nothing\n", "maps no channel"),
        ("[channels.front_wheel]\n", "names no column"),
        ("[channels.front_weel]\ncolumn='a'\n", "did you mean front_wheel"),
        ("[channels.front_wheel]\ncolum='a'\n", "did you mean column"),
        ("[channels.front_wheel]\ncolumn='a'\nposition='1 m'\n", "position"),
        ("[channels.front_wheel]\ncolumn=['a','b']\naxis=[1.0]\n", "one number for each column"),
        ("[channels.front_wheel]\ncolumn=['a','b']\naxis=[0.0,0.0]\n", "axis is zero"),
        ("[channels.front_wheel]\ncolumn='a'\nscale=0.0\n", "scale is zero"),
        ("[channels.front_wheel]\ncolumn='a'\nsign=0\n", "sign"),
        ("[channels.front_wheel]\ncolumn='a'\nmotion_ratio=0.6\n", "travel sensor alone"),
        ("[channels.front_travel]\ncolumn='a'\nmotion_ratio=-0.6\n", "not above zero"),
        ("[channels.front_travel]\ncolumn='a'\ncurve=[[1.0,2.0]]\n", "two readings"),
        ("[channels.front_travel]\ncolumn='a'\ncurve=[[2.0,2.0],[1.0,3.0]]\n", "increasing"),
        (
            "[channels.front_travel]\ncolumn='a'\noffset=1.0\ncurve=[[1.0,2.0],[2.0,3.0]]\n",
            "beside",
        ),
        (
            "[channels.front_travel]\ncolumn='a'\nmotion_ratio={travel=[1.0],ratio=[1.0,2.0],unit='mm'}",
            "unequal numbers",
        ),
        (
            "[channels.front_travel]\ncolumn='a'\nmotion_ratio={travel=[1.0],ratio=[1.0],unit='kg'}",
            "kg",
        ),
        ("rate='fast'\n[channels.front_wheel]\ncolumn='a'\n", "rate"),
    ],
)
def test_faults_of_a_map_are_one_sentence_with_the_fix(
    tmp_path: Path, text: str, words: str
) -> None:
    file = tmp_path / "map.toml"
    file.write_text(text, "utf-8")
    with pytest.raises(InputError, match=r"map\.toml") as caught:
        read_channel_map(file)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (MappedChannel("front_wheel", ("b",)), "it has a, twice"),
        (MappedChannel("front_wheel", ("twic",)), "did you mean 'twice'"),
        (MappedChannel("front_wheel", ("v",)), "add unit"),
        (MappedChannel("front_wheel", ("volts",)), "give scale, offset and unit"),
        (MappedChannel("front_wheel", ("a",), unit="mm"), "not a unit of acceleration"),
        (MappedChannel("front_wheel", ("twice",)), "add group = one of"),
        (MappedChannel("front_wheel", ("a", "slow")), "same times"),
    ],
)
def test_faults_of_the_file_are_one_sentence_with_the_fix(one: MappedChannel, words: str) -> None:
    a = _log(
        a=("g", 100.0, [0.0, 1.0]), twice=("g", 100.0, [0.0, 1.0]), v=("", 100.0, [0.0, 1.0]),
        volts=("V", 100.0, [0.0, 1.0]), slow=("g", 50.0, [0.0, 1.0]),
    )  # fmt: skip
    other = LoggedChannel("twice", "g", np.arange(2) / 100.0, np.zeros(2), "other")
    log = Log((*a.channels, other), "test", "run.csv")
    with pytest.raises(InputError) as caught:
        ChannelMap((one,), source="map.toml").recording(log)
    assert words in str(caught.value)


def test_a_unit_that_contradicts_the_file_is_noted() -> None:
    recording = ChannelMap((MappedChannel("front_wheel", ("a",), unit="g"),)).recording(
        _log(a=("m/s^2", 100.0, [0.0, 1.0]))
    )
    assert any("the file states m/s^2, the channel map g" in text for text in recording.warnings)
