"""Measured and simulated motion: fit, curves against time, residuals, sensor noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Fit, Noise, OutputCurves, Run
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table, Text
from bayes_asv.report.sections.travel import motion_window, travel_curve
from bayes_asv.report.words import (
    MISSING,
    capitalized,
    number,
    p_value,
    plain,
    plus_minus,
    probability,
    readable_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SECTION", "overview"]

Array = NDArray[np.float64]

MAX_RUNS: Final = 6
"""Runs that get figures of their own: more would make a page too large to open."""

_COLOURED: Final = (
    0.01  # whiteness p-value below which something moves that the model does not describe
)

_CAPTION: Final = (
    "Accelerations are positive upward, travel in extension. The residual, in the lower strip, "
    "should stay inside the band, where 95 % of the readings are predicted to be, and show no "
    "pattern. Flat tops, spikes and steps of a wheel acceleration are faults of its sensor. A peak "
    "in the spectrum of the residual (thick, below that of the reading) is a motion that the model "
    "does not describe. Of the bars of the autocorrelation, one in twenty may be outside the band; "
    "a p-value below 1 % means that something moves that the model does not describe."
)


class _Output(NamedTuple):
    """One output of a run."""

    name: str
    curves: OutputCurves
    unit: str

    @property
    def label(self) -> str:
        return self.name.replace("_", " ")

    @property
    def place(self) -> str:
        """The label of a chassis acceleration without what it is."""
        return self.label.removesuffix(" chassis")

    @property
    def key(self) -> str:
        return self.name.removesuffix("_chassis").replace("_", "-")

    @property
    def colour(self) -> str:
        return svg.axle_colour(self.name)

    @property
    def sign(self) -> str:
        """Direction of positive values."""
        if self.name.endswith("travel"):
            return "extension +"
        if self.name.endswith("rate"):
            return "nose-up +" if "pitch" in self.name else "left side up +"
        return "up +"


def _outputs(run: Run) -> list[_Output]:
    curves = {**run.chassis, **run.outputs}
    return [_Output(n, c, readable_unit(c.unit or run.unit)) for n, c in curves.items()]


def _content(document: EstimateDocument) -> Iterator[Block]:
    runs = document.runs
    for n, run in enumerate(runs[:MAX_RUNS]):
        of = f", {plain(run.source)}" if len(runs) > 1 else ""
        panels = (
            *_motion(run, n), *_wheels(run, n), *_spectra(run, n), *_whiteness(run, n),
            *travel_curve(run, n),
        )  # fmt: skip
        caption = _CAPTION if n == 0 else ""
        yield Figure(f"run-{n}", f"Motion and residuals{of}", caption, panels, 3)
    if len(runs) > MAX_RUNS:
        further = len(runs) - MAX_RUNS
        yield Text("", [f"Figures of {further} further recordings are left out; tables have all."])
    if document.fit_by_run:
        yield _fit_table(document)
    if any(noise.entries for noise in document.noise):
        yield _noise_table(document.noise)


def overview(document: EstimateDocument) -> Figure:
    """Measured and simulated motion of the run that is explained worst, for the first page."""
    runs = document.runs
    if not runs:
        return Figure("overview", "", "", ())
    run = max(runs, key=_misfit)
    chosen = "" if len(runs) == 1 else f"Of {len(runs)} recordings, that with the largest error. "
    return Figure(
        "overview", f"Measured and simulated motion, {plain(run.source)}",
        f"{chosen}The band should hold 95 % of the readings.", motion_panels(run),
    )  # fmt: skip


def _misfit(run: Run) -> float:
    """Largest rms residual of an output of a run over the rms of its motion."""
    ratios = [0.0]
    for curves in (*run.chassis.values(), *run.outputs.values()):
        measured, simulated = svg.curve_array(curves.measured), svg.curve_array(curves.simulated)
        there = np.isfinite(measured) & np.isfinite(simulated)
        if there.any() and measured[there].std() > 0.0:
            left = measured[there] - simulated[there]
            ratios.append(float(np.sqrt(np.mean(left**2)) / measured[there].std()))
    return max(ratios)


def motion_panels(
    run: Run, key: str = "overview", scaled: Sequence[Run] = ()
) -> tuple[svg.Panel, ...]:
    """Draw each output as measured and simulated.

    Parameters
    ----------
    run : Run
        The recording.
    key : str
        With which the keys of the pictures begin.
    scaled : sequence of Run
        Recordings whose pictures have one scale.
    """
    panels = []
    for output in _outputs(run):
        figure = svg.canvas(height=1.9)
        axes = figure.subplots()
        _draw_motion(axes, svg.curve_array(run.time), output)
        axes.set(
            xlabel="time [s]", ylabel=f"{output.label}\n[{output.unit}], {output.sign}",
            xlim=motion_window(run),
        )  # fmt: skip
        alike = [one.curves for other in scaled for one in _outputs(other) if one.key == output.key]
        if alike:
            axes.set_ylim(*svg.shared_limits([curves.measured for curves in alike]))
        svg.legend_above(axes)
        alt = f"{output.label} against time, measured and simulated with a 95 % band"
        panels.append(svg.panel(figure, f"{key}-{output.key}", alt))
    return tuple(panels)


def _draw_motion(axes: Axes, time: Array, output: _Output) -> None:
    """Draw an output as measured and simulated, with its band."""
    curves, paint = output.curves, output.colour
    low, high = (svg.curve_array(side) for side in curves.band95)
    # Thick and pale below thin and strong: both are visible where they coincide.
    axes.plot(
        time, svg.curve_array(curves.measured), color=svg.COLOURS["ink"], alpha=0.3,
        linewidth=4.0, label="measured",
    )  # fmt: skip
    axes.fill_between(time, low, high, color=paint, alpha=0.25, linewidth=0, label="95 % band")
    axes.plot(time, svg.curve_array(curves.simulated), color=paint, label="simulated")


def _limits(document: EstimateDocument) -> list[str]:
    return [
        f"The {output.label.removesuffix(' chassis')} residuals of {plain(run.source)} are not "
        f"white ({p_value(p)}): something moves that the model does not describe."
        for run in document.runs
        for output in _outputs(run)
        if (p := output.curves.whiteness_p) is not None and p < _COLOURED
    ]


SECTION: Final = Section(
    _content, _limits, about="model", title="Measurement, simulation and residuals"
)


def _fit_table(document: EstimateDocument) -> Table:
    """Normalised rms error of the simulation, by recording."""
    entries = [(plain(fits.source), fits) for fits in document.fit_by_run]
    if len(entries) > 1:
        entries.append(("All together", document.fit))
    names = list(dict.fromkeys(name for _, fits in entries for name in fits.entries))
    return Table(
        "Fit of the simulation",
        ["recording", *(f"{plain(name.replace('_', ' '))}, rms error" for name in names)],
        [
            [source, *(_fit_text(fits.entries.get(name)) for name in names)]
            for source, fits in entries
        ],
        "The simulation is driven by the measured wheel accelerations. Its error is in percent of "
        "the measured motion (NRMSE); 0 % is a perfect fit.",
    )


def _fit_text(fit: Fit | None) -> str:
    if fit is None or fit.nrmse_percent is None:
        return MISSING
    return f"{number(fit.nrmse_percent, 0.1 * abs(fit.nrmse_percent) or None)} %"


def _motion(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw each output as measured and simulated, with the residual below."""
    time, window = svg.curve_array(run.time), motion_window(run)
    panels = []
    for output in _outputs(run):
        curves, paint, ink = output.curves, output.colour, svg.COLOURS["ink"]
        measured, simulated = svg.curve_array(curves.measured), svg.curve_array(curves.simulated)
        low, high = (svg.curve_array(side) for side in curves.band95)
        figure = svg.canvas(*svg.SMALL)
        top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
        _draw_motion(top, time, output)
        alike = run.chassis.values() if output.name in run.chassis else [curves]
        top.set_ylim(*svg.shared_limits([c.measured for c in alike]))
        top.set_ylabel(f"{output.label}\n[{output.unit}]")
        below.fill_between(
            time, low - simulated, high - simulated, color=paint, alpha=0.25, linewidth=0
        )
        below.plot(time, measured - simulated, color=ink, linewidth=0.7)
        below.axhline(0.0, color=paint, linewidth=0.8)
        below.set_ylabel("residual")
        below.set_xlabel("time [s]")
        below.set_xlim(*window)
        figure.align_ylabels([top, below])
        alt = f"{output.label} against time, measured and simulated"
        panels.append(svg.panel(figure, f"motion-{output.key}-{n}", alt))
    return tuple(panels)


