"""What was named, against the best single explanation that has no name.

Names that only together imitate a third thing leave nothing to be found behind them; held against
that thing alone, they are no better and cost more.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.denoised_model import clear
from bayes_asv.diagnosis.nuisance_projection import imitation
from bayes_asv.diagnosis.thresholds import AS_WELL, PRICE, SHORT
from bayes_asv.diagnosis.tolerance_prior import granted
from bayes_asv.diagnosis.unlisted_faults_test import unlisted
from bayes_asv.posterior.fisher_scoring import LaplaceFit, slopes
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fitted
from bayes_asv.posterior.likelihood import Posterior, shared_work

__all__ = ["rival"]

Array = NDArray[np.float64]

_ROUNDS = 2


class _Instead(NamedTuple):
    """A decoy in the place of everything named.

    Parameters
    ----------
    lost : float
        Nats that it and the car do not explain.
    worth : float
        Nats that it explains beside the car, to first order.
    words : str
        What it is.
    z : (D,) array
        The car and the noise beside it.
    settled : (N,) bool array
        Innovations that count.
    out_of : int
        How many decoys it was chosen from.
    """

    lost: float
    worth: float
    words: str
    z: Array
    settled: NDArray[np.bool_]
    out_of: int


def rival(where: Dataset, stage: FittedModel, names: int, sites: int) -> tuple[float, str]:
    """Nats by which a decoy alone explains better than all names, and what it is.

    It is chosen, and its size, to first order with the car and the noise that the names left, the
    effects out of it; what it is worth says a fit with it.  Where a name hides it, noise has
    swollen to cover the rest, and held there it would hide it still (a sensor 14 mm further in,
    taken for 1.6 % of its gain: 9 nats behind, and 4 before it once noise was free).  Where first
    order may have fallen short it is chosen again from there.

    Parameters
    ----------
    where, stage : Dataset, FittedModel
        Recordings with quiet wheels, and the model with everything named at its mode.
    names, sites : int
        How many were named, and out of how many.
    """
    target = where.target(())
    z = stage.carried_to(target.space)
    best, words = -math.inf, ""
    for _ in range(_ROUNDS):
        other = _instead(where, target, z)
        if other is None:
            break
        named = _lost(stage.target, stage.mode, other.settled)
        price = names * (PRICE + math.log(sites)) - PRICE - math.log(other.out_of)
        if named - other.lost + price > best:
            best, words = named - other.lost + price, other.words
        if not AS_WELL - SHORT * other.worth < best < AS_WELL:
            break
        z = other.z
    return best, words


def _instead(where: Dataset, target: Posterior, z: Array) -> _Instead | None:
    """Fit the decoy that explains most about a car without effects at ``z``; none if none does."""
    with shared_work(target) as shared:
        here = slopes(shared, z)
    plain = FittedModel((), target, LaplaceFit(z, here, True))
    quiet = clear(where, plain)
    # least squares of the innovations on the car's coordinates, then on each decoy as well
    car = slice(target.space.lasting_dimension)
    along = quiet.slopes.only(car)
    along = replace(along, scales=0.0 * along.scales, given_back=0.0 * z[car])
    known = imitation(along, z[car], along.means[:0])
    decoys = unlisted(quiet, known)
    k = int(np.argmax(decoys.gains))
    worth = float(decoys.gains[k])
    if not worth > 0.0:
        return None
    change = decoys.rows[k] * decoys.pull[k] / decoys.gram[k, k]
    start = z.copy()
    start[car] += np.linalg.solve(known.precision, known.slope - known.rows @ change)
    with_it = fitted(granted(plain, change[None], np.ones(1)), start)
    lost = _lost(with_it.target, with_it.mode, quiet.settled)
    return _Instead(lost, worth, decoys.words[k], with_it.mode.z, quiet.settled, len(decoys.words))


def _lost(target: Posterior, mode: LaplaceFit, settled: NDArray[np.bool_]) -> float:
    """Nats that a model loses on innovations and coordinates, once its filter has settled.

    A reading at the end of its range is no innovation: no simulation says what it would have been.
    """
    here = mode.slopes
    runs = range(len(target.space.timelines))
    back = sum(float(target.given_back(mode.z[None], run)[0]) for run in runs)
    lost = np.sum((here.nu**2 + here.logs)[settled]) + mode.z @ mode.z
    return 0.5 * float(lost) - back
