"""The live view in a terminal."""

from __future__ import annotations

import math
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.live.braille import gauge, plot, round_limits
from bayes_asv.live.metadata import ViewMetadata
from bayes_asv.live.session import FRAME_RATE, Playback, Session
from bayes_asv.live.text import consistency_text, parameter_card, travel_text
from bayes_asv.report.words import number

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

__all__ = ["KEYS", "pressed_keys", "render", "run_terminal_view"]

KEYS: Final = {" ": "pause", "r": "restart", ".": "0.1", "1": "1", "0": "10"}
"""Actions by key; a number is a speed."""

_WINDOW: Final = 5.0  # s
_TONES: Final = {"good": "green", "below": "bold red", "above": "magenta", "muted": "dim"}
_COLOURS: Final = {"front": "bright_blue", "rear": "yellow"}
_GAUGE_WIDTH: Final = 25
_NARROW: Final = 100  # columns below which charts are drawn below each other


def run_terminal_view(session: Session, console: Console, stop: threading.Event) -> None:
    """Draw a session until `stop` is set or q is pressed.

    Parameters
    ----------
    session : Session
        What is shown.
    console : rich Console
        Where to draw.
    stop : Event
        Ends the view.
    """
    from rich.live import Live

    with (
        pressed_keys() as keys,
        Live(console=console, screen=True, auto_refresh=False, transient=False) as live,
    ):
        while not stop.is_set():
            for key in keys():
                if key in "qQ":
                    return
                _handle_key(session, key.lower())
            playback = session.playback()
            live.update(
                render(playback, session.metadata, console.width, console.height), refresh=True
            )
            stop.wait(1.0 / FRAME_RATE)


def render(playback: Playback, metadata: ViewMetadata, width: int, height: int) -> RenderableType:
    """Draw one moment of the playback.

    Parameters
    ----------
    playback : Playback
        State of the playback.
    metadata : ViewMetadata
        Of the session.
    width, height : int
        Of the terminal, characters.

    Returns
    -------
    renderable
        For rich.
    """
    from rich.console import Group
    from rich.text import Text

    head = Text(no_wrap=True, overflow="ellipsis")
    head.append(metadata.vehicle, "bold")
    head.append(f"  {metadata.source}  ", "dim")
    of = "" if metadata.live else f" of {number(metadata.duration or playback.end, 0.1)}"
    head.append(f"{playback.position:.2f}{of} s", "bold")
    speed = "" if metadata.live else f", ×{playback.speed:g}"
    head.append(f"  {playback.state}{speed}", "dim")
    parts: list[RenderableType] = [head]
    notes = [Text(note, "dim") for note in playback.notes[:2]]
    keys = "space pauses" if metadata.live else "space pauses, r restarts, . 1 0 set the speed"
    foot = Text(f"{keys}, q quits", "dim")
    if not playback.rows:
        return Group(*parts, Text("No row has come yet."), *notes, foot)
    row = playback.rows - 1
    estimates = playback.snapshot.estimates[row].tolist()
    now = dict(zip(metadata.traces, playback.snapshot.traces[row].tolist(), strict=True))
    nis, low, high = now["nis"], now["nis low"], now["nis high"]
    consistency = consistency_text(nis, low, high, estimates[-2] > 0.5, estimates[-1])
    verdict = Text(no_wrap=True, overflow="ellipsis")
    short = consistency.short
    verdict.append(f"{short[0].upper()}{short[1:]}. ", _TONES[consistency.tone])
    if math.isfinite(nis):
        verdict.append(f"NIS {nis:.2f} ({low:.2f} to {high:.2f}). ")
    verdict.append(consistency.long, "dim")
    parts += [verdict, _parameter_table(metadata, estimates, width)]
    side_by_side = width >= _NARROW
    remaining = height - 6 - len(metadata.parameters) - len(notes)
    charts = len(metadata.outputs) + len(metadata.elements)
    rows = remaining // ((charts + 1) // 2 if side_by_side else charts)
    parts += _charts(playback, metadata, width, max(rows - 1, 2), side_by_side=side_by_side)
    return Group(*parts, *notes, foot)


def _handle_key(session: Session, key: str) -> None:
    action = KEYS.get(key)
    if action is None or (session.metadata.live and action != "pause"):
        return
    if action == "pause":
        state = session.playback().state
        action = {"paused": "play", "ended": "play" if session.metadata.live else "restart"}.get(
            state, "pause"
        )
    if action[0].isdigit():
        session.control("speed", float(action))
    else:
        session.control(action)


