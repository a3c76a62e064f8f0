"""A serial port, here a pseudo-terminal: nothing is lost, and everything is on disk."""

from __future__ import annotations

import contextlib
import os
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.io import read_recording, write_csv
from bayes_asv.live.metadata import scene
from bayes_asv.live.port import PortReader
from bayes_asv.live.session import Show
from bayes_asv.live.sources import About, PortSource
from bayes_asv.live.worker import Pump
from tests.live.made_up import BAJA, MadeUp, recording, wait_for

Line = tuple[int, str]


@pytest.fixture
def line() -> Iterator[Line]:
    """The logger's end of a line, and the name of the other."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    for end in (ours, theirs):
        with contextlib.suppress(OSError):
            os.close(end)


def _send(end: int, data: bytes, size: int = 211) -> None:
    for start in range(0, len(data), size):
        os.write(end, data[start : start + size])


def test_every_byte_is_kept_and_every_row_arrives(line: Line, tmp_path: Path) -> None:
    run = recording(3.0, 800.0)
    write_csv(run, tmp_path / "sent.csv")
    sent = (tmp_path / "sent.csv").read_bytes()
    port = PortReader(line[1], tmp_path / "kept.csv")
    source = PortSource(port, line[1], BAJA)
    show = Show(scene(BAJA, line[1], None, live=True), 100.0)
    heard = []

    def make(about: About) -> MadeUp:
        heard.append(about)
        return MadeUp()

    pump = Pump(source, make, show)
    pump.start()
    _send(line[0], sent)
    wait_for(lambda: len(show.history.snapshot().time) == len(run.time) - 2)
    assert pump.running
    assert heard[0].rate == pytest.approx(800.0)
    assert heard[0].start.units == run.units
    np.testing.assert_array_equal(heard[0].start.values[:, :20], run.values[:, :20])
    pump.stop()
    assert pump.fault is None
    assert pump.wait(0.0)
    assert (tmp_path / "kept.csv").read_bytes() == sent
    snapshot = show.history.snapshot()  # with the two rows that the filter held back
    np.testing.assert_allclose(snapshot.time, run.time, atol=1e-12)
    again = read_recording(tmp_path / "kept.csv")
    np.testing.assert_array_equal(again.values, run.values)
    assert show.moment().state == "ended"
    assert any("kept.csv" in note for note in source.notes())


def test_a_cable_that_comes_off_is_told_and_bytes_before_it_are_kept(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    name = os.ttyname(theirs)
    port = PortReader(name, tmp_path / "kept.txt")
    os.write(ours, b"1 2 3 4 5\n")
    wait_for(lambda: port.kept == 10)
    os.close(theirs)
    os.close(ours)
    wait_for(lambda: port.losses >= 1)
    assert not port.connected
    source = PortSource(port, name, BAJA)
    assert "is away" in source.notes()[0]
    source.close()
    assert (tmp_path / "kept.txt").read_bytes() == b"1 2 3 4 5\n"


def test_an_older_recording_is_never_written_over(line: Line, tmp_path: Path) -> None:
    (tmp_path / "kept.csv").write_text("precious")
    with pytest.raises(InputError, match="is there already; name another file"):
        PortReader(line[1], tmp_path / "kept.csv")
    assert (tmp_path / "kept.csv").read_text() == "precious"
    with pytest.raises(InputError, match="cannot be written"):
        PortReader(line[1], tmp_path / "no" / "kept.csv")


def test_a_port_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"/dev/nothing: cannot be opened.*check the cable"):
        PortReader("/dev/nothing", tmp_path / "kept.csv")
    assert list(tmp_path.iterdir()) == []


def test_stopping_does_not_wait_for_a_silent_port(line: Line, tmp_path: Path) -> None:
    port = PortReader(line[1], tmp_path / "kept.csv")
    show = Show(scene(BAJA, line[1], None, live=True), 100.0)
    pump = Pump(PortSource(port, line[1], BAJA), lambda _: MadeUp(), show)
    pump.start()
    began = time.monotonic()
    pump.stop()
    assert time.monotonic() - began < 2.0
    assert not pump.running
    assert not any(thread.name == "port" for thread in threading.enumerate())


def test_what_is_no_recording_ends_the_pump_with_the_reason(line: Line, tmp_path: Path) -> None:
    port = PortReader(line[1], tmp_path / "kept.txt")
    show = Show(scene(BAJA, line[1], None, live=True), 100.0)
    pump = Pump(PortSource(port, line[1], BAJA), lambda _: MadeUp(), show)
    pump.start()
    os.write(line[0], b"1 500 500 500 500\n2 500 500 500 500\n")
    assert pump.wait(5.0)
    assert isinstance(pump.fault, InputError)
    assert show.moment().state == "failed"
    assert "give the rate" in show.moment().notes[0]
    pump.stop()
