"""Fisher scoring: climbing to a mode with first derivatives of the innovations alone.

For innovations ν with log variances s the log-likelihood is −½ Σ (ν² + s).  With dν and ds their
differences along a coordinate, the change of the prediction in units of its deviation is
dm = −(dν + ½ ν ds), the slope is −Σ (ν dν + ½ ds), and the expected curvature Σ dm dmᵀ + ½ ds dsᵀ.
A coordinate costs one pass, not one a pair, and a poor start cannot turn the curvature round.
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

STEP = 1e-4  # of a prior deviation
_FIRST, _ROUNDS = 8, 20  # with noise held, and with everything free
_MIN_GAIN = 5e-3  # nats that the next step would gain
_STEP_SHARES = (1.0, 0.4, 0.15)  # of a step: a bent ridge is followed further than damping would go
_FURTHER = 10.0  # times what the next step would gain, beyond which no climb goes
_SECANT_PAIRS = 4  # steps whose changes of slope are believed
_MIN_CURVATURE_SHARE = (
    0.1  # of the expected curvature, below which a change of slope teaches nothing
)
_NEGLIGIBLE_GAIN = (
    1.0  # nats expected of a step, beyond which no curvature by secants may end a climb
)
_MISFIT_SQUARE = 1.3  # mean square of innovations beyond which a model is wrong


@dataclass(frozen=True)
class ScoreAndInformation:
    """Where a posterior stands and how its innovations change.

    Parameters
    ----------
    nu : (N,) array
        Normalised innovations of all runs, readings without a value left out.
    log_variances : (N,) array
        Logarithms of their variances.
    means : (D, N) array
        Changes of the predictions along each coordinate, in deviations; zero for a run that does
        not know the coordinate.
    scales : (D, N) array
        Changes of the log variances.
    log_posterior : float
        Its value, not normalised.
    removed_band_correction : (D,) array
        Slope of what bands that were cut out give back.
    """

    nu: Array
    log_variances: Array
    means: Array
    scales: Array
    log_posterior: float
    removed_band_correction: Array

    def only(self, kept: NDArray[np.bool_] | slice) -> ScoreAndInformation:
        """Return the slopes along some of the coordinates."""
        return replace(
            self,
            means=self.means[kept],
            scales=self.scales[kept],
            removed_band_correction=self.removed_band_correction[kept],
        )

    def gradient(self, z: Array) -> Array:
        """Slope (D,) of the log-posterior."""
        of_data = self.means @ self.nu + 0.5 * self.scales @ (self.nu**2 - 1.0)
        return of_data + self.removed_band_correction - z

    def precision(self) -> Array:
        """Return the expected curvature (D, D) of minus the log-posterior."""
        data = self.means @ self.means.T + 0.5 * self.scales @ self.scales.T
        return data + np.eye(len(data))


@dataclass(frozen=True)
class LaplaceApproximation:
    """A mode found by scoring.

    Parameters
    ----------
    z : (D,) array
        Where.
    slopes : ScoreAndInformation
        The last that were taken, at or within a negligible step of the mode.
    converged : bool
        Whether the next step would have gained next to nothing.
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
        """Inverse (D, D) of the expected curvature."""
        return np.asarray(np.linalg.inv(self.slopes.precision()))

    @property
    def log_evidence(self) -> float:
        """Laplace's logarithm of the integral of the posterior."""
        _, log_det = np.linalg.slogdet(self.slopes.precision())
        volume = 0.5 * len(self.z) * math.log(2.0 * math.pi) - 0.5 * float(log_det)
        return self.log_posterior + volume


def slopes(
    posterior: Posterior, z: Array, first: int = 0, last: int | None = None
) -> ScoreAndInformation:
    """Take differences along every coordinate, run by run.

    Parameters
    ----------
    posterior : Posterior
        With sensor corrections.
    z : (D,) array
        Where.
    first, last : int
        Coordinates before the first and from the last on are held: their differences are zero.

    Returns
    -------
    ScoreAndInformation
    """
    space = posterior.space
    runs = range(len(space.recordings))
    last = len(z) if last is None else last
    seen = [space.coordinates_of_run(run) for run in runs]
    along = [own[(own >= first) & (own < last)] for own in seen]
    moved = [z + np.vstack([np.zeros(len(z)), STEP * np.eye(len(z))[own]]) for own in along]
    pieces = [(run, k) for run in runs for k in range(0, len(moved[run]), LANES)]

    def passed(piece: tuple[int, int]) -> tuple[Array, Array, Array]:
        run, k = piece
        return posterior.filter_passes(moved[run][k : k + LANES], run)

    work = posterior.pool.map if posterior.pool else map
    found = dict(zip(pieces, work(passed, pieces), strict=True))
    parts = []
    returned = np.zeros(len(z))
    for run in runs:
        of_run = [found[piece] for piece in pieces if piece[0] == run]
        nu, logs = (np.concatenate([x[k].reshape(len(x[k]), -1) for x in of_run]) for k in (0, 1))
        there = logs[0] != 0.0
        nu, logs = nu[:, there], logs[:, there]
        own = along[run]
        means, scales = (np.zeros((len(z), nu.shape[1])) for _ in range(2))
        scales[own] = (logs[1:] - logs[0]) / STEP
        means[own] = -((nu[1:] - nu[0]) / STEP + 0.5 * nu[0] * scales[own])
        parts.append((nu[0], logs[0], means, scales))
        if space.recordings[run].removed_band is not None:
            corrections = posterior.removed_band_correction(moved[run], run)
            returned[own] += (corrections[1:] - corrections[0]) / STEP
    nu, logs = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    value = _value(posterior, z)
    means = np.concatenate([p[2] for p in parts], axis=1)
    scales = np.concatenate([p[3] for p in parts], axis=1)
    return ScoreAndInformation(nu, logs, means, scales, value, returned)


