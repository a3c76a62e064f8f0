"""Covariance of the parameters due to model error, from a jackknife over bands of frequency.

Where a model leaves more than the sensors' noise, what it leaves has to do with the motion itself:
a damper that is a little digressive is wrong in the same way over every bump, and no number of
bumps averages it out.  The curvature of the likelihood knows nothing of this.  But what a model
lacks differs from one part of the spectrum to another: a seat, a mount, friction and a panel of the
body each have frequencies of their own.  So the spectrum is cut into bands as wide as a mode of the
car decays fast (ζ f, the half width of its resonance, across which whatever is missing from it is
missing together) and at least a third of an octave, and each band is left out in turn.  With s_b
and F_b the score and the information of band b, and P the precision of the posterior, the mode
moves by

    d_b = −(P − F_b)⁻¹ s_b,

and Σ d_b d_bᵀ less its expectation under the model, Σ (P − F_b)⁻¹ F_b (P − F_b)⁻¹, is the
covariance of the error: the jackknife over clusters, which here are bands of frequency in place of
the households of a survey (Bell & McCaffrey 2002, Survey Methodology 28, 169).  Few bands carry the
information, so that the error has Student's distribution with as many degrees of freedom as there
are bands of equal information, (Σ w_b)² / Σ w_b² with w_b = tr F_b P⁻¹ (after Satterthwaite 1946).

Where no band has more power than noise as declared, nothing is missing.

The noise of the sensors is to be near what is declared: noise levels that are free swell until the
misfit is noise, and the estimate then follows what the noise makes of the spectrum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm
from scipy.stats import t as student

from bayes_asv.models.modes import half_width
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.posterior.parameters import ParameterSpace

__all__ = ["draw_cars", "model_error"]

Array = NDArray[np.float64]

_SIGNIFICANT = 0.01  # probability of as much power in any band of noise as declared


class _Band(NamedTuple):
    """Score (D,), information (D, D), power and number of frequencies of a band."""

    score: Array
    information: Array
    power: float
    bins: int


def model_error(fit: FittedModel) -> Array:
    """Estimate the error of a mode by what its model lacks.

    Parameters
    ----------
    fit : FittedModel
        A model at its mode.

    Returns
    -------
    (D, D) array
        Covariance of the model's coordinates beyond that of the posterior, of the normal
        distribution that has the 95 % intervals of Student's; zero where nothing is missing.
    """
    precision = fit.mode.slopes.precision()
    bands = _by_band(fit)
    d = len(precision)
    least = min((chi2.sf(band.power, band.bins) for band in bands), default=1.0)
    if least > _SIGNIFICANT / max(len(bands), 1):
        return np.zeros((d, d))
    moves, expected = np.zeros((len(bands), d)), np.zeros((d, d))
    for b, band in enumerate(bands):
        without = np.linalg.inv(precision - band.information)
        moves[b] = without @ band.score
        expected += without @ band.information @ without
    excess = moves.T @ moves - expected
    # The part of it that is positive, in the metric of the posterior.
    covariance = np.linalg.inv(precision)
    root = np.linalg.cholesky(covariance)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ excess @ inverse.T)
    along = root @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    weights = np.array([np.sum(band.information * covariance) for band in bands])
    degrees = float(np.sum(weights)) ** 2 / float(np.sum(weights**2))
    wider = float(student.ppf(0.975, degrees) / norm.ppf(0.975))
    return np.asarray(wider**2 * along @ along.T)


def draw_cars(
    space: ParameterSpace, mean: Array, covariance: Array, count: int, rng: np.random.Generator
) -> Array:
    """Draw coordinates (count, D) from a normal distribution where the prior admits the car.

    Parameters
    ----------
    space : ParameterSpace
        What the coordinates are; draws without a prior density are left out.
    mean, covariance : (D,) and (D, D) arrays
        Of the normal distribution.
    count : int
        Number of draws.
    rng : numpy.random.Generator
        Where they come from.
    """
    kept: list[Array] = []
    while sum(map(len, kept)) < count:
        z = rng.multivariate_normal(mean, covariance, count, method="eigh")
        kept.append(z[np.isfinite(space.log_prior(z))])
    return np.concatenate(kept)[:count]


def _by_band(fit: FittedModel) -> list[_Band]:
    """Cut the innovations of all runs together into bands of frequency, the lowest first."""
    space, slopes = fit.space, fit.mode.slopes
    width = half_width(space.car, space.values(fit.mode.z[None]))
    bands: dict[int, _Band] = {}
    nothing = _Band(np.zeros(len(fit.mode.z)), np.zeros((len(fit.mode.z),) * 2), 0.0, 0)
    begin = 0
    for run, recording in enumerate(space.recordings):
        there = fit.posterior.innovations_and_variances(fit.mode.z, run)[1] != 0.0
        row, channel = np.nonzero(there)
        inside = slice(begin, begin + len(row))
        begin += len(row)
        nu, means = slopes.nu[inside], slopes.means[:, inside]
        spans = [np.ptp(recording.instants[row[channel == y]]) for y in range(there.shape[1])]
        for y, span in enumerate(spans):
            own = channel == y
            n = int(np.count_nonzero(own))
            if n < 2:
                continue
            # as many zeros behind it, so that the end does not run into the beginning
            frequency = np.arange(n + 1) * (n - 1) / (2.0 * n * span)
            twice = np.full(n + 1, math.sqrt(2.0))
            twice[[0, -1]] = 1.0
            scale = twice / math.sqrt(2.0 * n)
            left = np.fft.rfft(nu[own], 2 * n) * scale
            along = np.fft.rfft(means[:, own], 2 * n, axis=1) * scale
            band = _band(frequency, max(width, 1.0 / span))
            for b in np.unique(band).tolist():
                here = band == b
                z, y_here = along[:, here], left[here]
                old = bands.get(b, nothing)
                bands[b] = _Band(
                    old.score + (z.conj() @ y_here).real,
                    old.information + (z.conj() @ z.T).real,
                    old.power + float(np.sum(np.abs(y_here) ** 2)),
                    old.bins + len(y_here),
                )
    return [bands[b] for b in sorted(bands)]


def _band(frequency: Array, width: float) -> NDArray[np.int64]:
    """Return the band (n,) that each frequency is in, of a width and at least a third octave."""
    equal = frequency / width
    turn = 1.0 / (2.0 ** (1.0 / 3.0) - 1.0)  # widths, where a third of an octave is as wide
    octaves = turn + 3.0 * np.log2(np.maximum(equal, turn) / turn)
    return np.where(equal < turn, equal, octaves).astype(int)
