"""Measured and simulated motion: fit, curves against time, residuals, sensor noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Fit, Noise, Run
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
_CHASSIS: Final = (
    "The lower strip is the residual: it should stay inside the band, where 95 % of the readings "
    "are predicted to be, and show no pattern."
)
_WHEELS: Final = (
    "Flat tops, spikes and steps are faults of a sensor and not of the road. All else is computed "
    "from these two curves."
)
_SPECTRUM: Final = (
    "A peak of the residual is a motion that the half car does not describe, such as an engine or "
    "a loose mount. Without peaks the residual is sensor noise, with that of the wheel sensors "
    "rising towards low frequencies."
)
_WHITENESS: Final = (
    "About one bar in twenty may be outside the band. A pattern, or a p-value below 1 %, means "
    "that the intervals are too narrow."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    runs, several = document.runs, len(document.runs) > 1
    if runs:
        yield Text("Measurement and simulation", [_SIGNS])
    if document.fit_by_run:
        yield _fit_table(document)
    for n, run in enumerate(runs[:MAX_RUNS]):
        of = f", {plain(run.source)}" if several else ""
        yield Figure(f"chassis-{n}", f"Chassis acceleration{of}", _CHASSIS, _chassis(run, n))
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
    if any(getattr(noise, channel) for noise in document.noise for channel in CHANNELS):
        yield _noise_table(document.noise)


def _limits(document: EstimateDocument) -> list[str]:
    return [
        f"The {axle} residuals of {plain(run.source)} are not white ({p_value(p)}): something "
        "moves that the half car does not describe, and the intervals are too narrow."
        for run in document.runs
        for axle in svg.AXLES
        if f"{axle}_chassis" in run.chassis
        if (p := run.chassis[f"{axle}_chassis"].whiteness_p) is not None and p < _COLOURED
    ]


SECTION: Final = Section(_content, _limits)


def _fit_table(document: EstimateDocument) -> Table:
    """Normalised rms error of the simulation, by recording."""
    entries = [(plain(fits.source), fits) for fits in document.fit_by_run]
    if len(entries) > 1:
        entries.append(("All together", document.fit))
    rows = [
        [source, _fit_text(fits.front_chassis), _fit_text(fits.rear_chassis)]
        for source, fits in entries
    ]
    return Table(
        "Fit of the simulation",
        ["recording", "front chassis, rms error", "rear chassis, rms error"],
        rows,
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
    for curve in (run.wheels.front_wheel, run.wheels.rear_wheel):
        size = np.abs(svg.curve_array(curve))
        if np.isfinite(size).any():
            moving |= size > _MOVING * np.nanmax(size)
    if not moving.any():
        return float(time[0]), float(time[-1])
    first, last = time[moving][[0, -1]]
    return max(float(first) - _BEFORE, float(time[0])), min(float(last) + _AFTER, float(time[-1]))


def _chassis(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw measured and simulated acceleration, with the residual below."""
    time, unit, window = svg.curve_array(run.time), readable_unit(run.unit), motion_window(run)
    panels = []
    for axle in svg.AXLES:
        curves = run.chassis.get(f"{axle}_chassis")
        if curves is None:
            continue
        measured, simulated = svg.curve_array(curves.measured), svg.curve_array(curves.simulated)
        low, high = (svg.curve_array(side) for side in curves.band95)
        figure = svg.canvas(height=3.1)
        top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
        paint = svg.COLOURS[axle]
        # Thick and pale below thin and strong: both are visible where they coincide.
        top.plot(
            time, measured, color=svg.COLOURS["ink"], alpha=0.3, linewidth=4.0, label="measured"
        )
        top.fill_between(time, low, high, color=paint, alpha=0.25, linewidth=0)
        top.plot(time, simulated, color=paint, label="simulated, 95 % band")
        top.set_ylim(*svg.shared_limits([c.measured for c in run.chassis.values()]))
        top.set_ylabel(f"{axle} chassis [{unit}]\nup +")
        svg.legend_above(top, 2)
        below.fill_between(
            time, low - simulated, high - simulated, color=paint, alpha=0.25, linewidth=0
        )
        below.plot(time, measured - simulated, color=svg.COLOURS["ink"], linewidth=0.7)
        below.axhline(0.0, color=paint, linewidth=0.8)
        below.set_ylabel("measured\n− simul.")
        below.set_xlabel("time [s]")
        below.set_xlim(*window)
        figure.align_ylabels([top, below])
        alt = f"{axle} chassis acceleration against time, measured and simulated"
        panels.append(svg.panel(figure, f"chassis-{axle}-{n}", alt))
    return tuple(panels)


