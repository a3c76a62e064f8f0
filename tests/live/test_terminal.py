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

from bayes_asv.live.braille import gauge, plotted, round_limits
from bayes_asv.live.metadata import scene
from bayes_asv.live.session import Show
from bayes_asv.live.terminal import picture
from tests.live.made_up import BAJA, Time, frames, recording

ROOT = Path(__file__).parents[2]


def _show(position: float) -> Show:
    show = Show(scene(BAJA, "stops.csv", 9.0), 100.0, clock=Time())
    run = recording(9.0, 100.0)
    show.history.append(frames(BAJA, run.time, run.values.T))
    show.finish()
    show.ask("seek", position)
    return show


def _printed(show: Show, width: int, height: int) -> list[str]:
    console = Console(width=width, height=height, no_color=True, force_terminal=False)
    with console.capture() as capture:
        console.print(picture(show.moment(), show.scene, width, height))
    return capture.get().rstrip("\n").split("\n")


@pytest.mark.parametrize(("width", "height"), [(60, 24), (80, 24), (100, 30), (160, 50)])
def test_it_fits_the_terminal_and_says_what_matters(width: int, height: int) -> None:
    lines = _printed(_show(4.0), width, height)
    assert len(lines) <= height
    assert all(cell_len(line) <= width for line in lines)
    text = "\n".join(lines)
    assert "5.76 lbf·s/in ± 2.2 %" in text
    assert "20 % softer than nominal" in text
    assert "extension positive" in text
    assert "Consistent" in text
    assert re.search("[\u2801-\u28ff]", text)


def test_the_verdict_and_the_state_are_told() -> None:
    text = "\n".join(_printed(_show(7.0), 160, 40))
    assert "Errors too large" in text
    assert "NIS 2.50 (0.80 to 1.20)" in text
    show = _show(4.0)
    show.ask("pause")
    show.note("12 lines were not readable.")
    text = "\n".join(_printed(show, 100, 30))
    assert "paused" in text
    assert "12 lines were not readable." in text


def test_before_the_first_row() -> None:
    empty = Show(scene(BAJA, "/dev/ttyUSB0", None, live=True), 100.0)
    text = "\n".join(_printed(empty, 80, 24))
    assert "No row has come yet." in text
    assert "restarts" not in text


@given(
    st.lists(st.integers(0, 39), min_size=1, max_size=40),
    st.integers(4, 30),
    st.integers(2, 10),
)
def test_dots_stand_where_the_values_are(places: list[int], across: int, down: int) -> None:
    rows = np.array(places) % (4 * down)
    curve = 1.0 - (rows + 0.5) / (2.0 * down)  # the middle of a row of dots
    time = np.linspace(0.0, 1.0, len(curve))
    lines = plotted(time, [curve], (0.0, 1.0), (-1.0, 1.0), (across, down))
    grid = np.zeros((4 * down, 2 * across), dtype=bool)
    # Unicode 15, chapter 21.1: dots 1 2 3 7 down the left side, 4 5 6 8 down the right.
    order = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
    for row, runs in enumerate(lines):
        signs = "".join(signs for signs, _ in runs)
        assert len(signs) == across
        for column, sign in enumerate(signs):
            bits = 0 if sign == " " else ord(sign) - 0x2800
            for bit, (y, x) in enumerate(order):
                grid[4 * row + y, 2 * column + x] = bool(bits >> bit & 1)
    wanted: dict[int, list[int]] = {}
    for t, row in zip(time, rows, strict=True):
        wanted.setdefault(min(int(t * 2 * across), 2 * across - 1), []).append(int(row))
    for x in range(2 * across):
        lit = np.flatnonzero(grid[:, x])
        if x not in wanted:
            assert len(lit) == 0
        else:
            assert lit.tolist() == list(range(min(wanted[x]), max(wanted[x]) + 1))


def test_holes_and_what_is_outside_stay_empty() -> None:
    time = np.array([-1.0, 0.1, 0.5, 0.9, 2.0])
    curve = np.array([0.0, np.nan, 5.0, np.inf, 0.0])
    lines = plotted(time, [curve], (0.0, 1.0), (-1.0, 1.0), (10, 3))
    assert all(sign == " " for runs in lines for signs, _ in runs for sign in signs)


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
def test_limits_hold_what_they_were_made_for(low: float, span: float) -> None:
    least, most = round_limits(low, low + span)
    assert least <= low
    assert most >= low + span
    assert most - least <= 3.0 * span + 1e-9 * abs(low)


def test_keys_in_a_real_terminal(tmp_path: Path) -> None:
    """The view under a pseudo-terminal: it draws, a key pauses it, q gives the terminal back."""
    script = (
        "from tests.live.test_terminal import _show\n"
        "from bayes_asv.live.terminal import watch_in_terminal\n"
        "from rich.console import Console\n"
        "import threading\n"
        "watch_in_terminal(_show(1.0), Console(), threading.Event())\n"
        "print('left', flush=True)\n"
    )
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(ROOT)
        os.environ.update(TERM="xterm-256color", COLUMNS="100", LINES="30")
        os.execv(sys.executable, [sys.executable, "-c", script])
    seen = b""
    asked = {b"playing": b" ", b"paused": b"q"}
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                seen += os.read(terminal, 65536)
            except OSError:
                break
        for sight, key in list(asked.items()):
            if sight in seen:
                os.write(terminal, key)
                del asked[sight]
                break
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 0
    assert asked == {}
    assert b"left" in seen
    assert b"\x1b[?1049l" in seen  # back from the alternate screen
