"""Numbers, units, probabilities and comparisons with nominal as text, alike in every output."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable
from typing import Final, NamedTuple

from bayes_asv.domain.errors import enumerated
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.schema.parts import Parameter, Summary

__all__ = [
    "LABELS",
    "MISSING",
    "NOT_DETERMINED",
    "TONES",
    "Comparison",
    "capitalized",
    "compare",
    "compare_parameter",
    "decimals_for",
    "difference",
    "enumerated",
    "estimate_text",
    "interval",
    "is_determined",
    "labelled",
    "likelihood_words",
    "number",
    "p_value",
    "parameter_sentence",
    "percent",
    "plain",
    "plus_minus",
    "probability",
    "readable_unit",
    "two_digits",
]

LABELS: Final = {name: label for name, (_, label) in QUANTITIES.items()}
"""Display name of every parameter."""

MISSING: Final = "–"
NOT_DETERMINED: Final = "not determined"

TONES: Final = {"below": "below", "above": "above", "agrees": "good", "unclear": "muted"}
"""Colour of a comparison with nominal, by its sense."""

SMALL_DIFFERENCE: Final = 0.05
"""Share of nominal below which a difference, however certain, rarely matters."""
WIDE: Final = 0.10
"""Standard deviation over mean beyond which a parameter is called uncertain."""

_MOST_UNCERTAIN: Final = 10.0  # upper over lower end of an interval: an order of magnitude
_SUPERSCRIPTS: Final = {"^2": "²", "^3": "³", "^4": "⁴", "^1": ""}
_DIGITS_WITHOUT_SD: Final = 4
_MAX_LENGTH: Final = 500
# Controls, surrogates, unassigned code points, and format characters that change the direction of
# the text around them: none of them belongs in the name of a car or a file.
_UNWANTED: Final = frozenset({"Cc", "Cs", "Cn", "Cf", "Co", "Zl", "Zp"})

_COMPARATIVES: Final = {"below": ("smaller", "softer"), "above": ("larger", "stiffer")}
# Mastrandrea et al., Guidance Note for Lead Authors of the IPCC Fifth Assessment Report on
# Consistent Treatment of Uncertainties (2010), table 1, with the additional terms below it.
_LIKELIHOOD: Final = (
    (0.99, "virtually certain"),
    (0.95, "extremely likely"),
    (0.90, "very likely"),
    (0.66, "likely"),
)
_UNLIKELIHOOD: Final = (
    (0.01, "exceptionally unlikely"),
    (0.05, "extremely unlikely"),
    (0.10, "very unlikely"),
    (0.33, "unlikely"),
)


def readable_unit(unit: str) -> str:
    """Write a unit with raised dots and superscripts: ``lbf*s^2*in`` becomes ``lbf·s²·in``."""
    text = plain(unit)
    for power, sign in _SUPERSCRIPTS.items():
        text = text.replace(power, sign)
    return text.replace("*", "·")


def decimals_for(sd: float, digits: int = 2) -> int:
    """Decimals that keep `digits` significant digits of a positive `sd`; -2 rounds to hundreds."""
    # Rounding first makes 0.0996 a 0.10, so that it keeps two digits and not three.
    return digits - 1 - int(f"{sd:.{digits - 1}e}".partition("e")[2])


def number(value: float | None, sd: float | None = None, digits: int = 2) -> str:
    """Write a number with as many digits as its uncertainty allows.

    Parameters
    ----------
    value : float or None
        None and non-finite numbers become a dash.
    sd : float, optional
        Its standard deviation, of which `digits` significant digits are kept. Without one, or
        with 0, four significant digits of the number are written.
    digits : int
        Number of significant digits of the standard deviation.

    Returns
    -------
    str
        Plain decimals with a true minus sign, powers of ten only beyond a million or below 1e-4.
    """
    if value is None or not math.isfinite(value):
        return MISSING
    if sd is None or not math.isfinite(sd) or sd <= 0.0:
        text = f"{value:.{_DIGITS_WITHOUT_SD}g}"
        if "e" in text and 1e-4 <= abs(value) < 1e7:
            text = f"{float(text):.0f}"
    else:
        places = decimals_for(sd, digits)
        # Absurd ratios (a value of 1e30, a deviation of 1e-9) are not worth their digits.
        if abs(value) >= 1e9 or places > 9 or places < -6:
            text = f"{value:.{_DIGITS_WITHOUT_SD}g}"
        else:
            text = f"{round(value, places):.{max(places, 0)}f}"
    return _with_minus_sign(text)


def two_digits(value: float) -> str:
    """Write two significant digits, without trailing zeros."""
    return number(float(f"{value:.2g}"))


def percent(share: float | None, places: int = 0) -> str:
    """Write a share of one as a percentage, for example ``12 %``."""
    if share is None or not math.isfinite(share):
        return MISSING
    return _with_minus_sign(f"{100.0 * share:.{places}f}") + " %"


def _with_minus_sign(text: str) -> str:
    """Use a true minus sign, and none before zero."""
    return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", "−")


def probability(p: float | None) -> str:
    """Write a probability that was counted from draws: ``82 %``, ``99.4 %`` or ``> 99.9 %``."""
    if p is None or not math.isfinite(p):
        return MISSING
    if p > 0.999:
        return "> 99.9 %"
    if p < 0.001:
        return "< 0.1 %"
    return percent(p, 1 if p > 0.99 or p < 0.01 else 0)


def p_value(p: float) -> str:
    """Write a p-value, ``p = 0.77`` or ``p < 0.001``."""
    return f"p = {p:.2g}" if p >= 1e-3 else "p < 0.001"


def likelihood_words(p: float) -> str:
    """Describe a probability on the calibrated scale of the IPCC.

    From ``exceptionally unlikely`` (below 1 %) over ``about as likely as not`` (33 to 66 %) to
    ``virtually certain`` (above 99 %).  ValueError if `p` is not a probability.
    """
    if not 0.0 <= p <= 1.0:
        raise ValueError(f"{p} is not a probability")
    for bound, words in _LIKELIHOOD:
        if p > bound:
            return words
    for bound, words in _UNLIKELIHOOD:
        if p < bound:
            return words
    return "about as likely as not"


def plain(text: object) -> str:
    """Make foreign text safe to print: one line, no control or direction characters, 500 letters.

    The result is not escaped: every output format does that in its own way.
    """
    spaced = (" " if ch.isspace() else ch for ch in str(text))
    kept = "".join("\ufffd" if unicodedata.category(ch) in _UNWANTED else ch for ch in spaced)
    folded = " ".join(kept.split())
    return folded if len(folded) <= _MAX_LENGTH else folded[: _MAX_LENGTH - 1] + "…"


def capitalized(text: str) -> str:
    """Begin with a capital letter and leave the rest."""
    return text[:1].upper() + text[1:]


def labelled(name: str, label: str, unit: str) -> str:
    """Display name of a parameter with its unit in brackets, for a table or an axis."""
    text, shown = LABELS.get(name, plain(label or name)), readable_unit(unit)
    return f"{text} [{shown}]" if shown else text


def interval(parameter: Summary, digits: int = 2) -> str:
    """Write a 95 % interval, ``7.72 to 8.08``."""
    low, high = parameter.eti95
    # rounded to digits of the standard deviation, the lower end would be zero
    if low > 0.0 and not is_determined(parameter.eti95):
        return f"{two_digits(low)} to {two_digits(high)}"
    return f"{number(low, parameter.sd, digits)} to {number(high, parameter.sd, digits)}"


def plus_minus(parameter: Summary) -> str:
    """Write mean and standard deviation, ``7.90 ± 0.10``."""
    if not is_determined(parameter.eti95):
        return NOT_DETERMINED
    return f"{number(parameter.mean, parameter.sd)} ± {number(parameter.sd, parameter.sd)}"


def is_determined(eti95: Iterable[float]) -> bool:
    """Whether the 95 % interval of a positive parameter spans less than a factor of ten.

    A wider one leaves the order of magnitude open, and neither mean nor standard deviation says so.
    """
    low, high = eti95
    return high < _MOST_UNCERTAIN * low


def estimate_text(parameter: Summary, unit: str, digits: int = 1) -> str:
    """Write the mean with its unit, in the digits of a sentence; without one if it is unknown."""
    if not is_determined(parameter.eti95):
        return NOT_DETERMINED
    return f"{number(parameter.mean, parameter.sd, digits)} {readable_unit(unit)}".strip()


class Comparison(NamedTuple):
    """A parameter compared with its nominal value."""

    sense: str
    """``below`` or ``above``; ``agrees`` when nominal lies within the 95 % interval; ``unclear``
    when it does only because the interval is wide."""
    words: str
    """The same in words, ``9 % softer than nominal``."""
    short: str
    """In a word, ``softer``."""
    share: float
    """Posterior mean over nominal, less one."""
    p_below: float
    """Posterior probability that the parameter is below nominal."""

    @property
    def p_side(self) -> float:
        """Probability that the parameter is on the side of nominal on which its mean is."""
        return self.p_below if self.share < 0.0 else 1.0 - self.p_below

    @property
    def side(self) -> str:
        """``below`` or ``above``, even where the difference is within the uncertainty."""
        return "below" if self.share < 0.0 else "above"


def compare(
    name: str, mean: float, sd: float, eti95: Iterable[float], nominal: float, p_below: float
) -> Comparison:
    """Compare the posterior of a parameter with its nominal value, which is not zero."""
    low, high = eti95
    share = mean / nominal - 1.0
    if low <= nominal <= high:
        if sd > WIDE * abs(mean):
            words = "too uncertain to compare with nominal"
            return Comparison("unclear", words, "uncertain", share, p_below)
        return Comparison("agrees", "agrees with nominal", "agrees", share, p_below)
    side = "below" if share < 0.0 else "above"
    damper = name.startswith(("c_", "zeta"))
    word = _COMPARATIVES[side][damper]
    words = f"{difference(share)} {word} than nominal"
    if not is_determined((low, high)):
        words = f"{word} than nominal"
    elif abs(share) < SMALL_DIFFERENCE:
        words = f"slightly {word} than nominal ({difference(share)})"
    return Comparison(side, words, word, share, p_below)


def compare_parameter(name: str, parameter: Parameter) -> Comparison | None:
    """Compare a parameter of a document with nominal.

    None where it has no nominal value, or where the comparison is withheld.
    """
    p = parameter
    if not p.nominal or p.p_below_nominal is None or p.withheld:
        return None
    return compare(name, p.mean, p.sd, p.eti95, p.nominal, p.p_below_nominal)


def difference(share: float) -> str:
    """Size of a relative difference, without its sign."""
    return "less than 1 %" if abs(share) < 0.01 else percent(abs(share))


def parameter_sentence(name: str, parameter: Parameter) -> str:
    """State a parameter in one sentence: mean, interval, and how it compares with nominal."""
    label = LABELS.get(name, plain(parameter.label or name))
    value = estimate_text(parameter, parameter.unit)
    start = f"The {label} is {value} (95 %: {interval(parameter, 1)})"
    comparison = compare_parameter(name, parameter)
    if comparison is None:
        return f"{start}."
    nominal, p = number(parameter.nominal), comparison.p_side
    likelihood = (
        f"it is {likelihood_words(p)} ({probability(p)}) that it is {comparison.side} nominal"
    )
    size = f"{difference(comparison.share)} " if is_determined(parameter.eti95) else ""
    if comparison.sense == "agrees":
        return (
            f"{start}, which agrees with the nominal {nominal}: the difference of {size}is within "
            f"the uncertainty; {likelihood}."
        )
    if comparison.sense == "unclear":
        return f"{start}, too uncertain to compare with the nominal {nominal}; {likelihood}."
    return f"{start}, {size}{comparison.side} the nominal {nominal}; {likelihood}."
