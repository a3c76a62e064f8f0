"""Pictures of the page: coverage by condition, and places against uniform ones."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.files import write_atomically
from benchmarks.calibration.cells import GROUPS, NAMES, TERRAIN_NAMES
from benchmarks.calibration.summary import Summary
from benchmarks.calibration.uniformity import bands, differences, histogram_band, points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "coverage_picture", "curves", "look", "ranks", "save"]

Array = NDArray[np.float64]

# Okabe and Ito's palette, safe for colour-blind readers.
COLOURS = {"bump": "#0072b2", "stops": "#d55e00", "rough": "#007a5a", "rollers": "#946c00"}
_LINES = ("#0072b2", "#d55e00", "#007a5a", "#946c00")
_INK, _GREY, _BAND = "#1b1f24", "#5b6470", "#d9dde2"
_LOOK: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": _GREY,
    "text.color": _INK,
    "legend.frameon": False,
}
BINS = 20


def save(figure: Figure, path: Path) -> None:
    """Write a picture as PNG with a palette, the same bytes for the same figure."""
    from PIL import Image

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    small = io.BytesIO()
    with Image.open(buffer) as drawn:
        drawn.convert("RGB").quantize(256).save(small, "PNG", optimize=True)
    write_atomically(str(path), small.getvalue())


@contextmanager
def look() -> Iterator[None]:
    """Draw alike whatever matplotlib was told before."""
    import matplotlib as mpl

    kept = ("backend", "backend_fallback", "toolbar", "interactive")
    rc: dict[Any, Any] = {k: v for k, v in mpl.rcParamsDefault.items() if k not in kept}
    with mpl.rc_context(rc | _LOOK):
        yield


def _canvas(width: float, height: float, rows: int, columns: int) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def coverage_picture(found: Mapping[str, Summary], level: float) -> Figure:
    """Coverage with Jeffreys' intervals: a row a condition, a colour a terrain.

    Parameters
    ----------
    found : mapping of str to Summary
        Cells by name.
    level : float
        Their stated level.
    """
    there = [g for g in GROUPS if any(s.cell.group == g for s in found.values())]
    figure, axes = _canvas(9.0, 1.2 + 0.34 * len(there), 1, len(NAMES))
    lowest = 1.0
    for ax, name in zip(axes[0], NAMES, strict=True):
        for row, group in enumerate(there):
            for k, terrain in enumerate(TERRAIN_NAMES):
                summary = found.get(f"{group.key}-{terrain}")
                if summary is None or (name, level) not in summary.coverage:
                    continue
                one = summary.coverage[name, level]
                low, high = one.interval
                y = row + 0.18 * (k - 1.5)
                ax.plot([low, high], [y, y], color=COLOURS[terrain], lw=1.0, alpha=0.7)
                ax.plot(one.share, y, "o", ms=2.8, color=COLOURS[terrain])
                lowest = min(lowest, low)
        ax.axvline(level, color=_INK, lw=0.8)
        ax.set_title(name)
        ax.set_ylim(len(there) - 0.5, -0.5)
        ax.set_yticks(range(len(there)), [g.title for g in there] if ax is axes[0][0] else [])
        for row in range(len(there) - 1):
            ax.axhline(row + 0.5, color=_BAND, lw=0.6)
        ax.tick_params(axis="y", length=0)
    left = max(0.0, min(level - 0.08, lowest - 0.01))
    for ax in axes[0]:
        ax.set_xlim(left, min(1.0, level + 0.08))
        ax.xaxis.set_major_formatter(lambda x, _: f"{100 * x:.0f}")
    handles = [
        axes[0][0].plot([], [], "o-", ms=2.8, lw=1.0, color=COLOURS[t], label=t)[0]
        for t in TERRAIN_NAMES
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    figure.supxlabel(f"coverage of {100 * level:.0f} % intervals, %", fontsize=8)
    return figure


def curves(
    panels: Mapping[str, Mapping[str, Array]], columns: int, alpha: float, legend: bool
) -> Figure:
    """Distribution functions of places less the diagonal, with simultaneous bands.

    Parameters
    ----------
    panels : mapping of str to (mapping of str to (N,) array)
        Panels by title, each with curves by name.
    columns : int
        Panels side by side.
    alpha : float
        Probability that uniform places leave the band of one curve anywhere.
    legend : bool
        Name the curves.
    """
    figure, axes = _grid(len(panels), columns)
    highest = 0.0
    for ax, (title, lines) in zip(axes.flat, panels.items(), strict=False):
        counts = {len(places) for places in lines.values()}
        low, high = bands(max(counts), alpha)
        at = np.pad(points(max(counts)), 1, constant_values=(0.0, 1.0))
        ax.fill_between(at, np.pad(low, 1), np.pad(high, 1), color=_BAND, lw=0)
        for (name, places), colour in zip(lines.items(), _LINES, strict=False):
            apart = differences(places)
            ax.plot(points(len(places)), apart, color=colour, lw=1.1, label=name)
            highest = max(highest, float(np.abs(apart).max()))
        highest = max(highest, float(high.max()), float(-low.min()))
        ax.axhline(0.0, color=_GREY, lw=0.6)
        ax.set_title(title)
        ax.set_xlim(0.0, 1.0)
        ax.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    for ax in axes.flat[: len(panels)]:
        ax.set_ylim(-1.08 * highest, 1.08 * highest)
    if legend:
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    figure.supxlabel("posterior probability below the true value", fontsize=8)
    figure.supylabel("empirical minus uniform distribution function", fontsize=8)
    return figure


def ranks(panels: Mapping[str, Array], columns: int, alpha: float) -> Figure:
    """Histograms of places, with the counts that uniform ones keep within.

    Parameters
    ----------
    panels : mapping of str to (N,) array
        Places by title.
    columns : int
        Panels side by side.
    alpha : float
        Probability that some bar of one panel leaves the band when places are uniform.
    """
    figure, axes = _grid(len(panels), columns)
    for ax, (title, places) in zip(axes.flat, panels.items(), strict=False):
        low, high = histogram_band(len(places), BINS, alpha)
        ax.axhspan(low, high, color=_BAND, lw=0)
        ax.hist(places, bins=BINS, range=(0.0, 1.0), color=_LINES[0], rwidth=0.85)
        ax.axhline(len(places) / BINS, color=_GREY, lw=0.6)
        ax.set_title(title)
        ax.set_xlim(0.0, 1.0)
        ax.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
        ax.set_ylim(0.0, 1.15 * max(high, float(np.histogram(places, BINS, (0.0, 1.0))[0].max())))
    figure.supxlabel("posterior probability below the true value", fontsize=8)
    figure.supylabel("runs", fontsize=8)
    return figure


def _grid(count: int, columns: int) -> tuple[Figure, Any]:
    rows = -(-count // columns)
    figure, axes = _canvas(9.0, 0.7 + 1.65 * rows, rows, columns)
    spare: list[Axes] = list(axes.flat[count:])
    for ax in spare:
        ax.set_axis_off()
    return figure, axes
