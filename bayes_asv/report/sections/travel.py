"""Suspension travel and damper velocity: histograms, shares of time, stops that were reached."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Run, SpeedShare, TravelCurves
from bayes_asv.report.schema.parts import Curve, TravelLimits
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table
from bayes_asv.report.sections.damper_force import force_panel
from bayes_asv.report.words import (
    MISSING,
    capitalized,
    number,
    percent,
    plain,
    readable_unit,
    two_digits,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SECTION", "motion_window", "travel_curve", "velocity_shares"]

_MOVING: Final = 0.05  # of the largest wheel acceleration: the motion is above it
_BEFORE, _AFTER = 0.1, 0.4  # s shown around the motion

Array = NDArray[np.float64]

_AT_REST: Final = 0.02  # of the largest velocity: neither compression nor rebound
_REACHED: Final = 0.95  # share of a travel limit that counts as reached
_STOPS: Final = ((-1.0, "bump"), (1.0, "droop"))
_BINS: Final = 41
_RANGES: Final = ("compression high", "compression low", "rebound low", "rebound high")

_SUSPENSION: Final = (
    "Force: over the velocities driven, with its 95 % band; a force that resists extension is "
    "positive. Velocity: share of the time at each damper velocity (extension is positive) in all "
    "recordings, on a logarithmic scale. A damping rate is learnt only at the velocities that were "
    "driven, and those of compression (hatched) and rebound are averaged: look for unequal shares; "
    "pale bars are low speed. Travel: share of the time at each travel from rest; a stop that was "
    "reached biases the answer. All is at the wheel."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    runs, limits = document.runs, document.vehicle.travel or TravelLimits()
    if not runs:
        return
    places = dict.fromkeys(place for run in runs for place in run.travel.entries)
    panels = [
        panel
        for place in places
        for panel in (
            force_panel(document, place),
            _velocity_panel(runs, place),
            _travel_panel(runs, limits, place),
        )
        if panel is not None
    ]
    yield Figure("suspension", "Damper force, velocity and travel", _SUSPENSION, tuple(panels), 3)
    if any(curves.speed_shares for run in runs for curves in run.travel.entries.values()):
        yield _share_table(runs)
    yield _travel_table(runs, limits)


def _limits(document: EstimateDocument) -> list[str]:
    limits = document.vehicle.travel or TravelLimits()
    return [
        f"The {_words(place)} suspension reached its {stop} limit in {plain(run.source)}; the "
        "model has no stops, so drive over a lower bump or more slowly, or use another run."
        for run in document.runs
        for place, curves in run.travel.entries.items()
        for _, stop in _STOPS
        if (limit := _limit(limits, place, stop)) is not None
        and _largest(curves, stop) >= _REACHED * limit
    ]


SECTION: Final = Section(_content, _limits, about="model")


def _words(place: str) -> str:
    return plain(place.replace("_", " "))


def _limit(limits: TravelLimits, place: str, stop: str) -> float | None:
    """Travel to a stop of a suspension element, which is that of its axle."""
    value: float | None = getattr(limits, f"{place.partition('_')[0]}_{stop}", None)
    return value


def _largest(curves: TravelCurves, stop: str) -> float:
    return curves.largest_bump if stop == "bump" else curves.largest_droop


def _travel_table(runs: Sequence[Run], limits: TravelLimits) -> Table:
    """Extremes of travel and velocity, and the share of the limits that was used."""
    rows = []
    for run in runs:
        for place, curves in run.travel.entries.items():
            speeds = [v for v in curves.velocity if v is not None] or [0.0]
            of = f", {plain(run.source)}" if len(runs) > 1 else ""
            row = [f"{capitalized(_words(place))}{of}"]
            for sign, stop in _STOPS:
                most, limit = _largest(curves, stop), _limit(limits, place, stop)
                row += [_digits(sign * most), percent(most / limit) if limit else MISSING]
            row += [_digits(v) for v in (_sd(curves.deflection), min(speeds), max(speeds))]
            rows.append(row)
    unit, velocity = runs[-1].travel.unit, runs[-1].travel.velocity_unit
    unit, velocity = readable_unit(unit), readable_unit(velocity)
    return Table(
        "Suspension travel and damper velocity",
        [
            "suspension", f"largest bump [{unit}]", "of limit", f"largest droop [{unit}]",
            "of limit", f"sd [{unit}]", f"fastest compression [{velocity}]",
            f"fastest rebound [{velocity}]",
        ],
        rows,
        "Extension is positive; travel is from rest. The limits are those of the vehicle file.",
    )  # fmt: skip


def _digits(value: float) -> str:
    return number(value, abs(value) * 0.1 if value else None)


def _sd(curve: Curve) -> float:
    values = svg.curve_array(curve)
    values = values[np.isfinite(values)]
    return float(values.std(ddof=1)) if len(values) > 1 else 0.0


def _share_table(runs: Sequence[Run]) -> Table:
    """Shares of the time in compression and rebound at high and low speed, with intervals."""
    rows = []
    for run in runs:
        for place, curves in run.travel.entries.items():
            of = f", {plain(run.source)}" if len(runs) > 1 else ""
            shares = {f"{s.side} {s.speed}": s for s in curves.speed_shares}
            cells = (shares.get(name) for name in _RANGES)
            rows.append([f"{capitalized(_words(place))}{of}", *map(_share_text, cells)])
    travel = runs[-1].travel
    unit = readable_unit(travel.velocity_unit)
    divided = f"{two_digits(travel.low_speed or 0.0)} {unit}"
    metric = "" if unit == "mm/s" else " (25 mm/s)"
    return Table(
        "Time in compression and rebound, at low and high speed",
        ["suspension", "compression, high", "compression, low", "rebound, low", "rebound, high"],
        rows,
        f"Low speed is below {divided}{metric}. In brackets the 95 % credible interval.",
    )


def _share_text(share: SpeedShare | None) -> str:
    if share is None:
        return MISSING
    low, high = (percent(end, 1).removesuffix(" %") for end in share.eti95)
    return f"{percent(share.mean, 1)} ({low} to {high})"


def _travel_panel(runs: Sequence[Run], limits: TravelLimits, place: str) -> svg.Panel | None:
    """Draw the histogram of the travel of an element, with its stops where they are given."""
    travel, words = _pooled(runs, place, "deflection"), _words(place)
    if not len(travel):
        return None
    unit = readable_unit(runs[0].travel.unit)
    stops = [
        (sign * limit, stop)
        for sign, stop in _STOPS
        if (limit := _limit(limits, place, stop)) is not None
    ]
    figure = svg.canvas(*svg.SMALL)
    axes: Axes = figure.subplots()
    axes.hist(
        travel, bins=_BINS, weights=np.full(len(travel), 100.0 / len(travel)),
        color=svg.axle_colour(place), alpha=0.85, edgecolor=svg.COLOURS["ink"], linewidth=0.3,
    )  # fmt: skip
    _as_shares(axes)
    for at, stop in stops:
        svg.mark_stop(axes, at, f"{stop} stop {number(abs(at))}")
    axes.set_title(" ", fontsize=9)  # room for the names of the stops
    axes.set(xlabel=f"{words} travel [{unit}]")
    texts = "".join(f", {stop} stop at {number(at)} {unit}" for at, stop in stops)
    alt = f"{words} suspension travel: share of the time{texts}"
    return svg.panel(figure, f"travel-{place.replace('_', '-')}", alt)


def _as_shares(axes: Axes) -> None:
    """Make the values of a histogram shares of the time on a logarithmic scale."""
    axes.set_yscale("log")  # the time at rest would dwarf the rest
    axes.axvline(0.0, color=svg.COLOURS["ink"], linewidth=0.8)
    axes.set_ylabel("share of time [%]")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def travel_curve(run: Run, n: int) -> tuple[svg.Panel, ...]:
    """Draw the travel of every element of a run against time, with its interval, in one panel."""
    elements, time = run.travel.entries, svg.curve_array(run.time)
    if not elements:
        return ()
    figure = svg.canvas(*svg.SMALL)
    axes = figure.subplots()
    for place, curves in elements.items():
        low, high = (svg.curve_array(side) for side in curves.band95)
        look = svg.place_style(place)
        axes.fill_between(time, low, high, color=look["color"], alpha=0.3, linewidth=0)
        axes.plot(time, svg.curve_array(curves.deflection), label=_words(place), **look)
    axes.axhline(0.0, color=svg.COLOURS["muted"], linewidth=0.8)
    unit = readable_unit(run.travel.unit)
    alt = ", ".join(f"{_words(place)} suspension travel against time" for place in elements)
    axes.set(xlabel="time [s]", ylabel=f"travel [{unit}]\nextension +", xlim=motion_window(run))
    svg.legend_above(axes, 2)
    return (svg.panel(figure, f"travel-{n}", alt),)


def _velocity_panel(runs: Sequence[Run], place: str) -> svg.Panel | None:
    """Draw the histogram of the velocity of a damper, all runs together."""
    velocity, words = _pooled(runs, place, "velocity"), _words(place)
    if not velocity.any():
        return None
    unit, low_speed = readable_unit(runs[0].travel.velocity_unit), runs[0].travel.low_speed or 0.0
    figure = svg.canvas(*svg.SMALL)
    axes: Axes = figure.subplots()
    largest = float(np.abs(velocity).max())
    edges, ink = np.linspace(-largest, largest, _BINS), svg.COLOURS["ink"]
    share = 100.0 * np.histogram(velocity, edges)[0] / len(velocity)
    middle = 0.5 * (edges[1:] + edges[:-1])
    slow = np.abs(middle) < low_speed
    for side, hatch in ((middle < 0.0, "////"), (middle >= 0.0, None)):
        for shown, alpha in ((side & slow, 0.35), (side & ~slow, 0.8)):
            axes.bar(
                middle[shown], share[shown], edges[1] - edges[0], alpha=alpha, hatch=hatch,
                facecolor=svg.axle_colour(place), edgecolor=ink, linewidth=0.4,
            )  # fmt: skip
    _as_shares(axes)
    axes.set_xlabel(f"{words} damper velocity [{unit}]")
    compression, at_rest, rebound = velocity_shares(runs, place)
    axes.set_title(f"compression {percent(compression)}", loc="left", fontsize=9)
    axes.set_title(f"rebound {percent(rebound)}", loc="right", fontsize=9)
    alt = (
        f"{words} damper velocity: compression {percent(compression)}, at rest {percent(at_rest)}, "
        f"rebound {percent(rebound)} of the time"
    )
    return svg.panel(figure, f"velocity-{place.replace('_', '-')}", alt)


def velocity_shares(runs: Sequence[Run], place: str) -> tuple[float, float, float]:
    """Shares of the time in compression (negative velocity), at rest and in rebound; sum 1."""
    velocity = _pooled(runs, place, "velocity")
    if not velocity.any():
        return 0.0, 1.0, 0.0
    edge = _AT_REST * float(np.abs(velocity).max())
    compression, rebound = float(np.mean(velocity < -edge)), float(np.mean(velocity > edge))
    return compression, 1.0 - compression - rebound, rebound


def _pooled(runs: Sequence[Run], place: str, of: Literal["velocity", "deflection"]) -> Array:
    """Velocity or travel of one damper in all runs, at equal time steps."""
    parts = []
    for run in runs:
        curves = run.travel.entries.get(place)
        if curves is None:
            continue
        time, values = svg.curve_array(run.time), svg.curve_array(getattr(curves, of))
        good = np.isfinite(values) & np.isfinite(time)
        if good.sum() > 1:
            # Curves are thinned by different factors, so they are resampled at one rate first.
            count = int(np.clip((time[good][-1] - time[good][0]) * 400.0, 2, 400_000))
            clock = np.linspace(time[good][0], time[good][-1], count)
            parts.append(np.interp(clock, time[good], values[good]))
    return np.concatenate(parts) if parts else np.empty(0)


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
