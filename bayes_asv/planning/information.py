"""Fisher information of one recording about the logarithms of the car's parameters.

For normalised innovations ν with unit covariance, the information about parameters θ that change
their mean is J = Σ (∂ν/∂θ)(∂ν/∂θ)ᵀ, the expected negative Hessian of the log-likelihood.  The noise
levels are held at their true values.  Compared with the curvature of the full posterior with free
noise levels, J errs by 2 % on average and by 4 to 9 % in a single recording
(``benchmarks/plan.py``).

Mass and wheelbase are held fixed: accelerations depend on the ratios c/m, k/m and i/(m l²) only.
:mod:`bayes_asv.planning.predicted_sd` adds the uncertainty of both.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from bayes_asv.domain.vehicle import Given, Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import space
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = [
    "IDENTIFIABLE",
    "MIN_CORRELATION",
    "UNIDENTIFIABLE",
    "CorrelatedPair",
    "correlated_pairs",
    "fisher_information",
]

Array = NDArray[np.float64]

IDENTIFIABLE = ("c_f", "c_r", "i", "k_f", "k_r", "wdf")
"""Parameters of the information matrix, in its order."""

_LOG_PARAMETERS = IDENTIFIABLE[:5]
_STEP = 0.02  # of a coordinate, for central differences: 2 % of a damping rate, 0.1 % of a spring
_SPRING_SD, _WDF_SD = 0.05, 0.01  # relative; scale of the coordinates only, it cancels out
# Share of the noise that passes the sensor's filter; exactly one has no probit.
_FILTERED_SHARE = 0.98


def fisher_information(recording: PreparedRecording, vehicle: Vehicle) -> Array:
    """Compute the information of one recording about the logarithms of :data:`IDENTIFIABLE`.

    Parameters
    ----------
    recording : PreparedRecording
        One pass.
    vehicle : Vehicle
        The car; its values and the noise of its sensors are taken as true.

    Returns
    -------
    (6, 6) array
        Positive semi-definite.  The information of independent passes adds up.
    """
    # every identifiable parameter needs a prior deviation to become a coordinate
    free = replace(
        vehicle,
        m=Given(vehicle.m.value),
        l=Given(vehicle.l.value),
        k_f=_with_sd(vehicle.k_f, _SPRING_SD),
        k_r=_with_sd(vehicle.k_r, _SPRING_SD),
        wdf=_with_sd(vehicle.wdf, _WDF_SD),
    )
    wide = replace(recording, car=car_model(recording.car.name, free))
    parameters = space(free, (wide,))
    posterior = Posterior(parameters, (WHITE,))
    z = np.zeros(parameters.dimension)
    if "filtered share 0" in parameters.names:
        z[parameters.names.index("filtered share 0")] = ndtri(_FILTERED_SHARE)
    d = parameters.car_dimension
    jacobian = np.empty((recording.kind.size, d))
    for k in range(d):
        dz = np.zeros(parameters.dimension)
        dz[k] = _STEP
        above, below = posterior.innovations(z + dz, 0), posterior.innovations(z - dz, 0)
        jacobian[:, k] = (above - below).ravel() / (2.0 * _STEP)
    # ∂z/∂ln θ: coordinates are in units of prior deviations
    to_coordinates = np.zeros((d, len(IDENTIFIABLE)))
    for a, name in enumerate(_LOG_PARAMETERS):
        to_coordinates[:, a] = parameters.from_logs({name: 1.0})[:d]
    to_coordinates[d - 1] = 0.0
    to_coordinates[d - 1, 5] = free.wdf.value / free.wdf.sd
    jacobian = jacobian @ to_coordinates
    return np.asarray(jacobian.T @ jacobian)


def _with_sd(given: Given, relative_sd: float) -> Given:
    """Return the value with another standard deviation."""
    return Given(given.value, relative_sd * given.value)


MIN_CORRELATION = 0.9
"""Correlation beyond which two parameters are reported: 1/√(1 − 0.9²) = 2.3, so the standard
deviation of each is more than twice what it would be with the other one known."""

UNIDENTIFIABLE = (
    (("m", "c_f", "c_r", "i", "k_f", "k_r"), "a heavier car with every rate in proportion"),
    (("i", "l"), "pitch inertia in proportion to the square of the wheelbase"),
)
"""Groups of parameters that no acceleration separates, each with a description."""

_WEAK_PRIOR = 1.0  # standard deviation of a logarithm; regularises an uninformative drive


class CorrelatedPair(NamedTuple):
    """Two parameters whose estimates from one drive are strongly correlated.

    Parameters
    ----------
    names : tuple of 2 str
        Of :data:`IDENTIFIABLE`, at fixed mass and wheelbase.
    correlation : float
        Correlation of their logarithms, from the drive alone.
    sd_inflation : float
        Factor 1/√(1 − r²) on the standard deviation of either for not knowing the other.
    """

    names: tuple[str, str]
    correlation: float
    sd_inflation: float


def correlated_pairs(information: Array) -> list[CorrelatedPair]:
    """Find the strongly correlated pairs of parameters of one drive.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass; the correlations do not depend on the number of passes.

    Returns
    -------
    list of CorrelatedPair
        In decreasing order of correlation.
    """
    covariance = np.linalg.inv(information + np.eye(len(IDENTIFIABLE)) / _WEAK_PRIOR**2)
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    correlated = []
    for a, b in combinations(range(len(IDENTIFIABLE)), 2):
        r = float(correlation[a, b])
        if abs(r) > MIN_CORRELATION:
            correlated.append(
                CorrelatedPair(
                    (IDENTIFIABLE[a], IDENTIFIABLE[b]), r, float(1.0 / np.sqrt(1.0 - r**2))
                )
            )
    return sorted(correlated, key=lambda pair: -abs(pair.correlation))
