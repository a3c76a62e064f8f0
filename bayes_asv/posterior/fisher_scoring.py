"""Fisher scoring: maximisation with first derivatives of the innovations alone.

For normalised innovations ν with log variances s the log-likelihood is −½ Σ (ν² + s).  With dν and
ds their derivatives along a coordinate, the change of the prediction in units of its standard
deviation is dm = −(dν + ½ ν ds), the score is −Σ (ν dν + ½ ds), and the expected information is
Σ dm dmᵀ + ½ ds dsᵀ.  One filter pass per coordinate is enough, where second derivatives need one
per pair of coordinates, and the information is positive definite at any starting point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import LANES
from bayes_asv.posterior.likelihood import Posterior

__all__ = [
    "STEP",
    "LaplaceApproximation",
    "ScoreAndInformation",
    "maximise_by_scoring",
    "secant_update",
    "slopes",
]

Array = NDArray[np.float64]

STEP = 1e-4  # step of finite differences, prior standard deviations
_FIXED_NOISE_ROUNDS, _ROUNDS = 8, 20  # iterations with fixed noise levels, and with all free
_MIN_GAIN = 5e-3  # predicted gain of the next step (nats) below which the search has converged
# Step lengths tried, as shares of the full step: along a curved ridge a shorter step gets further
# than one with more damping.
_STEP_SHARES = (1.0, 0.4, 0.15)
_REACHABLE = 10.0  # largest total gain still expected, in predicted gains of the next step
_SECANT_PAIRS = 4  # latest steps whose changes of gradient update the curvature
_MIN_CURVATURE_SHARE = 0.1  # least observed curvature for a secant update, as share of the expected
# Gain (nats) predicted by the expected curvature above which secant updates may not end the search.
_NEGLIGIBLE_GAIN = 1.0
_MISFIT_SQUARE = 1.3  # mean square of the innovations above which the model is wrong


@dataclass(frozen=True)
class ScoreAndInformation:
    """Innovations at a point, with their derivatives, and the score and information from them.

    Parameters
    ----------
    nu : (N,) array
        Normalised innovations of all runs, readings without a value left out.
    log_variances : (N,) array
        Logarithms of their variances.
    means : (D, N) array
        Derivatives of the predictions along each coordinate, in standard deviations; zero for a run
        that does not depend on the coordinate.
    scales : (D, N) array
        Derivatives of the log variances.
    log_posterior : float
        Log-posterior at the point, not normalised.
    removed_band_correction : (D,) array
        Gradient of the log-determinant correction for removed bands.
    """

    nu: Array
    log_variances: Array
    means: Array
    scales: Array
    log_posterior: float
    removed_band_correction: Array

    def only(self, kept: NDArray[np.bool_] | slice) -> ScoreAndInformation:
        """Return a copy with derivatives along some of the coordinates."""
        return replace(
            self,
            means=self.means[kept],
            scales=self.scales[kept],
            removed_band_correction=self.removed_band_correction[kept],
        )

    def gradient(self, z: Array) -> Array:
        """Gradient (D,) of the log-posterior."""
        of_data = self.means @ self.nu + 0.5 * self.scales @ (self.nu**2 - 1.0)
        return of_data + self.removed_band_correction - z

    def precision(self) -> Array:
        """Return the expected information (D, D): of the data, plus that of the prior."""
        data = self.means @ self.means.T + 0.5 * self.scales @ self.scales.T
        return data + np.eye(len(data))


@dataclass(frozen=True)
class LaplaceApproximation:
    """Mode and expected information of a posterior, found by Fisher scoring.

    Parameters
    ----------
    z : (D,) array
        Coordinates of the mode.
    slopes : ScoreAndInformation
        The last derivatives computed, at or within a negligible step of the mode.
    converged : bool
        Whether the predicted gain of the next step is negligible.
    """

    z: Array
    slopes: ScoreAndInformation
    converged: bool

    @property
    def log_posterior(self) -> float:
        """Value at the mode, not normalised."""
        return self.slopes.log_posterior

    @property
    def covariance(self) -> Array:
        """Inverse (D, D) of the expected information."""
        return np.asarray(np.linalg.inv(self.slopes.precision()))

    @property
    def log_evidence(self) -> float:
        """Log evidence by Laplace's approximation."""
        _, log_det = np.linalg.slogdet(self.slopes.precision())
        volume = 0.5 * len(self.z) * math.log(2.0 * math.pi) - 0.5 * float(log_det)
        return self.log_posterior + volume


