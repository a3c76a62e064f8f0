"""What no listed effect explains, as it was added to the model without a name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from bayes_asv.report import svg
from bayes_asv.report.schema import DiagnoseDocument
from bayes_asv.report.schema.diagnose import UnnamedCause
from bayes_asv.report.sections.blocks import Block, Figure, Section
from bayes_asv.report.words import capitalized, enumerated, percent, plain, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SECTION", "unnamed_cause_lines"]

_CAPTION: Final = (
    "What the model contains without a name: on the left against time, where it is largest; on the "
    "right against what it depends on. A line that closes to a loop lags or leads; one that bends "
    "is not proportional."
)


def _content(document: DiagnoseDocument) -> Iterator[Block]:
    panels = [
        panel
        for n, cause in enumerate(document.unnamed)
        for panel in (_over_time(cause, n), _over_motion(cause, n))
    ]
    yield Figure("unnamed", "What is left, in the model without a name", _CAPTION, tuple(panels))


SECTION: Final = Section(_content)


def unnamed_cause_lines(document: DiagnoseDocument) -> list[str]:
    """Say what is in the model without a name, and that the parameters are given with it."""
    causes = document.unnamed
    if not causes:
        return []
    several = len(causes) > 1
    like = enumerated(
        [
            f"{plain(cause.like)} ({percent(cause.share)})" if several else plain(cause.like)
            for cause in causes
        ]
    )
    lines = [
        f"What remains changes the recordings as {like} would. That is a description and no "
        "finding: it is in the model without a name, and damping rates and inertia are given with "
        "it."
    ]
    if document.dampers:
        lines.append(
            "A rate of equal power includes what remains at that axle; the slope of a damper and "
            "its force over speed do not."
        )
    return lines


def _over_time(cause: UnnamedCause, n: int) -> svg.Panel:
    figure = svg.canvas()
    axes: Axes = figure.subplots()
    axes.axhline(0.0, color=svg.COLOURS["muted"], linewidth=0.8)
    axes.plot(svg.curve_array(cause.time), svg.curve_array(cause.change), color=_paint(cause))
    axes.set(xlabel="time [s]", ylabel=_label(cause))
    axes.set_title(capitalized(plain(cause.like)), fontsize=9.5)
    alt = f"{plain(cause.like)}: {_label(cause)} against time in {plain(cause.source)}"
    return svg.panel(figure, f"unnamed-time-{n}", alt)


def _over_motion(cause: UnnamedCause, n: int) -> svg.Panel:
    figure = svg.canvas()
    axes: Axes = figure.subplots()
    for line in (axes.axhline, axes.axvline):
        line(0.0, color=svg.COLOURS["muted"], linewidth=0.8)
    axes.plot(
        svg.curve_array(cause.along), svg.curve_array(cause.change),
        color=_paint(cause), linewidth=0.8,
    )  # fmt: skip
    words = f"{plain(cause.along_words)} [{readable_unit(cause.along_unit)}]"
    axes.set(xlabel=words, ylabel=_label(cause))
    axes.set_title(" ", fontsize=9.5)
    alt = f"{plain(cause.like)}: {_label(cause)} against {words}"
    return svg.panel(figure, f"unnamed-along-{n}", alt)


def _label(cause: UnnamedCause) -> str:
    what = "change of the reading" if cause.along_words == "reading" else "force on the body"
    return f"{what} [{readable_unit(cause.unit)}]"


def _paint(cause: UnnamedCause) -> str:
    words = plain(cause.like)
    return svg.COLOURS["front" if "front" in words else "rear" if "rear" in words else "good"]
