"""A season: what changed and when, the trend of every damper, and the recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv.report.schema.fleet import FleetChange, FleetDocument, FleetFile, FleetTrend, Ratio
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table
from bayes_asv.report.svg import COLOURS, Panel, axle_colour, canvas, curve_array, panel
from bayes_asv.report.words import (
    MISSING,
    capitalized,
    enumerated,
    number,
    p_value,
    percent,
    plain,
    probability,
    readable_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "RECORDINGS_SECTION", "SECTION", "file_rows", "fleet_headline", "fleet_lines", "fleet_steps",
    "fleet_subtitle",
]  # fmt: skip

_VERDICTS: Final = {
    "ok": "estimated",
    "doubtful": "doubtful",
    "not_converged": "not converged",
    "refused": "refused",
    "unreadable": "unreadable",
    "failed": "failed",
    "duplicate": "copies",
}
_ORIGINS: Final = {"metadata": "metadata", "name": "name", "file": "time of the file"}

_TRENDS: Final = (
    "Each point is one recording by itself with its own 95 % interval; the errors of mass, springs "
    "and weight share, which would move all points alike, are left out of it. The line is the "
    "level, averaged over the hypotheses, with its 95 % band; it differs from the points by the "
    "scatter from run to run. Shaded is the time in which a sudden change happened. The dashed "
    "line is the nominal value."
)
_NOTE: Final = (
    "A priori, no change has a probability of one half, a gradual and any number of sudden changes "
    "one quarter each. The test asks how often a season without a change would look as changed."
)


def fleet_headline(document: FleetDocument) -> str:
    """State of every damper whether and when it changed."""
    if document.verdict == "refused":
        return "No answer: no recording of this season has a verdict on the dampers."
    if not document.trends:
        return "The recordings were estimated; they are too few, or of too few dates, for a trend."
    return " ".join(_sentence(trend) for trend in document.trends.values())


def fleet_subtitle(document: FleetDocument) -> str:
    """Count the recordings by verdict, and name the season."""
    used = [file for file in document.files if file.verdict == "ok"] or document.files
    dates = [datetime.fromisoformat(file.date) for file in used]
    counts = ", ".join(f"{count} {_VERDICTS[v]}" for v, count in document.counts.items())
    total = len(document.files)
    return f"{total} recording{'s' * (total != 1)} ({counts}) · {_period(dates[0], dates[-1])}"


def fleet_lines(document: FleetDocument) -> list[str]:
    """State the result in sentences."""
    lines = [_sentence(trend) for trend in document.trends.values()] or [fleet_headline(document)]
    lines.append(f"{capitalized(fleet_subtitle(document))}.")
    for file in _without_verdict(document)[:_MOST_LISTED]:
        lines.append(f"{capitalized(file.verdict)}: {file.file}: {file.reason}.".replace("_", " "))
    more = len(_without_verdict(document)) - _MOST_LISTED
    if more > 0:
        lines.append(f"{more} more recordings have no verdict; the table says why.")
    return lines + [f"Note: {plain(warning)}." for warning in document.warnings]


_MOST_LISTED: Final = 10


def fleet_steps(document: FleetDocument) -> list[str]:
    """Say what to do next."""
    steps = []
    for trend in document.trends.values():
        damper = _damper(trend)
        falls = [c for c in trend.changes if c.median < 1.0] if trend.kind == "sudden" else []
        for change in falls:
            steps.append(
                f"Find out what happened to the {damper} {_between(change)}: adjuster setting, "
                "oil, seals, gas charge, mounts, or another damper."
            )
        if trend.kind == "gradual" and trend.gradual.median < 1.0:
            steps.append(
                f"The {damper} loses {_size(trend.gradual)} in a season like this: plan its "
                "service, and watch it."
            )
    if _without_verdict(document):
        steps.append(
            "Look at the recordings without a verdict below: a mistake in the logging setup often "
            "repeats in all that follow."
        )
    steps.append(
        "Add the next recordings and run the same command again: only new ones are estimated."
    )
    return steps


def file_rows(document: FleetDocument) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the table of recordings that have a verdict."""
    units = {name: readable_unit(trend.unit) for name, trend in document.trends.items()}
    head = ["recording", "date", "date from"]
    head += [f"{trend.label} [{units[name]}]" for name, trend in document.trends.items()]
    rows = []
    for file in document.files:
        if file.verdict != "ok":
            continue
        row = [file.file, _moment(datetime.fromisoformat(file.date)), _ORIGINS[file.date_from]]
        for name in document.trends:
            value = file.parameters.get(name)
            row.append(
                MISSING
                if value is None
                else f"{number(value.mean, value.sd)} ± {number(value.sd, value.sd)}"
            )
        rows.append(row)
    return head, rows