def slopes(
    posterior: Posterior, z: Array, first: int = 0, last: int | None = None
) -> ScoreAndInformation:
    """Compute forward differences along every coordinate, run by run.

    Parameters
    ----------
    posterior : Posterior
        Posterior with sensor corrections.
    z : (D,) array
        Coordinates.
    first, last : int
        Coordinates before ``first`` and from ``last`` on are fixed: their derivatives are zero.

    Returns
    -------
    ScoreAndInformation
    """
    space = posterior.space
    runs = range(len(space.recordings))
    last = len(z) if last is None else last
    coordinates_of_runs = [space.coordinates_of_run(run) for run in runs]
    free_of_runs = [
        columns[(columns >= first) & (columns < last)] for columns in coordinates_of_runs
    ]
    points = [
        z + np.vstack([np.zeros(len(z)), STEP * np.eye(len(z))[columns]])
        for columns in free_of_runs
    ]
    pieces = [(run, k) for run in runs for k in range(0, len(points[run]), LANES)]

    def filter_piece(piece: tuple[int, int]) -> tuple[Array, Array, Array]:
        run, k = piece
        return posterior.filter_passes(points[run][k : k + LANES], run)

    work = posterior.pool.map if posterior.pool else map
    passes = dict(zip(pieces, work(filter_piece, pieces), strict=True))
    parts = []
    band_correction = np.zeros(len(z))
    for run in runs:
        passes_of_run = [passes[piece] for piece in pieces if piece[0] == run]
        nu, logs = (
            np.concatenate([x[k].reshape(len(x[k]), -1) for x in passes_of_run]) for k in (0, 1)
        )
        has_reading = logs[0] != 0.0
        nu, logs = nu[:, has_reading], logs[:, has_reading]
        columns = free_of_runs[run]
        means, scales = (np.zeros((len(z), nu.shape[1])) for _ in range(2))
        with np.errstate(invalid="ignore", over="ignore"):  # where the filter diverged
            scales[columns] = (logs[1:] - logs[0]) / STEP
            means[columns] = -((nu[1:] - nu[0]) / STEP + 0.5 * nu[0] * scales[columns])
        parts.append((nu[0], logs[0], means, scales))
        if space.recordings[run].removed_band is not None:
            corrections = posterior.removed_band_correction(points[run], run)
            band_correction[columns] += (corrections[1:] - corrections[0]) / STEP
    nu, logs = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    value = _log_posterior(posterior, z)
    means = np.concatenate([p[2] for p in parts], axis=1)
    scales = np.concatenate([p[3] for p in parts], axis=1)
    return ScoreAndInformation(nu, logs, means, scales, value, band_correction)


def maximise_by_scoring(
    posterior: Posterior, start: Array, floor: float = -math.inf
) -> LaplaceApproximation:
    """Find the mode of a posterior from a starting point.

    Parameters
    ----------
    posterior : Posterior
        Posterior with sensor corrections.
    start : (D,) array
        Starting point.
    floor : float
        A log-posterior; the search ends early if its maximum cannot reach this value.

    Returns
    -------
    LaplaceApproximation
        Its ``converged`` is false if twenty iterations were not enough; this is not an error.
    """
    shared = posterior.space.shared_dimension
    # first with fixed noise levels, which would otherwise grow to absorb the initial misfit
    z, _ = _ascend(posterior, start, shared, _FIXED_NOISE_ROUNDS, 1.0, tempered=True)
    z, (at_mode, converged) = _ascend(posterior, z, len(start), _ROUNDS, _MIN_GAIN, floor=floor)
    return LaplaceApproximation(z, at_mode, converged)


