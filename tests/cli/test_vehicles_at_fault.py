"""Vehicle files with a fault: one line that names file, key and fix."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Check, Command

SPRING = 'front_spring_rate     = { value = 100, unit = "lbf/in", sd = "5 %" }'
MASS = 'sprung_mass           = { value = 1.294, unit = "lbf*s^2/in", sd = "1 %" }'

FAULTS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "no units": ('units = "US"', "", ("units", "add units")),
    "other units": ('"US"', '"UK"', ("units", 'write units = "US" or units = "SI"')),
    "misspelt key": (
        "front_spring_rate",
        "front_sprin_rate",
        ("[known] front_sprin_rate", "did you mean front_spring_rate?"),
    ),
    "key in the wrong table": (
        "[nominal]",
        '[nominal]\nwheelbase = "68 in"',
        ("[nominal] wheelbase", "move it to [known]"),
    ),
    "unknown table": ("[travel]", "[travels]", ("travels", "did you mean travel?")),
    "no table": ("[nominal]", "[nominale]", ("nominale", "did you mean nominal?")),
    "table as a number": ("[travel]", "[x]", ("x",)),
    "missing key": (SPRING, "", ("[known] front_spring_rate", "is missing", "add")),
    "two missing keys": (SPRING + "\n", "", ("[known] front_spring_rate", "is missing")),
    "wrong dimension": (
        'front_spring_rate     = { value = 100, unit = "lbf/in"',
        'front_spring_rate     = { value = 100, unit = "lbf*in"',
        ("[known] front_spring_rate", "not a unit of stiffness", "N/m"),
    ),
    "no unit": (
        'front_spring_rate     = { value = 100, unit = "lbf/in"',
        "front_spring_rate     = { value = 100",
        ("[known] front_spring_rate", "has no unit", "add unit"),
    ),
    "bare number": (SPRING, "front_spring_rate = 100", ("[known] front_spring_rate", "no unit")),
    "bare lb": (
        MASS,
        'sprung_mass = { value = 500, unit = "lb" }',
        ("[known] sprung_mass", "write lbf (force) or lbm (mass)"),
    ),
    "force as a mass": (MASS, 'sprung_mass = "500 lbf"', ("[known] sprung_mass", "lbm")),
    "negative mass": ("value = 1.294", "value = -1.294", ("[known] sprung_mass", "above zero")),
    "zero spring": (SPRING, 'front_spring_rate = "0 lbf/in"', ("front_spring_rate", "above zero")),
    "infinite": ("value = 1.294", "value = inf", ("[known] sprung_mass", "finite")),
    "text for a number": ("value = 1.294", 'value = "1.294"', ("[known] sprung_mass", "number")),
    "truth for a number": ("value = 1.294", "value = true", ("[known] sprung_mass", "number")),
    "negative sd": ('sd = "1 %" }\nwheel', "sd = -1 }\nwheel", ("sprung_mass", "sd is negative")),
    "negative percentage": ('"1 %" }\nwheel', '"-1 %" }\nwheel', ("sprung_mass", "negative")),
    "huge sd": ('"1 %" }\nwheel', '"500 %" }\nwheel', ("sprung_mass", "at most 1 times")),
    "weight share": ("value = 0.47", "value = 1.47", ("front_weight_fraction", "between 0 and 1")),
    "weight in percent": ("value = 0.47", "value = 47", ("front_weight_fraction", "as 0.47")),
    "nominal without spread": (
        '{ value = 7.2, unit = "lbf*s/in" }',
        '{ value = 7.2, unit = "lbf*s/in", sd = 0 }',
        ("[nominal] front_damping", "leave sd out"),
    ),
    "unbelievable": ("value = 68", "value = 68e9", ("wheelbase", "not plausible")),
    "unknown channel": (
        "[sensors.front_wheel]",
        "[sensors.front_weel]",
        ("[sensors.front_weel]", "did you mean front_wheel?"),
    ),
    "range upside down": (
        "low = -3385.6775, high = 2696.0575",
        "low = 2696.0575, high = -3385.6775",
        ("[sensors.front_wheel] range", "swap them"),
    ),
    "not TOML": ("[known]", "[known", ("is not TOML", "line")),
    "key twice": (MASS, MASS + "\n" + MASS, ("is not TOML", "line")),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_faulty_vehicle(
    invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path, kind: str
) -> None:
    old, new, expected = FAULTS[kind]
    text = baja.read_text(encoding="utf-8")
    assert old in text
    car = tmp_path / "car.toml"
    car.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert refuse(invoke("estimate", stops, "-v", car), "car.toml", *expected)
    assert refuse(invoke("simulate", "-v", car, "-o", tmp_path / "x.csv"), "car.toml", *expected)
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "is empty"),
        (b"\0\1\2", "is not a text file"),
        (b"\xff\xfea\0", "save it as UTF-8"),
        (b"PK\x03\x04", "zip archive"),
        (b"name = 'x'\n", "at fault"),
        (b"a = " + b"[" * 5000, "TOML"),
        (b"a = " + b"9" * 5000, "TOML"),
        (b"\xe4 = 1", "is not UTF-8 text"),
    ],
)
def test_a_file_that_is_no_vehicle(
    invoke: Command, refuse: Check, stops: Path, tmp_path: Path, data: bytes, expected: str
) -> None:
    car = tmp_path / "car.toml"
    car.write_bytes(data)
    assert refuse(invoke("estimate", stops, "-v", car), "car.toml", expected)
