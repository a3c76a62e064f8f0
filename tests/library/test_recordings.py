"""Recordings from files and tables, and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bayes_asv as asv

DATA = asv.example("stops-400hz.csv").parent


def test_a_table_and_back_is_the_same_recording(stops: asv.Recording) -> None:
    again = asv.Recording.from_dataframe(stops.to_dataframe())
    assert np.array_equal(again.time, stops.time)
    assert np.array_equal(again.values, stops.values)
    assert (again.units, again.metadata) == (stops.units, stops.metadata)
    assert isinstance(again, asv.Recording)


def test_a_table_in_other_units(stops: asv.Recording) -> None:
    frame = stops.to_dataframe(units="g")
    assert frame.columns[0] == "front_wheel [g]"
    assert frame.index.name == "time [s]"
    again = asv.Recording.from_dataframe(frame)
    assert again.units == ("g",) * 4
    assert again.values * 9.80665 / 0.0254 == pytest.approx(stops.values)


def test_a_table_of_other_channels_and_back() -> None:
    run = asv.Recording(
        np.arange(3.0), np.arange(12.0).reshape(4, 3), ("g", "g", "counts", "deg/s"),
        channels=("front_wheel", "rear_wheel", "front_travel", "body_pitch_rate"),
    )  # fmt: skip
    frame = run.to_dataframe(units="m/s^2")
    assert list(frame.columns) == [
        "front_wheel [m/s^2]", "rear_wheel [m/s^2]", "front_travel [counts]",
        "body_pitch_rate [deg/s]",
    ]  # fmt: skip
    again = asv.Recording.from_dataframe(frame)
    assert again.channels == run.channels
    assert again.values[:2] == pytest.approx(9.80665 * run.values[:2])
    assert np.array_equal(again.values[2:], run.values[2:])


def _table(**changes: Any) -> pd.DataFrame:
    columns = {
        "Front wheel": [0.0, 1.0, np.nan], "front_chassis": [0.0, 0.5, 1.0],
        "rear_wheel": [0.0, 0.0, 0.0], "rear-chassis": [0.0, 0.1, 0.2], "gear": [1, 1, 2],
    }  # fmt: skip
    return pd.DataFrame({**columns, **changes})


@pytest.mark.parametrize(
    ("frame", "rate"),
    [
        (_table(time=[0.0, 0.0025, 0.005]), None),
        (_table(**{"time [ms]": [0.0, 2.5, 5.0]}), None),
        (_table().set_index(pd.Index([0.0, 0.0025, 0.005], name="t")), None),
        (_table().set_index(pd.to_timedelta([0.0, 0.0025, 0.005], unit="s")), None),
        (_table().set_index(pd.to_datetime([10**9, 1002500000, 1005000000], unit="ns")), None),
        (_table(), 400.0),
    ],
    ids=["time", "ms", "index", "timedelta", "datetime", "rate"],
)
def test_times_come_from_a_column_the_index_or_the_rate(
    frame: pd.DataFrame, rate: float | None
) -> None:
    run = asv.Recording.from_dataframe(frame, "m/s^2", rate=rate)
    assert run.time == pytest.approx([0.0, 0.0025, 0.005], abs=1e-9)
    assert run.values[3].tolist() == [0.0, 0.1, 0.2]
    assert np.isnan(run.values[0, 2])
    assert run.rate == pytest.approx(400.0)


def test_channels_and_units_by_name() -> None:
    frame = _table(time=[0.0, 1.0, 2.0]).rename(columns={"rear_wheel": "A3"})
    units = dict.fromkeys(("front_wheel", "front_chassis", "rear_wheel"), "g")
    run = asv.Recording.from_dataframe(
        frame, {**units, "rear_chassis": "counts"}, channels={"rear_wheel": "A3"}, name="log"
    )
    assert run.units == ("g", "g", "g", "counts")
    assert run.source == "log"


@pytest.mark.parametrize(
    ("frame", "arguments", "words"),
    [
        (_table(), {"units": "g"}, "add a column 'time [s]' or give rate=400"),
        (_table(), {"rate": 400}, 'give units={"front_wheel"'),
        (_table(), {"units": "m", "rate": 400}, "m/s^2"),
        (_table(), {"units": "g", "rate": -1}, "not a plausible sampling rate"),
        (_table().drop(columns="rear_wheel"), {"units": "g", "rate": 400}, "no column rear_wheel"),
        (_table(), {"channels": {"rear_wheel": "x"}, "rate": 400}, "has no column 'x'"),
        (_table(), {"channels": {"boot": "gear"}, "rate": 400}, "there is no channel 'boot'"),
        (_table(time=[0.0, 0.0, 1.0]), {"units": "g"}, "time does not increase"),
    ],
)
def test_a_table_that_lacks_something_is_refused_with_the_fix(
    frame: pd.DataFrame, arguments: dict[str, Any], words: str
) -> None:
    with pytest.raises(asv.InputError, match=words.replace("[", r"\[").replace("^", r"\^")):
        asv.Recording.from_dataframe(frame, **arguments)


def test_files_by_name_list_and_pattern(tmp_path: Path) -> None:
    one = asv.read_recordings(asv.example("bump-400hz.csv"))
    assert [run.source for run in one] == [str(asv.example("bump-400hz.csv"))]
    several = asv.read_recordings(str(DATA / "valved-*.csv"))
    assert [Path(run.source).name[:8] for run in several] == ["valved-b", "valved-s"]
    odd = tmp_path / "run[1].csv"  # a name that could be a pattern
    one[0].to_csv(odd)
    assert len(asv.read_recordings([odd])) == 1
    with pytest.raises(asv.InputError, match="give each recording once"):
        asv.read_recordings([asv.example("bump-400hz.csv"), odd, odd])
    with pytest.raises(asv.InputError, match="no such file"):
        asv.read_recordings(str(tmp_path / "*.txt"))


def test_what_an_interpreter_and_a_notebook_show(stops: asv.Recording, car: asv.Vehicle) -> None:
    odd = asv.Recording(
        stops.time, stops.values, stops.units, source="<b>" * 200, warnings=("<i>",)
    )
    for shown in (stops, odd, car):
        assert len(repr(shown)) < 500
        assert "<b><" not in shown._repr_html_()
        assert "<table>" in shown._repr_html_()
    assert "<i>" not in odd._repr_html_()
    assert "800 rows at 400 Hz" in repr(stops)
    assert "c_f 7.2 lbf*s/in" in repr(car)


def test_the_vehicle_is_written_and_read_again(car: asv.Vehicle, tmp_path: Path) -> None:
    file = tmp_path / "car.toml"
    file.write_text(car.to_toml(), encoding="utf-8")
    assert asv.read_vehicle(file) == car


def test_an_example_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(asv.InputError, match=r"there are .*stops-400hz\.csv"):
        asv.example("stop.csv")
