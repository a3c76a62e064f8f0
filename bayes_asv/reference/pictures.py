"""The reference's figures drawn again from our data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Travel
from bayes_asv.reference.bench import Bench
from bayes_asv.reference.drawing import half_car
from bayes_asv.reference.greybox import PointEstimate
from bayes_asv.reference.integrated import Integrated
from bayes_asv.reference.roundtrip import Exact
from bayes_asv.reference.runs import Run
from bayes_asv.reference.spectral import Study
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel, style

__all__ = ["Picture", "pictures"]

Array = NDArray[np.float64]

INCH: Final = 0.0254
_WIDE: Final = 7.6
_OURS, _THEIRS = COLOURS["front"], COLOURS["ink"]


class Picture(NamedTuple):
    """One figure: its number in the reference, what it shows, and what to see in it."""

    number: str
    title: str
    caption: str
    panel: Panel


def pictures(
    studies: Sequence[Study],
    exact: Exact,
    channels: Bench,
    engine: Bench,
    runs: Sequence[Run],
    travel: Travel,
) -> list[Picture]:
    """Draw every figure, in the order of the reference.

    Parameters
    ----------
    studies : sequence of Study
        Fig. 4.1.
    exact : Exact
        Fig. 5.2.
    channels, engine : Bench
        Fig. 6.6 and 7.2.
    runs : sequence of Run
        Fig. 8.1 and 8.2 from the first, 8.3 and 8.4 from the second, 8.5 from both.
    travel : Travel
        Limits drawn in Fig. 8.5.
    """
    with style():
        found = [
            Picture(
                "3.1",
                "The half car",
                "Wheel positions are inputs, so neither tyres nor unsprung masses are in it. Pitch "
                "is nose-up here, as in eq. 5.5; Fig. 3.2 has it nose-down.",
                half_car(),
            ),
            Picture(
                "4.1",
                "Frequency content at 10, 30 and 70 % damping",
                "Front chassis velocity over white noise: one record of 20 s, the mean of ten "
                "minutes, and what an endless record shows. Dotted lines are the damped "
                "frequencies. At 10 % there are two peaks, which one record hides in its own "
                "scatter; from 30 % on the second peak does not exist, however long the record.",
                _spectra(studies),
            ),
            Picture(
                "5.2",
                "Inputs and outputs of the simulation",
                "The car of Table 5.1 over one bump, 300 points: wheels on the left, states on the "
                "right.",
                _states(
                    "figure-5-2", exact.time, exact.u, exact.y, None,
                    "inputs and states of the simulated car over one bump",
                ),
            ),
            Picture(
                "6.6",
                "All channels on one sensor at 800 Hz",
                "The second channel of each board is read 0.675 ms after the first and lies beside "
                "it wherever the signal is steep.",
                _channels(channels),
            ),
            Picture(
                "7.2",
                "Engine",
                "Car standing, engine revved at random, 200 Hz: a single cylinder without a "
                "balancer. How strongly it shakes is our choice, not a measurement.",
                _engine(engine),
            ),
        ]  # fmt: skip
        for run, first, second in zip(runs, ("8.1", "8.3"), ("8.2", "8.4"), strict=True):
            data, estimate = run.integrated[run.usual], run.its_way[run.usual]
            removed = {"trend": "the linear trend", "constant": "a constant"}[run.usual]
            rate = "400" if first == "8.1" else "800"
            found += [
                Picture(
                    first,
                    f"Accelerations at {rate} Hz, {removed} removed",
                    f"Shipped run {run.name}, simulated, truth known.",
                    _accelerations(first, data),
                ),
                Picture(
                    second,
                    f"The same integrated, against the reference's model ({rate} Hz)",
                    "Integrated once and twice (black) and the model with its grey-box estimates "
                    "(blue). What they differ by is drift: slow, and largest in the displacements.",
                    _states(
                        f"figure-{second.replace('.', '-')}", data.time, data.u, data.y, estimate,
                        f"states integrated from the {rate} Hz run against the model",
                    ),
                ),
            ]  # fmt: skip
        found.append(
            Picture(
                "8.5",
                "Suspension travel",
                "By integrating twice (grey, after each removal; black, the reference's) and from "
                "the fit in deflections (coloured), which cannot drift. Where travel reached a "
                "stop is an answer of the removal, not of the car. Dashed: the rear's stops.",
                _travel(runs, travel),
            )
        )
    return found


def _spectra(studies: Sequence[Study]) -> Panel:
    figure = canvas(_WIDE, 2.9)
    for axes, study in zip(figure.subplots(1, len(studies), sharey=True), studies, strict=True):
        level = float(study.expected[:, 0].max())
        axes.plot(study.frequency, study.single[:, 0] / level, color=COLOURS["grid"], zorder=1)
        axes.plot(study.frequency, study.mean[:, 0] / level, color=_OURS)
        axes.plot(study.frequency, study.expected[:, 0] / level, color=_THEIRS)
        for mode in study.modes:
            if mode.damped > 0.0:
                axes.axvline(mode.damped, color=COLOURS["rear"], linestyle=":", linewidth=1.2)
        axes.set(xlabel="frequency [Hz]", ylim=(0.0, 2.0), title=f"{100 * study.damping:.0f} %")
    first = figure.axes[0]
    first.set_ylabel("spectral density, peak = 1")
    names = ("one record of 20 s", "mean of 10 min", "endless", "damped frequency")
    figure.legend(first.get_lines()[:4], names, loc="outside lower center", ncols=4)
    alt = "spectra of the chassis over white noise at three dampings"
    return panel(figure, "figure-4-1", alt, wide=True)


def _states(
    key: str, time: Array, u: Array, y: Array, estimate: PointEstimate | None, alt: str
) -> Panel:
    """Four inputs on the left, four states on the right."""
    figure = canvas(_WIDE, 5.6)
    grid = figure.subplots(4, 2, sharex=True)
    left = ("front wheel\n[in]", "front wheel\n[in/s]", "rear wheel\n[in]", "rear wheel\n[in/s]")
    right = ("pitch\n[rad]", "pitch rate\n[rad/s]", "heave\n[in]", "heave rate\n[in/s]")
    for row in range(4):
        grid[row, 0].plot(time, u[:, row] / INCH, color=_THEIRS)
        scale = 1.0 if row < 2 else INCH
        grid[row, 1].plot(time, y[:, row] / scale, color=_THEIRS, label="integrated")
        if estimate is not None:
            grid[row, 1].plot(time, estimate.simulated[:, row] / scale, color=_OURS, label="model")
        grid[row, 0].set_ylabel(left[row])
        grid[row, 1].set_ylabel(right[row])
    for column in (0, 1):
        grid[3, column].set_xlabel("time [s]")
    grid[0, 0].set_title("inputs")
    grid[0, 1].set_title("outputs")
    if estimate is not None:
        lines = grid[0, 1].get_lines()
        names = ("integrated", "model")
        figure.legend(lines, names, loc="outside lower center", ncols=2)
    figure.align_ylabels()
    return panel(figure, key, alt, wide=True)


def _channels(bench: Bench) -> Panel:
    figure = canvas(_WIDE, 2.8)
    axes = figure.subplots()
    marks = ("o", "s", "x", "+")
    for k, name in enumerate(CHANNELS):
        colour = COLOURS["front"] if k % 2 == 0 else COLOURS["rear"]
        axes.plot(
            bench.time, bench.values[:, k], marks[k], color=colour, markersize=4.5,
            markerfacecolor="none", label=name.replace("_", " "),
        )  # fmt: skip
    shown = (bench.time > 0.052) & (bench.time < 0.078)  # on a slope
    low, high = bench.values[shown].min(), bench.values[shown].max()
    axes.set(xlabel="time [s]", ylabel="counts", xlim=(0.052, 0.078), ylim=(low - 5, high + 5))
    axes.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return panel(figure, "figure-6-6", "four channels that read one sensor", wide=True)


def _engine(bench: Bench) -> Panel:
    figure = canvas(_WIDE, 3.2)
    for axes, k, name in zip(figure.subplots(2, 1, sharex=True), (0, 1), ("front", "rear"),
                             strict=True):  # fmt: skip
        axes.plot(bench.time, bench.values[:, k] / INCH, color=COLOURS[name], linewidth=0.8)
        axes.set_ylabel(f"{name} chassis\n[in/s²]")
    axes.set_xlabel("time [s]")
    return panel(figure, "figure-7-2", "acceleration of the standing car, engine on", wide=True)


def _accelerations(number: str, data: Integrated) -> Panel:
    figure = canvas(_WIDE, 4.6)
    every: Any = figure.subplots(4, 1, sharex=True)
    for k, (axes, name) in enumerate(zip(every, CHANNELS, strict=True)):
        colour = COLOURS["front" if name.startswith("front") else "rear"]
        axes.plot(data.time, data.acceleration[k] / INCH, color=colour, linewidth=0.9)
        axes.set_ylabel(name.replace("_", "\n") + "\n[in/s²]")
    every[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    alt = "four accelerations of one run, up is positive"
    return panel(figure, f"figure-{number.replace('.', '-')}", alt, wide=True)


def _travel(runs: Sequence[Run], limits: Travel) -> Panel:
    figure = canvas(_WIDE, 4.8)
    grid = figure.subplots(2, len(runs), sharex="col", sharey=True)
    for column, run in enumerate(runs):
        for row, name in enumerate(("front", "rear")):
            axes = grid[row, column]
            for removal, data in run.integrated.items():
                ours = removal == run.usual
                axes.plot(
                    data.time, data.travel[row] / INCH,
                    color=_THEIRS if ours else COLOURS["grid"], zorder=2 if ours else 1,
                )  # fmt: skip
            fit = run.deflection
            axes.plot(fit.time, fit.travel[:, row] / INCH, color=COLOURS[name], zorder=3)
            for side, sign in (("bump", -1.0), ("droop", 1.0)):
                limit = getattr(limits, f"{name}_{side}")
                if limit is not None:
                    axes.axhline(sign * limit / INCH, color=COLOURS["muted"], linestyle="--")
            axes.set_ylim(-8.0, 8.0)
            if column == 0:
                axes.set_ylabel(f"{name} travel [in],\nextension +")
        grid[0, column].set_title(run.name.removesuffix(".csv"))
        grid[1, column].set_xlabel("time [s]")
    alt = "suspension travel by integration, which drifts, and from the fit, which does not"
    return panel(figure, "figure-8-5", alt, wide=True)
