"""Each file is recognised as its own format and as no other, by its content alone."""

import pytest

from bayes_asv.io.formats import FORMATS, bare, detect
from bayes_asv.io.formats.format import HEAD
from tests.io.formats import made

REAL = {
    "motec_sample1.ld": "MoTeC .ld",
    "sufni_00648.SST": "Sufni SST",
    "picoquake_car_vibration.csv": "PicoQuake CSV",
    "teensy_accelerometer.csv": "table in text",
    "stm32_suspension.csv": "table in text",
    "racechrono_v3.csv": "RaceChrono CSV",
    "endaq_SSX70065.IDE": "enDAQ IDE",
    "labview_raw1.tdms": "LabVIEW TDMS",
    "suspension_project_1.mat": "MATLAB .mat",
}
MADE = {
    **made.texts(),
    "AiM .xrk": made.aim_xrk(),
    "MDF": b"MDF     4.10    ",
    "MATLAB 7.3 .mat": b"MATLAB 7.3 MAT-file, Platform: GLNXA64",
    "ROS bag": b"#ROSBAG V2.0\n",
    "ROS 2 bag": b"SQLite format 3\0",
    "MCAP": b"\x89MCAP0\r\n",
}


def check(data: bytes, name: str) -> None:
    form = detect(data)
    assert form is not None
    assert form.name == name
    # Any text is a table in text, for want of something better.
    others = [one.name for one in FORMATS if one.recognises(data[:HEAD]) and one != bare.FORMAT]
    assert others == ([] if form == bare.FORMAT else [name])


@pytest.mark.parametrize("file", REAL)
def test_real_file(file: str) -> None:
    if not made.LOGS.is_dir():
        pytest.skip("the shared data are not here")
    check((made.LOGS / file).read_bytes(), REAL[file])


@pytest.mark.parametrize("name", MADE)
def test_made_file(name: str) -> None:
    check(MADE[name], name)


@pytest.mark.parametrize("data", [made.gcdc_ham(), made.aim_csv(";", ","), made.phyphox("\t", ",")])
def test_variants(data: bytes) -> None:
    form = detect(data)
    assert form is not None
    assert form != bare.FORMAT


def test_every_format_is_tried_here() -> None:
    assert {one.name for one in FORMATS} == {*REAL.values(), *MADE}
