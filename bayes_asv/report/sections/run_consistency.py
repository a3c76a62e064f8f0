"""Consistency of several runs: sentences, table and forest plot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import OwnValue, RunConsistency, Spread
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table, Text
from bayes_asv.report.sections.parameters import short_label
from bayes_asv.report.words import (
    LABELS,
    MISSING,
    interval,
    number,
    p_value,
    plain,
    plus_minus,
    probability,
    readable_unit,
    two_digits,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SECTION", "consistency_headline", "consistency_lines", "consistency_steps"]

_MAX_ROWS: Final = 40  # runs that a page has room for
_MAX_NAME: Final = 22  # letters of a file's name
_NEAR: Final = 0.35  # of the range: a nominal value farther away is written and not drawn

_FOREST: Final = (
    "Thick bars are the 95 % intervals of each run by itself with the given values held, whose "
    "errors all runs share; they should overlap. Thin lines include the given values' errors. The "
    "band is the answer of all runs together, the dashed line the nominal value."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    consistency = document.agreement
    if consistency is None or not consistency.runs:
        return
    yield _consistency_table(consistency)
    lines = consistency_lines(document)
    if lines:
        yield Text("", lines)
    if document.parameters and consistency.each:
        yield Figure("agreement", "Comparison of the runs", _FOREST, (_forest(document),))


SECTION: Final = Section(_content, title="Consistency of the runs")


def consistency_headline(document: EstimateDocument) -> str:
    """Sentence of the headline when runs are inconsistent, otherwise empty."""
    consistency = document.agreement
    if document.verdict != "ok" or consistency is None or consistency.verdict != "disagree":
        return ""
    return "The runs are not consistent."


def consistency_lines(document: EstimateDocument) -> list[str]:
    """State whether the runs are consistent; a warning of the document states it if not."""
    consistency = document.agreement
    if document.verdict == "refused" or consistency is None:
        return []
    if consistency.verdict == "agree" and consistency.p is not None:
        return [f"The {len(consistency.runs)} runs are consistent ({p_value(consistency.p)})."]
    if consistency.verdict == "unknown":
        return [
            "The consistency of the runs could not be tested: one of them by itself determines "
            "too little, or has a posterior too far from a normal distribution."
        ]
    return []


def consistency_steps(document: EstimateDocument) -> list[str]:
    """Say what to do about inconsistent runs."""
    if not consistency_headline(document):
        return []
    return [
        "Find out what changed between the runs (adjuster, load, heat, tyre pressure, road) and "
        "estimate the runs of one setting separately; further runs of the same setting narrow the "
        "interval."
    ]


def _spread_text(spread: Spread) -> str:
    """Write a spread from run to run, ``3.9 % (1.5 to 23 %)``."""
    low, high = (two_digits(v) for v in spread.eti95)
    return f"{two_digits(spread.median)} % ({low} to {high} %)"


def _consistency_table(consistency: RunConsistency) -> Table:
    """Each run's own values, the answers of all runs, and the spread from run to run."""
    names = list(consistency.each)
    rows = [
        [plain(run.source), *(_own_text(run.parameters.get(n)) for n in names)]
        for run in consistency.runs
    ]
    joint = consistency.joint
    if joint:
        cells = (interval(joint[n]) if n in joint else MISSING for n in names)
        rows.append(["all, if consistent", *cells])
    if consistency.verdict == "disagree":
        rows.append(["mean car", *(interval(consistency.mean_car[n]) for n in names)])
        rows.append(["prediction for a run", *(interval(consistency.next_run[n]) for n in names)])
        spread = consistency.spread_percent
        rows.append(["spread from run to run", *(_spread_text(spread[n]) for n in names)])
    rows.append(["p-value", *(probability(consistency.each[n].p) for n in names)])
    units = [readable_unit(consistency.mean_car[n].unit) for n in names]
    titles = [f"{short_label(n)} [{unit}]" for n, unit in zip(names, units, strict=True)]
    return Table(
        "Consistency of the runs",
        ["recording", *titles],
        rows,
        "A run's own value ± one standard deviation holds the given values at what all runs say "
        "of them, since their errors are common to all runs. Answers of all runs are 95 % "
        "intervals with all uncertainties. The p-value is the probability of at least so much "
        "difference among runs of an unchanged car.",
    )


