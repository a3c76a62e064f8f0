"""A source followed to its end, and the program as a person starts and ends it."""

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
from bayes_asv.domain.vehicle import Sensor
from bayes_asv.live.metadata import scene
from bayes_asv.live.run import follow
from bayes_asv.live.sources import About, RecordingSource
from bayes_asv.live.worker import Pump
from bayes_asv.tracking.frames import Frames, joined
from tests.live.made_up import BAJA, MadeUp, frames, recording

ROOT = Path(__file__).parents[2]


def test_all_frames_arrive_in_their_order_without_anybody_looking() -> None:
    run = recording(3.0, 400.0)
    heard: list[About] = []
    got: list[Frames] = []

    def make(about: About) -> MadeUp:
        heard.append(about)
        return MadeUp()

    source = RecordingSource(run, BAJA)
    show = follow(source, scene(BAJA, "x", source.duration), make, sink=got.append)
    assert heard[0].rate == pytest.approx(400.0)
    assert len(got) == 13  # quarters of a second, and what was held back
    every, wanted = joined(got), frames(BAJA, run.time, run.values.T)
    np.testing.assert_array_equal(every.time, wanted.time)
    np.testing.assert_allclose(every.median, wanted.median)
    assert show.moment().end == pytest.approx(run.time[-1])


def test_a_fault_of_the_filter_is_raised_and_not_swallowed() -> None:
    source = RecordingSource(recording(3.0, 400.0), BAJA)
    with pytest.raises(ArithmeticError, match="lost its sign"):
        follow(source, scene(BAJA, "x", 3.0), lambda _: MadeUp(fails_after=1.0))
    with pytest.raises(ArithmeticError):  # with a page as well: nobody has to press Ctrl-C
        follow(source, scene(BAJA, "x", 3.0), lambda _: MadeUp(fails_after=1.0), page=True,
               browser=False)  # fmt: skip
    assert not any(t.name in ("server", "filter") for t in threading.enumerate())


def test_counts_need_the_vehicles_zero_and_scale() -> None:
    run = Recording(np.arange(3.0), np.ones((4, 3)), ("counts",) * 4)
    assert RecordingSource(run, BAJA).duration == 2.0
    with pytest.raises(InputError, match="zero_counts"):
        RecordingSource(run, replace(BAJA, sensors=(Sensor(),) * 4))


def test_an_interrupted_recording_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(self: Pump) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(Pump, "running", property(interrupted))
    source = RecordingSource(recording(1.0), BAJA)
    view = scene(BAJA, "x", 1.0)
    with pytest.raises(KeyboardInterrupt):
        follow(source, view, lambda _: MadeUp())
    show = follow(source, view, lambda _: MadeUp(), page=True, browser=False)
    assert show.moment().state in ("playing", "ended")


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGINT to send")
def test_ctrl_c_ends_the_page_cleanly() -> None:
    script = (
        "import sys\n"
        "from bayes_asv.live.run import follow\n"
        "from bayes_asv.live.metadata import scene\n"
        "from bayes_asv.live.sources import RecordingSource\n"
        "from tests.live.made_up import BAJA, MadeUp, recording\n"
        "source = RecordingSource(recording(3.0), BAJA)\n"
        "heard = [0]\n"
        "def sink(frames):\n"
        "    heard[0] += len(frames.time)\n"
        "    if heard[0] == 2400: print('all', file=sys.stderr, flush=True)\n"
        "show = follow(source, scene(BAJA, 'x', 3.0), lambda _: MadeUp(), page=True,\n"
        "              browser=False, sink=sink,\n"
        "              say=lambda text: print(text, file=sys.stderr, flush=True))\n"
        "print(len(show.history.snapshot().time))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=ROOT, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stderr is not None
    said = [process.stderr.readline()]
    if said == ["all\n"]:  # a busy machine has read a recording before it has opened a page
        said.append(process.stderr.readline())
    assert said[-1].startswith("Live view: http://127.0.0.1:")
    port = int(said[-1].split(":")[3].split("/")[0])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", "/events")
    stream = connection.getresponse()  # a viewer that stays does not hold the program up
    assert stream.status == 200
    assert "all\n" in said or process.stderr.readline() == "all\n"
    process.send_signal(signal.SIGINT)
    began = time.monotonic()
    out, err = process.communicate(timeout=20)
    assert time.monotonic() - began < 5.0
    assert (process.returncode, out, err) == (0, "2400\n", "")
    assert b"event: end" in stream.read()
    connection.close()
