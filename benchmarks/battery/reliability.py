"""Calibration of probabilities: reliability curve and expected calibration error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.battery.intervals import Share

__all__ = ["Bin", "bins", "calibration_error"]

Array = NDArray[np.float64]

_MAX_BINS = 10
_MIN_PER_BIN = 10  # probabilities
_DRAWS = 2000
_SEED = 71


@dataclass(frozen=True)
class Bin:
    """A bin of probabilities.

    Parameters
    ----------
    mean : float
        Mean of the probabilities.
    right : Share
        Share of true claims.
    """

    mean: float
    right: Share


def bins(probabilities: Sequence[tuple[float, bool]]) -> list[Bin]:
    """Sort probabilities into bins of about equal numbers: at most ten, at least ten in each.

    Equal probabilities stay together.
    """
    table = np.array(probabilities, dtype=np.float64).reshape(-1, 2)
    table = table[np.argsort(table[:, 0], kind="stable")]
    number = max(1, min(_MAX_BINS, len(table) // _MIN_PER_BIN))
    edges = [0]
    for part in np.array_split(np.arange(len(table)), number):
        if len(part) and part[-1] >= edges[-1]:
            last = np.searchsorted(table[:, 0], table[part[-1], 0], side="right")
            edges.append(int(last))
    return [
        Bin(float(table[a:b, 0].mean()), Share(int(table[a:b, 1].sum()), b - a))
        for a, b in pairwise(edges)
    ]


def calibration_error(probabilities: Sequence[tuple[float, bool]]) -> tuple[float, float]:
    """Return the expected calibration error, and its 95 % quantile for calibrated probabilities.

    The error is the mean over the bins, weighted by their numbers, of the distance of the true
    share from the mean probability (Naeini, Cooper & Hauskrecht 2015, there with bins of equal
    width). Calibrated probabilities have an error as well: its quantile is that of 2000 draws of
    truths from the probabilities themselves, seed 71 (consistency resampling, Bröcker & Smith
    2007).

    Parameters
    ----------
    probabilities : sequence of (float, bool)
        At least one.
    """
    found = bins(probabilities)
    numbers = np.array([b.right.of for b in found])
    p = np.sort(np.array([p for p, _ in probabilities]))
    starts = np.concatenate([[0], np.cumsum(numbers)[:-1]])
    means = np.add.reduceat(p, starts)

    def error(hits: Array) -> Array:
        return np.asarray(np.abs(hits - means).sum(axis=-1) / len(p))

    rng = np.random.default_rng(_SEED)
    drawn = (rng.random((_DRAWS, len(p))) < p).astype(np.float64)
    chance = error(np.add.reduceat(drawn, starts, axis=1))
    hits = np.array([b.right.hits for b in found], dtype=np.float64)
    return float(error(hits)), float(np.quantile(chance, 0.95))