def _own_text(value: OwnValue | None) -> str:
    return MISSING if value is None or value.own is None else plus_minus(value.own)


def _forest(document: EstimateDocument) -> svg.Panel:
    """Draw every run's interval of each parameter, with the answer of all and nominal."""
    consistency = document.agreement
    assert consistency is not None
    runs = consistency.runs[:_MAX_ROWS]
    apart = consistency.verdict == "disagree"
    labels = [_shortened(plain(run.source)) for run in runs]
    labels += ["mean car", "prediction for a run"] if apart else ["all runs"]
    figure = svg.canvas(6.0, 0.23 * len(labels) + 1.45)
    columns = figure.subplots(1, len(consistency.each), sharey=True, squeeze=False)[0]
    for axes, name in zip(columns, consistency.each, strict=True):
        answer = (consistency.mean_car if apart else consistency.joint).get(name)
        values = [run.parameters.get(name) for run in runs]
        ends = [end for value in values if value is not None for end in _ends(value)]
        if answer is None:
            axes.axis("off")
            continue
        ends += answer.eti95
        paint = svg.axle_colour(LABELS[name])
        axes.axvspan(*answer.eti95, color=paint, alpha=0.14, linewidth=0)
        for row, value in enumerate(values):
            if value is None or value.own is None:
                continue
            axes.plot(value.eti95, [row, row], color=paint, linewidth=1.0, alpha=0.6)
            axes.plot(
                value.own.eti95, [row, row], color=paint, linewidth=4.0, solid_capstyle="butt"
            )
            axes.plot(value.own.mean, row, "o", color=paint, markersize=4.5)
        for row, p in enumerate([answer, *([consistency.next_run[name]] if apart else [])]):
            at = len(runs) + row
            axes.plot(p.eti95, [at, at], color=svg.COLOURS["ink"], linewidth=1.6)
            if p.median is not None:
                axes.plot(p.median, at, "D", color=svg.COLOURS["ink"], markersize=5.0)
        nominal = document.parameters[name].nominal if name in document.parameters else None
        _set_range(axes, ends, nominal)
        axes.set_xlabel(f"{short_label(name)}\n[{readable_unit(answer.unit)}]")
        axes.set(yticks=range(len(labels)), yticklabels=labels, ylim=(len(labels) - 0.4, -0.6))
        axes.axhline(len(runs) - 0.5, color=svg.COLOURS["grid"], linewidth=0.8)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.locator_params(axis="x", nbins=4)
    alt = "each run's own values beside the answer of all runs"
    return svg.panel(figure, "agreement", alt, wide=True)


def _ends(value: OwnValue) -> list[float]:
    return [*value.eti95, *(value.own.eti95 if value.own is not None else [])]


def _set_range(axes: Axes, ends: Sequence[float], nominal: float | None) -> None:
    """Show all intervals, and nominal where it is near them."""
    low, high = min(ends), max(ends)
    span = (high - low) or abs(high) or 1.0
    left, right = low - 0.06 * span, high + 0.06 * span
    if nominal is not None and low - _NEAR * span <= nominal <= high + _NEAR * span:
        left, right = min(left, nominal - 0.03 * span), max(right, nominal + 0.03 * span)
        axes.axvline(nominal, color=svg.COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0)
        axes.set_title(f"nominal {number(nominal)}", fontsize=8.5)
    elif nominal is not None:
        arrow = f"← nominal {number(nominal)}" if nominal < low else f"nominal {number(nominal)} →"
        axes.set_title(arrow, fontsize=8.5)
    axes.set_xlim(left, right)


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_NAME else f"{text[: _MAX_NAME - 1]}…"
