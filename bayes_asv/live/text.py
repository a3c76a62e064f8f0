"""Texts of the live view, the same on the page, in the terminal and in the animation."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.live.metadata import Parameter, ViewMetadata
from bayes_asv.report.words import TONES, compare, likelihood_words, number, percent, probability

__all__ = [
    "ConsistencyText", "ParameterCard", "consistency_text", "normal_below", "parameter_card",
    "travel_text",
]  # fmt: skip

_WIDE: Final = 0.25  # standard deviation of a logarithm beyond which two digits are enough
_MIN_INFLATION: Final = 1.05  # that is mentioned


class ParameterCard(NamedTuple):
    """Texts about one parameter.

    Attributes
    ----------
    value, interval, width : str
        Median with its unit; 95 % interval, such as ``5.62 to 5.84``; half its width in percent.
    sense, chance : str
        Comparison with nominal, and the probability of being on that side of it.
    tone : str
        ``good``, ``below``, ``above`` or ``muted``.
    """

    value: str
    interval: str
    width: str
    sense: str
    chance: str
    tone: str


class ConsistencyText(NamedTuple):
    """Texts about the consistency of the filter.

    Attributes
    ----------
    short, long : str
        Two words, and a sentence.
    tone : str
        ``good``, ``below`` (an alarm), ``above`` or ``muted``.
    """

    short: str
    long: str
    tone: str


def parameter_card(parameter: Parameter, median: float, log_sd: float) -> ParameterCard:
    """Describe the estimate of a parameter.

    Parameters
    ----------
    parameter : Parameter
        With its nominal value.
    median : float
        In the parameter's display unit.
    log_sd : float
        Standard deviation of its logarithm.

    Returns
    -------
    ParameterCard
        In the words of the report; the value is the median.
    """
    if not (math.isfinite(median) and math.isfinite(log_sd) and median > 0.0):
        return ParameterCard("–", "–", "–", "nothing known yet", "", "muted")
    low, high = (median * math.exp(sign * NORMAL_975 * log_sd) for sign in (-1.0, 1.0))
    sd = median * log_sd
    p_below = normal_below(math.log(parameter.nominal / median), log_sd)
    comparison = compare(parameter.name, median, sd, (low, high), parameter.nominal, p_below)
    if log_sd > _WIDE:
        shown, shown_low, shown_high = (number(v, 0.3 * v) for v in (median, low, high))
        width = f"within a factor {number(round(math.exp(NORMAL_975 * log_sd), 1))}"
    else:
        half = math.sinh(NORMAL_975 * log_sd)  # half the interval over the median
        shown, shown_low, shown_high = (number(v, sd, 1) for v in (median, low, high))
        width = f"± {percent(half, 1 if half < 0.1 else 0)}"
    side = f"{likelihood_words(comparison.p_side)} {comparison.side} nominal"
    return ParameterCard(
        value=f"{shown} {parameter.unit}".strip(),
        interval=f"{shown_low} to {shown_high}",
        width=width,
        sense=comparison.words,
        chance=f"{side}, {probability(comparison.p_side)}",
        tone=TONES[comparison.sense],
    )


def consistency_text(
    mean: float, low: float, high: float, consistent: bool, inflation: float
) -> ConsistencyText:
    """Describe whether the filter's errors match its stated uncertainty.

    Parameters
    ----------
    mean, low, high : float
        Mean normalised innovation squared over the filter's window, and its 95 % band.
    consistent : bool
        The filter's own verdict, which has hysteresis.
    inflation : float
        Factor by which the filter widened the noise's standard deviation.
    """
    if not all(map(math.isfinite, (mean, low, high))) or mean < 0.0:
        return ConsistencyText("settling", "Too few readings yet to test the filter.", "muted")
    widened = (
        f" The filter widens its noise {number(round(inflation, 2))} times, so that its intervals "
        "stay valid."
        if inflation > _MIN_INFLATION
        else ""
    )
    if mean > high:
        times = number(round(math.sqrt(mean), 2))
        return ConsistencyText(
            "errors too large",
            f"Prediction errors are {times} times as large as expected: the model lacks something "
            f"that moves, or a sensor is loose.{widened}",
            "below",
        )
    if mean < low:
        times = percent(math.sqrt(mean))
        return ConsistencyText(
            "errors too small",
            f"Prediction errors are {times} of what is expected: the sensors are better than the "
            f"vehicle file says, and the intervals are wider than necessary.{widened}",
            "above",
        )
    if not consistent:
        return ConsistencyText(
            "recovering", f"Prediction errors are back to what is expected.{widened}", "muted"
        )
    return ConsistencyText(
        "consistent", f"Prediction errors are as large as the filter expects.{widened}", "good"
    )


def travel_text(metadata: ViewMetadata, extremes: tuple[float, ...]) -> tuple[str, ...]:
    """Describe how far each suspension travelled, and which stops it reached.

    Parameters
    ----------
    metadata : ViewMetadata
        Gives the limits.
    extremes : tuple of 2 ne float
        Smallest and largest deflection of each element, display units.

    Returns
    -------
    tuple of str
        One an element.
    """
    unit = metadata.deflection[0]
    texts = []
    for axle in range(len(metadata.elements)):
        low, high = extremes[2 * axle : 2 * axle + 2]
        if not (math.isfinite(low) and math.isfinite(high)):
            texts.append("")
            continue
        resolution = max(abs(low), abs(high), 1e-12) * 0.05
        text = f"{number(low, resolution, 1)} to {number(high, resolution, 1)} {unit}"
        bump, droop = metadata.limits[axle]
        reached = [
            name
            for name, hit in (
                ("bump", bump is not None and low <= bump),
                ("droop", droop is not None and high >= droop),
            )
            if hit
        ]
        texts.append(text + (f", {' and '.join(reached)} limit reached" if reached else ""))
    return tuple(texts)


def normal_below(distance: float, sd: float) -> float:
    """Probability that a normal variable lies below its mean plus a distance.

    Parameters
    ----------
    distance : float
        In the variable's unit.
    sd : float
        Its standard deviation, not negative.

    Returns
    -------
    float
        One half at a distance of zero, whatever the standard deviation.
    """
    if sd <= 0.0:
        return 0.5 if distance == 0.0 else float(distance > 0.0)
    return 0.5 * math.erfc(-distance / (sd * math.sqrt(2.0)))