def _parameter_table(metadata: ViewMetadata, estimates: list[float], width: int) -> Table:
    """Table of the parameters: label, value, interval on a scale, comparison with nominal."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    for _ in range(4):
        table.add_column(no_wrap=True)
    for n, parameter in enumerate(metadata.parameters):
        median, log_sd = estimates[n], estimates[len(metadata.parameters) + n]
        factor = math.exp(NORMAL_975 * log_sd)
        card = parameter_card(parameter, median, log_sd)
        bar = gauge(median / factor, median, median * factor, parameter.nominal, _GAUGE_WIDTH)
        cells = [
            Text(parameter.label),
            Text(f"{card.value} {card.width}", "bold"),
            Text(bar, _TONES[card.tone]),
            Text(card.sense, _TONES[card.tone]),
        ]
        if width < _NARROW:
            cells[0] = Text(parameter.name)
            del cells[2]
        table.add_row(*cells)
    return table


def _charts(
    playback: Playback, metadata: ViewMetadata, width: int, rows: int, *, side_by_side: bool
) -> list[RenderableType]:
    """Draw all measured outputs and the deflections of the elements, two side by side."""
    from rich.table import Table

    snapshot = playback.snapshot
    now = float(snapshot.time[playback.rows - 1])
    span = (now - _WINDOW, now)
    if metadata.duration is not None and metadata.duration <= _WINDOW:  # show all of it
        span = (now - playback.position, now - playback.position + metadata.duration)
    begin = int(np.searchsorted(snapshot.time[: playback.rows], span[0]))
    part = slice(begin, playback.rows)
    time, values = snapshot.time[part], snapshot.traces[part]
    chart_width = width // 2 - 2 if side_by_side else width
    column = {name: n for n, name in enumerate(metadata.traces)}
    travel = travel_text(metadata, tuple(snapshot.extremes[playback.rows - 1].tolist()))
    unit = metadata.deflection[0]
    wanted: list[tuple[str, str, str, tuple[str, ...], str]] = [
        (o.key, f"{o.label} [{o.unit}], {o.sign}", o.unit, ("measured", "predicted"), "")
        for o in metadata.outputs
    ]
    wanted += [
        (element, f"{element.replace('_', ' ')} deflection [{unit}], extension positive",
         f"{unit} deflection", ("deflection",), so_far)
        for element, so_far in zip(metadata.elements, travel, strict=True)
    ]  # fmt: skip
    limits: dict[str, tuple[float, float]] = {}  # charts of one quantity share their scale
    for kind in dict.fromkeys(of for _, _, of, _, _ in wanted):
        alike = [
            column[f"{key} {n}"] for key, _, of, names, _ in wanted if of == kind for n in names
        ]
        shown = values[:, alike]
        finite = shown[np.isfinite(shown)]
        limits[kind] = round_limits(*((finite.min(), finite.max()) if len(finite) else (-1.0, 1.0)))
    charts: list[Text] = []
    for key, label, kind, names, so_far in wanted:
        curves = [values[:, column[f"{key} {name}"]] for name in names]
        low, high = limits[kind]
        title = f"{label}, {number(low)} to {number(high)}"
        longer = f"{title}; so far {so_far}"
        title = longer if so_far and len(longer) <= chart_width else title
        colour = _COLOURS.get(key.replace("_", " ").split()[0], "green")
        lines = plot(time, curves, span, limits[kind], (chart_width, rows))
        charts.append(_chart(title, lines, ["dim", colour][-len(names) :]))
    if not side_by_side:
        return [*charts]
    table = Table.grid(padding=(0, 2))
    for n in range(0, len(charts), 2):
        table.add_row(*charts[n : n + 2])
    return [table]


def _chart(title: str, lines: list[list[tuple[str, int]]], styles: list[str]) -> Text:
    from rich.text import Text

    text = Text(title, no_wrap=True, overflow="ellipsis")
    for line in lines:
        text.append("\n")
        for characters, curve in line:
            text.append(characters, styles[curve] if curve >= 0 else "")
    return text


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """Read keys without waiting, while the context lasts.

    Yields
    ------
    callable
        Returns the keys pressed since the last call, perhaps none; always none where standard input
        is not a terminal.
    """
    if not sys.stdin.isatty():
        yield str
        return
    if os.name == "nt":
        yield _windows_keys
        return
    import select
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)

    def read() -> str:
        keys = b""
        while select.select([terminal], [], [], 0.0)[0]:
            data = os.read(terminal, 64)
            if not data:
                break
            keys += data
        return keys.decode("ascii", "ignore")

    try:
        tty.setcbreak(terminal)  # keys without Enter; Ctrl-C still ends the program
        yield read
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _windows_keys() -> str:
    import importlib

    console = importlib.import_module("msvcrt")
    keys = ""
    while console.kbhit():
        keys += console.getwch()
    return keys
