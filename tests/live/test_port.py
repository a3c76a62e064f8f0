"""A serial port (a pseudo-terminal): no row is lost, and every byte is saved."""

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
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.port import PortReader
from bayes_asv.live.session import Session
from bayes_asv.live.sources import PortSource, StreamInfo
from bayes_asv.live.worker import Worker
from tests.live.synthetic import BAJA, FakeFilter, recording, wait_for

Line = tuple[int, str]


@pytest.fixture
def line() -> Iterator[Line]:
    """The logger's end of a serial line, and the name of the other end."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    for end in (ours, theirs):
        with contextlib.suppress(OSError):
            os.close(end)


def _send(end: int, data: bytes, size: int = 211) -> None:
    for start in range(0, len(data), size):
        os.write(end, data[start : start + size])


def test_every_byte_is_saved_and_every_row_arrives(line: Line, tmp_path: Path) -> None:
    run = recording(3.0, 800.0)
    write_csv(run, tmp_path / "sent.csv")
    sent = (tmp_path / "sent.csv").read_bytes()
    port = PortReader(line[1], tmp_path / "kept.csv")
    source = PortSource(port, line[1], BAJA)
    session = Session(view_metadata(BAJA, line[1], None, live=True), 100.0)
    infos = []

    def make(info: StreamInfo) -> FakeFilter:
        infos.append(info)
        return FakeFilter()

    worker = Worker(source, make, session)
    worker.start()
    _send(line[0], sent)
    wait_for(lambda: len(session.history.snapshot().time) == len(run.time) - 2)
    assert worker.running
    assert infos[0].rate == pytest.approx(800.0)
    assert infos[0].start.units == run.units
    np.testing.assert_array_equal(infos[0].start.values[:, :20], run.values[:, :20])
    worker.stop()
    assert worker.error is None
    assert worker.wait(0.0)
    assert (tmp_path / "kept.csv").read_bytes() == sent
    snapshot = session.history.snapshot()  # including the two rows that the filter held back
    np.testing.assert_allclose(snapshot.time, run.time, atol=1e-12)
    reread = read_recording(tmp_path / "kept.csv")
    np.testing.assert_array_equal(reread.values, run.values)
    assert session.playback().state == "ended"
    assert any("kept.csv" in note for note in source.notes())


def test_unplugged_cable(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    name = os.ttyname(theirs)
    port = PortReader(name, tmp_path / "kept.txt")
    os.write(ours, b"1 2 3 4 5\n")
    wait_for(lambda: port.bytes_saved == 10)
    os.close(theirs)
    os.close(ours)
    wait_for(lambda: port.losses >= 1)
    assert not port.connected
    source = PortSource(port, name, BAJA)
    assert "is disconnected" in source.notes()[0]
    source.close()
    assert (tmp_path / "kept.txt").read_bytes() == b"1 2 3 4 5\n"


def test_existing_file_is_not_overwritten(line: Line, tmp_path: Path) -> None:
    (tmp_path / "kept.csv").write_text("precious")
    with pytest.raises(InputError, match="exists already; name another file"):
        PortReader(line[1], tmp_path / "kept.csv")
    assert (tmp_path / "kept.csv").read_text() == "precious"
    with pytest.raises(InputError, match="cannot be written"):
        PortReader(line[1], tmp_path / "no" / "kept.csv")


def test_missing_port_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"/dev/nothing: cannot be opened.*check the cable"):
        PortReader("/dev/nothing", tmp_path / "kept.csv")
    assert list(tmp_path.iterdir()) == []


def test_stopping_with_a_silent_port(line: Line, tmp_path: Path) -> None:
    port = PortReader(line[1], tmp_path / "kept.csv")
    session = Session(view_metadata(BAJA, line[1], None, live=True), 100.0)
    worker = Worker(PortSource(port, line[1], BAJA), lambda _: FakeFilter(), session)
    worker.start()
    began = time.monotonic()
    worker.stop()
    assert time.monotonic() - began < 2.0
    assert not worker.running
    assert not any(thread.name == "port" for thread in threading.enumerate())


def test_stream_that_is_no_recording_ends_the_worker(line: Line, tmp_path: Path) -> None:
    port = PortReader(line[1], tmp_path / "kept.txt")
    session = Session(view_metadata(BAJA, line[1], None, live=True), 100.0)
    worker = Worker(PortSource(port, line[1], BAJA), lambda _: FakeFilter(), session)
    worker.start()
    os.write(line[0], b"1 500 500 500 500\n2 500 500 500 500\n")
    assert worker.wait(5.0)
    assert isinstance(worker.error, InputError)
    assert session.playback().state == "failed"
    assert "give the rate" in session.playback().notes[0]
    worker.stop()
