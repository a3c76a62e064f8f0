"""What was named, against the best single explanation that has no name.

Names that only together imitate a third thing leave nothing to be found behind them; held against
that thing alone, they are no better and cost more.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bayes_asv.diagnosis.clear import clear
from bayes_asv.diagnosis.imitation import imitation
from bayes_asv.diagnosis.thresholds import PRICE
from bayes_asv.diagnosis.tolerance import granted
from bayes_asv.diagnosis.unlisted import unlisted
from bayes_asv.inference.likelihood import shared_work
from bayes_asv.inference.scoring import Climbed, slopes
from bayes_asv.inference.stage import Setting, Stage, fitted

__all__ = ["rival"]


def rival(where: Setting, stage: Stage, names: int, sites: int) -> tuple[float, str]:
    """Nats by which a decoy alone explains better than all names, and what it is.

    Car and noise are taken from the named model, the effects out of it; there the decoy that
    explains most to first order is chosen.  What it is worth says a fit with it: where a name
    hides it, noise has swollen to cover the rest, and held there it would hide it still (a sensor
    14 mm further in, taken for 1.6 % of its gain: 9 nats behind, and 6 before it once noise was
    free).

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
    plain = Stage((), target, Climbed(z, here, True))
    quiet = clear(where, plain)
    # Least squares of the innovations on the car's coordinates, then on each decoy as well; how
    # much noise there is was settled with everything named.
    car = slice(target.space.lasting_dimension)
    along = quiet.slopes.only(car)
    along = replace(along, scales=0.0 * along.scales, given_back=0.0 * z[car])
    known = imitation(along, z[car], along.means[:0])
    decoys = unlisted(quiet, known)
    k = int(np.argmax(decoys.gains))
    change = decoys.rows[k : k + 1] * decoys.pull[k] / decoys.gram[k, k]
    with_it = fitted(granted(plain, change, np.ones(1)), z)
    cost = (names - 1) * PRICE + names * math.log(sites) - math.log(len(decoys.words))
    better = with_it.mode.log_posterior - stage.mode.log_posterior
    return better + cost, decoys.words[k]
