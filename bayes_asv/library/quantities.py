"""Quantities that are given as text with a unit."""

from __future__ import annotations

import math

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.units import parse_quantity, to_si

__all__ = ["positive_quantity"]


def positive_quantity(
    name: str,
    text: str | None,
    dimension: str,
    example: str,
    limits: tuple[float, float] = (0.0, math.inf),
) -> float | None:
    """Read a positive quantity with its unit.

    Parameters
    ----------
    name : str
        Of the argument, for messages.
    text : str or None
        Such as ``"12 mph"``.
    dimension : str
        As in :mod:`bayes_asv.domain.units`.
    example : str
        A text that fits.
    limits : pair of float
        Smallest and largest value, SI units.

    Returns
    -------
    float or None
        SI units; None for None.

    Raises
    ------
    InputError
        If it is not such a quantity.
    """
    if text is None:
        return None
    if not isinstance(text, str):
        raise InputError(name, f"{text!r} has no unit", f"write '{example}'")
    try:
        value = to_si(*parse_quantity(text), dimension)
    except InputError as fault:
        raise InputError(name, f"{fault.where} {fault.what}", f"write '{example}'") from None
    low, high = limits
    if not (low <= value <= high and 0.0 < value < math.inf):
        if high == math.inf:
            raise InputError(name, "has to be above zero", f"write '{example}'")
        raise InputError(name, f"has to be between {low:g} and {high:g} in SI units")
    return value
