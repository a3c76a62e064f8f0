"""Where simulation and measurement disagree: state, time and frequency."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv.domain.channels import channel
from bayes_asv.report import svg
from bayes_asv.report.schema import DiagnoseDocument
from bayes_asv.report.schema.diagnose import Cell, Disagreement, Residual
from bayes_asv.report.sections.blocks import Block, Figure, Section
from bayes_asv.report.sections.effects import car_words
from bayes_asv.report.words import enumerated, plain, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SECTION", "residual_overview", "where_to_look"]

_MAX_RUNS: Final = 3  # runs whose residuals are drawn
_POSITIVE: Final = {
    "acceleration": "up", "deflection": "extension", "pitch": "nose up", "roll": "left up",
}  # fmt: skip
_FULL_COLOUR: Final = 12.0  # t-value of a cell in full colour

_FORCE: Final = (
    "Mean force that the linear {car} lacks in each cell, upward on the chassis, with its "
    "t-value in brackets. A column of one colour points to travel (spring, stop), a row to "
    "velocity (damper, friction). A frame marks the strongest cell, if it is significant."
)
_RESIDUAL: Final = (
    "In the shaded windows and bands the linear {car} leaves more than chance. Low frequencies are "
    "motion of the body, high ones of wheels, engine or sensors."
)


def _content(document: DiagnoseDocument) -> Iterator[Block]:
    seen, car = document.disagreement or Disagreement(), car_words(document)
    yield Figure(
        "plane", f"Missing force of the linear {car}", _FORCE.format(car=car),
        _missing_force(document),
    )  # fmt: skip
    for n, run in enumerate(document.residuals[:_MAX_RUNS]):
        of = f", {plain(run.source)}" if len(document.residuals) > 1 else ""
        yield Figure(
            f"left-{n}", f"Residuals before and after{of}",
            _RESIDUAL.format(car=car),
            (*_residuals(run, seen, n), *_residual_spectra(run, seen, n)), 3,
        )  # fmt: skip


SECTION: Final = Section(_content, title="Where simulation and measurement disagree")


def where_to_look(document: DiagnoseDocument) -> str:
    """Say where and when an unexplained disagreement shows, and what usually causes one."""
    seen = document.disagreement or Disagreement()
    text = "Look for the unlisted cause"
    if seen.channel:
        text += f", first near the {plain(seen.channel).replace('_', ' ')} sensor"
    parts = []
    if seen.frequency:
        low, high = min(band[0] for band in seen.frequency), max(b[1] for b in seen.frequency)
        parts.append(f"between {low:.2g} and {high:.2g} Hz")
    if seen.time:
        begin, end = seen.time[0]
        source = f" of {plain(seen.time_run[0])}" if seen.time_run and seen.time_run[0] else ""
        parts.append(f"from {begin:.2f} to {end:.2f} s{source}")
    if parts:
        text += f"; it shows {' and '.join(parts)}"
    if document.unnamed:
        likes = enumerated([plain(cause.like) for cause in document.unnamed], "or")
        return f"{text}. It acts as {likes} would."
    return (
        f"{text}. Common causes are a loose mount, a seat, a panel, tyres off the ground, and roll."
    )


def _missing_force(document: DiagnoseDocument) -> tuple[svg.Panel, ...]:
    """Draw the missing force over the deflection–velocity plane."""
    from matplotlib.patches import Rectangle

    seen = document.disagreement or Disagreement()

    def draw(axes: Axes, axle: str) -> str | None:
        cells = (document.map or {}).get(axle)
        if not cells:
            return None
        for cell in cells:
            (left, right), (low, high) = cell.deflection, cell.velocity
            box = (left, low), right - left, high - low
            colour = svg.COLOURS["above" if cell.force > 0.0 else "prior"]
            strength = min(abs(cell.t) / _FULL_COLOUR, 1.0)
            edge: dict[str, Any] = {"edgecolor": svg.COLOURS["grid"], "linewidth": 0.6}
            axes.add_patch(Rectangle(*box, facecolor=colour, alpha=0.75 * strength, **edge))
            axes.add_patch(Rectangle(*box, fill=False, **edge))
            axes.text(
                0.5 * (left + right), 0.5 * (low + high),
                f"{_signed(cell.force)}\n({_signed(cell.t)})",
                ha="center", va="center", fontsize=7.5, color=svg.COLOURS["ink"], linespacing=1.15,
            )  # fmt: skip
            if seen.axle == axle and _same_cell(cell, seen.state):
                frame: dict[str, Any] = {"edgecolor": svg.COLOURS["ink"], "linewidth": 1.6}
                axes.add_patch(Rectangle(*box, fill=False, zorder=3, **frame))
        length, velocity, force = (readable_unit(unit) for unit in cells[0].units)
        axes.set(
            xlim=_limits([c.deflection for c in cells]), ylim=_limits([c.velocity for c in cells]),
            xlabel=f"{axle} deflection [{length}], extension +",
            ylabel=f"velocity [{velocity}], extension +",
        )  # fmt: skip
        axes.set_title(f"missing force [{force}], up + (t-value)", loc="left")
        axes.grid(visible=False)
        return f"{axle}: mean missing force by deflection and velocity"

    return svg.axle_panels("plane-{}", draw, 2.4)


def _same_cell(cell: Cell, other: Cell | None) -> bool:
    return other is not None and bool(
        np.allclose(cell.deflection, other.deflection)
        and np.allclose(cell.velocity, other.velocity)
    )


def _limits(intervals: Sequence[Sequence[float]]) -> tuple[float, float]:
    return min(low for low, _ in intervals), max(high for _, high in intervals)


def _signed(value: float) -> str:
    text = f"{value:+.0f}" if abs(value) >= 99.5 else f"{value:+.2g}"
    if "e" in text:
        text = f"{value:+.0f}"
    return text.replace("-", "−")


def _residuals(run: Residual, seen: Disagreement, n: int | None) -> tuple[svg.Panel, ...]:
    """Draw the residuals of a run against time, before and after.

    `n` is the number of the run; on the first page, where panels are wider, it is None.
    """
    time = svg.curve_array(run.time)
    spans = zip(seen.time, seen.time_run, strict=False)
    windows = [window for window, source in spans if source == run.source]

    def draw(axes: Axes, name: str) -> str | None:
        curve = run.entries[name]
        if curve is None or all(v is None for v in curve.before):
            return None
        before, after = svg.curve_array(curve.before), svg.curve_array(curve.after)
        _shade(axes, windows)
        axes.plot(time, before, color=svg.COLOURS["muted"], linewidth=0.9, label="before")
        axes.plot(time, after, color=_colour(name), linewidth=0.8, label="after")
        axes.axhline(0.0, color=svg.COLOURS["ink"], linewidth=0.6)
        unit, measured = readable_unit(curve.unit or run.unit), channel(name)
        sign = _POSITIVE[measured.axis or measured.quantity]
        label = f"{_place(name)}: measured − simul.\n[{unit}], {sign} +"
        axes.set(xlabel="time [s]", ylabel=label)
        axes.set_xlim(float(time[0]), float(time[-1]))
        svg.legend_above(axes)
        return f"{plain(run.source)}, {_place(name)}: residuals against time, before and after"

    if n is None:
        return _output_panels("overview-{}", draw, run, (svg.WIDTH, 1.9))
    return _output_panels(f"left-{{}}-{n}", draw, run, svg.SMALL)


def residual_overview(document: DiagnoseDocument) -> Figure:
    """Residuals of the first run, before and after the effects, for the first page."""
    run = document.residuals[0] if document.residuals else None
    return Figure(
        "overview",
        "" if run is None else f"Measured less simulated motion, {plain(run.source)}",
        "Before: the linear car. After: with all that was added to it. A model that holds leaves "
        "sensor noise alone, without a pattern.",
        () if run is None else _residuals(run, document.disagreement or Disagreement(), None),
    )


def _residual_spectra(run: Residual, seen: Disagreement, n: int) -> tuple[svg.Panel, ...]:
    """Draw the spectra of the residuals of a run, before and after, one panel a unit."""
    spectrum = run.spectrum
    by_unit: dict[str, list[str]] = {}
    for name, curve in spectrum.entries.items():
        if curve is not None:
            by_unit.setdefault(curve.unit or spectrum.unit, []).append(name)
    panels = []
    for unit, names in by_unit.items():
        figure = svg.canvas(*svg.SMALL)
        axes = figure.subplots()
        _shade(axes, seen.frequency)
        drawn = []
        for k, name in enumerate(names):
            curve = spectrum.entries[name]
            assert curve is not None
            muted: svg.Look = {"color": svg.COLOURS["muted"], "linestyle": ("-", "--", ":")[k % 3]}
            after: svg.Look = {"color": _colour(name), "linestyle": muted["linestyle"]}
            curves = [
                (f"{_place(name)}, before", muted, curve.before),
                ("after", after, curve.after),
            ]
            if svg.draw_spectra(axes, spectrum.frequency, curves):
                drawn.append(_place(name))
        if not drawn:
            continue
        svg.label_spectra(axes)
        axes.set_ylabel(f"spectral density\n[{readable_unit(unit)}]")
        axes.set_xlim(*svg.curve_array(spectrum.frequency)[[0, -1]].tolist())
        svg.legend_above(axes, 2)
        words = f"{plain(run.source)}: spectrum of the residuals, before and after"
        key = f"leftband-{drawn[0].replace(' ', '-')}-{n}"
        panels.append(svg.panel(figure, key, f"{words}, {', '.join(drawn)}"))
    return tuple(panels)


def _output_panels(
    key: str, draw: Callable[[Axes, str], str | None], run: Residual, size: tuple[float, float]
) -> tuple[svg.Panel, ...]:
    """Draw one panel an output."""
    panels = []
    for name in run.entries:
        figure = svg.canvas(*size)
        alt = draw(figure.subplots(), name)
        if alt is not None:
            panels.append(svg.panel(figure, key.format(_place(name).replace(" ", "-")), alt))
    return tuple(panels)


def _colour(name: str) -> str:
    """Colour of an output's axle, or of the body as a whole."""
    return svg.COLOURS["good"] if channel(name).axle is None else svg.axle_colour(name)


def _place(name: str) -> str:
    """Name an output in words; a chassis channel by its place alone."""
    return name.removesuffix("_chassis").replace("_", " ")


def _shade(axes: Any, intervals: Sequence[Sequence[float]]) -> None:
    for k, (begin, end) in enumerate(intervals):
        label = "disagreement" if k == 0 else None
        axes.axvspan(begin, end, color=svg.COLOURS["below"], alpha=0.1, linewidth=0, label=label)