def _content(document: FleetDocument) -> Iterator[Block]:
    if document.trends:
        yield Figure("trends", "Damping rates over the season", _TRENDS, _panels(document))
        yield _hypotheses(document)
    faulty = _without_verdict(document)
    if faulty:
        rows = [
            [file.file, _moment(datetime.fromisoformat(file.date)),
             file.verdict.replace("_", " "), file.reason]
            for file in faulty
        ]  # fmt: skip
        yield Table(
            "Recordings without a verdict", ["recording", "date", "verdict", "reason"], rows,
            kind="texts",
        )  # fmt: skip


def _recordings(document: FleetDocument) -> Iterator[Block]:
    head, rows = file_rows(document)
    if rows:
        yield Table(
            "Recordings", head, rows,
            "Mean ± standard deviation of each recording by itself, with the errors of the given "
            "values.",
        )  # fmt: skip


def _limits(document: FleetDocument) -> list[str]:
    return [
        f"The {trend.label} differs from recording to recording by "
        f"{number(100.0 * trend.scatter.median, 100.0 * trend.scatter.median)} % (95 %: "
        f"{_percents(trend.scatter.eti95)}): a smaller change shows in many recordings only."
        for trend in document.trends.values()
        if trend.scatter.median > _SCATTER
    ]


_SCATTER: Final = 0.01  # beyond which the scatter, and not the recordings, limits the trend

SECTION: Final = Section(_content, _limits)

RECORDINGS_SECTION: Final = Section(_recordings, title="Recordings of the season")


def _hypotheses(document: FleetDocument) -> Table:
    rows = []
    for trend in document.trends.values():
        one, two, *more = trend.p_sudden
        chances = (trend.p_no_change, trend.p_gradual, one, two, sum(more))
        test = p_value(trend.p_value)
        scatter = _percents(trend.scatter.eti95)
        rows.append([capitalized(_damper(trend)), *map(probability, chances), test, scatter])
    columns = [
        "", "no change", "gradual", "one change", "two changes", "more", "test of no change",
        "scatter (95 %)",
    ]  # fmt: skip
    return Table("Probabilities", columns, rows, _NOTE)


def _sentence(trend: FleetTrend) -> str:
    damper = capitalized(_damper(trend))
    if trend.kind == "no change":
        return f"{damper}: no change (probability {probability(trend.p_no_change)})."
    if trend.kind == "gradual":
        first, last = (datetime.fromisoformat(trend.date[n]) for n in (0, -1))
        return (
            f"{damper}: {_verb(trend.gradual)} gradually by {_size(trend.gradual)} from "
            f"{_day(first)} to {_day(last)} (95 %: {_span(trend.gradual)}; probability "
            f"{probability(trend.p_gradual)})."
        )
    if not trend.changes:
        return (
            f"{damper}: a sudden change (probability {probability(sum(trend.p_sudden))}), "
            "but it is not clear when."
        )
    parts = [
        f"{_verb(change)} by {_size(change)} {_between(change)} (95 %: {_span(change)}; "
        f"probability {probability(change.probability)})"
        for change in trend.changes
    ]
    return f"{damper}: {enumerated(parts)}."


