"""What was named, against the best single explanation that has no name.

Names that only together imitate a third thing leave nothing to be found behind them; held against
that thing alone, they are no better and cost more.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.clear import Quiet, clear
from bayes_asv.diagnosis.imitation import imitation
from bayes_asv.diagnosis.thresholds import PRICE
from bayes_asv.diagnosis.unlisted import unlisted
from bayes_asv.inference.likelihood import shared_work
from bayes_asv.inference.scoring import Climbed, slopes
from bayes_asv.inference.stage import Setting, Stage

__all__ = ["rival"]

Array = NDArray[np.float64]


def rival(where: Setting, stage: Stage, names: int, sites: int) -> tuple[float, str]:
    """Nats by which a decoy alone explains better than all names, and what it is.

    Car and noise are taken from the named model, the effects out of it; from there the decoy and
    the car answer the innovations to first order.

    Parameters
    ----------
    where, stage : Setting, Stage
        Recordings with quiet wheels, and the model with everything named at its mode.
    names, sites : int
        How many were named, and out of how many.
    """
    target = where.target(())
    z = stage.carried_to(target.space)
    with shared_work(target) as shared:
        here = slopes(shared, z)
    quiet = clear(where, Stage((), target, Climbed(z, here, True)))
    # Least squares of the innovations on the car's coordinates, then on each decoy as well; how
    # much noise there is was settled with everything named.
    car = slice(target.space.lasting_dimension)
    along = quiet.slopes.only(car)
    along = replace(along, scales=0.0 * along.scales, given_back=0.0 * z[car])
    known = imitation(along, z[car], along.means[:0])
    decoys = unlisted(quiet, known)
    gain, words = decoys.best
    own = float(known.slope @ np.linalg.solve(known.precision, known.slope))
    alone = _misfit(here.nu, quiet, z) - own - 2.0 * gain
    named = _misfit(stage.mode.slopes.nu, quiet, stage.mode.z)
    cost = (names - 1) * PRICE + names * math.log(sites) - math.log(len(decoys.words))
    return 0.5 * (named - alone) + cost, words


def _misfit(nu: Array, quiet: Quiet, z: Array) -> float:
    """Twice what innovations and coordinates lose, where the filter has found the motion."""
    return float(np.sum(nu[quiet.settled] ** 2) + z @ z)
