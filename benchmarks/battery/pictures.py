"""Figures of the page: confusion matrices, naming against strength, reliability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.battery.cells import Group
from benchmarks.battery.intervals import Share
from benchmarks.battery.judge import Judged
from benchmarks.battery.reliability import bins
from benchmarks.battery.summary import confusion, naming, probabilities, single, strengths
from benchmarks.calibration.pictures import look, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["confusion_picture", "look", "naming_picture", "reliability_picture", "save"]

Array = NDArray[np.float64]

_BLUE, _ORANGE, _GREEN, _INK, _GREY = "#0072b2", "#d55e00", "#007a5a", "#1b1f24", "#5b6470"
_DARK = 0.55  # share from which figures are written in white


def _canvas(width: float, height: float, rows: int, columns: int) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def confusion_picture(cases: Mapping[Group, Sequence[Judged]], strength: float) -> Figure:
    """Draw the confusion matrix of the first reported effect by the true effect.

    Parameters
    ----------
    cases : mapping
        As :func:`benchmarks.battery.summary.by_group` gives it.
    strength : float
        Noncentrality of the effects.
    """
    rows, columns, shares = confusion(cases, strength)
    figure, axes = _canvas(7.6, 1.9 + 0.23 * len(rows), 1, 1)
    ax: Axes = axes[0, 0]
    ax.imshow(
        np.where(shares > 0.0, shares, np.nan), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto"
    )
    ax.set_xticks(range(len(columns)), columns, rotation=55, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(rows)), rows)
    ax.tick_params(length=0, labelsize=7)
    for r, c in zip(*np.nonzero(shares), strict=True):
        colour = "white" if shares[r, c] > _DARK else _INK
        ax.text(c, r, f"{100 * shares[r, c]:.0f}", ha="center", va="center", fontsize=6.5,
                color=colour)  # fmt: skip
    for side in ax.spines.values():
        side.set_visible(False)
    ax.set_xticks(np.arange(len(columns) + 1) - 0.5, minor=True)
    ax.set_yticks(np.arange(len(rows) + 1) - 0.5, minor=True)
    ax.grid(which="minor", color="#e4e7eb", linewidth=0.6)
    ax.tick_params(which="minor", length=0)
    ax.set_xlabel("reported first, % of a row")
    ax.set_ylabel("true (cases)")
    ax.set_title(f"Noncentrality {strength:g}", loc="left")
    return figure


def naming_picture(cases: Sequence[Judged]) -> Figure:
    """Draw detection and naming of single effects against strength, with Wilson's intervals.

    Parameters
    ----------
    cases : sequence of Judged
        Of the group of single effects.
    """
    figure, axes = _canvas(5.2, 3.2, 1, 1)
    ax: Axes = axes[0, 0]
    ways = (
        ("detected", "detected", _GREY, "s"),
        ("first name's class correct", "of_class", _BLUE, "o"),
        ("first name and location correct", "first", _GREEN, "^"),
        ("confidently wrong", "confidently_wrong", _ORANGE, "v"),
    )
    there = strengths(cases)
    found = [naming(single(cases, strength)) for strength in there]
    for k, (label, key, colour, marker) in enumerate(ways):
        shares: list[Share] = [getattr(one, key) for one in found]
        x = np.array(there) * 1.06 ** (k - 1.5)
        y = np.array([100 * s.share for s in shares])
        ends = 100 * np.array([s.interval for s in shares]).reshape(-1, 2).T
        ax.errorbar(x, y, np.abs(ends - y), color=colour, marker=marker, markersize=4,
                    linewidth=1.2, elinewidth=0.8, label=label)  # fmt: skip
    ax.set_xscale("log")
    ax.set_xticks(there, [f"{s:g}" for s in there])
    ax.minorticks_off()
    ax.set_ylim(-3.0, 103.0)
    ax.set_xlabel("noncentrality in the fitted runs")
    ax.set_ylabel("cases, %")
    ax.grid(axis="y", color="#e4e7eb", linewidth=0.6)
    ax.set_axisbelow(True)
    figure.legend(loc="outside upper center", ncols=2, fontsize=7)
    return figure


def reliability_picture(cases: Sequence[Judged]) -> Figure:
    """Draw the fraction of correct names against their stated probability.

    Parameters
    ----------
    cases : sequence of Judged
        All of them.
    """
    figure, axes = _canvas(4.2, 3.9, 1, 1)
    ax: Axes = axes[0, 0]
    ax.plot([0, 1], [0, 1], color=_GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    ways = (
        ("documents with nothing unexplained", False, _BLUE, "o"),
        ("all documents", True, _ORANGE, "s"),
    )
    for label, flagged, colour, marker in ways:
        found = bins(probabilities(cases, flagged))
        if not found:
            continue
        x = np.array([b.mean for b in found])
        y = np.array([b.right.share for b in found])
        ends = np.array([b.right.interval for b in found]).T
        ax.errorbar(x, y, np.abs(ends - y), color=colour, marker=marker, markersize=4,
                    linewidth=1.0, elinewidth=0.8, label=label)  # fmt: skip
    ax.set_xlim(-0.02, 1.02)
    ax.set_ylim(-0.02, 1.02)
    ax.set_aspect("equal")
    ax.set_xlabel("stated probability")
    ax.set_ylabel("fraction correct")
    figure.legend(loc="outside upper center", ncols=2, fontsize=7)
    return figure
