"""Force of each damper over velocity, with its band, beside the nominal one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.words import readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_force_curve", "force_panel", "label_sides"]


def force_panel(document: EstimateDocument, place: str) -> svg.Panel | None:
    """Draw the force of the damper of one suspension element; None where it is not known."""
    force, paint, words = (
        document.forces.get(place),
        svg.axle_colour(place),
        place.replace("_", " "),
    )
    if force is None:
        return None
    figure = svg.canvas(*svg.SMALL)
    axes: Axes = figure.subplots()
    nominal = None if document.doubt else force.nominal
    draw_force_curve(axes, force.velocity, force.median, force.band95, nominal, paint)
    label_sides(axes, "compression", "rebound")
    axes.set(
        xlabel=f"{words} damper velocity [{readable_unit(force.unit)}]",
        ylabel=f"force [{readable_unit(force.force_unit)}]",
    )
    svg.legend_above(axes)
    alt = f"{words} damper: force over velocity with its 95 % band, and the nominal force"
    return svg.panel(figure, f"force-{place.replace('_', '-')}", alt)


def draw_force_curve(
    axes: Axes,
    at: Sequence[float | None],
    median: Sequence[float | None],
    band95: Sequence[Sequence[float | None]],
    nominal: Sequence[float | None] | None,
    paint: str,
) -> None:
    """Draw a force with its 95 % band through both axes, beside the nominal one if it is known."""
    grid, muted = svg.curve_array(at), svg.COLOURS["muted"]
    low, high = (svg.curve_array(side) for side in band95)
    axes.axhline(0.0, color=muted, linewidth=0.8)
    axes.axvline(0.0, color=muted, linewidth=0.8)
    axes.fill_between(grid, low, high, color=paint, alpha=0.3, linewidth=0)
    axes.plot(grid, svg.curve_array(median), color=paint, label="estimated")
    if nominal is not None:
        axes.plot(
            grid, svg.curve_array(nominal), color=svg.COLOURS["ink"], linestyle=(0, (5, 3)),
            linewidth=1.0, label="nominal",
        )  # fmt: skip


def label_sides(axes: Axes, left: str, right: str) -> None:
    """Name the sides of a force curve, which rises from the lower left to the upper right."""
    muted = svg.COLOURS["muted"]
    for x, y, align, words in (
        (0.02, 0.93, "left", f"← {left}"), (0.98, 0.03, "right", f"{right} →"),
    ):  # fmt: skip
        axes.text(x, y, words, transform=axes.transAxes, ha=align, fontsize=8.5, color=muted)
