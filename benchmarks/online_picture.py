"""Figure of the online filter, for ``docs/online.md``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import norm

from bayes_asv.tracking.track import track
from benchmarks.online_runs import faded_share, long_drive
from tests.posterior.cases import DECLARED, case, vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PICTURE", "draw_picture"]

Row = dict[str, Any]

PICTURE = Path(__file__).parents[1] / "docs" / "online.png"

_FRONT, _TRUE = "#1b6ca8", "#c0392b"
_Z95 = 1.959964
_LOSS, _FADE = 0.3, 20.0


def draw_picture(results: Row) -> None:
    """Draw a drive over a bump, a fading damper, and the errors of all runs.

    Parameters
    ----------
    results : dict
        Results of :mod:`benchmarks.online`; the drives of the first two panels are its seeds.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12.4, 4.0), layout="constrained")
    _learning(left, results["coverage"]["seed"])
    _fading(middle, results["change"]["seed"])
    _errors(right, results["coverage"]["rows"])
    for axes in (left, middle, right):
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(PICTURE, dpi=120, metadata={"Software": None})
    plt.close(figure)


def _learning(axes: Axes, seed: int) -> None:
    car, _, recording = case("bump", seed, DECLARED)
    frames = track(recording, vehicle(DECLARED)).frames
    share = frames.median[:, 0] / car.c_f
    half = np.exp(_Z95 * frames.log_sd[:, 0])
    axes.fill_between(frames.time, share / half, share * half, color=_FRONT, alpha=0.25, lw=0.0)
    axes.plot(frames.time, share, color=_FRONT, lw=1.4, label="filter, 95 % band")
    axes.axhline(1.0, color=_TRUE, lw=1.0, ls="--", label="truth")
    axes.set(
        ylim=(0.8, 1.2), xlim=(0.0, 2.0), xlabel="time, s",
        ylabel="front damping rate over its true value", title="Learning, over one bump",
    )  # fmt: skip
    axes.legend(frameon=False, loc="upper right")


def _fading(axes: Axes, seed: int) -> None:
    car, recording = long_drive(24.0, 400.0, seed, loss=_LOSS)
    given = vehicle(DECLARED)
    frames = track(recording, given, forget=60.0).frames
    true = faded_share(frames.time, _LOSS, _FADE)
    share = frames.median[:, 0] / car.c_f
    half = np.exp(_Z95 * frames.log_sd[:, 0])
    axes.fill_between(frames.time, share / half, share * half, color=_FRONT, alpha=0.25, lw=0.0)
    axes.plot(frames.time, share, color=_FRONT, lw=1.2, label="filter, 95 % band")
    axes.plot(frames.time, true, color=_TRUE, lw=1.0, ls="--", label="truth")
    axes.set(
        ylim=(0.6, 1.1), xlim=(0.0, 24.0), xlabel="time, s",
        title="Tracking a damper that loses 30 % in 20 s",
    )  # fmt: skip
    axes.legend(frameon=False, loc="upper right")


def _errors(axes: Axes, rows: list[Row]) -> None:
    for knowledge, face, label in (
        ("exact", _FRONT, "given values exact"),
        ("declared", "none", "given values as declared"),
    ):
        own = [r for r in rows if r["knowledge"] == knowledge]
        z = np.sort(np.concatenate([np.array(r["error"]) / r["sd"] for r in own]))
        quantile = norm.ppf((np.arange(len(z)) + 0.5) / len(z))
        axes.scatter(quantile, z, s=11, facecolors=face, edgecolors=_FRONT, lw=0.6, label=label)
    ends = np.array([-3.4, 3.4])
    axes.plot(ends, ends, color="black", lw=0.9)
    axes.set(
        xlim=ends, ylim=ends, xlabel="normal quantile",
        ylabel="error over stated standard deviation",
        title=f"Last errors of c_f, c_r and i in {len(rows)} drives",
    )  # fmt: skip
    axes.legend(frameon=False, loc="upper left")
