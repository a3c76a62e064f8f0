"""The live view in a terminal."""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.live.bands import Z95
from bayes_asv.live.braille import gauge, plotted, round_limits
from bayes_asv.live.history import TRACES
from bayes_asv.live.keys import pressed_keys
from bayes_asv.live.metadata import AXLES, Scene
from bayes_asv.live.session import Moment, Show
from bayes_asv.live.words import card, consistency, travel
from bayes_asv.report.readable import number

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

__all__ = ["KEYS", "picture", "watch_in_terminal"]

KEYS: Final = {" ": "pause", "r": "restart", ".": "0.1", "1": "1", "0": "10"}

_FRAMES_A_SECOND: Final = 12.5
_WINDOW: Final = 5.0  # s
_TONES: Final = {"good": "green", "below": "bold red", "above": "magenta", "muted": "dim"}
_PAINT: Final = {"front": "bright_blue", "rear": "yellow"}
_GAUGE: Final = 25
_NARROW: Final = 100  # columns below which the axles stand under each other


def watch_in_terminal(show: Show, console: Console, stop: threading.Event) -> None:
    """Draw the show until `stop` is set, or the recording has ended and q is pressed.

    Parameters
    ----------
    show : Show
        What is watched.
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
                _press(show, key.lower())
            moment = show.moment()
            live.update(picture(moment, show.scene, console.width, console.height), refresh=True)
            stop.wait(1.0 / _FRAMES_A_SECOND)


def picture(moment: Moment, scene: Scene, width: int, height: int) -> RenderableType:
    """Draw one moment.

    Parameters
    ----------
    moment : Moment
        From a show.
    scene : Scene
        Likewise.
    width, height : int
        Of the terminal, signs.

    Returns
    -------
    renderable
        For rich.
    """
    from rich.console import Group
    from rich.text import Text

    head = Text(no_wrap=True, overflow="ellipsis")
    head.append(scene.vehicle, "bold")
    head.append(f"  {scene.source}  ", "dim")
    of = "" if scene.live else f" of {number(scene.duration or moment.end, 0.1)}"
    head.append(f"{moment.position:.2f}{of} s", "bold")
    speed = "" if scene.live else f", ×{moment.speed:g}"
    head.append(f"  {moment.state}{speed}", "dim")
    parts: list[RenderableType] = [head]
    notes = [Text(note, "dim") for note in moment.notes[:2]]
    wanted = "space pauses" if scene.live else "space pauses, r restarts, . 1 0 set the speed"
    foot = Text(f"{wanted}, q leaves", "dim")
    if not moment.rows:
        return Group(*parts, Text("No row has come yet."), *notes, foot)
    place = moment.rows - 1
    known = moment.snapshot.known[place].tolist()
    now = dict(zip(TRACES, moment.snapshot.traces[place].tolist(), strict=True))
    said = consistency(now["nis"], now["nis low"], now["nis high"], known[6] > 0.5, known[7])
    verdict = Text(no_wrap=True, overflow="ellipsis")
    verdict.append(f"{said.short[0].upper()}{said.short[1:]}. ", _TONES[said.tone])
    if math.isfinite(now["nis"]):
        verdict.append(f"NIS {now['nis']:.2f} ({now['nis low']:.2f} to {now['nis high']:.2f}). ")
    verdict.append(said.long, "dim")
    parts += [verdict, _cards(scene, known, width)]
    side_by_side = width >= _NARROW
    rest = height - 9 - len(notes)
    rows = rest // 2 if side_by_side else rest // 4
    parts += _axles(moment, scene, width, max(rows - 1, 2), side_by_side=side_by_side)
    return Group(*parts, *notes, foot)


def _press(show: Show, key: str) -> None:
    wish = KEYS.get(key)
    if wish is None or (show.scene.live and wish != "pause"):
        return
    if wish == "pause":
        state = show.moment().state
        wish = {"paused": "play", "ended": "play" if show.scene.live else "restart"}.get(
            state, "pause"
        )
    if wish[0].isdigit():
        show.ask("speed", float(wish))
    else:
        show.ask(wish)


def _cards(scene: Scene, known: list[float], width: int) -> Table:
    """Three lines: label, value, interval on a scale, and how it stands to nominal."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    for _ in range(4):
        table.add_column(no_wrap=True)
    for place, parameter in enumerate(scene.parameters):
        median, spread = known[place], math.exp(Z95 * known[3 + place])
        said = card(parameter, median, known[3 + place])
        bar = gauge(median / spread, median, median * spread, parameter.nominal, _GAUGE)
        cells = [
            Text(parameter.label),
            Text(f"{said.value} {said.width}", "bold"),
            Text(bar, _TONES[said.tone]),
            Text(said.sense, _TONES[said.tone]),
        ]
        if width < _NARROW:
            cells[0] = Text(parameter.name)
            del cells[2]
        table.add_row(*cells)
    return table


def _axles(
    moment: Moment, scene: Scene, width: int, rows: int, *, side_by_side: bool
) -> list[RenderableType]:
    """Draw acceleration and deflection of both axles."""
    from rich.table import Table

    snapshot = moment.snapshot
    now = float(snapshot.time[moment.rows - 1])
    span = (now - _WINDOW, now)
    if scene.duration is not None and scene.duration <= _WINDOW:  # then all of it stands still
        span = (now - moment.position, now - moment.position + scene.duration)
    begin = int(np.searchsorted(snapshot.time[: moment.rows], span[0]))
    part = slice(begin, moment.rows)
    time, values = snapshot.time[part], snapshot.traces[part]
    across = width // 2 - 2 if side_by_side else width
    index = {name: place for place, name in enumerate(TRACES)}
    reach = travel(scene, tuple(snapshot.reach[moment.rows - 1].tolist()))
    cells: dict[str, list[Text]] = {}
    for what, unit, words, shown in (
        ("acceleration", scene.acceleration[0], "up positive", ("measured", "predicted")),
        ("deflection", scene.deflection[0], "extension positive", ("deflection",)),
    ):
        both = values[:, [index[f"{axle} {name}"] for axle in AXLES for name in shown]]
        finite = both[np.isfinite(both)]
        limits = round_limits(*((finite.min(), finite.max()) if len(finite) else (-1.0, 1.0)))
        for place, axle in enumerate(AXLES):
            curves = [values[:, index[f"{axle} {name}"]] for name in shown]
            title = f"{axle} {what} [{unit}], {words}, {number(limits[0])} to {number(limits[1])}"
            if what == "deflection" and reach[place]:
                longer = f"{title}; so far {reach[place]}"
                title = longer if len(longer) <= across else title
            paints = ["dim", _PAINT[axle]][-len(shown) :]
            drawn = plotted(time, curves, span, limits, (across, rows))
            cells.setdefault(what, []).append(_drawn(title, drawn, paints))
    if not side_by_side:
        return [text for axle in range(2) for text in (cell[axle] for cell in cells.values())]
    table = Table.grid(padding=(0, 2))
    for pair in cells.values():
        table.add_row(*pair)
    return [table]


def _drawn(title: str, lines: list[list[tuple[str, int]]], paints: list[str]) -> Text:
    from rich.text import Text

    text = Text(title, no_wrap=True, overflow="ellipsis")
    for line in lines:
        text.append("\n")
        for signs, owner in line:
            text.append(signs, paints[owner] if owner >= 0 else "")
    return text
