"""Magnitude adjustment of a misspecified likelihood from the scores of segments.

Where a car does what no half car does, what is left over is no steady noise: it swells and
changes with the road, and the curvature of the likelihood claims too much.  The score of each
part of a recording, its pull on the parameters, shows how much: the parts' scores vary by F,
the information, if the likelihood is right, and by K if it is not.  The likelihood is then
raised to the power tr(F Σ) / tr(K Σ), with Σ the posterior's covariance, so that on the whole
the posterior is as wide as the estimate varies: the magnitude adjustment of a composite
likelihood (Pauli, Racugno & Ventura 2011, Statistica Sinica 21) with Takeuchi's trace.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.newton import Mode

__all__ = ["FEWEST_PARTS", "PERIODS", "agreement", "share"]

Array = NDArray[np.float64]

PERIODS = 10.0  # of the slowest mode that a part lasts: what swings in it is over at its end
FEWEST_PARTS = 5
_STEP = 0.1  # of a posterior deviation, for derivatives of what is all but linear


def agreement(scores: Array, information: Array, covariance: Array) -> float:
    """Power of a likelihood whose parts' scores vary more than its information says.

    Parameters
    ----------
    scores : (B, d) array
        Gradient of each part's log-likelihood.
    information : (d, d) array
        F, what the whole claims to know.
    covariance : (d, d) array
        Σ, of the posterior.

    Returns
    -------
    float
        tr(F Σ) / tr(K Σ) with K the B parts' sum of squares about their mean, times
        B / (B − 1); near 1 if the likelihood is right, with a relative deviation of about
        √(2 / (B p)) where p parameters are measured.  Never above 1.
    """
    count = len(scores)
    about = scores - scores.mean(axis=0)
    varied = float(np.sum((about @ covariance) * about)) * count / (count - 1)
    claimed = float(np.sum(information * covariance))
    return min(1.0, claimed / varied) if varied > 0.0 else 1.0


def share(target: Posterior, mode: Mode, run: int, slowest: float) -> float | None:
    """Share of its readings for which a run should count.

    Parameters
    ----------
    target : Posterior
        The posterior.
    mode : Mode
        Its mode.
    run : int
        Which recording.
    slowest : float
        Natural frequency of the car's slowest mode, Hz.

    Returns
    -------
    float or None
        None when the recording has not :data:`FEWEST_PARTS` parts of :data:`PERIODS` periods.
    """
    line = target.space.timelines[run]
    time = line.instants[line.pairs.max(axis=1)]
    span = float(time[-1] - time[0])
    count = int(span * slowest / PERIODS)
    if count < FEWEST_PARTS:
        return None
    n = target.space.car_dimension
    sd = mode.sd[:n]

    def innovations(z: Array) -> Array:
        return np.nan_to_num(line.paired(target.innovations(z, run)))

    slope = np.empty((len(time), len(line.outputs), n))
    for k in range(n):
        step = np.zeros(len(mode.z))
        step[k] = _STEP * sd[k]
        slope[:, :, k] = innovations(mode.z + step) - innovations(mode.z - step)
    slope /= 2.0 * _STEP  # in units of the posterior's deviations
    information = np.einsum("tak,tal->kl", slope, slope)
    pull = -np.einsum("tak,ta->tk", slope, innovations(mode.z))
    part = np.minimum(((time - time[0]) / span * count).astype(int), count - 1)
    scores = np.zeros((count, n))
    np.add.at(scores, part, pull)
    covariance = np.linalg.inv(information + np.diag(sd**2))  # the prior is a standard normal
    return agreement(scores, information, covariance)
