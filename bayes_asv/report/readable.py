"""Numbers, units and foreign text made fit for the eye. Nothing here knows what they mean."""

from __future__ import annotations

import math
import unicodedata
from typing import Final

__all__ = ["decimals_for", "number", "percent", "plain", "probability", "readable_unit"]

MISSING: Final = "–"

_SUPERSCRIPTS: Final = {"^2": "²", "^3": "³", "^4": "⁴", "^1": ""}
_DIGITS_WITHOUT_SD: Final = 4
_LONGEST: Final = 500

# Controls, surrogates, unassigned code points, and format characters, which turn the direction of
# the text around them: none of them belongs into a name of a car or a file.
_UNWANTED: Final = frozenset({"Cc", "Cs", "Cn", "Cf", "Co", "Zl", "Zp"})


def readable_unit(unit: str) -> str:
    """Write a unit as people do: ``lbf*s^2*in`` becomes ``lbf·s²·in``.

    Parameters
    ----------
    unit : str
        As in a document; empty for a bare number.

    Returns
    -------
    str
        The same unit with raised dots and superscripts.
    """
    text = plain(unit)
    for power, sign in _SUPERSCRIPTS.items():
        text = text.replace(power, sign)
    return text.replace("*", "·")


def decimals_for(sd: float, digits: int = 2) -> int:
    """Decimals that leave `digits` significant digits of a deviation.

    Parameters
    ----------
    sd : float
        Deviation, positive and finite.
    digits : int
        Significant digits of it to keep.

    Returns
    -------
    int
        May be negative: -2 rounds to hundreds.
    """
    # Rounding first makes 0.0996 a 0.10, so that it keeps two digits and not three.
    return digits - 1 - int(f"{sd:.{digits - 1}e}".partition("e")[2])


def number(value: float | None, sd: float | None = None, digits: int = 2) -> str:
    """Write a number with as many digits as its uncertainty leaves.

    Parameters
    ----------
    value : float or None
        The number; None and what is not finite become a dash.
    sd : float, optional
        Its deviation. Without one, or with one of 0, four significant digits are written.
    digits : int
        Significant digits of `sd` to keep.

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
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def percent(share: float | None, places: int = 0) -> str:
    """Write a share of one as a percentage, for example ``12 %``."""
    if share is None or not math.isfinite(share):
        return MISSING
    text = f"{100.0 * share:.{places}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−") + " %"


def probability(p: float | None) -> str:
    """Write a probability that was counted from draws: never quite 0 or 1.

    Parameters
    ----------
    p : float or None
        Between 0 and 1.

    Returns
    -------
    str
        For example ``82 %``, ``99.4 %`` or ``> 99.9 %``.
    """
    if p is None or not math.isfinite(p):
        return MISSING
    if p > 0.999:
        return "> 99.9 %"
    if p < 0.001:
        return "< 0.1 %"
    return percent(p, 1 if p > 0.99 or p < 0.01 else 0)


def plain(text: object) -> str:
    """Make foreign text fit to print: one line, no control or direction characters, not endless.

    It is not escaped: the views do that, each in its own way.
    """
    seen = (" " if ch.isspace() else ch for ch in str(text))
    kept = "".join("\ufffd" if unicodedata.category(ch) in _UNWANTED else ch for ch in seen)
    folded = " ".join(kept.split())
    return folded if len(folded) <= _LONGEST else folded[: _LONGEST - 1] + "…"
