"""A track against time: parameters with their bands, and whether the filter was consistent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report.plots_time import values_of
from bayes_asv.report.readable import number, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel
from bayes_asv.report.words import LABELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["autocorrelations", "consistency", "parameters"]

Document = dict[str, Any]
Array = NDArray[np.float64]

PAINT: Final = {"c_f": "front", "c_r": "rear", "i": "muted"}

_WIDTHS: Final = 5.0  # half-widths of the last band that the axis shows at least
_LEARNT: Final = 8.0  # widths of the last band: what is wider was not learnt yet


def parameters(document: Document) -> tuple[Panel, ...]:
    """Draw each parameter with its 95 % band against time.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/track/1``.

    Returns
    -------
    tuple of Panel
        c_f, c_r, i.  The axis shows where the parameter ended and what it did once it was known;
        the wide band of the beginning runs out of it.
    """
    curves = document["track"]
    time = values_of(curves["time"])
    panels = []
    for name, curve in curves["parameters"].items():
        median = values_of(curve["median"])
        low, high = (values_of(side) for side in curve["band95"])
        nominal = (document["parameters"].get(name) or {}).get("nominal")
        paint = COLOURS[PAINT[name]]
        figure = canvas(height=2.4)
        axes = figure.subplots()
        _shade(axes, time, curves["consistent"])
        axes.fill_between(time, low, high, color=paint, alpha=0.3, linewidth=0)
        axes.plot(time, median, color=paint)
        bottom, top = _window(median, low, high, nominal)
        if nominal is not None:
            above = nominal < 0.5 * (bottom + top)
            axes.axhline(nominal, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0)
            axes.annotate(
                f"nominal {number(nominal)}",
                (0.99, nominal),
                xycoords=("axes fraction", "data"),
                xytext=(0, 3 if above else -3),
                textcoords="offset points",
                ha="right",
                va="bottom" if above else "top",
                fontsize=8.5,
            )
        axes.set_ylim(bottom, top)
        axes.set_xlim(float(time[0]), float(time[-1]))
        label = LABELS[name]
        axes.set(xlabel="time [s]", ylabel=f"{label}\n[{readable_unit(curve['unit'])}]")
        alt = f"{label} against time with its 95 % band, from the online filter"
        panels.append(panel(figure, f"track-{name.replace('_', '-')}", alt))
    return tuple(panels)


def _window(median: Array, low: Array, high: Array, nominal: float | None) -> tuple[float, float]:
    """Limits of the axis: everything that was known well, and nominal."""
    last = float(high[-1] - low[-1])
    known = (high - low) < _LEARNT * last
    known[-1] = True
    inside = [float(median[-1]) - _WIDTHS * last / 2, float(median[-1]) + _WIDTHS * last / 2]
    inside += [float(np.nanmin(low[known])), float(np.nanmax(high[known]))]
    if nominal is not None:
        inside.append(nominal)
    margin = 0.06 * (max(inside) - min(inside))
    return min(inside) - margin, max(inside) + margin


def _shade(axes: Axes, time: Array, consistent: list[bool]) -> None:
    """Shade the time in which the filter was not consistent."""
    wrong = np.array([not well for well in consistent])
    edges = np.diff(np.concatenate([[0], wrong.astype(int), [0]]))
    starts, stops = np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist()
    for start, stop in zip(starts, stops, strict=True):
        axes.axvspan(
            float(time[start]), float(time[min(stop, len(time) - 1)]),
            color=COLOURS["below"], alpha=0.15, linewidth=0,
        )  # fmt: skip


def consistency(document: Document) -> Panel:
    """Draw the mean NIS over a sliding window with its band, and how far noise was widened."""
    curves = document["track"]
    time = values_of(curves["time"])
    mean = values_of(curves["nis"]["mean"])
    low, high = (values_of(side) for side in curves["nis"]["band95"])
    figure = canvas(width=6.4, height=2.9)
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.3))
    _shade(top, time, curves["consistent"])
    reach = max(2.2, 1.1 * float(np.nanquantile(mean, 0.995)))
    reach = min(reach, 12.0)
    top.fill_between(
        time, np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=reach), color=COLOURS["good"],
        alpha=0.2, linewidth=0, label="95 % band",
    )  # fmt: skip
    top.plot(time, np.minimum(mean, reach), color=COLOURS["ink"], linewidth=0.9, label="mean NIS")
    top.axhline(1.0, color=COLOURS["good"], linewidth=0.8)
    window = document["consistency"].get("window_seconds")
    top.set(ylabel=f"mean NIS a reading\nover {number(window)} s", ylim=(0.0, reach))
    top.legend(loc="upper right", ncols=2)
    below.plot(time, values_of(curves["inflation"]), color=COLOURS["below"], linewidth=0.9)
    below.set(xlabel="time [s]", ylabel="noise widened\n[times]")
    below.set_ylim(0.9, max(1.6, 1.05 * float(np.nanmax(values_of(curves["inflation"])))))
    below.set_xlim(float(time[0]), float(time[-1]))
    figure.align_ylabels([top, below])
    alt = "mean normalised innovation squared against time with its 95 % band, and how far the "
    return panel(figure, "track-nis", f"{alt}noise was widened", wide=True)


def autocorrelations(document: Document) -> tuple[Panel, ...]:
    """Draw the autocorrelation of the innovations with its 95 % band, front and rear."""
    found = document["consistency"].get("autocorrelation") or {}
    band = found.get("band95") or 0.0
    panels = []
    for axle in ("front", "rear"):
        values = np.array([v or 0.0 for v in (found.get(axle) or [])][1:], dtype=float)
        if not len(values):
            continue
        figure = canvas(height=2.2)
        axes = figure.subplots()
        lags = np.arange(1, len(values) + 1)
        axes.axhspan(-band, band, color=COLOURS[axle], alpha=0.2, linewidth=0)
        axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
        axes.vlines(lags, 0.0, values, color=COLOURS[axle], linewidth=2.0)
        axes.plot(lags, values, "o", color=COLOURS[axle], markersize=3.5)
        reach = max(1.15 * float(np.abs(values).max()), 2.2 * band, 1e-3)
        axes.set(
            xlabel=f"lag [samples of {1e3 * (found.get('lag_seconds') or 0.0):.3g} ms]",
            ylabel=f"{axle} autocorrelation",
            ylim=(-reach, reach),
            xlim=(0.3, len(values) + 0.7),
        )
        alt = f"{axle} innovations of the online filter: autocorrelation with its 95 % band"
        panels.append(panel(figure, f"track-lags-{axle}", alt))
    return tuple(panels)