def _wheels(run: Run, n: int) -> tuple[svg.Panel, ...]:
    unit, window, time = (
        readable_unit(run.unit),
        motion_window(run),
        svg.curve_array(run.wheels.time),
    )
    curves = {"front": run.wheels.front_wheel, "rear": run.wheels.rear_wheel}
    limits = svg.shared_limits([*curves.values()])

    def draw(axes: Axes, axle: str) -> str:
        axes.plot(time, svg.curve_array(curves[axle]), color=svg.COLOURS[axle], linewidth=0.9)
        axes.set(xlabel="time [s]", ylabel=f"{axle} wheel [{unit}]\nup +", xlim=window)
        axes.set_ylim(*limits)
        return f"{axle} wheel acceleration against time"

    return svg.axle_panels(f"wheel-{{}}-{n}", draw, 2.1)


def _spectra(run: Run, n: int) -> tuple[svg.Panel, ...]:
    def draw(axes: Axes, axle: str) -> str | None:
        curves = run.chassis.get(f"{axle}_chassis")
        if curves is None or curves.spectrum is None:
            return None
        spectrum = curves.spectrum
        spectra = [("reading", "ink", spectrum.measured), ("residual", axle, spectrum.residual)]
        if not svg.draw_spectra(axes, spectrum.frequency, spectra):
            return None
        unit = readable_unit(spectrum.unit)
        axes.set_ylabel(f"{axle} chassis, spectral\ndensity [{unit}]")
        return f"{axle} chassis: spectrum of the reading and of the residual"

    return svg.axle_panels(f"spectrum-{{}}-{n}", draw, 2.5)


def _whiteness(run: Run, n: int) -> tuple[svg.Panel, ...]:
    def draw(axes: Axes, axle: str) -> str | None:
        curves = run.chassis.get(f"{axle}_chassis")
        values = [] if curves is None else [v or 0.0 for v in curves.autocorrelation[1:]]
        if curves is None or not values:
            return None
        svg.draw_autocorrelation(
            axes, values, curves.autocorrelation_band95, curves.lag_seconds, axle
        )
        axes.set_xticks(range(5, len(values) + 1, 5))
        p = probability(curves.whiteness_p)
        axes.set_title(f"{axle}: whiteness p-value {p}", loc="left")
        return f"{axle} innovations: autocorrelation, whiteness p-value {p}"

    return svg.axle_panels(f"whiteness-{{}}-{n}", draw, 2.2)


def _noise_table(entries: Sequence[Noise]) -> Table:
    """Noise of each sensor as estimated, and as declared in the vehicle file."""
    rows, unit = [], ""
    for entry in entries:
        unit = readable_unit(entry.unit)
        for channel in CHANNELS:
            level = getattr(entry, channel)
            if level is None:
                continue
            label = capitalized(channel.replace("_", " "))
            label += f", {plain(entry.source)}" if len(entries) > 1 else ""
            given = "not declared" if level.given is None else number(level.given)
            rows.append([label, plus_minus(level), given])
    return Table(
        "Sensor noise",
        ["sensor", f"estimated, rms [{unit}]", "declared"],
        rows,
        "A level far above the declared one means a loose mount, or a motion that the half car "
        "does not describe.",
    )
