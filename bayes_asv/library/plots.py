"""Figures of the results as matplotlib axes, which the caller may go on drawing in.

The report draws its own for print; these take the user's matplotlib style and its colours.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.report.sections.parameters import answers, log_normal_prior
from bayes_asv.report.sections.travel import velocity_shares
from bayes_asv.report.svg import COLOURS, axle_colour, curve_array
from bayes_asv.report.words import LABELS, labelled, percent, readable_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bayes_asv.report.schema import DiagnoseDocument, EstimateDocument, TrackDocument

__all__ = ["DiagnosisPlots", "EstimatePlots", "TrackPlots"]

Array = NDArray[np.float64]

_DASHES = (0, (5, 3))
_WIDTH = 4.0  # inches of one panel
_BINS = 41


class EstimatePlots:
    """Figures of an estimate; each method returns an array of matplotlib axes."""

    def __init__(self, document: EstimateDocument):
        self._document = document

    def posterior(self, *names: str) -> NDArray[np.object_]:
        """Draw posterior, prior and nominal value of parameters.

        Parameters
        ----------
        *names : str
            All but the damping ratios by default.

        Returns
        -------
        (N,) array of matplotlib.axes.Axes
        """
        document = self._document
        shown = [n for n in (names or answers(document.parameters)) if n in document.parameters]
        if not shown:
            raise InputError("plot.posterior", "there is no such parameter", _why(document))
        axes = _row(len(shown), 2.8)
        for ax, name in zip(axes, shown, strict=True):
            p, paint = document.parameters[name], axle_colour(LABELS[name])
            draws = curve_array(document.draws[name])
            ax.hist(draws, bins="auto", density=True, color=paint, alpha=0.6, label="posterior")
            ax.axvspan(*p.eti95, color=paint, alpha=0.15, label="95 %")
            log_normal = log_normal_prior(name, document)
            if log_normal is not None:
                low, high = ax.get_xlim()
                grid = np.linspace(max(low, 1e-6 * high), high, 200)
                z = (np.log(grid) - math.log(log_normal[0])) / log_normal[1]
                height = np.exp(-0.5 * z**2) / (grid * log_normal[1] * math.sqrt(2.0 * math.pi))
                ax.plot(grid, height, color=COLOURS["prior"], label="prior")
            if p.nominal is not None:
                ax.axvline(p.nominal, color=COLOURS["ink"], linestyle=_DASHES, label="nominal")
            ax.set(xlabel=labelled(name, p.label, p.unit), yticks=[])
            ax.legend(frameon=False, fontsize="small")
        return axes

    def simulation(self, recording: int = 0) -> NDArray[np.object_]:
        """Draw the measured and simulated outputs of one recording.

        Parameters
        ----------
        recording : int
            Its place among the recordings.

        Returns
        -------
        (N,) array of matplotlib.axes.Axes
            One an output, accelerations of the chassis first.
        """
        run = self._run(recording)
        outputs = {**run.chassis, **run.outputs}
        axes = _column(len(outputs))
        time = curve_array(run.time)
        for ax, (name, curves) in zip(axes, outputs.items(), strict=True):
            paint = axle_colour(name)
            low, high = (curve_array(side) for side in curves.band95)
            ax.plot(
                time, curve_array(curves.measured), color=COLOURS["ink"], alpha=0.35, linewidth=3.0,
                label="measured",
            )  # fmt: skip
            ax.fill_between(time, low, high, color=paint, alpha=0.25, linewidth=0)
            ax.plot(time, curve_array(curves.simulated), color=paint, label="simulated, 95 %")
            ax.set_ylabel(f"{name.replace('_', ' ')} [{readable_unit(curves.unit or run.unit)}]")
            ax.legend(frameon=False, fontsize="small")
        axes[-1].set_xlabel("time [s]")
        return axes

    def damper_velocity(self) -> NDArray[np.object_]:
        """Draw how long each damper moved at which velocity, all recordings together.

        Returns
        -------
        (N,) array of matplotlib.axes.Axes
            One a damper; compression is negative.
        """
        self._run(0)
        runs = self._document.runs
        places = list(runs[0].travel.entries)
        axes = _row(len(places), 2.8)
        for ax, place in zip(axes, places, strict=True):
            curves = [run.travel.entries[place] for run in runs]
            velocity = np.concatenate([curve_array(c.velocity) for c in curves])
            reach = float(np.nanmax(np.abs(velocity))) or 1.0
            weights = np.full(len(velocity), 100.0 / len(velocity))
            edges = np.linspace(-reach, reach, _BINS).tolist()
            ax.hist(velocity, bins=edges, weights=weights, color=axle_colour(place))
            compression, _, rebound = velocity_shares(runs, place)
            ax.set_title(
                f"compression {percent(compression)}, rebound {percent(rebound)}", fontsize="medium"
            )
            unit = readable_unit(runs[0].travel.velocity_unit)
            words = place.replace("_", " ")
            ax.set(yscale="log", xlabel=f"{words} damper velocity [{unit}]", ylabel="time [%]")
        return axes

    def _run(self, recording: int) -> Any:
        runs = self._document.runs
        if not runs:
            raise InputError("plot", "there is no simulation", _why(self._document))
        if not -len(runs) <= recording < len(runs):
            raise InputError(f"recording {recording}", "does not exist", f"there are {len(runs)}")
        return runs[recording]


class DiagnosisPlots:
    """Figures of a diagnosis; each method returns matplotlib axes."""

    def __init__(self, document: DiagnoseDocument):
        self._document = document

    def simulation_error(self) -> Axes:
        """Draw the simulation error before and after, and what sensor noise alone leaves."""
        gap = self._document.gap
        there = {"fitted": gap.fit, "held out": gap.holdout}
        bars = {name: error for name, error in there.items() if error is not None}
        if not bars:
            raise InputError("plot", "there is no simulation", _why(self._document))
        ax = _single()
        for n, (key, colour) in enumerate(
            (("before", "muted"), ("after", "good"), ("floor", "prior"))
        ):
            places = np.arange(len(bars)) + 0.27 * (n - 1)
            values = [getattr(error, key) for error in bars.values()]
            label = "sensor noise" if key == "floor" else key
            ax.bar(places, values, width=0.24, color=COLOURS[colour], label=label)
        ax.set_xticks(range(len(bars)), list(bars))
        ax.set_ylabel(f"rms of measured − simulated [{readable_unit(gap.unit)}]")
        ax.legend(frameon=False, fontsize="small")
        return ax

    def parameters(self) -> Axes:
        """Draw each parameter before and after, relative to nominal, with its 95 % interval."""
        from bayes_asv.report.sections.simulation_error import asked

        before, after = self._document.parameters_before, self._document.parameters_after
        names = [n for n in asked(self._document) if n in before and after[n].nominal]
        if not names:
            raise InputError("plot", "there are no parameters", _why(self._document))
        ax = _single()
        sides = (("before", before, -0.12, "muted"), ("after", after, 0.12, "good"))
        for label, parameters, shift, colour in sides:
            for row, name in enumerate(names):
                p = parameters[name]
                nominal = after[name].nominal or 1.0
                low, high = (100.0 * x / nominal for x in p.eti95)
                mean = 100.0 * p.mean / nominal
                ax.errorbar(
                    mean, row + shift, xerr=[[mean - low], [high - mean]], fmt="o",
                    color=COLOURS[colour], label=label if row == 0 else None,
                )  # fmt: skip
        ax.axvline(100.0, color=COLOURS["ink"], linestyle=_DASHES)
        ax.set_yticks(range(len(names)), [labelled(n, "", "") for n in names])
        ax.invert_yaxis()
        ax.set_xlabel("percent of nominal")
        ax.legend(frameon=False, fontsize="small")
        return ax


class TrackPlots:
    """Figures of a track; each method returns matplotlib axes."""

    def __init__(self, document: TrackDocument):
        self._document = document

    def parameters(self) -> NDArray[np.object_]:
        """Draw each parameter with its 95 % band against time.

        Returns
        -------
        (3,) array of matplotlib.axes.Axes
            Of ``c_f``, ``c_r`` and ``i``.
        """
        curves = self._curves()
        axes = _column(len(curves.parameters))
        time = curve_array(curves.time)
        for ax, (name, curve) in zip(axes, curves.parameters.items(), strict=True):
            paint = axle_colour(LABELS[name])
            low, high = (curve_array(side) for side in curve.band95)
            ax.fill_between(time, low, high, color=paint, alpha=0.3, linewidth=0)
            ax.plot(time, curve_array(curve.median), color=paint)
            nominal = self._document.parameters[name].nominal
            if nominal is not None:
                ax.axhline(nominal, color=COLOURS["ink"], linestyle=_DASHES)
                last = float(high[-1] - low[-1])
                shown = (nominal, float(low[-1]) - 5.0 * last, float(high[-1]) + 5.0 * last)
                ax.set_ylim(min(shown) - last, max(shown) + last)
            ax.set_ylabel(labelled(name, "", curve.unit).replace(" [", "\n["))
        axes[-1].set_xlabel("time [s]")
        return axes

    def consistency(self) -> Axes:
        """Draw the mean normalised innovation squared with its 95 % band against time."""
        curves = self._curves()
        ax = _single()
        time = curve_array(curves.time)
        low, high = (curve_array(side) for side in curves.nis.band95)
        ax.fill_between(time, low, high, color=COLOURS["good"], alpha=0.25, label="95 % band")
        ax.plot(time, curve_array(curves.nis.mean), color=COLOURS["ink"], label="mean NIS")
        ax.set(xlabel="time [s]", ylabel="normalised innovation squared")
        ax.legend(frameon=False, fontsize="small")
        return ax

    def _curves(self) -> Any:
        if self._document.track is None:
            raise InputError("plot", "there are no curves", _why(self._document))
        return self._document.track


def _why(document: Any) -> str:
    return "; ".join(document.reasons) or f"the verdict is {document.verdict!r}"


def _single() -> Axes:
    axes: Axes = _row(1, 2.8)[0]
    return axes


def _row(count: int, height: float) -> NDArray[np.object_]:
    """Axes side by side, in the current pyplot so that a notebook shows them."""
    from matplotlib import pyplot

    _, axes = pyplot.subplots(
        1, count, figsize=(_WIDTH * max(count, 1.4), height), layout="constrained", squeeze=False
    )
    return np.asarray(axes[0])


def _column(count: int) -> NDArray[np.object_]:
    """Axes below each other with a common time."""
    from matplotlib import pyplot

    _, axes = pyplot.subplots(
        count, 1, figsize=(2.2 * _WIDTH, 2.2 * count), layout="constrained", sharex=True,
        squeeze=False,
    )  # fmt: skip
    return np.asarray(axes[:, 0])
