"""Tests of the innovations: whiteness, outliers, and timing jitter.

Timing jitter is a variance that grows with the slope of a signal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.signal import sosfreqz
from scipy.stats import chi2, pearson3

from bayes_asv.domain.channels import Channel
from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.fitted_model import Dataset, FittedModel
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.quantization import is_slow
from bayes_asv.preprocessing.tone_removal import Notch, notch_filter

__all__ = [
    "LAGS",
    "Outlier",
    "jitter_log_likelihood_ratio",
    "outlier_test",
    "timing_jitter_test",
    "whiteness_test",
]

Array = NDArray[np.float64]

LAGS = 12
"""Number of lags of the portmanteau statistic."""

# Numbers of successive readings of one output whose misfit is added up.
_OUTLIER_READINGS = (1, 2, 4, 8, 16, 32, 64)
_MIN_GROUPS = 10 * LAGS  # least number of groups of readings of a tested run
_REMOVED = 0.9  # share of power that notches pass, below which a frequency counts as removed
# Bound on a squared slope, in its mean: no single reading may dominate the test.
_MAX_SQUARED_SLOPE = 10.0


def whiteness_test(model: FittedModel) -> tuple[float, float]:
    """Multivariate portmanteau test over all outputs and all runs.

    Q = Σ_l n² / (n − l) tr(C_lᵀ C₀⁻¹ C_l C₀⁻¹) over lags l = 1 … 12 is χ² distributed, with 12 ny²
    degrees of freedom for a run of ny outputs (Hosking 1980, J. Am. Stat. Assoc. 75:602).  Runs
    with too few groups of readings are left out.

    Returns
    -------
    excess, p : float
        Statistic minus its expectation, and its p-value.
    """
    statistic, freedom = 0.0, 0
    for run, recording in enumerate(model.space.recordings):
        nu = model.posterior.innovations_and_variances(model.mode.z, run)[0]
        # the error of a coarse converter is autocorrelated where the signal moves slowly
        nu[np.any([is_slow(recording, c) for c in recording.outputs], axis=0)] = np.nan
        nu = recording.paired(nu)
        nu = nu[np.all(np.isfinite(nu), axis=1)]
        n = len(nu)
        if n < _MIN_GROUPS:
            continue
        sections = notch_filter(
            [Notch(*notch) for notch in recording.notches], 1.0 / recording.reading_step
        )
        covariances = _autocovariances(nu, sections)
        inverse = np.linalg.inv(covariances[0])
        for lag, c in enumerate(covariances[1:], 1):
            statistic += n**2 / (n - lag) * float(np.trace(c.T @ inverse @ c @ inverse))
        freedom += nu.shape[1] ** 2 * LAGS
    return statistic - freedom, float(chi2.sf(statistic, freedom)) if freedom else 1.0


class Outlier(NamedTuple):
    """Successive readings of one output that fit worst.

    Parameters
    ----------
    p : float
        p-value of their misfit, corrected for the number of places that were searched.
    channel : str
        Output.
    source : str
        Recording.
    time : float
        Time of the first reading by the recording's clock, s.
    readings : int
        Their number.
    """

    p: float
    channel: str = ""
    source: str = ""
    time: float = 0.0
    readings: int = 0


def outlier_test(model: FittedModel) -> Outlier:
    """Test for a misfit of some successive readings: a scan of the squared innovations.

    The sum of n squared innovations is χ² distributed with n degrees of freedom.  It is computed
    for 1, 2, 4 … 64 successive readings of each output from every instant; the smallest p-value is
    multiplied by the number of sums (Bonferroni), which is conservative, since they overlap (Glaz,
    Naus & Wallenstein 2001, Scan Statistics, ch. 1).
    """
    worst, sums = Outlier(0.0), 0
    for run, recording in enumerate(model.space.recordings):
        nu = model.posterior.innovations_and_variances(model.mode.z, run)[0]
        for y, c in enumerate(recording.outputs):
            used = np.flatnonzero((recording.kind[:, y] == VALUE) & ~is_slow(recording, c))
            total = np.concatenate([[0.0], np.cumsum(nu[used, y] ** 2)])
            for n in _OUTLIER_READINGS:
                if n > len(used):
                    break
                sums += len(used)
                log_p = chi2.logsf(total[n:] - total[:-n], n)
                k = int(np.argmin(log_p))
                if log_p[k] < worst.p:
                    time = float(recording.instants[used[k]])
                    channel = recording.channels[c].name
                    worst = Outlier(float(log_p[k]), channel, recording.source, time, n)
    return worst._replace(p=min(sums * math.exp(worst.p), 1.0))


def _autocovariances(nu: Array, sections: Array) -> Array:
    """Autocovariances (LAGS + 1, ny, ny) of innovations.

    A removed band holds no information: it contains the edge of the notch and, if a force law is
    nonlinear, the distortion by the missing tone.  It is filled with the mean power of the rest of
    the spectrum.  Covariances that are estimated from part of the spectrum scatter less than those
    of white noise, so the test is conservative.

    Parameters
    ----------
    nu : (N, ny) array
        Innovations without missing values.
    sections : (T, 6) array
        Second-order sections of the notches; T is 0 without any.
    """
    n = len(nu)
    spectrum = np.fft.rfft(nu, 2 * n, axis=0)
    power = spectrum[:, :, None].conj() * spectrum[:, None, :] / n
    if len(sections):
        _, response = sosfreqz(sections, np.linspace(0.0, np.pi, len(power)))
        removed = np.abs(response) ** 2 < _REMOVED
        power[removed] = power[~removed].mean(axis=0)
    # rows: the later innovations, columns: the earlier ones
    return np.asarray(np.fft.irfft(power, 2 * n, axis=0)[: LAGS + 1].transpose(0, 2, 1))


def timing_jitter_test(dataset: Dataset, model: FittedModel) -> tuple[float, str]:
    """p-value of a variance that grows with the squared slope of a channel, and the channel.

    A reading whose time stamp has a random error τ has an error of τ times the slope of the signal:
    the mean is unchanged, but the variance follows the squared slope, which no constant noise level
    describes.  This is a score test of the variance (Breusch & Pagan 1979, Econometrica 47:1287),
    one-sided, with noise levels projected out and a Bonferroni correction over channels.  A bump is
    steep at few instants, so the statistic is a sum of few squares; its skewness is accounted for.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Recordings, and a model at its mode.
    """
    at_mode = model.mode.slopes
    of_noise_levels = np.vstack([at_mode.scales, np.ones_like(at_mode.nu)])
    of_noise_levels = of_noise_levels[np.sum(of_noise_levels**2, axis=1) > 1e-12]
    p = []
    for squared_slope in _squared_slopes(dataset, model):
        explained = (
            of_noise_levels.T @ np.linalg.lstsq(of_noise_levels.T, squared_slope, rcond=1e-10)[0]
        )
        remaining = squared_slope - explained
        variance = 2.0 * float(remaining @ remaining)
        if variance <= 0.0:
            p.append(1.0)
            continue
        z = float(remaining @ (at_mode.nu**2 - 1.0)) / math.sqrt(variance)
        skew = 8.0 * float(np.sum(remaining**3)) / variance**1.5
        p.append(float(pearson3(skew).sf(z)))
    best = int(np.argmin(p))
    return min(len(p) * p[best], 1.0), dataset.channels[best].name


def jitter_log_likelihood_ratio(
    dataset: Dataset, model: FittedModel, settled: NDArray[np.bool_]
) -> tuple[float, str]:
    """Log-likelihood ratio (nats) of a variance that grows with a squared slope, and the channel.

    The variance is a level plus a factor times the squared slope, both by maximum likelihood; it is
    compared with a constant level for each output and run.  The channel is that of the largest
    gain.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Recordings, and a model at its mode.
    settled : (N,) bool array
        Whether the filter has settled at each innovation.
    """
    squares = np.asarray(model.mode.slopes.nu**2, np.float64)
    for group in _groups(dataset):
        squares[group] /= np.mean(squares[group & settled])
    slopes = _squared_slopes(dataset, model)[:, settled]
    squares = squares[settled]
    constant = 0.5 * len(squares)
    gains = [
        constant - _min_negative_log_likelihood(squares, squared_slope) for squared_slope in slopes
    ]
    best = int(np.argmax(gains))
    return gains[best], dataset.channels[best].name


def _groups(dataset: Dataset) -> Iterator[NDArray[np.bool_]]:
    """Yield masks that select the innovations of each output and run."""
    output = [np.nonzero(recording.kind == VALUE)[1] for recording in dataset.recordings]
    most = max(len(recording.outputs) for recording in dataset.recordings)
    group_index = np.concatenate(
        [most * run + outputs_of_readings for run, outputs_of_readings in enumerate(output)]
    )
    for group in np.unique(group_index):
        yield group_index == group


def _min_negative_log_likelihood(squares: Array, squared_slope: Array) -> float:
    """Minimise ½ Σ (log v + x / v) over variances v = level + growth · squared slope."""
    level = float(np.mean(squares))

    def loss(logs: Array) -> float:
        variance = np.exp(logs[0]) + np.exp(logs[1]) * squared_slope
        return 0.5 * float(np.sum(np.log(variance) + squares / variance))

    half = math.log(0.5 * level)
    return float(minimize(loss, [half, half], method="Nelder-Mead").fun)


def _squared_slopes(dataset: Dataset, model: FittedModel) -> Array:
    """Squared slopes (C, N) of the measured channels at the innovations of all runs."""
    channels = dataset.channels
    return np.hstack(
        [
            _run_slopes(model, recording, run, channels)
            for run, recording in enumerate(dataset.recordings)
        ]
    )


def _run_slopes(
    model: FittedModel, recording: PreparedRecording, run: int, channels: tuple[Channel, ...]
) -> Array:
    """Squared slope (C, N) of each channel at every reading, in the order of the innovations.

    An input drives all outputs, so its slope is used at the readings of each of them.
    """
    predicted = free_run(model.posterior, model.mode.z, run).output
    instant, output = np.nonzero(recording.kind == VALUE)
    out = np.zeros((len(channels), len(instant)))
    for c, channel in enumerate(recording.channels):
        if c in recording.inputs:
            wheel = recording.wheels[recording.inputs.index(c)]
            squared = wheel.spline(recording.instants, 1)[instant] ** 2
        else:
            y = recording.outputs.index(c)
            spline = CubicSpline(recording.instants, predicted[:, y])
            squared = np.where(output == y, spline(recording.instants, 1)[instant] ** 2, 0.0)
        out[channels.index(channel)] = squared
    out /= np.maximum(out.mean(axis=1, keepdims=True), 1e-30)
    return np.asarray(np.minimum(out, _MAX_SQUARED_SLOPE))
