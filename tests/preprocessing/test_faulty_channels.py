"""Copied, frozen, clipped and noisy channels are named, and coarse converters at rest are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.io import read_recording
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.faulty_channels import noisy_channels, stuck_channels
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, case, vehicle
from tests.rig import SensorSpec

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]

FINE = SensorSpec(noise=(0.05, 0.05, 0.05, 0.05), adc=None)


def _drive(terrain: str, sensors: SensorSpec = FINE) -> tuple[Recording, Vehicle]:
    recording = case(terrain, 7, DECLARED, sensors=sensors)[2]
    if sensors.adc is None:
        recording = replace(recording, values=np.rint(recording.values * 5.0) / 5.0)  # 5 mm/s²
    return recording, vehicle(DECLARED, sensors)


def _broken(change: Callable[[Array], None], terrain: str = "rough") -> list[str]:
    recording, car = _drive(terrain)
    values = recording.values.copy()
    change(values)
    return stuck_channels(replace(recording, values=values), car, car_model("half", car))


def test_a_copy_is_named_with_its_original() -> None:
    def copy(values: Array) -> None:
        values[3] = values[2]

    (reason,) = _broken(copy)
    assert "rear wheel and rear chassis" in reason
    assert "hold the same readings" in reason


@pytest.mark.parametrize(("channel", "name"), [(0, "front wheel"), (3, "rear chassis")])
def test_a_frozen_channel_is_named(channel: int, name: str) -> None:
    def freeze(values: Array) -> None:
        values[channel, 400:] = values[channel, 400]

    (reason,) = _broken(freeze)
    assert reason.startswith(f"the {name} sensor")
    assert "holds its value in 4" in reason


@pytest.mark.parametrize(("channel", "name"), [(1, "front chassis"), (3, "rear chassis")])
def test_a_body_that_never_moves_above_a_wheel_that_does_is_named(channel: int, name: str) -> None:
    def kill(values: Array) -> None:
        values[channel] = 0.2

    (reason,) = _broken(kill)
    assert reason.startswith(f"the {name} sensor")
    assert "holds its value in" in reason


def test_an_axle_that_has_not_met_the_bump_yet_may_be_still() -> None:
    def rest(values: Array) -> None:
        values[2:] = 0.2

    assert _broken(rest) == []


def test_a_channel_that_never_changes_is_none_in_a_car_at_rest() -> None:
    def rest(values: Array) -> None:
        values[:] = 0.05 * np.random.default_rng(1).normal(size=values.shape)
        values[3] = 0.0

    assert _broken(rest) == []


def test_a_channel_that_falls_to_zero_now_and_then_is_named() -> None:
    def drop(values: Array) -> None:
        for first in range(300, 700, 50):
            values[1, first : first + 12] = 0.0

    (reason,) = _broken(drop)
    assert reason.startswith("the front chassis sensor")


def test_a_range_that_nobody_stated_is_seen() -> None:
    def clip(values: Array) -> None:
        level = 0.4 * np.abs(values[2]).max()
        np.clip(values[2], -level, level, out=values[2])

    (reason,) = _broken(clip)
    assert reason.startswith("the rear wheel sensor")
    assert "stays at its extreme" in reason


@pytest.mark.parametrize("terrain", ["bump", "stops", "rough"])
@pytest.mark.parametrize("coarse", [False, True], ids=["fine", "ten bits"])
def test_a_sound_drive_has_no_fault(terrain: str, coarse: bool) -> None:
    """A converter of ten bits repeats itself for as long as a wheel rests."""
    recording, car = _drive(terrain, SensorSpec() if coarse else FINE)
    model = car_model("half", car)
    assert stuck_channels(recording, car, model) == []
    assert noisy_channels(recording, car, model) == []


def test_a_noisy_channel_is_named_with_its_factor() -> None:
    recording, car = _drive("bump")
    values = recording.values.copy()
    values[2] += 40.0 * np.random.default_rng(1).normal(size=len(recording.time))  # 1 m/s²
    (reason,) = noisy_channels(replace(recording, values=values), car, car_model("half", car))
    assert reason.startswith("the rear wheel sensor")
    assert "times as noisy as the vehicle file says" in reason


def test_a_stuck_channel_refuses_a_recording_before_a_fit() -> None:
    recording, car = _drive("rough")
    values = recording.values.copy()
    values[1] = values[0]
    lines, reasons, _ = prepare_runs([replace(recording, values=values)], car)
    assert lines == ()
    assert "hold the same readings" in reasons[0]


@pytest.mark.parametrize("name", ["bump-400hz", "rough-400hz", "stops-800hz"])
@pytest.mark.parametrize("rows", [80, 120, 200])
def test_rest_on_a_coarse_converter_is_no_fault(name: str, rows: int) -> None:
    """The first rows of a drive: some wheels still stand, and two sensors hold one value each."""
    recording = read_recording(ROOT / "data" / "recordings" / f"{name}.csv")
    cut = replace(recording, time=recording.time[:rows], values=recording.values[:, :rows])
    car = read_vehicle(ROOT / "data" / "vehicles" / "baja2008.toml")
    assert not stuck_channels(cut, car, car_model("half", car))
