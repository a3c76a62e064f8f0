"""``[clocks]`` of the vehicle file: read, written back, and its mistakes in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayes_asv.domain.clocks import Clock
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Vehicle, read_vehicle, to_toml
from tests.cli.conftest import ROOT

BAJA = (ROOT / "data" / "vehicles" / "baja2008.toml").read_text(encoding="utf-8")


def read(folder: Path, table: str) -> Vehicle:
    path = folder / "car.toml"
    path.write_text(f"{BAJA}\n{table}\n", encoding="utf-8")
    return read_vehicle(path)


def test_a_clock_without_priors_has_the_default_ones(tmp_path: Path) -> None:
    (clock,) = read(tmp_path, '[clocks.phone]\nchannels = ["body_vertical"]').clocks
    assert clock == Clock("phone", ("body_vertical",), 0.0, 0.02, 0.0, 50e-6)


def test_a_clock_is_written_back(tmp_path: Path) -> None:
    table = (
        '[clocks."rear board"]\nchannels = ["rear_wheel", "rear_chassis"]\n'
        'offset = { value = -3, unit = "ms", sd = "5 ms" }\n'
        'drift = { value = 20, unit = "ppm", sd = 0 }\n'
    )
    vehicle = read(tmp_path, table)
    (clock,) = vehicle.clocks
    assert clock.name == "rear board"
    assert (clock.offset, clock.offset_sd) == pytest.approx((-0.003, 0.005))
    assert (clock.drift, clock.drift_sd) == pytest.approx((20e-6, 0.0))
    again = tmp_path / "again.toml"
    again.write_text(to_toml(vehicle), encoding="utf-8")
    assert read_vehicle(again) == vehicle


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('[clocks.a]\nchannels = ["rear_weel"]', "did you mean rear_wheel"),
        ("[clocks.a]\noffset = '3 ms'", "add channels"),
        ('[clocks.a]\nchannels = ["rear_wheel"]\nofset = "3 ms"', "did you mean offset"),
        ('[clocks.a]\nchannels = ["rear_wheel"]\noffset = "3 s"', "not plausible"),
        ('[clocks.a]\nchannels = ["rear_wheel"]\ndrift = 20', "give it in \"ppm\""),
        (
            '[clocks.a]\nchannels = ["rear_wheel"]\n[clocks.b]\nchannels = ["rear_wheel"]',
            "has two clocks, a and b",
        ),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_with_its_fix(tmp_path: Path, table: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(tmp_path, table)
