"""Unidentifiable groups of parameters, and pairs that are strongly correlated after one drive.

Accelerations depend on the ratios c/m, k/m and i/(m l²) only.  The unidentifiable groups follow
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
    """Parameters that no drive can separate.

    Parameters
    ----------
    names : tuple of str
        Parameters of the car; the first is a given value.
    words : str
        The change of them that does not change any reading, in words.
    along : (nT,) array
        Direction of that change in the logarithms of all unknowns.
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
        Factor 1/√(1 − r²) on the standard deviation of either because the other is unknown.
    """

    names: tuple[str, str]
    correlation: float
    sd_inflation: float


def inseparable_groups(parameter_prior: ParameterPrior) -> tuple[Group, ...]:
    """Find the groups of parameters that no drive can separate with the measured channels."""
    springs = {parameter_prior.names[int(np.argmax(parameter_prior.log_gradients[e.spring] != 0.0))]
               for e in parameter_prior.car.elements}  # fmt: skip
    heavier = {"m", *parameter_prior.car.estimated, *springs}
    candidates = [
        ({name: 1.0 for name in parameter_prior.names if name in heavier},
         "a heavier car with every rate in proportion"),
        ({"l": 1.0, "i": 2.0}, "pitch inertia in proportion to the square of the wheelbase"),
        ({"t_f": 1.0, "t_r": 1.0, "i_roll": 2.0},
         "roll inertia in proportion to the square of the track"),
    ]  # fmt: skip
    groups = []
    for powers, words in candidates:
        if not set(powers) <= set(parameter_prior.names):
            continue
        along = np.array([powers.get(name, 0.0) for name in parameter_prior.names])
        if np.linalg.norm(parameter_prior.identified.T @ along) < _ABSENT * np.linalg.norm(along):
            # the given values first: one of them has to be known
            names = sorted(powers, key=lambda name: name in parameter_prior.car.estimated)
            groups.append(Group(tuple(names), words, along))
    return tuple(groups)


def correlated_pairs(information: Array, parameter_prior: ParameterPrior) -> list[CorrelatedPair]:
    """Find the strongly correlated pairs of parameters of one drive.

    Parameters
    ----------
    information : (nT, nT) array
        Fisher information of one pass; the correlations do not depend on the number of passes.
    parameter_prior : ParameterPrior
        Unknowns of the car.

    Returns
    -------
    list of CorrelatedPair
        In decreasing order of correlation.
    """
    fixed = {group.names[0] for group in inseparable_groups(parameter_prior)}
    fixed |= {"t_r"} if "t_f" in fixed else set()
    kept = [k for k, name in enumerate(parameter_prior.names) if name not in fixed]
    names = [parameter_prior.names[k] for k in kept]
    kept_information = information[np.ix_(kept, kept)]
    covariance = np.linalg.inv(kept_information + np.eye(len(kept)) / _WEAK_PRIOR**2)
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    correlated = []
    for a, b in combinations(range(len(kept)), 2):
        r = float(correlation[a, b])
        if abs(r) > MIN_CORRELATION:
            inflation = float(1.0 / np.sqrt(1.0 - r**2))
            correlated.append(CorrelatedPair((names[a], names[b]), r, inflation))
    return sorted(correlated, key=lambda pair: -abs(pair.correlation))