def _ascend(
    posterior: Posterior,
    start: Array,
    last: int,
    rounds: int,
    enough: float,
    *,
    tempered: bool = False,
    floor: float = -math.inf,
) -> tuple[Array, tuple[ScoreAndInformation, bool]]:
    """Ascend in the coordinates before ``last`` until a step gains less than ``enough`` nats.

    With ``tempered``, the log-likelihood is divided by the mean square of the innovations where
    that exceeds one.  Otherwise, far from the mode, poorly constrained coordinates would move to
    extreme values to reduce a misfit that is due to the dampers.
    """
    z = start.copy()
    current = slopes(posterior, z, last=last)
    gradient = current.gradient(z)[:last]
    last_step: Array = np.zeros(last)
    damping, use_secants = 0.0, False
    secants: list[tuple[Array, Array]] = []
    for _ in range(rounds):
        precision = current.precision()[:last, :last]
        temperature = max(float(np.mean(current.nu**2)), 1.0) if tempered else 1.0
        slope = (gradient + z[:last]) / temperature - z[:last]
        expected = precision = (precision - np.eye(last)) / temperature + np.eye(last)
        for past_step, change in secants if use_secants else ():
            precision = secant_update(precision, past_step, change)
        while True:
            ridge = precision + damping * np.diag(np.diag(precision))
            step: Array = np.asarray(np.linalg.solve(ridge, slope), np.float64)
            gain = 0.5 * float(gradient @ step)
            if (
                gain < enough
                and precision is not expected
                and _predicted_gain(expected, gradient) > _NEGLIGIBLE_GAIN
            ):
                precision, secants = expected, []  # the secant pairs are out of date
                continue
            # The noise levels of a wrong model have no sharp optimum, and need none.
            if gain < (enough if np.mean(current.nu**2) < _MISFIT_SQUARE else max(enough, 0.3)):
                return z, (current, damping < 2.0)
            if current.log_posterior + _REACHABLE * gain < floor:
                return z, (current, False)
            step = np.asarray(step * min(1.0, 3.0 / float(np.max(np.abs(step)))), np.float64)
            trials = (_add_to_leading(z, share * step) for share in _STEP_SHARES)
            accepted = next(
                (x for x in trials if _log_posterior(posterior, x) > current.log_posterior), None
            )
            if accepted is not None:
                break
            damping = max(4.0 * damping, 0.03)
            if damping > 1e6:
                return z, (current, False)
        step, z = accepted[:last] - z[:last], accepted
        # A step back shows that the last step overshot: the curvature is larger than expected.
        # From here on, secant updates override the expected curvature.
        reversed_step = float(step @ last_step) < -0.3 * float(
            np.linalg.norm(step) * np.linalg.norm(last_step)
        )
        use_secants = use_secants or (reversed_step and not tempered)
        damping = max(damping, 1.0) if reversed_step else 0.0 if damping < 0.05 else 0.3 * damping
        last_step = step
        current = slopes(posterior, z, last=last)
        earlier, gradient = gradient, current.gradient(z)[:last]
        secants = [*secants[1 - _SECANT_PAIRS :], (step, earlier - gradient)]
    return z, (current, False)


def _predicted_gain(precision: Array, gradient: Array) -> float:
    return 0.5 * float(gradient @ np.linalg.solve(precision, gradient))


def secant_update(precision: Array, step: Array, change: Array) -> Array:
    """Update an expected curvature by the change of the gradient along a step (BFGS).

    It is used once the search has overshot: without it, steps back and forth took a fifth more
    iterations where the model is wrong.

    Parameters
    ----------
    precision : (D, D) array
        Expected curvature of minus the log-posterior.
    step : (D,) array
        The step.
    change : (D,) array
        Change of the gradient of minus the log-posterior along the step.
    """
    expected = precision @ step
    along, seen = float(step @ expected), float(step @ change)
    if seen < _MIN_CURVATURE_SHARE * along:
        return precision
    new = np.outer(change, change) / seen - np.outer(expected, expected) / along
    return np.asarray(precision + new, np.float64)


def _add_to_leading(z: Array, step: Array) -> Array:
    out = z.copy()
    out[: len(step)] += step
    return out


def _log_posterior(posterior: Posterior, z: Array) -> float:
    return float(posterior.log_posterior(z[None])[0])
