"""Is there a disagreement at all?  One test over many directions together.

The largest squared score over the directions is held against its distribution under the model,
drawn with the correlations that the signatures have (Westfall & Young 1993, for Gaussian
scores).  A global test of the residual would need an effect far larger than one that looks for
what may be missing.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.free_force_test import RAREST, push_p
from bayes_asv.diagnosis.score_test import SILENT, ScoreTest

__all__ = ["family_p", "largest", "one_sided"]

Array = NDArray[np.float64]

_DRAWS = 20_000
_LOUDER = 1.03  # times as loud as a filter believes are innovations where laws answer, 10 to 40 Hz
_FOR_PUSHES = 0.2  # share of the error that pushes have to themselves


def one_sided(score: Array, found: ScoreTest) -> Array:
    """Squared scores (…, K), zero where less than nothing of an effect is asked for."""
    signed = np.array([c.signed for c in found.candidates])
    return np.where(signed & (score < 0.0), 0.0, score**2)


def family_p(found: ScoreTest, seed: int) -> float:
    """p-value of the largest squared score over all candidates.

    A push may begin and end at any time, which makes it thousands of questions; so that they do not
    make all others dear, they have a fifth of the error to themselves (Bonferroni with weights).
    No noise model is right to the last per cent, and a twentieth of a score's variance makes half
    as many false alarms again: three per cent, as measured, are allowed for.

    Parameters
    ----------
    found : ScoreTest
        Of all candidates, edges among them.
    seed : int
        Of the draws.
    """
    found = replace(found, pull=found.pull / math.sqrt(_LOUDER))
    plain = np.flatnonzero([not c.edge for c in found.candidates])
    signed = np.array([found.candidates[k].signed for k in plain])
    raw = np.sum(found.rows[plain] ** 2, axis=1)
    p, _ = largest(found.pull[plain], found.gram[np.ix_(plain, plain)], raw, signed, seed)
    others = p / (1.0 - _FOR_PUSHES)
    if others <= RAREST / _FOR_PUSHES:  # pushes cannot be rarer, and take long to ask
        return others
    return min(others, push_p(found, seed) / _FOR_PUSHES, 1.0)


def largest(
    pull: Array, gram: Array, raw: Array, signed: NDArray[np.bool_], seed: int
) -> tuple[float, int]:
    """p-value of the largest squared score over K directions, and which it is.

    Parameters
    ----------
    pull : (K,) array
        Slopes of the log-likelihood.
    gram : (K, K) array
        Their covariance under the model.
    raw : (K,) array
        Squared lengths of the signatures before the model's own part was taken out; what is next
        to nothing of that is silent.
    signed : (K,) bool array
        Directions in which only a positive score counts.
    seed : int
        Of 20,000 draws.
    """
    own = np.diag(gram)
    use = own > SILENT * np.maximum(raw, 1e-30)
    if not np.any(use):
        return 1.0, 0
    sd = np.sqrt(own[use])
    eigen, vectors = np.linalg.eigh(gram[np.ix_(use, use)] / np.outer(sd, sd))
    root = vectors * np.sqrt(np.maximum(eigen, 0.0))
    rng = np.random.default_rng([seed, 21])
    draws = rng.standard_normal((_DRAWS, len(root))) @ root.T
    top = np.where(signed[use] & (draws < 0.0), 0.0, draws**2).max(axis=1)
    score = np.zeros(len(pull))
    score[use] = pull[use] / sd
    squared = np.where(signed & (score < 0.0), 0.0, score**2)
    k = int(np.argmax(squared))
    p = (1 + np.count_nonzero(top >= squared[k])) / (1 + _DRAWS)
    return float(p), k
