"""The view in a terminal."""

from __future__ import annotations

import os
import pty
import re
import select
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from bayes_asv.live.braille import gauge, plot, round_limits
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.session import Session
from bayes_asv.live.terminal import render
from tests.live.synthetic import BAJA, FakeClock, frames, recording

ROOT = Path(__file__).parents[2]


def _session(position: float) -> Session:
    session = Session(view_metadata(BAJA, "stops.csv", 9.0), 100.0, clock=FakeClock())
    run = recording(9.0, 100.0)
    session.history.append(frames(BAJA, run.time, run.values.T))
    session.finish()
    session.control("seek", position)
    return session


def _printed(session: Session, width: int, height: int) -> list[str]:
    console = Console(width=width, height=height, no_color=True, force_terminal=False)
    with console.capture() as capture:
        console.print(render(session.playback(), session.metadata, width, height))
    return capture.get().rstrip("\n").split("\n")


@pytest.mark.parametrize(("width", "height"), [(60, 24), (80, 24), (100, 30), (160, 50)])
def test_view_fits_the_terminal(width: int, height: int) -> None:
    lines = _printed(_session(4.0), width, height)
    assert len(lines) <= height
    assert all(cell_len(line) <= width for line in lines)
    text = "\n".join(lines)
    assert "5.76 lbf·s/in ± 2.2 %" in text
    assert "20 % softer than nominal" in text
    assert "extension positive" in text
    assert "Consistent" in text
    assert re.search("[\u2801-\u28ff]", text)


def test_verdict_state_and_notes() -> None:
    text = "\n".join(_printed(_session(7.0), 160, 40))
    assert "Errors too large" in text
    assert "NIS 2.50 (0.80 to 1.20)" in text
    session = _session(4.0)
    session.control("pause")
    session.set_notes("12 lines were not readable.")
    text = "\n".join(_printed(session, 100, 30))
    assert "paused" in text
    assert "12 lines were not readable." in text


def test_before_the_first_row() -> None:
    empty = Session(view_metadata(BAJA, "/dev/ttyUSB0", None, live=True), 100.0)
    text = "\n".join(_printed(empty, 80, 24))
    assert "No row has come yet." in text
    assert "restarts" not in text


@given(
    st.lists(st.integers(0, 39), min_size=1, max_size=40),
    st.integers(4, 30),
    st.integers(2, 10),
)
def test_dots_are_at_the_values(places: list[int], width: int, height: int) -> None:
    rows = np.array(places) % (4 * height)
    curve = 1.0 - (rows + 0.5) / (2.0 * height)  # the centre of a row of dots
    time = np.linspace(0.0, 1.0, len(curve))
    lines = plot(time, [curve], (0.0, 1.0), (-1.0, 1.0), (width, height))
    grid = np.zeros((4 * height, 2 * width), dtype=bool)
    # Unicode 15, chapter 21.1: dots 1 2 3 7 down the left side, 4 5 6 8 down the right.
    order = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
    for row, runs in enumerate(lines):
        characters = "".join(characters for characters, _ in runs)
        assert len(characters) == width
        for column, character in enumerate(characters):
            bits = 0 if character == " " else ord(character) - 0x2800
            for bit, (y, x) in enumerate(order):
                grid[4 * row + y, 2 * column + x] = bool(bits >> bit & 1)
    expected: dict[int, list[int]] = {}
    for t, row in zip(time, rows, strict=True):
        expected.setdefault(min(int(t * 2 * width), 2 * width - 1), []).append(int(row))
    for x in range(2 * width):
        dots = np.flatnonzero(grid[:, x])
        if x not in expected:
            assert len(dots) == 0
        else:
            assert dots.tolist() == list(range(min(expected[x]), max(expected[x]) + 1))


def test_gaps_and_values_outside_are_not_drawn() -> None:
    time = np.array([-1.0, 0.1, 0.5, 0.9, 2.0])
    curve = np.array([0.0, np.nan, 5.0, np.inf, 0.0])
    lines = plot(time, [curve], (0.0, 1.0), (-1.0, 1.0), (10, 3))
    assert all(
        character == " " for runs in lines for characters, _ in runs for character in characters
    )


@pytest.mark.parametrize(
    ("low", "middle", "high", "drawn"),
    [
        (0.9, 1.0, 1.1, "     ├●┤     "),
        (1.1, 1.25, 1.4, "      ┊├─●─┤ "),
        (0.1, 0.6, 1.2, "◂●────┼─┤    "),
        (0.8, 0.8, 0.8, "    ●  ┊     "),
        (0.01, 2.0, 9.0, "◂─────┼─────●"),
    ],
)
def test_gauge(low: float, middle: float, high: float, drawn: str) -> None:
    made = gauge(low * 7.2, middle * 7.2, high * 7.2, 7.2, 13)
    assert len(made) == 13
    if low == high:
        assert made.count("●") == 1
        assert "├" not in made
    else:
        assert made == drawn


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_round_limits_enclose_the_values(low: float, span: float) -> None:
    low_limit, high_limit = round_limits(low, low + span)
    assert low_limit <= low
    assert high_limit >= low + span
    assert high_limit - low_limit <= 3.0 * span + 1e-9 * abs(low)


def test_keys_in_a_real_terminal(tmp_path: Path) -> None:
    """The view in a pseudo-terminal: it draws, a key pauses it, q restores the terminal."""
    script = (
        "from tests.live.test_terminal import _session\n"
        "from bayes_asv.live.terminal import run_terminal_view\n"
        "from rich.console import Console\n"
        "import threading\n"
        "run_terminal_view(_session(1.0), Console(), threading.Event())\n"
        "print('left', flush=True)\n"
    )
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(ROOT)
        os.environ.update(TERM="xterm-256color", COLUMNS="100", LINES="30")
        os.execv(sys.executable, [sys.executable, "-c", script])
    seen = b""
    pending = {b"playing": b" ", b"paused": b"q"}
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                seen += os.read(terminal, 65536)
            except OSError:
                break
        for text, key in list(pending.items()):
            if text in seen:
                os.write(terminal, key)
                del pending[text]
                break
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 0
    assert pending == {}
    assert b"left" in seen
    assert b"\x1b[?1049l" in seen  # back from the alternate screen
