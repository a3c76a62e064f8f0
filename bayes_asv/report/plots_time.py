"""Curves against time, and the histogram of damper velocities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report.readable import number, percent, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["chassis", "travels", "values_of", "velocities", "velocity_shares", "wheels"]

Document = dict[str, Any]
Array = NDArray[np.float64]

AXLES: Final = ("front", "rear")

_QUIET = 0.05  # of the largest wheel acceleration: below it nothing happens
_BEFORE, _AFTER = 0.1, 0.4  # s shown around what happens
_STILL = 0.02  # of the largest velocity: neither bound nor rebound


def chassis(run: Document, n: int) -> tuple[Panel, ...]:
    """Draw measured and simulated chassis acceleration, and their difference below.

    Parameters
    ----------
    run : dict
        One of the document's ``runs``.
    n : int
        Its place among them.

    Returns
    -------
    tuple of Panel
        Front, rear.
    """
    time, unit, window = values_of(run["time"]), readable_unit(run["unit"]), _window(run)
    panels = []
    for axle in AXLES:
        curve = run["chassis"].get(f"{axle}_chassis")
        if curve is None:
            continue
        measured, simulated = values_of(curve["measured"]), values_of(curve["simulated"])
        low, high = (values_of(side) for side in curve["band95"])
        figure = canvas(height=3.1)
        top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
        paint = COLOURS[axle]
        # Thick and pale below thin and strong: both are seen where they lie on each other.
        top.plot(time, measured, color=COLOURS["ink"], alpha=0.3, linewidth=4.0, label="measured")
        top.fill_between(time, low, high, color=paint, alpha=0.25, linewidth=0)
        top.plot(time, simulated, color=paint, label="simulated, 95 % band")
        top.set_ylim(*_shared([run["chassis"][c]["measured"] for c in run["chassis"]]))
        top.set_ylabel(f"{axle} chassis [{unit}]\nup +")
        _legend(top)
        below.fill_between(
            time, low - simulated, high - simulated, color=paint, alpha=0.25, linewidth=0
        )
        below.plot(time, measured - simulated, color=COLOURS["ink"], linewidth=0.7)
        below.axhline(0.0, color=paint, linewidth=0.8)
        below.set_ylabel("measured\n− simul.")
        below.set_xlabel("time [s]")
        below.set_xlim(*window)
        figure.align_ylabels([top, below])
        alt = f"{axle} chassis acceleration against time, measured and simulated"
        panels.append(panel(figure, f"chassis-{axle}-{n}", alt))
    return tuple(panels)


def wheels(run: Document, n: int) -> tuple[Panel, ...]:
    """Draw the wheel accelerations, front and rear."""
    unit, window = readable_unit(run["unit"]), _window(run)
    time = values_of(run["wheels"]["time"])
    panels = []
    for axle in AXLES:
        figure = canvas(height=2.1)
        axes = figure.subplots()
        axes.plot(
            time, values_of(run["wheels"][f"{axle}_wheel"]), color=COLOURS[axle], linewidth=0.9
        )
        axes.set(xlabel="time [s]", ylabel=f"{axle} wheel [{unit}]\nup +", xlim=window)
        axes.set_ylim(*_shared([run["wheels"][f"{a}_wheel"] for a in AXLES]))
        panels.append(panel(figure, f"wheel-{axle}-{n}", f"{axle} wheel acceleration against time"))
    return tuple(panels)


def travels(run: Document, limits: Document, n: int) -> tuple[Panel, ...]:
    """Draw suspension travel, with the limits of the vehicle where it gives them."""
    time, window = values_of(run["time"]), _window(run)
    unit = readable_unit(run["travel"]["unit"])
    there = [run["travel"][a]["deflection"] for a in AXLES if a in run["travel"]]
    stops = [
        sign * limits[f"{a}_{name}"]
        for a in AXLES for sign, name in ((-1.0, "bump"), (1.0, "droop"))
        if limits.get(f"{a}_{name}") is not None
    ]  # fmt: skip
    panels = []
    for axle in AXLES:
        curve = run["travel"].get(axle)
        if curve is None:
            continue
        figure = canvas(height=2.3)
        axes = figure.subplots()
        low, high = (values_of(side) for side in curve["band95"])
        axes.fill_between(time, low, high, color=COLOURS[axle], alpha=0.3, linewidth=0)
        axes.plot(time, values_of(curve["deflection"]), color=COLOURS[axle])
        axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
        for sign, name in ((-1.0, "bump"), (1.0, "droop")):
            limit = limits.get(f"{axle}_{name}")
            if limit is None:
                continue
            axes.axhline(sign * limit, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0)
            axes.annotate(
                f"{name} limit {number(limit)} {unit}",
                (0.99, sign * limit),
                xycoords=("axes fraction", "data"),
                xytext=(0, -3.5 * sign),
                textcoords="offset points",
                ha="right",
                va="top" if sign > 0 else "bottom",
                fontsize=8.5,
            )
        axes.set_ylim(*_shared([*there, stops]))
        axes.set(xlabel="time [s]", ylabel=f"{axle} travel [{unit}]\nextension +", xlim=window)
        panels.append(panel(figure, f"travel-{axle}-{n}", f"{axle} suspension travel against time"))
    return tuple(panels)


def velocities(runs: list[Document]) -> tuple[Panel, ...]:
    """Draw how long the suspension moved at which velocity, all runs together."""
    unit = readable_unit(runs[0]["travel"].get("velocity_unit", ""))
    panels = []
    for axle in AXLES:
        velocity = _pooled(runs, axle)
        if not velocity.any():
            continue
        bound, still, rebound = velocity_shares(runs, axle)
        reach = float(np.abs(velocity).max())
        figure = canvas(height=2.4)
        axes = figure.subplots()
        edges = np.linspace(-reach, reach, 41).tolist()
        weights = np.full(len(velocity), 100.0 / len(velocity))
        for sign, hatch in ((-1.0, "////"), (1.0, None)):
            side = sign * velocity > 0.0
            axes.hist(
                velocity[side], bins=edges, weights=weights[side],
                facecolor=COLOURS[axle], alpha=0.55 if hatch else 0.85, hatch=hatch,
                edgecolor=COLOURS["ink"], linewidth=0.4,
            )  # fmt: skip
        axes.set_yscale("log")  # standing still would dwarf the rest
        axes.axvline(0.0, color=COLOURS["ink"], linewidth=0.8)
        axes.set(xlabel=f"{axle} damper velocity [{unit}], extension +", ylabel="share of time [%]")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_title(f"bound {percent(bound)}", loc="left", fontsize=9)
        axes.set_title(f"still {percent(still)}", loc="center", fontsize=9)
        axes.set_title(f"rebound {percent(rebound)}", loc="right", fontsize=9)
        alt = (
            f"{axle} damper velocity: bound {percent(bound)}, nearly still {percent(still)}, "
            f"rebound {percent(rebound)} of the time"
        )
        panels.append(panel(figure, f"velocity-{axle}", alt))
    return tuple(panels)


def velocity_shares(runs: list[Document], axle: str) -> tuple[float, float, float]:
    """Shares of the time in bound, nearly still, and in rebound.

    Parameters
    ----------
    runs : list of dict
        The document's ``runs``.
    axle : str
        ``front`` or ``rear``.

    Returns
    -------
    tuple of float
        They sum to 1. Bound is compression, a negative velocity; nearly still is below 2 % of
        the largest velocity.
    """
    velocity = _pooled(runs, axle)
    if not velocity.any():
        return 0.0, 1.0, 0.0
    edge = _STILL * float(np.abs(velocity).max())
    bound = float(np.mean(velocity < -edge))
    rebound = float(np.mean(velocity > edge))
    return bound, 1.0 - bound - rebound, rebound


def _pooled(runs: list[Document], axle: str) -> Array:
    """Velocities of all runs, each at its own spacing times its length: equal weight a second."""
    parts = []
    for run in runs:
        curve = run["travel"].get(axle)
        if curve is None:
            continue
        time, velocity = values_of(run["time"]), values_of(curve["velocity"])
        good = np.isfinite(velocity) & np.isfinite(time)
        if good.sum() > 1:
            # Curves are thinned by different factors, so they are put on one clock first.
            count = int(np.clip((time[good][-1] - time[good][0]) * 400.0, 2, 400_000))
            clock = np.linspace(time[good][0], time[good][-1], count)
            parts.append(np.interp(clock, time[good], velocity[good]))
    return np.concatenate(parts) if parts else np.empty(0)


def values_of(curve: list[float | None]) -> Array:
    """Return a curve as an array, with nan where the document has no number."""
    return np.array([np.nan if v is None else v for v in curve], dtype=float)


def _window(run: Document) -> tuple[float, float]:
    """Return the times between which something happens, with a margin."""
    time = values_of(run["wheels"]["time"])
    moved = np.zeros(len(time), dtype=bool)
    for axle in AXLES:
        size = np.abs(values_of(run["wheels"][f"{axle}_wheel"]))
        if np.isfinite(size).any():
            moved |= size > _QUIET * np.nanmax(size)
    if not moved.any():
        return float(time[0]), float(time[-1])
    first, last = time[moved][[0, -1]]
    return max(float(first) - _BEFORE, float(time[0])), min(float(last) + _AFTER, float(time[-1]))


def _shared(curves: list[list[float | None]]) -> tuple[float, float]:
    """Limits of an axis that front and rear share, so that the eye may compare them."""
    values = np.concatenate([values_of(curve) for curve in curves])
    values = values[np.isfinite(values)]
    if not len(values):
        return -1.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or 1.0
    return low - margin, high + margin


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
