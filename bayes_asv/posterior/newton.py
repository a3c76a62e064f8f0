"""The mode of the posterior and its curvature there, by Newton's method.

Least squares on the normalised innovations come first, from several starting points; their noise
levels are fixed, so that they cannot end where noise explains everything.  Newton steps on the full
posterior follow, with derivatives by central differences scaled to each standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bayes_asv.posterior.likelihood import Posterior

__all__ = ["PosteriorMode", "find_mode", "residual_functions"]

Array = NDArray[np.float64]

# Step of forward differences, prior sd: a balance of rounding and truncation errors.
_SLOPE_STEP = 1e-6
# Step of central differences, sd: large against rounding, small against changes of the curvature.
_STEP = 0.3
_ROUNDS = 25  # Newton iterations
_GOOD_FIT = 1.3  # rms residual, in declared noise levels, below which no further start is tried
# Starting points: factors on all damping rates and on all inertias.
_STARTS = ((1.0, 1.0), (2.5, 1.0), (0.4, 1.0), (1.0, 2.0), (1.0, 0.5))


@dataclass(frozen=True)
class PosteriorMode:
    """A mode of the posterior.

    Parameters
    ----------
    z : (D,) array
        Coordinates.
    covariance : (D, D) array
        Inverse of the Hessian of minus the log-posterior there.
    log_posterior : float
        Log-posterior at the mode, not normalised.
    converged : bool
        Whether the last Newton step gained less than a thousandth of a nat.
    """

    z: Array
    covariance: Array
    log_posterior: float
    converged: bool

    @property
    def sd(self) -> Array:
        """Standard deviations (D,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def find_mode(posterior: Posterior, start: Array | None = None) -> PosteriorMode:
    """Find the mode of a posterior.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    start : (D,) array, optional
        Starting point; without it several are tried.

    Returns
    -------
    PosteriorMode
        Its ``converged`` is false if the iterations did not converge; this is not an error.
    """
    if start is None:
        start, sd = _least_squares(posterior)
    else:
        sd = posterior.space.scales(0.05)
    return _newton(posterior, start, sd)


def _least_squares(posterior: Posterior) -> tuple[Array, Array]:
    """Best of several least-squares fits, with noise levels fixed at their prior centre."""
    space = posterior.space
    n = space.shared_dimension
    levels = [
        (k, one.run, [c.name for c in outputs].index(one.channel))
        for k, one in enumerate(space.coordinates)
        if one.kind == "noise" and one.run is not None
        for recording in [space.recordings[one.run]]
        for outputs in [[recording.channels[c] for c in recording.outputs]]
        if one.channel in [c.name for c in outputs]
    ]

    residual, slopes = residual_functions(posterior, space.origin, range(n))
    best, best_value, best_sd = space.from_logs({}), -np.inf, space.scales(1.0)
    dampers = {element.damping for element in space.car.elements}
    for damping_factor, inertia_factor in _STARTS:
        start = space.from_logs(
            {
                name: math.log(damping_factor if name in dampers else inertia_factor)
                for name in space.car.estimated
            }
        )
        if np.any(np.abs(start) > 4.0):
            continue  # the prior is narrower than this start
        fit = least_squares(
            residual, start[:n], slopes, bounds=(-7.0, 7.0), xtol=1e-7, ftol=1e-8, max_nfev=40
        )
        z = space.origin
        z[:n] = fit.x
        largest = 0.0
        for k, run, y in levels:  # set noise levels to the rms of the residuals
            residuals = posterior.innovations(z, run)[:, y]
            level = float(np.sqrt(np.mean(residuals[residuals != 0.0] ** 2)))
            largest = max(largest, level)
            z[k] = np.clip(math.log(max(level, 1e-3)) / space.coordinates[k].scale, -4.0, 4.0)
        value = float(posterior.log_posterior(z[None])[0])
        if value > best_value:
            best, best_value = z, value
            curvature = np.sum(np.asarray(fit.jac) ** 2, axis=0)
            best_sd = space.scales(0.3)
            best_sd[:n] = 1.0 / np.sqrt(np.maximum(curvature, 1.0))
        if levels and largest < _GOOD_FIT:
            break  # no fit can leave less than the noise
    return best, best_sd


def residual_functions(
    posterior: Posterior, origin: Array, free: Sequence[int]
) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Make functions for least squares: residuals and their Jacobian.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    origin : (D,) array
        Coordinates; those that are not free keep these values.
    free : sequence of int
        Free coordinates, F of them.

    Returns
    -------
    residual, slopes : callable
        Functions of the free coordinates (F,): the normalised innovations of all runs followed by
        the coordinates themselves (whose prior is standard normal), and the Jacobian of these by
        forward differences.
    """
    runs, free = range(len(posterior.space.recordings)), list(free)

    def residuals(values: Array) -> Array:
        z = np.repeat(origin[None], len(values), axis=0)
        z[:, free] = values
        parts = [posterior.innovations(z, run).reshape(len(z), -1) for run in runs]
        every = np.concatenate([*parts, values], axis=1)
        return np.asarray(np.nan_to_num(every, nan=1e6, posinf=1e6, neginf=-1e6))

    def residual(values: Array) -> Array:
        return np.asarray(residuals(values[None])[0])

    def slopes(values: Array) -> Array:
        values_and_steps = residuals(
            values + _SLOPE_STEP * np.vstack([np.zeros(len(free)), np.eye(len(free))])
        )
        return np.asarray((values_and_steps[1:] - values_and_steps[0]).T / _SLOPE_STEP)

    return residual, slopes


def derivatives(posterior: Posterior, z: Array, scale: Array) -> tuple[float, Array, Array]:
    """Value, gradient (D,) and Hessian (D, D) of the log-posterior in units of ``scale``.

    Differences are taken run by run, since a run does not depend on the noise of another; the
    prior is standard normal.  Derivatives are nan if a step leaves the support of the posterior.
    """
    value = float(posterior.space.log_prior(z[None])[0])
    gradient = -z * scale
    hessian = -np.diag(scale**2)
    for run in range(len(posterior.space.recordings)):
        coordinates_of_run = posterior.space.coordinates_of_run(run)
        d = len(coordinates_of_run)
        steps = np.zeros((d, len(z)))
        steps[np.arange(d), coordinates_of_run] = _STEP * scale[coordinates_of_run]
        first, second = np.triu_indices(d, 1)
        both = steps[first] + steps[second]
        points = np.concatenate([z[None], z + steps, z - steps, z + both, z - both])
        values = posterior.by_run(points, [run])[0]
        if not np.all(np.isfinite(values)):
            return float(values[0]), np.full(len(z), np.nan), np.full((len(z), len(z)), np.nan)
        f0, fp, fm = values[0], values[1 : d + 1], values[d + 1 : 2 * d + 1]
        fc, fa = np.split(values[2 * d + 1 :], 2)
        value += float(f0)
        gradient[coordinates_of_run] += (fp - fm) / (2.0 * _STEP)
        curvature = np.diag((fp - 2.0 * f0 + fm) / _STEP**2)
        mixed = fc + fa - fp[first] - fm[first] - fp[second] - fm[second] + 2.0 * f0
        curvature[first, second] = curvature[second, first] = mixed / (2.0 * _STEP**2)
        hessian[np.ix_(coordinates_of_run, coordinates_of_run)] += curvature
    return value, gradient, hessian


def _newton(posterior: Posterior, z: Array, scale: Array) -> PosteriorMode:
    """Damped Newton iterations; the scale of the differences follows the curvature."""
    damping = 1.0
    d = len(z)
    value = float(posterior.log_posterior(z[None])[0])
    converged = False
    precision = np.eye(d)
    up_to_date = False
    for _ in range(_ROUNDS):
        if not up_to_date:
            value, gradient, hessian = derivatives(posterior, z, scale)
            if not (np.all(np.isfinite(gradient)) and np.all(np.isfinite(hessian))):
                scale = 0.3 * scale
                continue
            # Differences of a stiff likelihood are too coarse for poorly constrained directions.
            # The prior's curvature is known, and near a mode the data can only add to it.
            prior = np.diag(scale**2)
            eigen, vectors = np.linalg.eigh(-hessian - prior)
            precision = (vectors * np.maximum(eigen, 0.0)) @ vectors.T + prior
            up_to_date = True
        ridge = precision + (0.0 if damping < 1e-3 else damping) * np.diag(np.diag(precision))
        step = np.linalg.solve(ridge, gradient)
        step /= max(1.0, float(np.max(np.abs(step))) / 30.0)
        candidate = z + step * scale
        candidate_value = float(posterior.log_posterior(candidate[None])[0])
        gain = 0.5 * float(gradient @ np.linalg.solve(precision, gradient))
        if gain < 1e-3:
            converged = bool(np.linalg.eigvalsh(-hessian)[0] > 0.0)
            break
        if candidate_value > value:
            z, up_to_date = candidate, False
            damping = 0.0 if damping < 1e-2 else damping * 0.1
            sd = np.sqrt(np.diag(np.linalg.inv(precision)))
            scale = scale * np.clip(sd, 0.2, 5.0)
        else:
            damping = max(4.0 * damping, 0.05)
            if damping > 1e8:
                break
    covariance = np.linalg.inv(precision) * np.outer(scale, scale)
    return PosteriorMode(z, covariance, value, converged)
