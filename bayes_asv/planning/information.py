"""What one recording says about the car: Fisher information in logarithms of its parameters.

With ν the normalised innovations at the true car, the information of a Gaussian record about
parameters θ that move its mean is Σ (∂ν/∂θ)(∂ν/∂θ)ᵀ: the negative Hessian of the log-likelihood
in expectation, positive by construction.  Noise levels are held at their true values.  Against
the curvature of the whole posterior, with every noise level free, that errs by 2 % on average
and 4 to 9 % in a single record (``benchmarks/plan.py``).

Mass and wheel base are fixed here: accelerations say nothing about them beyond the ratios
c/m, k/m and i/(m l²), and :mod:`bayes_asv.planning.widths` brings them back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from bayes_asv.domain.vehicle import Given, Vehicle
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import space
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["SEEN", "information"]

Array = NDArray[np.float64]

SEEN = ("c_f", "c_r", "i", "k_f", "k_r", "wdf")
"""Parameters whose logarithms the information is about, in its order."""

_LOGS = SEEN[:5]
_STEP = 0.02  # coordinates: 2 % of a damping rate, 0.1 % of a spring rate
_SPRING, _SHARE = 0.05, 0.01  # what a coordinate of a spring rate and the weight share is worth
# A sensor's own noise passes its own filter; a share of exactly one has no probit.
_FILTERED = 0.98


def information(line: PreparedRecording, vehicle: Vehicle) -> Array:
    """Information (6, 6) of one recording about the logarithms of :data:`SEEN`.

    Parameters
    ----------
    line : PreparedRecording
        The recording, laid out.
    vehicle : Vehicle
        The car that made it: its values are the truth here, its sensors' noise as well.

    Returns
    -------
    (6, 6) array
        Positive semi-definite; one pass.  Independent passes add.
    """
    loose = replace(
        vehicle,
        m=Given(vehicle.m.value),
        l=Given(vehicle.l.value),
        k_f=_loosened(vehicle.k_f, _SPRING),
        k_r=_loosened(vehicle.k_r, _SPRING),
        wdf=_loosened(vehicle.wdf, _SHARE),
    )
    where = space(loose, (line,))
    target = Posterior(where, (WHITE,))
    centre = np.zeros(where.dimension)
    if "filtered share 0" in where.names:
        centre[where.names.index("filtered share 0")] = ndtri(_FILTERED)
    d = where.car_dimension
    slope = np.empty((line.step.size * 2, d))
    for k in range(d):
        by = np.zeros(where.dimension)
        by[k] = _STEP
        up, down = target.innovations(centre + by, 0), target.innovations(centre - by, 0)
        slope[:, k] = (up - down).ravel() / (2.0 * _STEP)
    # coordinates are directions in units of prior deviations: turn them into logarithms
    turn = np.zeros((d, len(SEEN)))
    for a, name in enumerate(_LOGS):
        turn[:, a] = where.from_logs({name: 1.0})[:d]
    turn[d - 1] = 0.0
    turn[d - 1, 5] = loose.wdf.value / loose.wdf.sd
    slope = slope @ turn
    return np.asarray(slope.T @ slope)


def _loosened(given: Given, share: float) -> Given:
    """Return the value with a deviation, so that it becomes a coordinate."""
    return Given(given.value, share * given.value)
