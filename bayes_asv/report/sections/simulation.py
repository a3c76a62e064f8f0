"""Measured and simulated motion: fit, curves against time, residuals, sensor noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Fit, Noise, OutputCurves, Run
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table, Text
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

__all__ = ["MAX_RUNS", "SECTION", "motion_window"]

MAX_RUNS: Final = 6
"""Runs that get figures of their own: more would make a page too large to open."""

_COLOURED: Final = 0.01  # whiteness p-value below which the intervals are called too narrow
_MOVING: Final = 0.05  # of the largest wheel acceleration: the motion is above it
_BEFORE, _AFTER = 0.1, 0.4  # s shown around the motion

_SIGNS: Final = (
    "Signs: up is positive for accelerations, extension is positive for travel, and compression is "
    "a negative damper velocity."
)
_MOTION: Final = (
    "The lower strip is the residual: it should stay inside the band, where 95 % of the readings "
    "are predicted to be, and show no pattern."
)
_WHEELS: Final = (
    "Flat tops, spikes and steps are faults of a sensor and not of the road. All else is computed "
    "from these curves."
)
_SPECTRUM: Final = (
    "A peak of the residual is a motion that the model does not describe, such as an engine or "
    "a loose mount. Without peaks the residual is sensor noise, with that of the wheel sensors "
    "rising towards low frequencies."
)
_WHITENESS: Final = (
    "About one bar in twenty may be outside the band. A pattern, or a p-value below 1 %, means "
    "that the intervals are too narrow."
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
    runs, several = document.runs, len(document.runs) > 1
    if runs:
        yield Text("Measurement and simulation", [_SIGNS])
    if document.fit_by_run:
        yield _fit_table(document)
    for n, run in enumerate(runs[:MAX_RUNS]):
        of = f", {plain(run.source)}" if several else ""
        motion = "Measured and simulated motion" if run.outputs else "Chassis acceleration"
        yield Figure(f"chassis-{n}", f"{motion}{of}", _MOTION, _motion(run, n))
        yield Figure(f"wheels-{n}", f"Wheel acceleration{of}", _WHEELS, _wheels(run, n))
    for n, run in enumerate(runs[:MAX_RUNS]):
        of = f", {plain(run.source)}" if several else ""
        yield Figure(
            f"spectrum-{n}", f"Spectrum of reading and residual{of}", _SPECTRUM, _spectra(run, n)
        )
        yield Figure(
            f"whiteness-{n}", f"Autocorrelation of the innovations{of}", _WHITENESS,
            _whiteness(run, n),
        )  # fmt: skip
    if len(runs) > MAX_RUNS:
        further = len(runs) - MAX_RUNS
        yield Text("", [f"Figures of {further} further recordings are left out; tables have all."])
    if any(noise.entries for noise in document.noise):
        yield _noise_table(document.noise)


def _limits(document: EstimateDocument) -> list[str]:
    return [
        f"The {output.label.removesuffix(' chassis')} residuals of {plain(run.source)} are not "
        f"white ({p_value(p)}): something moves that the model does not describe, and the "
        "intervals are too narrow."
        for run in document.runs
        for output in _outputs(run)
        if (p := output.curves.whiteness_p) is not None and p < _COLOURED
    ]


SECTION: Final = Section(_content, _limits)


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


def motion_window(run: Run) -> tuple[float, float]:
    """First and last time that figures show: the motion of the wheels with a margin."""
    time = svg.curve_array(run.wheels.time)
    moving = np.zeros(len(time), dtype=bool)
    for curve in run.wheels.entries.values():
        size = np.abs(svg.curve_array(curve))
        if np.isfinite(size).any():
            moving |= size > _MOVING * np.nanmax(size)
    if not moving.any():
        return float(time[0]), float(time[-1])
    first, last = time[moving][[0, -1]]
    return max(float(first) - _BEFORE, float(time[0])), min(float(last) + _AFTER, float(time[-1]))


def _motion(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw each output as measured and simulated, with the residual below."""
    time, window = svg.curve_array(run.time), motion_window(run)
    panels = []
    for output in _outputs(run):
        curves, paint, ink = output.curves, output.colour, svg.COLOURS["ink"]
        measured, simulated = svg.curve_array(curves.measured), svg.curve_array(curves.simulated)
        low, high = (svg.curve_array(side) for side in curves.band95)
        figure = svg.canvas(height=3.1)
        top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
        # Thick and pale below thin and strong: both are visible where they coincide.
        top.plot(time, measured, color=ink, alpha=0.3, linewidth=4.0, label="measured")
        top.fill_between(time, low, high, color=paint, alpha=0.25, linewidth=0)
        top.plot(time, simulated, color=paint, label="simulated, 95 % band")
        alike = run.chassis.values() if output.name in run.chassis else [curves]
        top.set_ylim(*svg.shared_limits([c.measured for c in alike]))
        top.set_ylabel(f"{output.label} [{output.unit}]\n{output.sign}")
        svg.legend_above(top, 2)
        below.fill_between(
            time, low - simulated, high - simulated, color=paint, alpha=0.25, linewidth=0
        )
        below.plot(time, measured - simulated, color=ink, linewidth=0.7)
        below.axhline(0.0, color=paint, linewidth=0.8)
        below.set_ylabel("measured\n− simul.")
        below.set_xlabel("time [s]")
        below.set_xlim(*window)
        figure.align_ylabels([top, below])
        alt = f"{output.label} against time, measured and simulated"
        panels.append(svg.panel(figure, f"chassis-{output.key}-{n}", alt))
    return tuple(panels)


