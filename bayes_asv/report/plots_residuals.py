"""What the model leaves: spectrum and autocorrelation."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from bayes_asv.report.plots_time import AXLES, values_of
from bayes_asv.report.readable import probability, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

__all__ = ["spectra", "whiteness"]

Document = dict[str, Any]

_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(value: float) -> str:
    """Write 10⁻² for 0.01, without the markup that a unit's text could be taken for."""
    if value <= 0.0:
        return ""
    return "10" + str(round(math.log10(value))).translate(_RAISED)


def spectra(run: Document, n: int) -> tuple[Panel, ...]:
    """Draw power spectral densities of reading and residual, front and rear.

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
    panels = []
    for axle in AXLES:
        spectrum = run["chassis"].get(f"{axle}_chassis", {}).get("spectrum")
        if not spectrum:
            continue
        frequency = values_of(spectrum["frequency"])
        measured, residual = (
            np.where((v := values_of(spectrum[k])) > 0.0, v, np.nan)
            for k in ("measured", "residual")
        )
        if not (np.isfinite(measured).any() and np.isfinite(residual).any()):
            continue  # a channel that never moved has no logarithm to show
        figure = canvas(height=2.5)
        axes = figure.subplots()
        axes.loglog(frequency, measured, color=COLOURS["ink"], label="measured")
        axes.loglog(frequency, residual, color=COLOURS[axle], label="what is left")
        axes.set(
            xlabel="frequency [Hz]",
            ylabel=f"{axle} chassis, spectral\ndensity [{readable_unit(spectrum['unit'])}]",
        )
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_major_formatter(lambda value, _: power_of_ten(value))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        alt = f"{axle} chassis: spectrum of measurement and of what the simulation leaves"
        panels.append(panel(figure, f"spectrum-{axle}-{n}", alt))
    return tuple(panels)


def whiteness(run: Document, n: int) -> tuple[Panel, ...]:
    """Draw the autocorrelation of the innovations with its 95 % band, front and rear."""
    panels = []
    for axle in AXLES:
        curve = run["chassis"].get(f"{axle}_chassis", {})
        values = np.array([v or 0.0 for v in curve.get("autocorrelation", ())][1:], dtype=float)
        if not len(values):
            continue
        band = curve["autocorrelation_band95"]
        figure = canvas(height=2.2)
        axes = figure.subplots()
        lags = np.arange(1, len(values) + 1)
        axes.axhspan(-band, band, color=COLOURS[axle], alpha=0.2, linewidth=0)
        axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
        axes.vlines(lags, 0.0, values, color=COLOURS[axle], linewidth=2.0)
        axes.plot(lags, values, "o", color=COLOURS[axle], markersize=3.5)
        reach = max(1.15 * float(np.abs(values).max()), 2.2 * band)
        step = 1e3 * curve["lag_seconds"]
        axes.set(
            xlabel=f"lag [samples of {step:.3g} ms]",
            ylabel=f"{axle} autocorrelation",
            ylim=(-reach, reach),
            xlim=(0.3, len(values) + 0.7),
            xticks=range(5, len(values) + 1, 5),
        )
        p = curve.get("whiteness_p")
        axes.set_title(f"{axle}: whiteness probability {probability(p)}", loc="left")
        alt = f"{axle} innovations: autocorrelation, whiteness probability {probability(p)}"
        panels.append(panel(figure, f"whiteness-{axle}-{n}", alt))
    return tuple(panels)
