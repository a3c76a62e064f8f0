"""Suspension travel and damper velocity: table, curves, histogram, and stops that were reached."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Run, TravelCurves
from bayes_asv.report.schema.parts import Curve, TravelLimits
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table
from bayes_asv.report.sections.simulation import MAX_RUNS, motion_window
from bayes_asv.report.words import MISSING, capitalized, number, percent, plain, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SECTION", "velocity_shares"]

Array = NDArray[np.float64]

_AT_REST: Final = 0.02  # of the largest velocity: neither compression nor rebound
_REACHED: Final = 0.95  # share of a travel limit that counts as reached
_STOPS: Final = ((-1.0, "bump"), (1.0, "droop"))

_TRAVEL: Final = (
    "Reconstructed from the recording. A stop that was reached biases the answer. The shading, "
    "where it is wide enough to be seen, is the 95 % interval."
)
_VELOCITY: Final = (
    "A damping rate is learnt only at the velocities that were driven, and the rates of "
    "compression (left of zero) and rebound are averaged: look for unequal shares. The velocity is "
    "that of the suspension at the wheel; below 2 % of the largest it counts as at rest."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    runs, limits = document.runs, document.vehicle.travel or TravelLimits()
    if not runs:
        return
    yield _travel_table(runs, limits)
    for n, run in enumerate(runs[:MAX_RUNS]):
        of = f", {plain(run.source)}" if len(runs) > 1 else ""
        yield Figure(f"travel-{n}", f"Suspension travel{of}", _TRAVEL, _travels(run, limits, n))
    yield Figure("velocity", "Damper velocity", _VELOCITY, _velocities(runs))


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


SECTION: Final = Section(_content, _limits)


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


def _travels(run: Run, limits: TravelLimits, n: int) -> tuple[svg.Panel, ...]:
    time, window, unit = (
        svg.curve_array(run.time),
        motion_window(run),
        readable_unit(run.travel.unit),
    )
    elements = run.travel.entries
    stops = {
        (place, stop): sign * limit
        for place in elements
        for sign, stop in _STOPS
        if (limit := _limit(limits, place, stop)) is not None
    }
    drawn = [curves.deflection for curves in elements.values()]
    y_limits = svg.shared_limits([*drawn, [*stops.values()]])

    def draw(axes: Axes, place: str) -> str:
        curves, words, paint = elements[place], _words(place), svg.axle_colour(place)
        low, high = (svg.curve_array(side) for side in curves.band95)
        axes.fill_between(time, low, high, color=paint, alpha=0.3, linewidth=0)
        axes.plot(time, svg.curve_array(curves.deflection), color=paint)
        axes.axhline(0.0, color=svg.COLOURS["muted"], linewidth=0.8)
        for (of, stop), at in stops.items():
            if of == place:
                svg.draw_level(axes, at, f"{stop} limit {number(abs(at))} {unit}", above=at < 0.0)
        axes.set(xlabel="time [s]", ylabel=f"{words} travel [{unit}]\nextension +", xlim=window)
        axes.set_ylim(*y_limits)
        return f"{words} suspension travel against time"

    return svg.axle_panels(f"travel-{{}}-{n}", draw, 2.3, elements)


def _velocities(runs: Sequence[Run]) -> tuple[svg.Panel, ...]:
    """Draw the histogram of damper velocity, all runs together."""
    unit = readable_unit(runs[0].travel.velocity_unit)

    def draw(axes: Axes, place: str) -> str | None:
        velocity, words = _pooled_velocity(runs, place), _words(place)
        if not velocity.any():
            return None
        largest = float(np.abs(velocity).max())
        edges = np.linspace(-largest, largest, 41).tolist()
        weights = np.full(len(velocity), 100.0 / len(velocity))
        for sign, hatch in ((-1.0, "////"), (1.0, None)):
            side = sign * velocity > 0.0
            axes.hist(
                velocity[side], bins=edges, weights=weights[side], facecolor=svg.axle_colour(place),
                alpha=0.55 if hatch else 0.85, hatch=hatch, edgecolor=svg.COLOURS["ink"],
                linewidth=0.4,
            )  # fmt: skip
        axes.set_yscale("log")  # the time at rest would dwarf the rest
        axes.axvline(0.0, color=svg.COLOURS["ink"], linewidth=0.8)
        axes.set(
            xlabel=f"{words} damper velocity [{unit}], extension +", ylabel="share of time [%]"
        )
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        shares = zip(
            ("compression", "at rest", "rebound"), velocity_shares(runs, place), strict=True
        )
        texts = [f"{name} {percent(share)}" for name, share in shares]
        axes.set_title(texts[0], loc="left", fontsize=9)
        axes.set_title(texts[1], loc="center", fontsize=9)
        axes.set_title(texts[2], loc="right", fontsize=9)
        return f"{words} damper velocity: {', '.join(texts)} of the time"

    places = dict.fromkeys(place for run in runs for place in run.travel.entries)
    return svg.axle_panels("velocity-{}", draw, 2.4, places)


def velocity_shares(runs: Sequence[Run], place: str) -> tuple[float, float, float]:
    """Shares of the time in compression (negative velocity), at rest and in rebound; sum 1."""
    velocity = _pooled_velocity(runs, place)
    if not velocity.any():
        return 0.0, 1.0, 0.0
    edge = _AT_REST * float(np.abs(velocity).max())
    compression, rebound = float(np.mean(velocity < -edge)), float(np.mean(velocity > edge))
    return compression, 1.0 - compression - rebound, rebound


def _pooled_velocity(runs: Sequence[Run], place: str) -> Array:
    """Velocities of one damper in all runs, at equal time steps."""
    parts = []
    for run in runs:
        curves = run.travel.entries.get(place)
        if curves is None:
            continue
        time, velocity = svg.curve_array(run.time), svg.curve_array(curves.velocity)
        good = np.isfinite(velocity) & np.isfinite(time)
        if good.sum() > 1:
            # Curves are thinned by different factors, so they are resampled at one rate first.
            count = int(np.clip((time[good][-1] - time[good][0]) * 400.0, 2, 400_000))
            clock = np.linspace(time[good][0], time[good][-1], count)
            parts.append(np.interp(clock, time[good], velocity[good]))
    return np.concatenate(parts) if parts else np.empty(0)