def maximise_by_scoring(
    posterior: Posterior, start: Array, floor: float = -math.inf
) -> LaplaceApproximation:
    """Climb from a start to the mode.

    Parameters
    ----------
    posterior : Posterior
        With sensor corrections.
    start : (D,) array
        Coordinates.
    floor : float
        A log-posterior; the climb ends early where it is out of reach, some nats short of a mode
        that is far below.

    Returns
    -------
    LaplaceApproximation
        Not converged when it did not settle in twenty rounds: a value, not an error.
    """
    lasting = posterior.space.shared_dimension
    # noise held: it cannot swell on the way
    z, _ = _ascend(posterior, start, lasting, _FIRST, 1.0, tempered=True)
    z, (here, settled) = _ascend(posterior, z, len(start), _ROUNDS, _MIN_GAIN, floor=floor)
    return LaplaceApproximation(z, here, settled)


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
    """Climb in the coordinates before ``last`` until a step gains less than ``enough`` nats.

    Far from the data the misfit counts as noise where ``tempered``: what the data hardly know
    would otherwise go to any length to mend what a damper is to mend, and nothing else would move.
    """
    z = start.copy()
    here = slopes(posterior, z, last=last)
    gradient = here.gradient(z)[:last]
    before: Array = np.zeros(last)
    damping, use_secants = 0.0, False
    secants: list[tuple[Array, Array]] = []
    for _ in range(rounds):
        precision = here.precision()[:last, :last]
        temperature = max(float(np.mean(here.nu**2)), 1.0) if tempered else 1.0
        slope = (gradient + z[:last]) / temperature - z[:last]
        expected = precision = (precision - np.eye(last)) / temperature + np.eye(last)
        for taken, change in secants if use_secants else ():
            precision = secant_update(precision, taken, change)
        while True:
            ridge = precision + damping * np.diag(np.diag(precision))
            step: Array = np.asarray(np.linalg.solve(ridge, slope), np.float64)
            gain = 0.5 * float(gradient @ step)
            if (
                gain < enough
                and precision is not expected
                and _gain(expected, gradient) > _NEGLIGIBLE_GAIN
            ):
                precision, secants = expected, []  # secants from elsewhere hold no longer
                continue
            # Where the model is wrong its noise has no sharp optimum, and needs none.
            if gain < (enough if np.mean(here.nu**2) < _MISFIT_SQUARE else max(enough, 0.3)):
                return z, (here, damping < 2.0)
            if here.log_posterior + _FURTHER * gain < floor:
                return z, (here, False)
            step = np.asarray(step * min(1.0, 3.0 / float(np.max(np.abs(step)))), np.float64)
            tried = (_moved(z, share * step) for share in _STEP_SHARES)
            ahead = next((x for x in tried if _value(posterior, x) > here.log_posterior), None)
            if ahead is not None:
                break
            damping = max(4.0 * damping, 0.03)
            if damping > 1e6:
                return z, (here, False)
        step, z = ahead[:last] - z[:last], ahead
        # A step back shows that the last one went too far: the curvature is steeper than expected.
        # From then on what the slope did along the last steps is believed before what it should.
        reversed_step = float(step @ before) < -0.3 * float(
            np.linalg.norm(step) * np.linalg.norm(before)
        )
        use_secants = use_secants or (reversed_step and not tempered)
        damping = max(damping, 1.0) if reversed_step else 0.0 if damping < 0.05 else 0.3 * damping
        before = step
        here = slopes(posterior, z, last=last)
        earlier, gradient = gradient, here.gradient(z)[:last]
        secants = [*secants[1 - _SECANT_PAIRS :], (step, earlier - gradient)]
    return z, (here, False)


def _gain(precision: Array, gradient: Array) -> float:
    return 0.5 * float(gradient @ np.linalg.solve(precision, gradient))


def secant_update(precision: Array, step: Array, change: Array) -> Array:
    """Correct an expected curvature by how a slope changed along a step.

    Broyden, Fletcher, Goldfarb & Shanno's update.  A climb that had to turn back believes it: half
    steps to and fro took a fifth more rounds where a model is wrong.

    Parameters
    ----------
    precision : (D, D) array
        Expected curvature of minus the log-posterior.
    step : (D,) array
        What was taken.
    change : (D,) array
        By how much the slope of minus the log-posterior grew along it.
    """
    expected = precision @ step
    along, seen = float(step @ expected), float(step @ change)
    if seen < _MIN_CURVATURE_SHARE * along:
        return precision
    new = np.outer(change, change) / seen - np.outer(expected, expected) / along
    return np.asarray(precision + new, np.float64)


def _moved(z: Array, step: Array) -> Array:
    out = z.copy()
    out[: len(step)] += step
    return out


def _value(posterior: Posterior, z: Array) -> float:
    return float(posterior.log_posterior(z[None])[0])
