"""The most probable parameters and the curvature there.

Least squares on the normalised innovations come first, from several starts: with the noise
held they cannot run to the corner where everything is noise.  Newton steps on the whole
posterior finish, with derivatives by central differences scaled to each deviation.
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

_SLOPE_STEP = 1e-6  # of a prior deviation: halfway between rounding and curvature
_STEP = 0.3  # of a deviation: large against rounding, small against the posterior's curvature
_ROUNDS = 25
_NOTHING_LEFT = 1.3  # deviations of what is left, in units of the noise given
# Starts besides the prior's centre: factors on all damping rates and on all inertias.
_STARTS = ((1.0, 1.0), (2.5, 1.0), (0.4, 1.0), (1.0, 2.0), (1.0, 0.5))


@dataclass(frozen=True)
class PosteriorMode:
    """A mode of the posterior.

    Parameters
    ----------
    z : (D,) array
        Coordinates.
    covariance : (D, D) array
        Inverse of the curvature of minus the log-posterior there.
    log_posterior : float
        Its value, not normalised.
    converged : bool
        The last Newton step gained less than a thousandth of a nat.
    """

    z: Array
    covariance: Array
    log_posterior: float
    converged: bool

    @property
    def sd(self) -> Array:
        """Deviations (D,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def find_mode(posterior: Posterior, start: Array | None = None) -> PosteriorMode:
    """Climb to the posterior's mode.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    start : (D,) array, optional
        Where to begin; without it several starts are tried.

    Returns
    -------
    Mode
        With ``converged`` false when it did not settle: a value, not an error.
    """
    if start is None:
        start, sd = _least_squares(posterior)
    else:
        sd = posterior.space.scales(0.05)
    return _newton(posterior, start, sd)


def _least_squares(posterior: Posterior) -> tuple[Array, Array]:
    """Best of several least-squares fits, noise held at its prior centre."""
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
    for of_dampers, of_inertias in _STARTS:
        start = space.from_logs(
            {
                name: math.log(of_dampers if name in dampers else of_inertias)
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
        for k, run, y in levels:  # noise as large as what was left over
            left = posterior.innovations(z, run)[:, y]
            level = float(np.sqrt(np.mean(left[left != 0.0] ** 2)))
            largest = max(largest, level)
            z[k] = np.clip(math.log(max(level, 1e-3)) / space.coordinates[k].scale, -4.0, 4.0)
        value = float(posterior.log_posterior(z[None])[0])
        if value > best_value:
            best, best_value = z, value
            curvature = np.sum(np.asarray(fit.jac) ** 2, axis=0)
            best_sd = space.scales(0.3)
            best_sd[:n] = 1.0 / np.sqrt(np.maximum(curvature, 1.0))
        if levels and largest < _NOTHING_LEFT:
            break  # no start can end lower than at the noise
    return best, best_sd


def residual_functions(
    posterior: Posterior, origin: Array, free: Sequence[int]
) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Make what least squares asks for: residuals and their Jacobian.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    origin : (D,) array
        Values of the coordinates that are held.
    free : sequence of int
        The others, F of them.

    Returns
    -------
    residual, slopes : callable
        From values (F,) the normalised innovations of all runs with the values behind them (their
        prior is a standard normal), and the derivatives of these by forward differences.
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
        found = residuals(
            values + _SLOPE_STEP * np.vstack([np.zeros(len(free)), np.eye(len(free))])
        )
        return np.asarray((found[1:] - found[0]).T / _SLOPE_STEP)

    return residual, slopes


def derivatives(posterior: Posterior, z: Array, scale: Array) -> tuple[float, Array, Array]:
    """Value, gradient (D,) and Hessian (D, D) of the log-posterior in units of ``scale``.

    Differences are taken run by run, since a run knows nothing of another's noise; the prior
    is a standard normal.  Derivatives are nan where a step leaves the region in which the
    posterior is positive.
    """
    value = float(posterior.space.log_prior(z[None])[0])
    gradient = -z * scale
    hessian = -np.diag(scale**2)
    for run in range(len(posterior.space.recordings)):
        own = posterior.space.coordinates_of_run(run)
        d = len(own)
        steps = np.zeros((d, len(z)))
        steps[np.arange(d), own] = _STEP * scale[own]
        first, second = np.triu_indices(d, 1)
        both = steps[first] + steps[second]
        points = np.concatenate([z[None], z + steps, z - steps, z + both, z - both])
        values = posterior.by_run(points, [run])[0]
        if not np.all(np.isfinite(values)):
            return float(values[0]), np.full(len(z), np.nan), np.full((len(z), len(z)), np.nan)
        f0, fp, fm = values[0], values[1 : d + 1], values[d + 1 : 2 * d + 1]
        fc, fa = np.split(values[2 * d + 1 :], 2)
        value += float(f0)
        gradient[own] += (fp - fm) / (2.0 * _STEP)
        curvature = np.diag((fp - 2.0 * f0 + fm) / _STEP**2)
        mixed = fc + fa - fp[first] - fm[first] - fp[second] - fm[second] + 2.0 * f0
        curvature[first, second] = curvature[second, first] = mixed / (2.0 * _STEP**2)
        hessian[np.ix_(own, own)] += curvature
    return value, gradient, hessian


def _newton(posterior: Posterior, z: Array, scale: Array) -> PosteriorMode:
    """Damped Newton steps; the scale follows the curvature."""
    damping = 1.0
    d = len(z)
    value = float(posterior.log_posterior(z[None])[0])
    converged = False
    precision = np.eye(d)
    fresh = False
    for _ in range(_ROUNDS):
        if not fresh:
            value, gradient, hessian = derivatives(posterior, z, scale)
            if not (np.all(np.isfinite(gradient)) and np.all(np.isfinite(hessian))):
                scale = 0.3 * scale
                continue
            # Differences of a stiff likelihood are too coarse for its soft directions; the prior's
            # curvature is known, and the data can only add to it near a mode.
            prior = np.diag(scale**2)
            eigen, vectors = np.linalg.eigh(-hessian - prior)
            precision = (vectors * np.maximum(eigen, 0.0)) @ vectors.T + prior
            fresh = True
        ridge = precision + (0.0 if damping < 1e-3 else damping) * np.diag(np.diag(precision))
        step = np.linalg.solve(ridge, gradient)
        step /= max(1.0, float(np.max(np.abs(step))) / 30.0)
        candidate = z + step * scale
        reached = float(posterior.log_posterior(candidate[None])[0])
        gain = 0.5 * float(gradient @ np.linalg.solve(precision, gradient))
        if gain < 1e-3:
            converged = bool(np.linalg.eigvalsh(-hessian)[0] > 0.0)
            break
        if reached > value:
            z, fresh = candidate, False
            damping = 0.0 if damping < 1e-2 else damping * 0.1
            sd = np.sqrt(np.diag(np.linalg.inv(precision)))
            scale = scale * np.clip(sd, 0.2, 5.0)
        else:
            damping = max(4.0 * damping, 0.05)
            if damping > 1e8:
                break
    covariance = np.linalg.inv(precision) * np.outer(scale, scale)
    return PosteriorMode(z, covariance, value, converged)
