"""Figure of ``docs/roomster.md``: coherence bound, drives, and a prediction between drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.roomster.drives import WORKED_ON

__all__ = ["PICTURE", "draw_picture"]

Row = dict[str, Any]

PICTURE = Path(__file__).parents[2] / "docs" / "roomster.png"
FRONT, REAR, GREY = "#1b6ca8", "#c0392b", "#555555"


def draw_picture(result: Row) -> None:
    """Draw the figure from the results."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(11.0, 7.6), layout="constrained")
    grid = figure.add_gridspec(2, 6)
    _bound(figure.add_subplot(grid[0, :3]), result)
    for k, (name, words) in enumerate(
        (
            ("c_f", "front damping, N·s/m"),
            ("c_r", "rear damping, N·s/m"),
            ("i", "pitch inertia, kg·m²"),
        )
    ):
        _drives(figure.add_subplot(grid[0, 3 + k]), result, name, words, k == 0)
    for k, axle in enumerate(("front", "rear")):
        _predicted(figure.add_subplot(grid[1, 3 * k : 3 * k + 3]), result["shown"], axle)
    figure.savefig(PICTURE, dpi=110)
    plt.close(figure)


def _bound(axes: Any, result: Row) -> None:
    """Draw the residual power of any linear relation and of the half car over frequency."""
    rows = result["coherence"]
    edges = np.array([band[0] for band in rows[WORKED_ON[0]]["bands"]] + [20.0])
    for axle, (word, colour) in enumerate((("front", FRONT), ("rear", REAR))):
        for key, style, label in (
            ("left_by_half_car", "-", "the half car"),
            ("left_by_any", "--", "any linear relation"),
        ):
            each = np.array([np.array(row[key])[:, axle] for row in rows.values()])
            axes.stairs(
                100.0 * np.minimum(each.mean(axis=0), 1.2), edges, color=colour, ls=style, lw=1.6,
                label=f"{word}: {label}", baseline=None,
            )  # fmt: skip
    axes.axvline(result["below"], color=GREY, lw=0.9, ls=":")
    axes.text(result["below"] * 1.04, 108, "band used", color=GREY, fontsize=8)
    axes.set(
        xscale="log", xlabel="frequency, Hz", ylabel="residual power, %", ylim=(0, 115),
        title="Unexplained chassis power, mean of four drives",
    )  # fmt: skip
    axes.set_xticks([0.5, 1, 2, 4, 8, 16], ["0.5", "1", "2", "4", "8", "16"])
    axes.minorticks_off()
    axes.legend(fontsize=8, frameon=False, loc="upper left")


def _drives(axes: Any, result: Row, name: str, words: str, named: bool) -> None:
    """Draw the 95 % interval of each drive, and that of the mean car with the random effects."""
    for k, drive in enumerate(WORKED_ON):
        row = result["posterior"][drive][name]
        axes.plot([k, k], row["eti95"], color=GREY, lw=1.2)
        own, sd = (result["between"]["own"][name][j][k] for j in range(2))
        axes.plot([k, k], [own - 1.96 * sd, own + 1.96 * sd], color=FRONT, lw=4.5, alpha=0.75)
        axes.plot(k, own, "o", color="white", ms=3)
    car = result["between"]["mean_car"][name]
    axes.axhspan(*car["eti95"], color=REAR, alpha=0.13, lw=0)
    axes.axhline(car["mean"], color=REAR, lw=1.0)
    axes.set_xticks(range(len(WORKED_ON)), WORKED_ON, rotation=60, fontsize=8)
    axes.tick_params(axis="y", labelsize=8)
    axes.set_title(words, fontsize=9)
    axes.set_xlim(-0.6, len(WORKED_ON) - 0.4)
    low = min(result["posterior"][drive][name]["eti95"][0] for drive in WORKED_ON)
    high = max(result["posterior"][drive][name]["eti95"][1] for drive in WORKED_ON)
    axes.set_ylim(low - 0.08 * (high - low), high + (0.45 if named else 0.08) * (high - low))
    if named:
        axes.plot([], [], color=GREY, lw=1.2, label="givens free")
        axes.plot([], [], color=FRONT, lw=4.5, alpha=0.75, label="givens fixed")
        axes.fill_between([], [], color=REAR, alpha=0.2, label="mean car")
        axes.legend(fontsize=7, frameon=False, loc="upper left")


def _predicted(axes: Any, shown: Row, axle: str) -> None:
    """Draw measured readings and the predictive band of a model estimated from another drive."""
    time, row = np.array(shown["time"]), shown[axle]
    mean, sd = np.array(row["mean"]), np.array(row["sd"])
    colour = FRONT if axle == "front" else REAR
    axes.fill_between(time, mean - 1.96 * sd, mean + 1.96 * sd, color=colour, alpha=0.18, lw=0)
    axes.plot(time, mean, color=colour, lw=1.4, label=f"model of drive {shown['from']}")
    axes.plot(
        row["read_at"], row["measured"], "k.", ms=4, label=f"measured in drive {shown['drive']}"
    )
    axes.set(xlabel="time, s", title=f"{axle} chassis below 4 Hz, 95 % predictive band")
    axes.set_ylabel("upward acceleration, m/s²")
    axes.legend(fontsize=8, frameon=False, loc="upper right", ncols=2)