def _damper(trend: FleetTrend) -> str:
    return trend.label.replace("damping rate", "damper")


def _verb(ratio: Ratio) -> str:
    return "fell" if ratio.median < 1.0 else "rose"


def _size(ratio: Ratio) -> str:
    share = abs(ratio.median - 1.0)
    return percent(share, 0 if share >= 0.1 else 1)


def _span(ratio: Ratio) -> str:
    """Write the ends of the interval of a fall or a rise, in percent."""
    ends = sorted((x - 1.0) * (-1.0 if ratio.median < 1.0 else 1.0) for x in ratio.eti95)
    return _percents(ends)


def _percents(ends: Sequence[float]) -> str:
    low, high = (100.0 * end for end in ends)
    width = max(high - low, 1e-3) / 4.0
    return f"{number(low, width, 1)} to {number(high, width, 1)} %"


def _between(change: FleetChange) -> str:
    """Write two dates, without repeating month and year."""
    first, last = (datetime.fromisoformat(text) for text in (change.after, change.before))
    if first.date() == last.date():
        return f"on {_day(first)} between {first:%H:%M} and {last:%H:%M}"
    if (first.year, first.month) == (last.year, last.month):
        return f"between {first.day} and {_day(last)}"
    if first.year == last.year:
        return f"between {first.day} {first:%B} and {_day(last)}"
    return f"between {_day(first)} and {_day(last)}"


def _period(first: datetime, last: datetime) -> str:
    if first.date() == last.date():
        return _day(first)
    return f"{_day(first)} to {_day(last)}"


def _day(date: datetime) -> str:
    return f"{date.day} {date:%B %Y}"


def _moment(date: datetime) -> str:
    """Write a date, and the time of day unless it is midnight, as of a date alone."""
    return f"{date:%Y-%m-%d %H:%M}".removesuffix(" 00:00")


def _without_verdict(document: FleetDocument) -> list[FleetFile]:
    return [file for file in document.files if file.verdict != "ok"]


def _panels(document: FleetDocument) -> tuple[Panel, ...]:
    panels = []
    for name, trend in document.trends.items():
        figure = canvas()
        _draw(figure.subplots(), trend)
        alt = f"{trend.label} over the season. {_sentence(trend)}"
        panels.append(panel(figure, f"trend-{name.replace('_', '-')}", alt))
    return tuple(panels)


def _draw(axes: Axes, trend: FleetTrend) -> None:
    from matplotlib import dates

    ticks: Any = dates  # which has no types
    colour = axle_colour(trend.label)
    days = np.array(trend.date, dtype="datetime64[s]")
    value, level = curve_array(trend.value), curve_array(trend.level)
    low, high = (curve_array(curve) for curve in trend.value95)
    below, above = (curve_array(curve) for curve in trend.level95)
    axes.fill_between(days, below, above, color=colour, alpha=0.22, linewidth=0, step="mid")
    axes.errorbar(
        days, value, np.stack([value - low, high - value]), fmt="o", color=colour, markersize=3.0,
        elinewidth=0.8, alpha=0.8, linewidth=0,
    )  # fmt: skip
    axes.step(days, level, where="mid", color=COLOURS["ink"], linewidth=1.3)
    axes.axhline(trend.nominal, color=COLOURS["muted"], linestyle=(0, (5, 3)), linewidth=1.0)
    for change in trend.changes if trend.kind == "sudden" else ():
        begin, end = (np.datetime64(text, "s") for text in (change.after, change.before))
        paint = COLOURS["below" if change.median < 1.0 else "above"]
        axes.axvspan(begin, end, color=paint, alpha=0.18, linewidth=0)  # type: ignore[arg-type]
    locator = ticks.AutoDateLocator(minticks=3, maxticks=6)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ticks.ConciseDateFormatter(locator, show_offset=False))
    axes.set_ylabel(f"{trend.label} [{readable_unit(trend.unit)}]")
    axes.margins(x=0.04)
