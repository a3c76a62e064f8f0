"""The online filter: headline, consistency, curves against time, and the alarm of ``watch``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report import svg
from bayes_asv.report.schema import TrackDocument, WatchDocument
from bayes_asv.report.schema.parts import Parameter
from bayes_asv.report.schema.track import Consistency
from bayes_asv.report.sections.blocks import Block, Figure, Section, Text
from bayes_asv.report.words import (
    LABELS,
    capitalized,
    labelled,
    number,
    percent,
    plain,
    probability,
    readable_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "DETAILS_SECTION",
    "INCONSISTENT_STEPS",
    "LAST_STATE",
    "RECOVERED",
    "SECTION",
    "UNEXPLAINED",
    "consistency_lines",
    "is_inconsistent",
    "last_state",
    "track_subtitle",
    "watch_lines",
]

Array = NDArray[np.float64]

RECOVERED: Final = "The filter was inconsistent for some time and has recovered."
UNEXPLAINED: Final = (
    "the {car} car and the sensors of the vehicle file do not explain this recording"
)
LAST_STATE: Final = "The figures are the last state of the filter."
INCONSISTENT_STEPS: Final = (
    "Check whether a sensor is loose, or its noise in the vehicle file too small.",
    "Run 'bayes-asv diagnose' to find what the {car} car lacks: unequal compression and rebound "
    "damping, a stop, friction.",
    "Run 'bayes-asv estimate', which also estimates the noise and states how much of the motion is "
    "explained.",
)
"""What to do where the filter was inconsistent."""

_FAULTS: Final = {
    "swollen": (
        "The noise was inflated to {level} the level of the vehicle file: a sensor is faulty, "
        "a value given as exact is wrong, or something moves that the {car} car does not describe."
    ),
    "coloured": (
        "The innovations are autocorrelated: the parameters changed, a given value is wrong, or "
        "the car does something that the {car} car does not describe. Meanwhile the filter lets "
        "the parameters vary, which widens the intervals."
    ),
    "uneven": "For a part of the time the errors were larger than stated.",
    "optimistic": "The errors were larger than stated: the noise is larger than given.",
    "pessimistic": (
        "The errors were smaller than stated: the noise is smaller than given, and the intervals "
        "are wider than necessary."
    ),
}
_MAX_LEVEL: Final = 200.0  # a larger noise level is called hundreds of times
_MAX_RESETS: Final = 5  # whose times are listed

_MARGIN: Final = 5.0  # half-widths of the last band that the axis shows at least
_LEARNT: Final = 8.0  # widths of the last band: a parameter with a wider one is not learnt yet
_MAX_NIS: Final = 12.0  # end of the axis

_PARAMETERS: Final = (
    "Bands are 95 %; the initial band, when nothing is known, exceeds the axis. A curve that "
    "leaves its own earlier band shows a parameter that changed, or a filter that was too certain. "
    "Red marks the time in which the filter was inconsistent."
)
_NIS: Final = (
    "A consistent filter is inside the green band for 95 % of the time. Above it, errors are "
    "larger than stated; below it, smaller. The lower curve is the factor by which the noise was "
    "raised to compensate: about one for a consistent filter."
)
_LAGS: Final = (
    "Bars far outside the band mean that one error predicts the next: something moves that the "
    "filter does not describe."
)


def _content(document: TrackDocument) -> Iterator[Block]:
    if document.verdict == "refused":
        return
    yield Figure(
        "track", "Parameters from the online filter", _PARAMETERS, _parameter_curves(document), 3
    )


def _details(document: TrackDocument) -> Iterator[Block]:
    if document.verdict == "refused":
        return
    yield Text("", consistency_lines(document))
    yield Figure(
        "track-nis", "Errors of the online filter", f"{_NIS} {_LAGS}",
        (*_consistency_curves(document), *_autocorrelations(document.consistency)), 3,
    )  # fmt: skip


SECTION: Final = Section(_content)

DETAILS_SECTION: Final = Section(_details, title="Consistency of the filter")


def track_subtitle(document: TrackDocument) -> str:
    """Name the recording and the settings of the filter."""
    parts = [", ".join(plain(r.file) for r in document.provenance.recordings)]
    settings = document.filter
    if settings.rows:
        seconds, rate = number(settings.seconds, 0.1), number(settings.rate, 10.0)
        parts.append(f"{seconds} s at {rate} Hz")
    forget = settings.forget_seconds
    parts.append(
        "online filter, parameters constant"
        if forget is None
        else f"online filter, parameters may change by 10 % in {number(forget)} s"
    )
    return " · ".join(p for p in parts if p)


def is_inconsistent(document: TrackDocument) -> bool:
    """Whether the filter was inconsistent at the end, so that nothing can be concluded."""
    return document.consistency.verdict == "inconsistent"


def consistency_lines(document: TrackDocument) -> list[str]:
    """State whether the errors of the filter matched its stated uncertainty."""
    consistency = document.consistency
    if not consistency.readings:
        return ["No reading was left to compare the predictions with."]
    low, high = consistency.nis_band95
    lines = []
    resets = document.filter.resets
    if not consistency.faults and not resets:
        lines.append("The filter is consistent: its errors match its stated uncertainty.")
    lines.append(
        f"Normalised innovation squared (NIS): mean {number(consistency.nis_mean, 0.01)} over "
        f"{consistency.readings} readings; a consistent filter is between {number(low, 0.01)} and "
        f"{number(high, 0.01)} with 95 % probability. It was consistent for "
        f"{percent(consistency.share_of_time)} of the time."
    )
    raised = consistency.largest_noise_level
    level = f"{number(raised, 0.1 * raised)} times" if raised < _MAX_LEVEL else "hundreds of times"
    lines += [_FAULTS[fault].format(level=level, car=document.car) for fault in consistency.faults]
    if resets:
        times = ", ".join(f"{number(t, 0.1)} s" for t in resets[:_MAX_RESETS])
        further = len(resets) - _MAX_RESETS
        more = f" and {further} times more" if further > 0 else ""
        lines.append(
            f"At {times}{more} the readings became incompatible with the filter: it reset motion "
            "and biases, and discarded what it had just learnt about the car."
        )
    return lines


def last_state(name: str, parameter: Parameter) -> str:
    """State the last value of a parameter, without a conclusion."""
    low, high = parameter.eti95
    return (
        f"{capitalized(LABELS[name])}: {number(parameter.median, high - low)} "
        f"{readable_unit(parameter.unit)} (nominal {number(parameter.nominal)})."
    )


def _parameter_curves(document: TrackDocument) -> tuple[svg.Panel, ...]:
    """Draw each parameter with its 95 % band against time.

    The axis shows the last value and all of the time in which the parameter was known.
    """
    curves = document.track
    if curves is None:
        return ()
    time = svg.curve_array(curves.time)
    panels = []
    for name, curve in curves.parameters.items():
        median = svg.curve_array(curve.median)
        low, high = (svg.curve_array(side) for side in curve.band95)
        parameter = document.parameters.get(name)
        nominal = None if parameter is None else parameter.nominal
        paint = svg.axle_colour(LABELS[name])
        figure = svg.canvas(*svg.SMALL)
        axes = figure.subplots()
        _shade_inconsistent(axes, time, curves.consistent)
        axes.fill_between(time, low, high, color=paint, alpha=0.3, linewidth=0)
        axes.plot(time, median, color=paint)
        bottom, top = _range(median, low, high, nominal)
        if nominal is not None:
            above = nominal < 0.5 * (bottom + top)
            svg.draw_level(axes, nominal, f"nominal {number(nominal)}", above=above)
        axes.set_ylim(bottom, top)
        axes.set_xlim(float(time[0]), float(time[-1]))
        axes.set(xlabel="time [s]", ylabel=labelled(name, "", curve.unit).replace(" [", "\n["))
        alt = f"{LABELS[name]} against time with its 95 % band, from the online filter"
        panels.append(svg.panel(figure, f"track-{name.replace('_', '-')}", alt))
    for label, curve in curves.effects.items():
        median = svg.curve_array(curve.median)
        low, high = (svg.curve_array(side) for side in curve.band95)
        paint = svg.axle_colour(label.partition("@")[2])
        figure = svg.canvas(height=2.4)
        axes = figure.subplots()
        _shade_inconsistent(axes, time, curves.consistent)
        axes.fill_between(time, low, high, color=paint, alpha=0.3, linewidth=0)
        axes.plot(time, median, color=paint)
        axes.set_ylim(*_range(median, low, high, None))
        axes.set_xlim(float(time[0]), float(time[-1]))
        place, _, quantity = plain(label).rpartition(" ")
        unit = f" [{readable_unit(curve.unit)}]" if curve.unit else ""
        axes.set(xlabel="time [s]", ylabel=f"{quantity}{unit}\n{place}")
        key = "".join(c if c.isalnum() else "-" for c in label)
        alt = f"{quantity} of {place} against time with its 95 % band, from the online filter"
        panels.append(svg.panel(figure, f"track-{key}", alt))
    return tuple(panels)


def _range(median: Array, low: Array, high: Array, nominal: float | None) -> tuple[float, float]:
    last = float(high[-1] - low[-1])
    known = (high - low) < _LEARNT * last
    known[-1] = True
    shown = [float(median[-1]) + side * _MARGIN * last / 2 for side in (-1.0, 1.0)]
    shown += [float(np.nanmin(low[known])), float(np.nanmax(high[known]))]
    if nominal is not None:
        shown.append(nominal)
    margin = 0.06 * (max(shown) - min(shown))
    return min(shown) - margin, max(shown) + margin


def _shade_inconsistent(axes: Axes, time: Array, consistent: Sequence[bool]) -> None:
    inconsistent = ~np.array(consistent, bool)
    inconsistent[1:] |= inconsistent[:-1]  # to the first point at which it was consistent again
    if inconsistent.any():  # one artist, however often the filter changed its mind
        axes.fill_between(
            time, 0.0, 1.0, where=inconsistent, transform=axes.get_xaxis_transform(),
            color=svg.COLOURS["below"], alpha=0.15, linewidth=0,
        )  # fmt: skip


def _consistency_curves(document: TrackDocument) -> tuple[svg.Panel, ...]:
    """Draw the mean NIS over a sliding window with its band, and the factor on the noise."""
    curves = document.track
    if curves is None:
        return ()
    time, mean = svg.curve_array(curves.time), svg.curve_array(curves.nis.mean)
    low, high = (svg.curve_array(side) for side in curves.nis.band95)
    inflation = svg.curve_array(curves.inflation)
    figure = svg.canvas(*svg.SMALL)
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.3))
    _shade_inconsistent(top, time, curves.consistent)
    end = min(max(2.2, 1.1 * float(np.nanquantile(mean, 0.995))), _MAX_NIS)
    top.fill_between(
        time, np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=end), color=svg.COLOURS["good"],
        alpha=0.2, linewidth=0, label="95 % band",
    )  # fmt: skip
    top.plot(time, np.minimum(mean, end), color=svg.COLOURS["ink"], linewidth=0.9, label="mean NIS")
    top.axhline(1.0, color=svg.COLOURS["good"], linewidth=0.8)
    window = number(document.consistency.window_seconds)
    top.set(ylabel=f"mean NIS\nover {window} s", ylim=(0.0, end))
    top.legend(loc="upper right", ncols=2)
    below.plot(time, inflation, color=svg.COLOURS["below"], linewidth=0.9)
    below.set(xlabel="time [s]", ylabel="noise\nfactor")
    below.set_ylim(0.9, max(1.6, 1.05 * float(np.nanmax(inflation))))
    below.set_xlim(float(time[0]), float(time[-1]))
    figure.align_ylabels([top, below])
    alt = "mean NIS against time with its 95 % band, and the factor on the noise"
    return (svg.panel(figure, "track-nis", alt),)


def _autocorrelations(consistency: Consistency) -> tuple[svg.Panel, ...]:
    correlation = consistency.autocorrelation
    if correlation is None:
        return ()
    # Documents of earlier versions have the two chassis accelerations of the half car alone.
    by_axle = {"front": correlation.front, "rear": correlation.rear}
    half = set(correlation.outputs) <= {"front_chassis", "rear_chassis"}
    curves = by_axle if half else correlation.outputs

    shown = [
        (place.removesuffix("_chassis").replace("_", " "), place, [v or 0.0 for v in values[1:]])
        for place, values in curves.items()
        if len(values) > 1
    ]
    if not shown:
        return ()
    figure = svg.canvas(*svg.SMALL)
    svg.draw_autocorrelations(figure.subplots(), shown, correlation.band95, correlation.lag_seconds)
    names = ", ".join(name for name, _, _ in shown)
    alt = f"{names} innovations of the online filter: autocorrelation with its 95 % band"
    return (svg.panel(figure, "track-lags", alt),)


def watch_lines(document: WatchDocument) -> list[str]:
    """State an alarm, or that there was none."""
    asked = document.asked
    worn = f"below {percent(asked.share)} of its nominal rate"
    notes = [f"Note: {plain(warning)}." for warning in document.warnings]
    alarm = document.alarm
    if alarm is not None:
        low, high = alarm.eti95
        return [
            f"ALARM: the {alarm.axle.replace('_', ' ')} damper is {worn}, with a probability of "
            f"{probability(alarm.probability)}.",
            f"Its rate is {percent(alarm.share_of_nominal)} of nominal (95 %: {percent(low)} to "
            f"{percent(high)}). The alarm was raised at {number(alarm.time, 0.1)} s, after "
            f"{number(alarm.time - alarm.since, 0.1)} s above the required probability.",
            f"Next: stop and inspect the {alarm.axle.replace('_', ' ')} damper: oil, seals, gas "
            "charge, heat.",
            *notes,
        ]
    if document.verdict == "refused":
        return [
            "Cannot tell whether a damper is worn.",
            *(f"Why: {plain(reason)}." for reason in document.reasons),
        ]
    places = [
        f"{probability(p)} at the {place.replace('_', ' ')}"
        for place, p in document.probability.items()
    ]
    listed = " and ".join([", ".join(places[:-1]), places[-1]] if len(places) > 1 else places)
    told = document.share_of_time * document.seconds_watched
    lines = [
        f"No alarm in {number(told, 1.0)} s: the probability that a damper is {worn} is {listed}."
    ]
    if document.share_of_time < 1.0 and document.seconds_watched - told >= 1.0:
        lines.append(
            f"For a further {number(document.seconds_watched - told, 1.0)} s the filter was "
            "inconsistent and could not tell; see 'bayes-asv track'."
        )
    return lines + notes
