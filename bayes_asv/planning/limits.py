"""Which weighed or measured value keeps an answer from being as good as it is wanted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.planning.widths import ANSWERS, GIVEN, Known, widths

__all__ = ["Limit", "limit"]

Array = NDArray[np.float64]

_NOTICED = 0.02  # share by which a width must shrink for a given value to be worth naming
_FINEST = 1e-4  # deviation below which nobody weighs anything


class Limit(NamedTuple):
    """What has to be known better, and how well.

    Parameters
    ----------
    answer : str
        The parameter that stays too wide.
    needed : dict of str to float
        Deviation (share of the value) that each of these given values needs; empty when even
        exact ones would not do, so that the drive is to blame.
    """

    answer: str
    needed: dict[str, float]


def limit(information: Array, passes: int, before: Known, answer: str, want: float) -> Limit | None:
    """Find the given values that stand in the way of one answer.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass.
    passes : int
        The most that anyone will drive.
    before : Known
        Deviations beforehand.
    answer : str
        One of :data:`~bayes_asv.planning.widths.ANSWERS`.
    want : float
        Wanted width, share of one.

    Returns
    -------
    Limit or None
        None when the answer comes out as wanted.  One value alone where that suffices, the one
        that has to improve least; else all that matter, each by the same factor.
    """
    place = ANSWERS.index(answer)

    def width(belief: Known) -> float:
        return float(widths(information, passes, belief)[place])

    now = width(before)
    if now <= want:
        return None
    if width(before.exactly()) > want:
        return Limit(answer, {})
    matter = [
        name
        for name in GIVEN
        if before.log_sd[name] > 0.0 and width(before.but(**{name: 0.0})) < (1.0 - _NOTICED) * now
    ]
    alone = {}
    for name in matter:
        factor = _largest_factor(width, before, (name,), want)
        if factor > 0.0:
            alone[name] = factor
    if alone:
        best = max(alone, key=lambda name: alone[name])
        return Limit(answer, {best: alone[best] * before.log_sd[best]})
    every = tuple(name for name in GIVEN if before.log_sd[name] > 0.0)
    factor = _largest_factor(width, before, every, want)
    return Limit(answer, {name: factor * before.log_sd[name] for name in matter or every})


def _largest_factor(
    width: Callable[[Known], float], before: Known, names: tuple[str, ...], want: float
) -> float:
    """Largest factor on these deviations with which the answer is as wanted; 0 for none."""

    def at(factor: float) -> float:
        return width(before.but(**{n: factor * before.log_sd[n] for n in names}))

    least = _FINEST / max(before.log_sd[n] for n in names)
    if least >= 1.0 or at(least) > want:
        return 0.0
    low, high = math.log(least), 0.0  # low does, high does not
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(math.exp(middle)) <= want else (low, middle)
    return math.exp(low)
