"""Following a source to its end, and the program as a user starts and ends it."""

from __future__ import annotations

import http.client
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.run import follow
from bayes_asv.live.sources import RecordingSource, StreamInfo
from bayes_asv.live.worker import Worker
from bayes_asv.tracking.frames import Frames, concatenate
from tests.live.synthetic import BAJA, FakeFilter, frames, recording

ROOT = Path(__file__).parents[2]


def test_all_frames_arrive_in_order_without_a_view() -> None:
    run = recording(3.0, 400.0)
    infos: list[StreamInfo] = []
    parts: list[Frames] = []

    def make(info: StreamInfo) -> FakeFilter:
        infos.append(info)
        return FakeFilter()

    source = RecordingSource(run, BAJA)
    session = follow(source, view_metadata(BAJA, "x", source.duration), make, sink=parts.append)
    assert infos[0].rate == pytest.approx(400.0)
    assert len(parts) == 13  # quarters of a second, and the rows held back
    all_frames, expected = concatenate(parts), frames(BAJA, run.time, run.values.T)
    np.testing.assert_array_equal(all_frames.time, expected.time)
    np.testing.assert_allclose(all_frames.median, expected.median)
    assert session.playback().end == pytest.approx(run.time[-1])


def test_errors_of_the_filter_are_raised() -> None:
    source = RecordingSource(recording(3.0, 400.0), BAJA)
    with pytest.raises(ArithmeticError, match="lost its sign"):
        follow(source, view_metadata(BAJA, "x", 3.0), lambda _: FakeFilter(fails_after=1.0))
    with pytest.raises(ArithmeticError):  # with a page as well, without Ctrl-C
        follow(
            source, view_metadata(BAJA, "x", 3.0), lambda _: FakeFilter(fails_after=1.0), page=True,
            browser=False,
        )  # fmt: skip
    assert not any(t.name in ("server", "filter") for t in threading.enumerate())


def test_counts_need_the_vehicles_zero_and_scale() -> None:
    run = Recording(np.arange(3.0), np.ones((4, 3)), ("counts",) * 4)
    assert RecordingSource(run, BAJA).duration == 2.0
    with pytest.raises(InputError, match="zero_counts"):
        RecordingSource(run, replace(BAJA, sensors={}))


def test_interrupted_recording_has_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(self: Worker) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(Worker, "running", property(interrupted))
    source = RecordingSource(recording(1.0), BAJA)
    metadata = view_metadata(BAJA, "x", 1.0)
    with pytest.raises(KeyboardInterrupt):
        follow(source, metadata, lambda _: FakeFilter())
    session = follow(source, metadata, lambda _: FakeFilter(), page=True, browser=False)
    assert session.playback().state in ("playing", "ended")


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGINT to send")
def test_ctrl_c_ends_the_page() -> None:
    script = (
        "import sys\n"
        "from bayes_asv.live.run import follow\n"
        "from bayes_asv.live.metadata import view_metadata\n"
        "from bayes_asv.live.sources import RecordingSource\n"
        "from tests.live.synthetic import BAJA, FakeFilter, recording\n"
        "source = RecordingSource(recording(3.0), BAJA)\n"
        "count = [0]\n"
        "def sink(frames):\n"
        "    count[0] += len(frames.time)\n"
        "    if count[0] == 2400: print('all', file=sys.stderr, flush=True)\n"
        "names = view_metadata(BAJA, 'x', 3.0)\n"
        "session = follow(source, names, lambda _: FakeFilter(), page=True,\n"
        "              browser=False, sink=sink,\n"
        "              say=lambda text: print(text, file=sys.stderr, flush=True))\n"
        "print(len(session.history.snapshot().time))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=ROOT, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stderr is not None
    said = [process.stderr.readline()]
    if said == ["all\n"]:  # a busy machine may finish before the page is open
        said.append(process.stderr.readline())
    assert said[-1].startswith("Live view: http://127.0.0.1:")
    port = int(said[-1].split(":")[3].split("/")[0])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", "/events")
    stream = connection.getresponse()  # a connected viewer does not delay the end
    assert stream.status == 200
    assert "all\n" in said or process.stderr.readline() == "all\n"
    process.send_signal(signal.SIGINT)
    began = time.monotonic()
    out, err = process.communicate(timeout=20)
    assert time.monotonic() - began < 5.0
    assert (process.returncode, out, err) == (0, "2400\n", "")
    assert b"event: end" in stream.read()
    connection.close()
