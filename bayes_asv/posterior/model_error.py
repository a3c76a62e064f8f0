"""Covariance of the parameters due to model error, from a jackknife over bands of frequency.

If the residuals of a model exceed the noise of the sensors, the excess depends on the motion: a
damper that is a little digressive makes the same error over every bump, and more bumps do not
average it out.  The curvature of the likelihood does not contain this error.  But missing effects
differ from one part of the spectrum to another: a seat, a mount, friction and a panel of the body
each have frequencies of their own.  The spectrum is therefore divided into bands, and each band is
left out in turn.  A band is as wide as the half width ζ f of the car's resonances, within which the
effect of a missing force is correlated, and at least a third of an octave.  With s_b and F_b the
score and the information of band b, and P the precision of the posterior, the mode moves by

    d_b = −(P − F_b)⁻¹ s_b,

and the covariance of the error is Σ d_b d_bᵀ less its expectation under the model,
Σ (P − F_b)⁻¹ F_b (P − F_b)⁻¹.  This is the jackknife over clusters, with bands of frequency in
place of the households of a survey (Bell & McCaffrey 2002, Survey Methodology 28, 169).  Few bands
hold the information, so the error has Student's distribution with the effective number of bands as
degrees of freedom, (Σ w_b)² / Σ w_b² with w_b = tr F_b P⁻¹ (after Satterthwaite 1946).

If no band has more power than the declared noise, no error is added.

Noise levels have to be near the declared ones: free levels grow until noise explains the misfit,
and the estimate then depends on the spectrum that this noise implies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm
from scipy.stats import t as student

from bayes_asv.domain.errors import FitError
from bayes_asv.models.modes import half_width
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.posterior.parameters import ParameterSpace

__all__ = ["draw_cars", "model_error"]

Array = NDArray[np.float64]

# Significance level (familywise, over all bands) of power beyond the declared noise.
_SIGNIFICANCE = 0.01
_ROUNDS = 200  # rounds of draws: less than one in 200 within the prior's support is no distribution


class _Band(NamedTuple):
    """Score (D,), information (D, D), power and number of frequencies of a band."""

    score: Array
    information: Array
    power: float
    bins: int


def model_error(fit: FittedModel) -> Array:
    """Estimate the covariance of a mode's error that is due to model error.

    Parameters
    ----------
    fit : FittedModel
        A model at its mode.

    Returns
    -------
    (D, D) array
        Covariance to be added to that of the posterior, scaled such that a normal distribution has
        the 95 % intervals of Student's; zero if no band exceeds the noise.
    """
    precision = fit.mode.slopes.precision()
    bands = _split_into_bands(fit)
    d = len(precision)
    smallest_p = min((chi2.sf(band.power, band.bins) for band in bands), default=1.0)
    if smallest_p > _SIGNIFICANCE / max(len(bands), 1):
        return np.zeros((d, d))
    moves, expected = np.zeros((len(bands), d)), np.zeros((d, d))
    for b, band in enumerate(bands):
        root, _ = _root_of_inverse(precision - band.information)
        without = root @ root.T
        moves[b] = without @ band.score
        expected += without @ band.information @ without
    excess = moves.T @ moves - expected
    # the positive part of the excess, in the metric of the posterior
    root, inverse = _root_of_inverse(precision)
    covariance = root @ root.T
    values, vectors = np.linalg.eigh(inverse @ excess @ inverse.T)
    root_of_excess = root @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    weights = np.array([np.sum(band.information * covariance) for band in bands])
    degrees = float(np.sum(weights)) ** 2 / float(np.sum(weights**2))
    student_factor = float(student.ppf(0.975, degrees) / norm.ppf(0.975))
    return np.asarray(student_factor**2 * root_of_excess @ root_of_excess.T)


def _root_of_inverse(precision: Array) -> tuple[Array, Array]:
    """Return R with R Rᵀ = P⁻¹, and its inverse; rounding may lose the prior's part of P, I."""
    size, axes = np.linalg.eigh(precision)
    deviation = np.sqrt(np.maximum(size, 1.0))
    return axes / deviation, (axes * deviation).T


