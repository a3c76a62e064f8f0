"""Damaged files give a log or one error, soon and without much memory; never anything else."""

import pickle
import random
import resource
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats import (
    FORMATS,
    Format,
    LogFile,
    bare,
    detect,
    isolated,
    read_file,
    read_log,
)  # fmt: skip
from tests.io.formats import made

OWN = ["motec_sample1.ld", "sufni_00648.SST", "picoquake_car_vibration.csv", "racechrono_v3.csv",
       "teensy_accelerometer.csv", "stm32_suspension.csv"]  # fmt: skip
WITH_PACKAGES = ["endaq_SSX70065.IDE", "labview_raw1.tdms", "suspension_project_1.mat"]
MAX_SECONDS = 5.0
MAX_MEGABYTES = 300


@cache
def content(name: str) -> bytes:
    files = made.texts()
    return files[name] if name in files else (made.LOGS / name).read_bytes()


def damage(data: bytes, seed: int) -> bytes:
    """Cut a file, change some of its bytes, more often in its header, or repeat a piece."""
    chance = random.Random(seed)
    damaged = bytearray(data)
    kind = chance.choice(["cut", "change", "change", "repeat"])
    if kind == "cut":
        return bytes(damaged[: chance.randrange(len(damaged))])
    for _ in range(chance.choice([1, 2, 5, 20])):
        reach = min(len(damaged), chance.choice([4000, len(damaged)]))
        damaged[chance.randrange(reach)] = chance.choice(
            [0, 1, 127, 128, 255, chance.randrange(256)]
        )
    if kind == "repeat":
        start, end = chance.randrange(len(damaged)), chance.randrange(len(damaged))
        damaged[end:end] = damaged[start : start + chance.randrange(300)]
    return bytes(damaged)


def check(form: Format, data: bytes, read: Callable[[Format, LogFile], object]) -> None:
    before, started = memory(), time.monotonic()
    try:
        read(form, LogFile("file", data, 100.0))
    except InputError as exc:
        message = str(exc)
        assert message.startswith("file")
        assert "\n" not in message
    assert time.monotonic() - started < MAX_SECONDS
    assert memory() - before < MAX_MEGABYTES


def memory() -> float:
    """Peak resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.parametrize("name", [*made.texts(), *OWN])
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32))
def test_own_readers(name: str, seed: int) -> None:
    if name in OWN and not made.LOGS.is_dir():
        pytest.skip("the shared data are not here")
    form = detect(content(name))
    assert form is not None
    check(form, damage(content(name), seed), lambda form, file: form.read(file))


@pytest.mark.parametrize("name", WITH_PACKAGES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_readers_of_packages(name: str, seed: int) -> None:
    if not made.LOGS.is_dir():
        pytest.skip("the shared data are not here")
    form = detect(content(name))
    assert form is not None
    pytest.importorskip(form.needs)
    check(form, damage(content(name), seed), read_file)


@given(st.binary(max_size=300), st.sampled_from(FORMATS))
def test_any_bytes_behind_any_head(data: bytes, form: Format) -> None:
    heads = {
        "MoTeC .ld": b"\x40\0\0\0\0\0\0\0" + bytes(110), "Sufni SST": b"SST\x03" + bytes(14),
        "RaceCapture log": b'"Interval"|"ms"|0|0|1,"A"|"g"|0|0|1\n', "GCDC CSV":
        b";Title, http://www.gcdataconcepts.com, X16-1D\n;Time, Ax\n", "VBOX":
        b"[header]\ntime\n[column names]\ntime\n[data]\n",
        "PicoQuake CSV": b"# PLab PicoQuake Data\n",
    }  # fmt: skip
    if form.needs:
        return
    check(form, heads.get(form.name, b"") + data, lambda form, file: form.read(file))


@pytest.mark.parametrize(
    "data",
    [
        b'"' + b"time " * 13_000, b'"Time (s)","' + b"(" * 60_000, b"a (" * 60_000, b"; " * 60_000,
        b"front_wheel [" + b" front_wheel" * 1600, b"# " * 30_000, b";" * 60_000, b"1:" * 30_000,
        b"1" * 999_999 + b"\n1\n2\n", b"1,2\n" * 16_000 + b'"' * 60_000, b"|,|" * 20_000,
    ],
)  # fmt: skip
def test_long_lines_take_no_longer_than_others(data: bytes) -> None:
    started = time.monotonic()
    form = detect(data)
    assert time.monotonic() - started < MAX_SECONDS
    check(form or bare.FORMAT, data + b"\n1,2\n3,4\n", read_file)


def test_a_package_that_hangs_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("libxrk")
    monkeypatch.setattr(isolated, "_PATIENCE", 0.01)
    monkeypatch.setattr(isolated, "_PATIENCE_PER_BYTE", 0.0)
    with pytest.raises(
        InputError, match=r"takes the package libxrk more than 0 s; it may be damaged"
    ):
        read_file(detect_made(), LogFile("file", made.aim_xrk()))


def test_a_package_that_crashes_is_survived(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("libxrk")
    crash = tmp_path / "python"
    crash.write_text("#!/bin/sh\ncat > /dev/null\nkill -SEGV $$\n")
    crash.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crash))
    with pytest.raises(InputError, match="crashes the package libxrk; it may be damaged"):
        read_file(detect_made(), LogFile("file", made.aim_xrk()))


def test_a_log_from_another_process_is_read_only(tmp_path: Path) -> None:
    pytest.importorskip("libxrk")
    path = tmp_path / "log.xrk"
    path.write_bytes(made.aim_xrk())
    (channel,) = read_log(path).channels
    assert pickle.loads(pickle.dumps(channel)).values.flags.writeable  # a pickle forgets it
    assert not channel.time.flags.writeable
    assert not channel.values.flags.writeable


def detect_made() -> Format:
    form = detect(made.aim_xrk())
    assert form is not None
    return form
