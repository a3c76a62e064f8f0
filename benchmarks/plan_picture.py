"""Figure of a plan and of its validation, for ``docs/plan.md``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv.planning.drives import KINDS, RoadProfile
from bayes_asv.planning.plan import PlanResult
from bayes_asv.planning.predicted_sd import predicted_sd

__all__ = ["PICTURE", "draw_picture"]

Row = dict[str, Any]

PICTURE = Path(__file__).parents[1] / "docs" / "plan.png"


def draw_picture(made: PlanResult, rows: Sequence[Row]) -> None:
    """Draw the figure.

    Parameters
    ----------
    made : PlanResult
        A plan for one car at one sampling rate.
    rows : sequence of dict
        Predicted and posterior deviations of the first part of :mod:`benchmarks.plan`.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    colours = dict(zip(KINDS, ("#1b6ca8", "#c0392b", "#2e8b57", "#8e6c1a"), strict=True))
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.6), layout="constrained")
    lines: dict[RoadProfile, list[tuple[float, float, bool]]] = {}
    for one in made.rated:
        if one.evaluation.usable:
            width = float(
                predicted_sd(one.evaluation.information, 1, made.prior.with_exact_given())["c_f"]
            )
            point = (one.evaluation.drive.speed / 0.44704, 100.0 * width, one.evaluation.gentle)
            lines.setdefault(one.evaluation.drive.road, []).append(point)
    named: set[str] = set()
    for road, points in lines.items():
        x, y, gentle = zip(*sorted(points), strict=True)
        label = None if road.kind in named else road.kind
        named.add(road.kind)
        left.plot(x, y, color=colours[road.kind], lw=1.2, label=label)
        faces = [colours[road.kind] if soft else "white" for soft in gentle]
        left.scatter(x, y, s=22, c=faces, edgecolors=colours[road.kind], zorder=3)
    sd_floor = 100.0 * made.sd_floor["c_f"]
    left.axhline(sd_floor, color="black", lw=0.9, ls="--")
    left.text(20.0, 1.06 * sd_floor, "lower limit for a mass known to 1 %", ha="right", va="bottom")
    left.set(
        yscale="log", xlabel="speed, mph", ylabel="front damping rate: standard deviation, %",
        title="One pass at 400 Hz, given values exact",
    )  # fmt: skip
    left.set_yticks([0.02, 0.05, 0.1, 0.2, 0.5, 1.0], ["0.02", "0.05", "0.1", "0.2", "0.5", "1"])
    left.minorticks_off()
    left.legend(frameon=False, title="filled: gentle", loc="center right")
    for knowledge, face in (("exact", True), ("declared", False)):
        for kind in KINDS:
            mine = [r for r in rows if r["knowledge"] == knowledge and r["road"] == kind]
            if mine:
                x_ = 100.0 * np.array([r["promised"] for r in mine])[:, :3].ravel()
                y_ = 100.0 * np.array([r["posterior"] for r in mine])[:, :3].ravel()
                face_ = colours[kind] if face else "none"
                right.scatter(x_, y_, s=12, facecolors=face_, edgecolors=colours[kind], lw=0.7)
    ends = np.array([0.008, 3.0])
    right.plot(ends, ends, color="black", lw=0.9)
    right.fill_between(ends, ends / 1.5, ends * 1.5, color="black", alpha=0.08, lw=0.0)
    right.set(
        xscale="log", yscale="log", xlim=ends, ylim=ends, xlabel="predicted standard deviation, %",
        ylabel="posterior on the simulator, %",
        title="Damping rates and inertia; band: factor 1.5",
    )  # fmt: skip
    ticks = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0]
    for axis in (right.xaxis, right.yaxis):
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    right.minorticks_off()
    for axes in (left, right):
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    right.scatter([], [], s=12, color="0.3", label="given values exact")
    right.scatter(
        [], [], s=12, facecolors="none", edgecolors="0.3", label="given values as declared"
    )
    right.legend(frameon=False, loc="upper left")
    figure.savefig(PICTURE, dpi=130, metadata={"Software": None})
    plt.close(figure)
