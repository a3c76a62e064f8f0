"""The reference's figures drawn again from our data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.units import INCH
from bayes_asv.domain.vehicle import Travel
from bayes_asv.reference.experiments import ExactStates, Readings, Run
from bayes_asv.reference.greybox import PointEstimate
from bayes_asv.reference.integrated import Integrated
from bayes_asv.reference.spectral import SpectralStudy
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel, style

__all__ = ["Figure", "draw_figures"]

Array = NDArray[np.float64]

_WIDTH: Final = 7.6
_MODEL_COLOUR, _REFERENCE_COLOUR = COLOURS["front"], COLOURS["ink"]


class Figure(NamedTuple):
    """One figure with its number in the reference, title and caption."""

    number: str
    title: str
    caption: str
    panel: Panel


def draw_figures(
    studies: Sequence[SpectralStudy],
    exact: ExactStates,
    channels: Readings,
    engine: Readings,
    runs: Sequence[Run],
    travel: Travel,
) -> list[Figure]:
    """Draw every figure, in the order of the reference.

    Parameters
    ----------
    studies : sequence of SpectralStudy
        Fig. 4.1.
    exact : ExactStates
        Fig. 5.2.
    channels, engine : Readings
        Fig. 6.6 and 7.2.
    runs : sequence of Run
        Fig. 8.1 and 8.2 from the first, 8.3 and 8.4 from the second, 8.5 from both.
    travel : Travel
        Limits drawn in Fig. 8.5.
    """
    with style():
        figures = [
            Figure(
                "3.1",
                "The half car",
                "Wheel positions are inputs, so the model has no tyres and unsprung masses. Pitch "
                "is positive nose-up, as in eq. 5.5; in Fig. 3.2 it is nose-down.",
                draw_half_car(),
            ),
            Figure(
                "4.1",
                "Frequency content at 10, 30 and 70 % damping",
                "Front chassis velocity over white noise: one record of 20 s, the mean of ten "
                "minutes, and the theoretical spectrum. Dotted lines are the damped frequencies. "
                "At 10 % there are two peaks, which the scatter of one record hides; from 30 % on "
                "the theoretical spectrum has no second peak.",
                _spectra(studies),
            ),
            Figure(
                "5.2",
                "Inputs and outputs of the simulation",
                "The car of Table 5.1 over one bump, 300 points: wheels on the left, states on the "
                "right.",
                _states(
                    "figure-5-2", exact.time, exact.u, exact.y, None,
                    "inputs and states of the simulated car over one bump",
                ),
            ),
            Figure(
                "6.6",
                "All channels on one sensor at 800 Hz",
                "The second channel of each board is sampled 0.675 ms after the first and differs "
                "from it wherever the signal is steep.",
                _channels(channels),
            ),
            Figure(
                "7.2",
                "Engine",
                "Standing car with an engine of random speed, a single cylinder without balancer, "
                "at 200 Hz. The unbalance is our choice, not a measurement.",
                _engine(engine),
            ),
        ]  # fmt: skip
        for run, first, second in zip(runs, ("8.1", "8.3"), ("8.2", "8.4"), strict=True):
            detrending = run.reference_detrending
            data, estimate = run.integrated[detrending], run.reference_fits[detrending]
            removed = {"trend": "linear trend", "constant": "constant"}[detrending]
            rate = "400" if first == "8.1" else "800"
            figures += [
                Figure(
                    first,
                    f"Accelerations at {rate} Hz, {removed} removed",
                    f"Shipped run {run.name}, simulated with known true values.",
                    _accelerations(first, data),
                ),
                Figure(
                    second,
                    f"The same data integrated, and the reference's model ({rate} Hz)",
                    "Integrated once and twice (black) and the model with its grey-box estimates "
                    "(blue). The difference is drift: slow, and largest in the displacements.",
                    _states(
                        f"figure-{second.replace('.', '-')}", data.time, data.u, data.y, estimate,
                        f"states integrated from the {rate} Hz run against the model",
                    ),
                ),
            ]  # fmt: skip
        figures.append(
            Figure(
                "8.5",
                "Suspension travel",
                "By double integration (grey, after each kind of detrending; black, that of the "
                "reference) and from the fit in deflections (coloured), which cannot drift. "
                "Whether the integrated travel reaches a stop depends on the detrending, not on "
                "the car. Dashed: rear stops.",
                _travel(runs, travel),
            )
        )
    return figures


def _spectra(studies: Sequence[SpectralStudy]) -> Panel:
    figure = canvas(_WIDTH, 2.9)
    for axes, study in zip(figure.subplots(1, len(studies), sharey=True), studies, strict=True):
        level = float(study.expected[:, 0].max())
        axes.plot(study.frequency, study.single[:, 0] / level, color=COLOURS["grid"], zorder=1)
        axes.plot(study.frequency, study.mean[:, 0] / level, color=_MODEL_COLOUR)
        axes.plot(study.frequency, study.expected[:, 0] / level, color=_REFERENCE_COLOUR)
        for mode in study.modes:
            if mode.damped > 0.0:
                axes.axvline(mode.damped, color=COLOURS["rear"], linestyle=":", linewidth=1.2)
        axes.set(xlabel="frequency [Hz]", ylim=(0.0, 2.0), title=f"{100 * study.damping:.0f} %")
    first = figure.axes[0]
    first.set_ylabel("spectral density, peak = 1")
    names = ("one record of 20 s", "mean of 10 min", "theoretical", "damped frequency")
    figure.legend(first.get_lines()[:4], names, loc="outside lower center", ncols=4)
    alt = "spectra of the chassis over white noise at three dampings"
    return panel(figure, "figure-4-1", alt, wide=True)


def _states(
    key: str, time: Array, u: Array, y: Array, estimate: PointEstimate | None, alt: str
) -> Panel:
    """Four inputs on the left, four states on the right."""
    figure = canvas(_WIDTH, 5.6)
    grid = figure.subplots(4, 2, sharex=True)
    left = ("front wheel\n[in]", "front wheel\n[in/s]", "rear wheel\n[in]", "rear wheel\n[in/s]")
    right = ("pitch\n[rad]", "pitch rate\n[rad/s]", "heave\n[in]", "heave rate\n[in/s]")
    for row in range(4):
        grid[row, 0].plot(time, u[:, row] / INCH, color=_REFERENCE_COLOUR)
        scale = 1.0 if row < 2 else INCH
        grid[row, 1].plot(time, y[:, row] / scale, color=_REFERENCE_COLOUR, label="integrated")
        if estimate is not None:
            grid[row, 1].plot(
                time, estimate.simulated[:, row] / scale, color=_MODEL_COLOUR, label="model"
            )
        grid[row, 0].set_ylabel(left[row])
        grid[row, 1].set_ylabel(right[row])
    for column in (0, 1):
        grid[3, column].set_xlabel("time [s]")
    grid[0, 0].set_title("inputs")
    grid[0, 1].set_title("outputs")
    if estimate is not None:
        recordings = grid[0, 1].get_lines()
        names = ("integrated", "model")
        figure.legend(recordings, names, loc="outside lower center", ncols=2)
    figure.align_ylabels()
    return panel(figure, key, alt, wide=True)


def _channels(bench: Readings) -> Panel:
    figure = canvas(_WIDTH, 2.8)
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


def _engine(bench: Readings) -> Panel:
    figure = canvas(_WIDTH, 3.2)
    for axes, k, name in zip(figure.subplots(2, 1, sharex=True), (0, 1), ("front", "rear"),
                             strict=True):  # fmt: skip
        axes.plot(bench.time, bench.values[:, k] / INCH, color=COLOURS[name], linewidth=0.8)
        axes.set_ylabel(f"{name} chassis\n[in/s²]")
    axes.set_xlabel("time [s]")
    return panel(figure, "figure-7-2", "acceleration of the standing car, engine on", wide=True)


def _accelerations(number: str, data: Integrated) -> Panel:
    figure = canvas(_WIDTH, 4.6)
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
    figure = canvas(_WIDTH, 4.8)
    grid = figure.subplots(2, len(runs), sharex="col", sharey=True)
    for column, run in enumerate(runs):
        for row, name in enumerate(("front", "rear")):
            axes = grid[row, column]
            for detrending, data in run.integrated.items():
                of_reference = detrending == run.reference_detrending
                axes.plot(
                    data.time, data.travel[row] / INCH,
                    color=_REFERENCE_COLOUR if of_reference else COLOURS["grid"],
                    zorder=2 if of_reference else 1,
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


_FRONT, _REAR, _CG = 8.0, 0.0, 3.76  # nose to the right, centre of gravity at wdf = 0.47


def draw_half_car() -> Panel:
    """Draw the half car: chassis on springs and dampers, wheels as inputs."""
    figure = canvas(width=7.0, height=3.4)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_aspect("equal")
    ink = COLOURS["ink"]
    axes.plot([_REAR - 0.7, _FRONT + 0.7], [4.0, 4.0], color=ink, linewidth=5.0)
    axes.plot([_CG], [4.0], "o", color=ink, markersize=9, markerfacecolor="white")
    axes.text(_CG - 0.15, 4.55, "CG", ha="right")
    axes.text(_CG + 1.9, 4.4, "m, i", ha="center", fontsize=11)
    for x, s, colour in ((_FRONT, "f", "front"), (_REAR, "r", "rear")):
        paint = COLOURS[colour]
        _spring(axes, x - 0.45, 1.2, 4.0, paint)
        _damper(axes, x + 0.45, 1.2, 4.0, paint)
        axes.plot([x - 0.8, x + 0.8], [1.2, 1.2], color=paint, linewidth=2.5)
        axes.text(x - 0.85, 2.6, f"k{_SUB[s]}", ha="right", color=paint, fontsize=11)
        axes.text(x + 0.85, 2.6, f"c{_SUB[s]}", ha="left", color=paint, fontsize=11)
        _arrow(axes, (x, 0.25), (x, 1.15), paint)
        axes.text(x + 0.2, 0.45, f"u{_SUB[s]}", color=paint, fontsize=11)
        end = 1.3 if s == "f" else -1.3
        _arrow(axes, (x + end, 4.0), (x + end, 5.0), ink)
        axes.text(x + end, 5.1, f"x{_SUB[s]}", ha="center", fontsize=11)
    _arrow(axes, (_CG, 4.2), (_CG, 5.6), ink)
    axes.text(_CG + 0.2, 5.4, "x", fontsize=11)
    turn = np.linspace(-0.2, 0.9, 30)
    axes.plot(_CG + 1.2 * np.cos(turn), 4.0 + 1.2 * np.sin(turn), color=ink, linewidth=1.2)
    _arrow(axes, (_CG + 1.2 * np.cos(0.8), 4.0 + 1.2 * np.sin(0.8)),
           (_CG + 1.2 * np.cos(1.0), 4.0 + 1.2 * np.sin(1.0)), ink)  # fmt: skip
    axes.text(_CG + 1.0, 5.1, "θ", fontsize=11)
    for left, right, word in ((_REAR, _CG, f"l{_SUB['r']} = l·wdf"),
                              (_CG, _FRONT, f"l{_SUB['f']} = l·(1−wdf)")):  # fmt: skip
        style = {"arrowstyle": "<->", "color": COLOURS["muted"], "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (left, 6.1), (right, 6.1), arrowprops=style)
        axes.text(0.5 * (left + right), 6.25, word, ha="center", color=COLOURS["muted"])
    axes.text(_FRONT + 1.9, 2.6, "front", color=COLOURS["front"], ha="left")
    axes.text(_REAR - 1.9, 2.6, "rear", color=COLOURS["rear"], ha="right")
    axes.set(xlim=(-3.2, 11.2), ylim=(0.0, 6.9))
    alt = (
        "Half car: a rigid chassis of mass m and pitch inertia i on a spring and a damper at each "
        "axle; wheel positions u are the inputs; heave x and pitch θ, nose up, are the degrees of "
        "freedom"
    )
    return panel(figure, "figure-3-1", alt, wide=True)


_SUB = {"f": "_f", "r": "_r"}


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0, "linewidth": 1.2}
    axes.annotate("", end, start, arrowprops=style)


def _spring(axes: Any, x: float, low: float, high: float, colour: str) -> None:
    turns = 7
    y = np.concatenate([[low], np.linspace(low + 0.5, high - 0.5, 2 * turns), [high]])
    side = np.concatenate([[0.0], 0.22 * (-1.0) ** np.arange(2 * turns), [0.0]])
    side[[1, -2]] = 0.0
    axes.plot(x + side, y, color=colour, linewidth=1.4)


def _damper(axes: Any, x: float, low: float, high: float, colour: str) -> None:
    middle = 0.5 * (low + high)
    axes.plot([x, x], [low, middle - 0.5], color=colour, linewidth=1.4)
    axes.plot([x - 0.24, x - 0.24, x + 0.24, x + 0.24],
              [middle + 0.4, middle - 0.5, middle - 0.5, middle + 0.4],
              color=colour, linewidth=1.4)  # fmt: skip
    axes.plot([x - 0.17, x + 0.17], [middle, middle], color=colour, linewidth=2.2)
    axes.plot([x, x], [middle, high], color=colour, linewidth=1.4)
