"""Simulation error and parameters before and after the named effects were added."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report import svg
from bayes_asv.report.schema import DiagnoseDocument
from bayes_asv.report.schema.diagnose import Gap, SimulationError
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table
from bayes_asv.report.sections.effects import car_words, effect_name
from bayes_asv.report.words import (
    LABELS,
    MISSING,
    capitalized,
    enumerated,
    estimate_text,
    interval,
    is_determined,
    labelled,
    number,
    percent,
    probability,
    readable_unit,
)

__all__ = [
    "SECTION",
    "asked",
    "error_numbers",
    "error_sentences",
    "reduction_text",
    "shift_sentence",
]

_ASKED: Final = ("damping", "pitch_inertia")  # dimensions
_MAX_RATIO: Final = 3.0  # times nominal: the end of the axis
_BARS: Final = (("before", "muted"), ("after", "good"), ("sensor noise alone", "prior"))

_ERROR: Final = (
    "On held-out runs only initial state and biases are fitted: there the green bar should come "
    "down to the brown one, which sensor noise alone would leave."
)
_CHANGES: Final = (
    "The distance from circle to diamond is the error that the linear {car} would have made. "
    "Bars are 95 % intervals."
)


def _content(document: DiagnoseDocument) -> Iterator[Block]:
    if document.gap.fit is not None:
        yield _error_table(document)
    if document.parameters_before and document.parameters_after:
        yield _parameters_table(document)
    if document.gap.fit is not None:
        yield Figure(
            "gap", "Simulation error before and after", _ERROR, (_error_bars(document.gap),)
        )
    if document.verdict == "named" or document.unnamed:
        caption = _CHANGES.format(car=car_words(document))
        yield Figure("moved", "Parameters before and after", caption, _parameter_changes(document))


SECTION: Final = Section(_content, title="Simulation error and parameters, before and after")


def asked(document: DiagnoseDocument) -> list[str]:
    """Names of the parameters that are asked for: damping rates and inertias."""
    return [n for n in document.parameters_after if QUANTITIES[n][0] in _ASKED]


def _measured(document: DiagnoseDocument) -> str:
    """Say what is compared with the simulation, and relative to what."""
    names = dict.fromkeys(name for run in document.residuals for name in run.entries)
    if all(name.endswith("_chassis") for name in names):
        return "chassis acceleration"
    relative = ", each relative to its standard deviation," if document.gap.unit == "%" else ""
    return f"{enumerated([name.replace('_', ' ') for name in names])}{relative}"


def _runs(gap: Gap) -> list[tuple[str, SimulationError]]:
    both = (("fitted runs", gap.fit), ("held-out runs", gap.holdout))
    return [(words, error) for words, error in both if error is not None]


def error_numbers(error: SimulationError) -> list[str]:
    """Error before, after and of sensor noise alone, to three digits with trailing zeros."""
    return [number(v, v, digits=3) for v in (error.before, error.after, error.floor)]


def error_sentences(gap: Gap) -> list[str]:
    """State the simulation error before and after, on fitted and on held-out runs."""
    unit, lines = readable_unit(gap.unit), []
    for words, error in _runs(gap):
        before, after, floor = error_numbers(error)
        worse = "; it increased" if error.worse else ""
        lines.append(
            f"Simulation error on {words}: {before} {unit} before, {after} {unit} after; sensor "
            f"noise alone leaves {floor} {unit}{worse}."
        )
    return lines


def shift_sentence(name: str, document: DiagnoseDocument) -> str:
    """State a parameter before and after the named effects were added."""
    before, after = document.parameters_before[name], document.parameters_after[name]
    return (
        f"{capitalized(LABELS[name])}: "
        f"{estimate_text(before, '' if is_determined(after.eti95) else after.unit, 2)} before, "
        f"{estimate_text(after, after.unit, 2)} after "
        f"(95 %: {interval(after)}; nominal {number(after.nominal)})."
    )


def reduction_text(share: float | None) -> str:
    """Write the share of the excess error that was removed, rounded down."""
    if share is None:
        return MISSING
    return "> 99.9 %" if share > 0.999 else percent(math.floor(1000.0 * share) / 1000.0, 1)


def _error_table(document: DiagnoseDocument) -> Table:
    """Tabulate the simulation error before and after, of all effects together and of each."""
    unit = readable_unit(document.gap.unit)
    rows = _error_rows("", document.gap)
    if len(document.effects) > 1:
        for effect in document.effects:
            rows += _error_rows(f"{effect_name(effect)}, ", effect.gap)
    return Table(
        "Simulation error",
        ["", f"before [{unit}]", f"after [{unit}]", f"noise alone [{unit}]", "reduction"],
        rows,
        f"RMS of measured less simulated {_measured(document)}; the reduction is that of the mean "
        "square above what sensor noise alone leaves.",
    )


def _error_rows(prefix: str, gap: Gap) -> list[list[str]]:
    return [
        [
            f"{prefix}{words}",
            *(number(v, 0.01 * v) for v in (error.before, error.after, error.floor)),
            "increased" if error.worse else reduction_text(error.closed),
        ]
        for words, error in _runs(gap)
    ]


def _error_bars(gap: Gap) -> svg.Panel:
    """Draw the simulation error before and after beside what sensor noise alone leaves."""
    runs = _runs(gap)
    figure = svg.canvas(6.0, 0.75 * len(runs) + 1.0)
    axes = figure.subplots()
    values = [(error.before, error.after, error.floor) for _, error in runs]
    largest = max(max(row) for row in values) or 1.0
    for row, heights in enumerate(values):
        for n, (value, (label, colour)) in enumerate(zip(heights, _BARS, strict=True)):
            at = row + 0.27 * (n - 1)
            axes.barh(
                at, value, height=0.24, color=svg.COLOURS[colour], linewidth=0,
                label=label if row == 0 else None,
            )  # fmt: skip
            axes.text(
                value + 0.012 * largest, at, number(value, 0.01 * value), va="center", fontsize=8.5,
                color=svg.COLOURS["ink"],
            )  # fmt: skip
    svg.label_rows(figure, axes, [words for words, _ in runs])
    axes.set(ylim=(len(runs) - 0.5, -0.5), xlim=(0.0, 1.12 * largest))
    axes.set_xlabel(f"rms of measured − simulated [{readable_unit(gap.unit)}]")
    alt = "simulation error before and after, with what sensor noise alone leaves"
    return svg.panel(figure, "gap", alt, wide=True)


def _parameters_table(document: DiagnoseDocument) -> Table:
    """Parameters of the linear car and of the model with the named effects."""
    before, after = document.parameters_before, document.parameters_after
    rows = [
        [
            capitalized(labelled(name, "", after[name].unit)),
            interval(before[name]),
            interval(after[name]),
            number(after[name].nominal),
            probability(after[name].p_below_nominal),
        ]
        for name in before
        if name in after
    ]
    return Table(
        "Parameters before and after",
        ["parameter", "before, 95 %", "after, 95 %", "nominal", "P(below nominal) after"],
        rows,
        f"Before: linear {car_words(document)}. After: with all that was added to it and the "
        "tolerances of all other effects. Both are approximations near the most probable values.",
    )


def _colour(name: str) -> str:
    """Colour of the axle of a damping rate, or that of the inertias."""
    return (
        svg.axle_colour(LABELS[name]) if QUANTITIES[name][0] == "damping" else svg.COLOURS["good"]
    )


def _parameter_changes(document: DiagnoseDocument) -> tuple[svg.Panel, ...]:
    """Draw each parameter before and after, over its nominal value, with 95 % intervals."""
    before, after = document.parameters_before, document.parameters_after
    rows = [
        (name, nominal)
        for name in asked(document)
        if name in before and name in after and (nominal := after[name].nominal or 0.0) > 0.0
    ]
    if not rows:
        return ()
    figure = svg.canvas(6.0, 0.55 * len(rows) + 1.0)
    axes = figure.subplots()
    ends = [1.0]
    for row, (name, nominal) in enumerate(rows):
        for at, parameter, paint, marker in (
            (row - 0.15, before[name], svg.COLOURS["muted"], "o"),
            (row + 0.15, after[name], _colour(name), "D"),
        ):
            low, high = (min(v / nominal, _MAX_RATIO) for v in parameter.eti95)
            mean = min(parameter.mean / nominal, _MAX_RATIO)
            axes.plot([low, high], [at, at], color=paint, linewidth=4.0, solid_capstyle="butt")
            axes.plot(mean, at, marker, color=paint, markersize=5.5)
            ends += [low, high]
    axes.plot([], [], "o-", color=svg.COLOURS["muted"], linewidth=3.0, label="before")
    axes.plot([], [], "D-", color=svg.COLOURS["ink"], linewidth=3.0, label="after")
    axes.axvline(
        1.0, color=svg.COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0, label="nominal"
    )
    margin = 0.06 * (max(ends) - min(ends))
    svg.label_rows(figure, axes, [LABELS[name] for name, _ in rows])
    axes.set(ylim=(len(rows) - 0.45, -0.55), xlabel="of nominal")
    axes.set_xlim(min(ends) - margin, max(ends) + margin)
    axes.xaxis.set_major_formatter(lambda value, _: percent(value))
    return (svg.panel(figure, "moved", "parameters before and after, over nominal", wide=True),)
