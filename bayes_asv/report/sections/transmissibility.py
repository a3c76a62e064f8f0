"""Transmissibility from each wheel to the chassis above it, measured and simulated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Run
from bayes_asv.report.sections.blocks import Block, Figure, Section
from bayes_asv.report.words import plain

__all__ = ["SECTION"]

_MAX_RUNS: Final = 3
_TICKS: Final = (1.0, 2.0, 5.0)  # of each decade

_CAPTION: Final = (
    "Amplitude of the chassis acceleration over that of the wheel below it, from the spectral "
    "densities of the recording (thick) and of its simulation (thin), where the wheel moved "
    "enough. Below one the suspension isolates; motion that comes from the other axle is in both "
    "curves."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    drawn = (_panel(run, n) for n, run in enumerate(document.runs[:_MAX_RUNS]))
    panels = tuple(panel for panel in drawn if panel is not None)
    yield Figure("transmissibility", "Transmissibility from wheel to chassis", _CAPTION, panels, 3)


SECTION: Final = Section(_content)


def _panel(run: Run, n: int) -> svg.Panel | None:
    from matplotlib.ticker import LogLocator

    curves = {
        name: output.transmissibility
        for name, output in run.chassis.items()
        if output.transmissibility is not None and len(output.transmissibility.frequency) > 1
    }
    if not curves:
        return None
    figure = svg.canvas(*svg.SMALL)
    axes = figure.subplots()
    for name, curve in curves.items():
        frequency, look = svg.curve_array(curve.frequency), svg.place_style(name)
        axes.loglog(frequency, svg.curve_array(curve.measured), **look, alpha=0.3, linewidth=4.0)
        place = name.removesuffix("_chassis").replace("_", " ")
        axes.loglog(frequency, svg.curve_array(curve.simulated), **look, label=place)
    axes.axhline(1.0, color=svg.COLOURS["muted"], linewidth=0.8)
    axes.set(xlabel=f"frequency [Hz], {plain(run.source)}", ylabel="chassis over wheel")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=_TICKS))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(lambda value, _: "")
    svg.legend_above(axes, 2)
    alt = f"{plain(run.source)}: transmissibility from each wheel to the chassis above it"
    return svg.panel(figure, f"transmissibility-{n}", alt)
