"""What drives cannot separate: groups of parameters that none does, and pairs that one hardly does.

Accelerations depend on the ratios c/m, k/m and i/(m l²) only.  Which such groups there are follows
from the car and its measured outputs (:class:`bayes_asv.posterior.information.ParameterPrior`).
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.information import ParameterPrior

__all__ = ["MIN_CORRELATION", "CorrelatedPair", "Group", "correlated_pairs", "inseparable_groups"]

Array = NDArray[np.float64]

MIN_CORRELATION = 0.9
"""Correlation beyond which two parameters are reported: 1/√(1 − 0.9²) = 2.3, so the standard
deviation of each is more than twice what it would be with the other one known."""

_WEAK_PRIOR = 1.0  # standard deviation of a logarithm; regularises an uninformative drive
_ABSENT = 1e-3  # share of a direction in the identified ones below which no reading depends on it


class Group(NamedTuple):
    """Parameters that no drive separates.

    Parameters
    ----------
    names : tuple of str
        Parameters of the car; the first is a given value.
    words : str
        The change of them that leaves every reading as it is.
    along : (nT,) array
        That change of the logarithms of all unknowns.
    """

    names: tuple[str, ...]
    words: str
    along: Array


class CorrelatedPair(NamedTuple):
    """Two parameters whose estimates from one drive are strongly correlated.

    Parameters
    ----------
    names : tuple of 2 str
        Parameters of the car, with the first unknown of every inseparable group held fixed.
    correlation : float
        Correlation of their logarithms, from the drive alone.
    sd_inflation : float
        Factor 1/√(1 − r²) on the standard deviation of either for not knowing the other.
    """

    names: tuple[str, str]
    correlation: float
    sd_inflation: float


def inseparable_groups(about: ParameterPrior) -> tuple[Group, ...]:
    """Find the groups of parameters that no drive separates with what is measured."""
    springs = {about.names[int(np.argmax(about.log_gradients[e.spring] != 0.0))]
               for e in about.car.elements}  # fmt: skip
    heavier = {"m", *about.car.estimated, *springs}
    candidates = [
        ({name: 1.0 for name in about.names if name in heavier},
         "a heavier car with every rate in proportion"),
        ({"l": 1.0, "i": 2.0}, "pitch inertia in proportion to the square of the wheelbase"),
        ({"t_f": 1.0, "t_r": 1.0, "i_roll": 2.0},
         "roll inertia in proportion to the square of the track"),
    ]  # fmt: skip
    found = []
    for powers, words in candidates:
        if not set(powers) <= set(about.names):
            continue
        along = np.array([powers.get(name, 0.0) for name in about.names])
        if np.linalg.norm(about.identified.T @ along) < _ABSENT * np.linalg.norm(along):
            # the given values first: one of them has to be known
            names = sorted(powers, key=lambda name: name in about.car.estimated)
            found.append(Group(tuple(names), words, along))
    return tuple(found)


def correlated_pairs(information: Array, about: ParameterPrior) -> list[CorrelatedPair]:
    """Find the strongly correlated pairs of parameters of one drive.

    Parameters
    ----------
    information : (nT, nT) array
        Of one pass; the correlations do not depend on the number of passes.
    about : ParameterPrior
        Its unknowns.

    Returns
    -------
    list of CorrelatedPair
        In decreasing order of correlation.
    """
    held = {group.names[0] for group in inseparable_groups(about)}
    held |= {"t_r"} if "t_f" in held else set()
    kept = [k for k, name in enumerate(about.names) if name not in held]
    names = [about.names[k] for k in kept]
    own = information[np.ix_(kept, kept)]
    covariance = np.linalg.inv(own + np.eye(len(kept)) / _WEAK_PRIOR**2)
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    correlated = []
    for a, b in combinations(range(len(kept)), 2):
        r = float(correlation[a, b])
        if abs(r) > MIN_CORRELATION:
            inflation = float(1.0 / np.sqrt(1.0 - r**2))
            correlated.append(CorrelatedPair((names[a], names[b]), r, inflation))
    return sorted(correlated, key=lambda pair: -abs(pair.correlation))
