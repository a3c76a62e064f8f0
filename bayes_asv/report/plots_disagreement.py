"""Where simulation and measurement disagree: state, time and frequency."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from bayes_asv.report.plots_residuals import power_of_ten
from bayes_asv.report.plots_time import AXLES, values_of
from bayes_asv.report.readable import plain, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

__all__ = ["bands", "planes", "windows"]

Document = dict[str, Any]

_STRONG: Final = 12.0  # t-value of a cell in full colour
_SIGNED: Final = {True: "above", False: "prior"}  # a force that pushes up, or down


def planes(document: Document) -> tuple[Panel, ...]:
    """Draw the missing force over the deflection–velocity plane, front and rear."""
    from matplotlib.patches import Rectangle

    found = document.get("map") or {}
    state = (document.get("disagreement") or {}).get("state")
    panels = []
    for axle in AXLES:
        cells = found.get(axle) or []
        if not cells:
            continue
        length, velocity, force = (readable_unit(u) for u in cells[0]["units"])
        figure = canvas(height=3.4)
        axes = figure.subplots()
        for cell in cells:
            (left, right), (low, high) = cell["deflection"], cell["velocity"]
            colour = COLOURS[_SIGNED[cell["force"] > 0.0]]
            box = (left, low), right - left, high - low
            axes.add_patch(
                Rectangle(
                    *box,
                    facecolor=colour,
                    edgecolor=COLOURS["grid"],
                    linewidth=0.6,
                    alpha=min(abs(cell["t"]) / _STRONG, 1.0) * 0.75,
                )
            )
            axes.add_patch(Rectangle(*box, fill=False, edgecolor=COLOURS["grid"], linewidth=0.6))
            axes.text(
                0.5 * (left + right), 0.5 * (low + high),
                f"{_signed(cell['force'])}\n({_signed(cell['t'])})",
                ha="center", va="center", fontsize=7.5, color=COLOURS["ink"], linespacing=1.15,
            )  # fmt: skip
            if (
                state is not None
                and axle == document["disagreement"]["axle"]
                and _same(cell, state)
            ):
                axes.add_patch(
                    Rectangle(*box, fill=False, edgecolor=COLOURS["ink"], linewidth=1.6, zorder=3)
                )
        axes.set(
            xlim=_reach(cells, "deflection"), ylim=_reach(cells, "velocity"),
            xlabel=f"{axle} deflection [{length}], extension +",
            ylabel=f"velocity [{velocity}], extension +",
        )  # fmt: skip
        axes.set_title(f"missing force [{force}], up + (t-value)", loc="left")
        axes.grid(visible=False)
        panels.append(
            panel(figure, f"plane-{axle}", f"{axle}: mean missing force by deflection and velocity")
        )
    return tuple(panels)


def _same(cell: Document, state: Document) -> bool:
    return bool(
        np.allclose(cell["deflection"], state["deflection"])
        and np.allclose(cell["velocity"], state["velocity"])
    )


def _reach(cells: list[Document], key: str) -> tuple[float, float]:
    return min(c[key][0] for c in cells), max(c[key][1] for c in cells)


def _signed(value: float) -> str:
    text = f"{value:+.0f}" if abs(value) >= 99.5 else f"{value:+.2g}"
    if "e" in text:
        text = f"{value:+.0f}"
    return text.replace("-", "−")


def windows(document: Document, n: int) -> tuple[Panel, ...]:
    """Draw what is left of one run against time, before and after, windows of disagreement shaded.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/diagnose/1``.
    n : int
        Which of its ``residuals``.
    """
    run = document["residuals"][n]
    seen = document.get("disagreement") or {}
    spans = [
        span
        for span, source in zip(seen.get("time", ()), seen.get("time_run", ()), strict=False)
        if source == run["source"]
    ]
    time, unit = values_of(run["time"]), readable_unit(run["unit"])
    panels = []
    for axle in AXLES:
        curve = run[f"{axle}_chassis"]
        before, after = values_of(curve["before"]), values_of(curve["after"])
        if not np.isfinite(before).any():
            continue
        figure = canvas(height=2.5)
        axes = figure.subplots()
        for k, (begin, end) in enumerate(spans):
            axes.axvspan(
                begin, end, color=COLOURS["below"], alpha=0.1, linewidth=0,
                label="disagreement" if k == 0 else None,
            )  # fmt: skip
        axes.plot(time, before, color=COLOURS["muted"], linewidth=0.9, label="before")
        axes.plot(time, after, color=COLOURS[axle], linewidth=0.8, label="after")
        axes.axhline(0.0, color=COLOURS["ink"], linewidth=0.6)
        axes.set(
            xlabel="time [s]", ylabel=f"{axle}: measured − simul.\n[{unit}], up +",
            xlim=(float(time[0]), float(time[-1])),
        )  # fmt: skip
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.2)
        alt = f"{plain(run['source'])}, {axle}: what is left against time, before and after"
        panels.append(panel(figure, f"left-{axle}-{n}", alt))
    return tuple(panels)


def bands(document: Document, n: int) -> tuple[Panel, ...]:
    """Draw the spectrum of what is left of one run, bands of disagreement shaded."""
    run = document["residuals"][n]
    seen = document.get("disagreement") or {}
    spectrum = run["spectrum"]
    frequency = values_of(spectrum["frequency"])
    panels = []
    for axle in AXLES:
        curve = spectrum[f"{axle}_chassis"]
        before, after = (
            np.where((v := values_of(curve[k])) > 0.0, v, np.nan) for k in ("before", "after")
        )
        if not (np.isfinite(before).any() and np.isfinite(after).any()):
            continue
        figure = canvas(height=2.5)
        axes = figure.subplots()
        for k, (low, high) in enumerate(seen.get("frequency", ())):
            axes.axvspan(
                low, high, color=COLOURS["below"], alpha=0.1, linewidth=0,
                label="disagreement" if k == 0 else None,
            )  # fmt: skip
        axes.loglog(frequency, before, color=COLOURS["muted"], label="before")
        axes.loglog(frequency, after, color=COLOURS[axle], label="after")
        axes.set(
            xlabel="frequency [Hz]", xlim=(float(frequency[0]), float(frequency[-1])),
            ylabel=f"{axle}, spectral\ndensity [{readable_unit(spectrum['unit'])}]",
        )  # fmt: skip
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_major_formatter(lambda value, _: power_of_ten(value))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.2)
        alt = f"{plain(run['source'])}, {axle}: spectrum of what is left, before and after"
        panels.append(panel(figure, f"leftband-{axle}-{n}", alt))
    return tuple(panels)