def draw_cars(
    space: ParameterSpace, mean: Array, covariance: Array, count: int, rng: np.random.Generator
) -> Array:
    """Draw coordinates (count, D) from a normal distribution, truncated to the prior's support.

    Coordinates of heavy-tailed parameters are drawn so that their values are normal: it is these
    that the recordings determine, and of the steps of a curve only sums.  Normal coordinates would
    have a density e⁻⁴⁰⁰⁰ times too small with the curve of a real damper, where half the dimension
    is due, e⁻²¹.

    Parameters
    ----------
    space : ParameterSpace
        Parameter space; draws with zero prior density are rejected.
    mean, covariance : (D,) and (D, D) arrays
        Mean and covariance of the normal distribution.
    count : int
        Number of draws.
    rng : numpy.random.Generator
        Random number generator.

    Raises
    ------
    FitError
        If hardly any draw is within the prior's support.
    """
    kept: list[Array] = []
    for _ in range(_ROUNDS):
        z = rng.multivariate_normal(mean, covariance, count, method="eigh")
        heavy = space.heavy_tailed
        step = z[:, heavy] - mean[heavy]
        z[:, heavy] = np.arcsinh(np.sinh(mean[heavy]) + np.cosh(mean[heavy]) * step)
        kept.append(z[np.isfinite(space.log_prior(z))])
        if sum(map(len, kept)) >= count:
            return np.concatenate(kept)[:count]
    raise FitError(
        space.recordings[0].source,
        f"the fitted {space.car.name} car may err by more than any car allows, so that no interval "
        "can be drawn",
        "check channels, signs, units and clocks, and the values in the vehicle file",
    )


def _split_into_bands(fit: FittedModel) -> list[_Band]:
    """Divide the innovations of all runs into bands of frequency, the lowest first."""
    space, slopes = fit.space, fit.mode.slopes
    width = half_width(space.car, space.values(fit.mode.z[None]))
    bands: dict[int, _Band] = {}
    empty = _Band(np.zeros(len(fit.mode.z)), np.zeros((len(fit.mode.z),) * 2), 0.0, 0)
    start = 0
    for run, recording in enumerate(space.recordings):
        has_reading = fit.posterior.innovations_and_variances(fit.mode.z, run)[1] != 0.0
        row, channel = np.nonzero(has_reading)
        of_run = slice(start, start + len(row))
        start += len(row)
        nu, means = slopes.nu[of_run], slopes.means[:, of_run]
        spans = [np.ptp(recording.instants[row[channel == y]]) for y in range(has_reading.shape[1])]
        for y, span in enumerate(spans):
            of_channel = channel == y
            n = int(np.count_nonzero(of_channel))
            if n < 2:
                continue
            # zero padding, so that the end does not wrap around to the beginning
            frequency = np.arange(n + 1) * (n - 1) / (2.0 * n * span)
            twice = np.full(n + 1, math.sqrt(2.0))
            twice[[0, -1]] = 1.0
            scale = twice / math.sqrt(2.0 * n)
            residuals = np.fft.rfft(nu[of_channel], 2 * n) * scale
            gradients = np.fft.rfft(means[:, of_channel], 2 * n, axis=1) * scale
            band = _band_index(frequency, max(width, 1.0 / span))
            for b in np.unique(band).tolist():
                in_band = band == b
                gradients_in_band, residuals_in_band = gradients[:, in_band], residuals[in_band]
                old = bands.get(b, empty)
                bands[b] = _Band(
                    old.score + (gradients_in_band.conj() @ residuals_in_band).real,
                    old.information + (gradients_in_band.conj() @ gradients_in_band.T).real,
                    old.power + float(np.sum(np.abs(residuals_in_band) ** 2)),
                    old.bins + len(residuals_in_band),
                )
    return [bands[b] for b in sorted(bands)]


def _band_index(frequency: Array, width: float) -> NDArray[np.int64]:
    """Return the band index (n,) of each frequency; bands span at least a third of an octave."""
    equal = frequency / width
    # frequency, in widths, above which a third of an octave is wider than ``width``
    turn = 1.0 / (2.0 ** (1.0 / 3.0) - 1.0)
    octaves = turn + 3.0 * np.log2(np.maximum(equal, turn) / turn)
    return np.where(equal < turn, equal, octaves).astype(int)
