"""What the numbers mean, in words, alike for page, terminal and animation."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from bayes_asv.live.bands import Z95, normal_below
from bayes_asv.live.metadata import AXLES, Parameter, Scene
from bayes_asv.report.readable import number, percent, probability
from bayes_asv.report.words import compare, likelihood_words

__all__ = ["Card", "Consistency", "card", "consistency", "travel"]

_TONES: Final = {"below": "below", "above": "above", "agrees": "good", "unclear": "muted"}
_VAGUE: Final = 0.25  # deviation of a logarithm beyond which two digits of each number will do
_WIDENED: Final = 1.05  # an inflation that is worth a word


class Card(NamedTuple):
    """One parameter, said.

    Attributes
    ----------
    value, interval, width : str
        Median with its unit, ``5.62 to 5.84``, and half the width of that in percent.
    sense, chance : str
        How it stands to nominal, and the probability of the side it is on.
    tone : str
        ``good``, ``below``, ``above`` or ``muted``.
    """

    value: str
    interval: str
    width: str
    sense: str
    chance: str
    tone: str


class Consistency(NamedTuple):
    """The normalised innovations, said.

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


def card(parameter: Parameter, median: float, log_sd: float) -> Card:
    """Say where a parameter stands.

    Parameters
    ----------
    parameter : Parameter
        Which, with its nominal value.
    median : float
        In the parameter's display unit.
    log_sd : float
        Deviation of its logarithm.

    Returns
    -------
    Card
        In words of the report; the value is the median.
    """
    if not (math.isfinite(median) and math.isfinite(log_sd) and median > 0.0):
        return Card("–", "–", "–", "nothing known yet", "", "muted")
    low, high = (median * math.exp(sign * Z95 * log_sd) for sign in (-1.0, 1.0))
    sd = median * log_sd
    p_below = normal_below(math.log(parameter.nominal / median), log_sd)
    found = compare(
        parameter.name,
        {
            "mean": median, "sd": sd, "eti95": [low, high], "nominal": parameter.nominal,
            "p_below_nominal": p_below,
        },
    )  # fmt: skip
    if log_sd > _VAGUE:
        middle, least, most = (number(v, 0.3 * v) for v in (median, low, high))
        width = f"within a factor {number(round(math.exp(Z95 * log_sd), 1))}"
    else:
        half = math.sinh(Z95 * log_sd)  # half the interval over the median
        middle, least, most = (number(v, sd, 1) for v in (median, low, high))
        width = f"± {percent(half, 1 if half < 0.1 else 0)}"
    said = Card(
        value=f"{middle} {parameter.unit}".strip(),
        interval=f"{least} to {most}",
        width=width,
        sense="",
        chance="",
        tone="muted",
    )
    if found is None:
        return said
    return said._replace(
        sense=found.words,
        chance=f"{likelihood_words(found.p_side)} {found.side} nominal, "
        f"{probability(found.p_side)}",
        tone=_TONES[found.sense],
    )


def consistency(
    mean: float, low: float, high: float, consistent: bool, inflation: float
) -> Consistency:
    """Say whether the filter's errors are as large as it expects.

    Parameters
    ----------
    mean, low, high : float
        Mean of the normalised innovations squared over the filter's window, and its 95 % band.
    consistent : bool
        The filter's own verdict, which waits a little before it changes.
    inflation : float
        Factor by which the filter widened the noise's deviations.

    Returns
    -------
    Consistency
        In words.
    """
    if not all(map(math.isfinite, (mean, low, high))) or mean < 0.0:
        return Consistency("settling", "Too few readings yet to judge the filter by.", "muted")
    widened = (
        f" The filter widens its noise {number(round(inflation, 2))} times, so that the bands stay "
        "honest."
        if inflation > _WIDENED
        else ""
    )
    if mean > high:
        times = number(round(math.sqrt(mean), 2))
        return Consistency(
            "errors too large",
            f"Prediction errors are {times} times as large as expected: something moves that the "
            f"model does not know, or a sensor is loose.{widened}",
            "below",
        )
    if mean < low:
        times = percent(math.sqrt(mean))
        return Consistency(
            "errors too small",
            f"Prediction errors are {times} of what is expected: the sensors are better than the "
            f"vehicle file says, and the bands wider than need be.{widened}",
            "above",
        )
    if not consistent:
        return Consistency(
            "recovering", f"Prediction errors are back to what is expected.{widened}", "muted"
        )
    return Consistency(
        "consistent", f"Prediction errors are as large as the filter expects.{widened}", "good"
    )


def travel(scene: Scene, reach: tuple[float, ...]) -> tuple[str, ...]:
    """Say how far each suspension went, with what was left to the stops.

    Parameters
    ----------
    scene : Scene
        Has the limits.
    reach : tuple of 4 float
        Least and largest deflection, front and rear, display units.

    Returns
    -------
    tuple of str
        Front, rear.
    """
    unit = scene.deflection[0]
    said = []
    for axle in range(len(AXLES)):
        low, high = reach[2 * axle : 2 * axle + 2]
        if not (math.isfinite(low) and math.isfinite(high)):
            said.append("")
            continue
        small = max(abs(low), abs(high), 1e-12) * 0.05
        text = f"{number(low, small, 1)} to {number(high, small, 1)} {unit}"
        bump, droop = scene.limits[axle]
        touched = [
            name
            for name, hit in (
                ("bump", bump is not None and low <= bump),
                ("droop", droop is not None and high >= droop),
            )
            if hit
        ]
        said.append(text + (f", {' and '.join(touched)} limit reached" if touched else ""))
    return tuple(said)
