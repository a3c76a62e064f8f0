"""Parameters that a drive moves in the same way, so that it cannot tell one from the other."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.planning.information import SEEN

__all__ = ["ALIKE", "ALWAYS", "Pair", "pairs"]

Array = NDArray[np.float64]

ALIKE = 0.9
"""Correlation beyond which two parameters are called inseparable: what one is given wrong by,
the other makes up for, and either is more than twice as uncertain as with the other known."""

ALWAYS = (
    (("m", "c_f", "c_r", "i", "k_f", "k_r"), "a heavier car with every rate in proportion"),
    (("i", "l"), "pitch inertia in proportion to the square of the wheelbase"),
)
"""What no acceleration tells apart on any road (groups, and in words)."""

_FAINT = 1.0  # log deviation up to which a drive that says nothing is taken to be ignorant


class Pair(NamedTuple):
    """Two parameters that a drive hardly tells apart.

    Parameters
    ----------
    names : tuple of 2 str
        Of :data:`~bayes_asv.planning.information.SEEN`, at fixed mass and wheel base.
    correlation : float
        Of their logarithms, from the drive alone.
    blindness : float
        How many times wider the drive leaves either for not knowing the other.
    """

    names: tuple[str, str]
    correlation: float
    blindness: float


def pairs(information: Array) -> list[Pair]:
    """Find what one drive cannot tell apart.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass; the number of passes changes nothing.

    Returns
    -------
    list of Pair
        Most alike first.
    """
    covariance = np.linalg.inv(information + np.eye(len(SEEN)) / _FAINT**2)
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    found = []
    for a, b in combinations(range(len(SEEN)), 2):
        r = float(correlation[a, b])
        if abs(r) > ALIKE:
            found.append(Pair((SEEN[a], SEEN[b]), r, float(1.0 / np.sqrt(1.0 - r**2))))
    return sorted(found, key=lambda pair: -abs(pair.correlation))
