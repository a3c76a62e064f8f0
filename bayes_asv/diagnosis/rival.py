"""What was named, against the best single explanation that has no name.

Names that only together imitate a third thing leave nothing to be found behind them; held against
that thing alone, they are no better and cost more.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.clear import clear
from bayes_asv.diagnosis.decoys import decoy_rows
from bayes_asv.inference.likelihood import shared_work
from bayes_asv.inference.scoring import Climbed, slopes
from bayes_asv.inference.stage import Setting, Stage, carried

__all__ = ["AS_WELL", "rival"]

Array = NDArray[np.float64]

AS_WELL = -4.0
"""Nats from which on a decoy explains as well as names."""

_PRICE = 4.0  # nats that an effect of unknown size costs


def rival(where: Setting, stage: Stage, names: int, sites: int) -> tuple[float, str]:
    """Nats by which a decoy alone explains better than all names, and what it is.

    Car and noise are taken from the named model, the effects out of it; from there the decoy and
    the car answer the innovations to first order.

    Parameters
    ----------
    where, stage : Setting, Stage
        Recordings, and the model with everything named at its mode.
    names, sites : int
        How many were named, and out of how many.
    """
    target = where.target(())
    z = carried(stage.space, stage.mode.z, target.space, None, {})
    with shared_work(target) as shared:
        here = slopes(shared, z)
    rows, words = decoy_rows(clear(where, Stage((), target, Climbed(z, here, True))))
    # Least squares of the innovations on the car's coordinates, then on each decoy as well.
    whole = here.means @ here.means.T + np.eye(len(z))
    slope = here.means @ here.nu - z
    cross = here.means @ rows.T
    solved = np.linalg.solve(whole, np.column_stack([slope, cross]))
    pull = rows @ here.nu - cross.T @ solved[:, 0]
    own = np.sum(rows**2, axis=1)
    seen = own - np.sum(cross * solved[:, 1:], axis=0)
    gain = np.where(seen > 1e-8 * own, pull**2 / np.maximum(seen, 1e-30), 0.0)
    k = int(np.argmax(gain))
    alone = float(here.nu @ here.nu + z @ z - slope @ solved[:, 0] - gain[k])
    named = float(stage.mode.slopes.nu @ stage.mode.slopes.nu + stage.mode.z @ stage.mode.z)
    cost = (names - 1) * _PRICE + names * math.log(sites) - math.log(len(words))
    return 0.5 * (named - alone) + cost, words[k]
