"""What the unscented filter keeps, and what it is given: plain records for compiled code."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BROKEN", "CLOCK", "COLOUR", "COLUMNS", "COPIED", "DEFLECTION", "DEFLECTION_SD", "DEVIATION",
    "DOUBT", "DOUBTED", "EXPECTED", "EXPECTED_SD", "INNOVATION", "LAGS", "LEVEL", "LOG_P", "LOST",
    "MEAN", "MEMORY", "MOTION", "NIS", "QUICK", "READINGS", "SCORE", "SHAKEN", "SUM", "WEIGHT",
    "Model", "Rules",
    "State", "Steps",
]  # fmt: skip

Array = NDArray[np.float64]

# What `memory` holds.  Level of the noise of the front axle, then of the rear: sum and weight of
# what is behind the slow one, and the quick one.  Then clocks (s): of an upset, since the last
# look, since the last copy to `safe`; the logarithm of the parameters' volume that was lost, the
# log-likelihood, and −2 log p of the readings given the reference; how much more than white
# innovations theirs say at low frequencies, and whether the parameters are doubted for it; mean
# and variance of late of what the motion makes of each axle's acceleration.
SUM, WEIGHT, QUICK = 0, 2, 4
BROKEN, CLOCK, COPIED, LOST, LOG_P, SCORE = 6, 7, 8, 9, 10, 11
COLOUR, DOUBTED = 12, 13
MOTION, SHAKEN = 14, 16
MEMORY: Final = 18

LAGS: Final = 8
"""Readings apart up to which the filter looks for correlation of its innovations."""

# What a row of `out` holds.  Where two columns are meant, the front comes first.
MEAN, DEVIATION = 0, 3  # of the coordinates of c_f, c_r and i
DEFLECTION, DEFLECTION_SD = 6, 8  # m
EXPECTED, EXPECTED_SD = 10, 12  # readings, m/s²
NIS, READINGS = 14, 15  # squared deviations of the innovations, and how many readings have some
LEVEL = 16  # of the noise's variance
INNOVATION = 18  # in deviations; of the rear one, given the front one
DOUBT = 20  # one while the parameters are doubted
COLUMNS: Final = 21


class State(NamedTuple):
    """What the filter knows; every array is changed in place.

    Parameters
    ----------
    mu, D : (p,) and (p, p) arrays
        Reference, and spread of the sigma points: row i is direction i, zero before its i-th.
    x, J : (10,) and (p, 10) arrays
        State at the reference and its derivative along the directions.
    m, F : (p,) and (p, p) arrays
        Mean and triangular factor (rows as in D) of d; zero and one where the reference moves.
    Pi : (10, 10) array
        Covariance of the state given the parameters.
    memory : (MEMORY,) array
        See the module.
    safe : (2, p, 1 + p) array
        μ and D some time ago, when all was well: two copies, the older one first.
    echo : (2, 2, 1 + LAGS) array
        Of each axle: normalised innovations, the last one second, and running means of products
        of the newest with itself and with them.
    """

    mu: Array
    D: Array
    x: Array
    J: Array
    m: Array
    F: Array
    Pi: Array
    memory: Array
    safe: Array
    echo: Array


class Model(NamedTuple):
    """Car and sensors.

    Parameters
    ----------
    base, which, log, centre, scale : arrays
        As in :func:`bayes_asv.filters.simd_batch.place_cars`.
    noise : (12,) array
        As in :func:`bayes_asv.filters.kalman.log_likelihood`.
    start : (6,) array
        Prior variances of δ_f, δ̇_f, δ_r, δ̇_r and of the two biases.
    walk, doubt : (p,) arrays
        Variance that a coordinate gains in a second, and that it gains while parameters are
        doubted if that is more.
    """

    base: Array
    which: NDArray[np.int64]
    log: NDArray[np.bool_]
    centre: Array
    scale: Array
    noise: Array
    start: Array
    walk: Array
    doubt: Array


class Rules(NamedTuple):
    """When the filter doubts its noise, and when it comes back.

    Parameters
    ----------
    gate : float
        Squared deviations of a reading beyond which its variance is widened to that many.
    trust : float
        Readings that the declared noise is worth.
    window, quick : float
        Readings over which the slow and the quick level of the noise are learnt.
    sudden : float
        Quick level beyond which it counts.
    broken : float
        Quick level beyond which more than noise is at fault.
    patience : float
        Seconds at such a level after which the run comes back.
    coloured : float
        How much more than white ones innovations may say at low frequencies before parameters
        that are taken for constant are doubted; below its root they are trusted again.
    learned : float
        Logarithm of the parameters' volume that may be lost before the run comes back.
    look : float
        Seconds after which it comes back in any case.
    """

    gate: float
    trust: float
    window: float
    quick: float
    sudden: float
    broken: float
    patience: float
    coloured: float
    learned: float
    look: float


class Steps(NamedTuple):
    """Steps and readings.

    Parameters
    ----------
    step, moments, spread, kind, reading : arrays
        As in :func:`bayes_asv.filters.kalman.log_likelihood`.
    afresh : (N,) bool array
        Steps over which nothing is known of the wheels: the motion starts anew behind them.
    """

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    reading: Array
    afresh: NDArray[np.bool_]