def _wheels(run: Run, n: int) -> tuple[svg.Panel, ...]:
    unit, window, time = (
        readable_unit(run.unit),
        motion_window(run),
        svg.curve_array(run.wheels.time),
    )
    curves = {name.removesuffix("_wheel"): curve for name, curve in run.wheels.entries.items()}
    limits = svg.shared_limits([*curves.values()])

    def draw(axes: Axes, place: str) -> str:
        curve, words = svg.curve_array(curves[place]), place.replace("_", " ")
        axes.plot(time, curve, color=svg.axle_colour(place), linewidth=0.9)
        axes.set(xlabel="time [s]", ylabel=f"{words} wheel [{unit}]\nup +", xlim=window)
        axes.set_ylim(*limits)
        return f"{words} wheel acceleration against time"

    return svg.axle_panels(f"wheel-{{}}-{n}", draw, 2.1, curves)


def _spectra(run: Run, n: int) -> tuple[svg.Panel, ...]:
    panels = []
    for output in _outputs(run):
        spectrum = output.curves.spectrum
        if spectrum is None:
            continue
        figure = svg.canvas(height=2.5)
        axes = figure.subplots()
        spectra = [
            ("reading", svg.COLOURS["ink"], spectrum.measured),
            ("residual", output.colour, spectrum.residual),
        ]
        if svg.draw_spectra(axes, spectrum.frequency, spectra):
            unit = readable_unit(spectrum.unit)
            axes.set_ylabel(f"{output.label}, spectral\ndensity [{unit}]")
            alt = f"{output.label}: spectrum of the reading and of the residual"
            panels.append(svg.panel(figure, f"spectrum-{output.key}-{n}", alt))
    return tuple(panels)


def _whiteness(run: Run, n: int) -> tuple[svg.Panel, ...]:
    panels = []
    for output in _outputs(run):
        curves, name = output.curves, output.label.removesuffix(" chassis")
        values = [v or 0.0 for v in curves.autocorrelation[1:]]
        if not values:
            continue
        figure = svg.canvas(height=2.2)
        axes = figure.subplots()
        band = curves.autocorrelation_band95
        svg.draw_autocorrelation(axes, values, band, curves.lag_seconds, name, output.colour)
        axes.set_xticks(range(5, len(values) + 1, 5))
        p = probability(curves.whiteness_p)
        axes.set_title(f"{name}: whiteness p-value {p}", loc="left")
        alt = f"{name} innovations: autocorrelation, whiteness p-value {p}"
        panels.append(svg.panel(figure, f"whiteness-{output.key}-{n}", alt))
    return tuple(panels)


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