def _wheels(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw the acceleration of every wheel in one panel."""
    curves = run.wheels.entries
    if not curves:
        return ()
    figure = svg.canvas(*svg.SMALL)
    axes = figure.subplots()
    for name, curve in curves.items():
        axes.plot(
            svg.curve_array(run.wheels.time), svg.curve_array(curve), linewidth=0.9,
            label=name.removesuffix("_wheel").replace("_", " "), **svg.place_style(name),
        )  # fmt: skip
    axes.set(
        xlabel="time [s]", ylabel=f"wheel acceleration\n[{readable_unit(run.unit)}], up +",
        xlim=motion_window(run), ylim=svg.shared_limits([*curves.values()]),
    )  # fmt: skip
    svg.legend_above(axes, 2)
    alt = ", ".join(f"{plain(name.replace('_', ' '))} acceleration against time" for name in curves)
    return (svg.panel(figure, f"wheels-{n}", alt),)


def _spectra(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw the spectra of reading and residual of the outputs, those of one unit in one panel."""
    by_unit: dict[str, list[_Output]] = {}
    for output in _outputs(run):
        if output.curves.spectrum is not None:
            by_unit.setdefault(output.curves.spectrum.unit, []).append(output)
    panels = []
    for unit, outputs in by_unit.items():
        figure = svg.canvas(*svg.SMALL)
        axes = figure.subplots()
        drawn = [output.label for output in outputs if _draw_spectrum(axes, output)]
        if not drawn:
            continue
        svg.label_spectra(axes)
        axes.set_ylabel(f"spectral density\n[{readable_unit(unit)}]")
        svg.legend_above(axes, 2)
        alt = f"spectrum of reading and residual: {', '.join(drawn)}"
        panels.append(svg.panel(figure, f"spectrum-{outputs[0].key}-{n}", alt))
    return tuple(panels)


def _draw_spectrum(axes: Axes, output: _Output) -> bool:
    """Draw reading (thin) and residual (thick); False where one has no positive value."""
    spectrum = output.curves.spectrum
    assert spectrum is not None
    look = svg.place_style(output.name)
    name = output.place
    return svg.draw_spectra(
        axes, spectrum.frequency,
        [
            (name, {**look, "linewidth": 0.8}, spectrum.measured),
            ("", {**look, "linewidth": 2.0}, spectrum.residual),
        ],
    )  # fmt: skip


def _whiteness(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw the autocorrelations of the innovations of all outputs in one panel, side by side."""
    outputs = [output for output in _outputs(run) if len(output.curves.autocorrelation) > 1]
    if not outputs:
        return ()
    figure = svg.canvas(*svg.SMALL)
    axes = figure.subplots()
    first = outputs[0].curves
    svg.draw_autocorrelations(
        axes,
        [
            (
                f"{output.place}, p {probability(output.curves.whiteness_p)}",
                output.name,
                [v or 0.0 for v in output.curves.autocorrelation[1:]],
            )
            for output in outputs
        ],
        first.autocorrelation_band95,
        first.lag_seconds,
    )
    p = ", ".join(
        f"{output.label} p-value {probability(output.curves.whiteness_p)}" for output in outputs
    )
    return (svg.panel(figure, f"whiteness-{n}", f"autocorrelation of the innovations: {p}"),)


def _noise_table(entries: Sequence[Noise]) -> Table:
    """Noise of each sensor as estimated, and as declared in the vehicle file."""
    rows, unit = [], readable_unit(entries[0].unit)
    for entry in entries:
        for channel, level in entry.entries.items():
            label = capitalized(channel.replace("_", " "))
            label += f" [{readable_unit(level.unit)}]" if level.unit else ""
            label += f", {plain(entry.source)}" if len(entries) > 1 else ""
            given = "not declared" if level.given is None else number(level.given)
            rows.append([label, plus_minus(level), given])
    return Table(
        "Sensor noise",
        ["sensor", f"estimated, rms [{unit}]", "declared"],
        rows,
        "A level far above the declared one means a loose mount, or a motion that the model "
        "does not describe.",
    )
