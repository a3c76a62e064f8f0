"""Events of recordings that were too long to be taken whole: used, left out and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import LogEvent, LongLog
from bayes_asv.report.sections.blocks import Block, Figure, Section, Text
from bayes_asv.report.svg import COLOURS, Panel, canvas, curve_array, panel, power_of_ten
from bayes_asv.report.words import plain

__all__ = ["SECTION", "log_lines"]

_LOWEST: Final = 1e-6  # of the axis of the information
_WIDTH: Final = 8.6  # inches: two panels
_ROWS: Final = (("used", "good"), ("not needed", "muted"), ("unfit", "below"))


def _content(document: EstimateDocument) -> Iterator[Block]:
    if not document.logs:
        return
    yield Text("Events of long recordings", log_lines(document))
    panels = tuple(_timeline(f"events-{k}", log) for k, log in enumerate(document.logs) if log.time)
    yield Figure(
        "events", "Information over time",
        "Above: information per second about the answers, relative to the most there is. Below: "
        "the events that were found. Standing, cruising, braking and cornering carry little, "
        "because they hardly move the wheels against the body.",
        panels,
    )  # fmt: skip


SECTION: Final = Section(_content, title="Events of long recordings")


def log_lines(document: EstimateDocument) -> list[str]:
    """State what was found in each long recording, and what became of it."""
    return [_sentence(log) for log in document.logs]


def _sentence(log: LongLog) -> str:
    used = sum(event.used for event in log.events)
    kinds = Counter(event.kind for event in log.events)
    found = " and ".join(_count(n, kind) for kind, n in kinds.items()) or "no event"
    seconds = sum(event.end - event.begin for event in log.events if event.used)
    text = (
        f"{plain(log.source)} lasts {_minutes(log.seconds)}: {found} "
        f"{'was' if len(log.events) < 2 else 'were'} found"
    )
    text += f", and the best {used} used ({_minutes(seconds)})." if used else "."
    left = Counter(event.reason for event in log.events if not event.used)
    if left:
        text += " Left out: " + ", ".join(f"{n} as {plain(why)}" for why, n in left.items()) + "."
    rest = ", ".join(f"{plain(name)} {_minutes(seconds)}" for name, seconds in log.rest.items())
    return f"{text} The rest of the time: {rest}." if rest else text


def _count(n: int, kind: str) -> str:
    plural = {"bump": "bumps", "rough stretch": "pieces of rough stretches"}
    single = {"bump": "bump", "rough stretch": "piece of a rough stretch"}
    return f"{n} {single[kind] if n == 1 else plural[kind]}"


def _minutes(seconds: float) -> str:
    return f"{seconds / 60.0:.1f} min" if seconds >= 120.0 else f"{seconds:.0f} s"


def _row(event: LogEvent) -> str:
    if event.used:
        return "used"
    return "unfit" if event.unfit else "not needed"


def _timeline(key: str, log: LongLog) -> Panel:
    """Draw the information over time, and the events below it."""
    figure = canvas(_WIDTH, 2.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    minutes = curve_array(log.time) / 60.0
    level = np.maximum(np.nan_to_num(curve_array(log.level)), _LOWEST)
    above.fill_between(
        minutes, level, _LOWEST, step="post", color=COLOURS["front"], alpha=0.6, linewidth=0
    )
    above.set(yscale="log", ylim=(_LOWEST, 2.0), ylabel="information")
    above.yaxis.set_major_formatter(lambda value, _: power_of_ten(value))
    for place, (name, colour) in enumerate(_ROWS):
        bars = [
            (
                event.begin / 60.0,
                max((event.end - event.begin) / 60.0, 2e-3 * float(np.ptp(minutes))),
            )
            for event in log.events
            if _row(event) == name
        ]
        below.broken_barh(bars, (-place - 0.4, 0.8), color=COLOURS[colour])
    below.set(
        yticks=[0, -1, -2],
        yticklabels=[name for name, _ in _ROWS],
        ylim=(-2.6, 0.6),
        xlabel="time [min]",
    )
    below.grid(visible=False, axis="y")
    counts = Counter(map(_row, log.events))
    shown = ", ".join(f"{counts[name]} {name}" for name, _ in _ROWS)
    return panel(
        figure,
        key,
        f"Information over the time of {plain(log.source)}, and events: {shown}",
        wide=True,
    )
