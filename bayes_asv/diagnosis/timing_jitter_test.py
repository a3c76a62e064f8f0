"""Noise that is largest where a signal is steep: time stamps that jitter, or a sensor that slips.

A reading taken by a random time too early or late is off by its slope times that.  Nothing in the
mean tells; the variance of the innovations does, and a level of the noise cannot take it in.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.stats import pearson3

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.fitted_model import Dataset, FittedModel
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["jitter", "louder_where_steep"]

Array = NDArray[np.float64]

_STEEPEST = 10.0  # mean squares of a slope; no single reading is to decide


def jitter(where: Dataset, stage: FittedModel) -> tuple[float, str]:
    """p-value of innovations that are no louder where signals are steep, and the channel they are.

    A score test of the variance (Breusch & Pagan 1979, Econometrica 47:1287) against the squared
    slope of each channel, one-sided, noise levels taken out, Bonferroni over channels.  A bump is
    steep in a few places, so that the statistic is a sum of few squares: its skewness is counted.

    Parameters
    ----------
    where, stage : Dataset, FittedModel
        Recordings, and a model at its mode.
    """
    here = stage.mode.slopes
    known = np.vstack([here.scales, np.ones_like(here.nu)])
    known = known[np.sum(known**2, axis=1) > 1e-12]
    p = []
    for steep in _steep(where, stage):
        own = steep - known.T @ np.linalg.lstsq(known.T, steep, rcond=1e-10)[0]
        variance = 2.0 * float(own @ own)
        if variance <= 0.0:
            p.append(1.0)
            continue
        z = float(own @ (here.nu**2 - 1.0)) / math.sqrt(variance)
        skew = 8.0 * float(np.sum(own**3)) / variance**1.5
        p.append(float(pearson3(skew).sf(z)))
    best = int(np.argmin(p))
    return min(len(p) * p[best], 1.0), CHANNELS[best]


def louder_where_steep(
    where: Dataset, stage: FittedModel, settled: NDArray[np.bool_]
) -> tuple[float, str]:
    """Nats by which innovations are likelier whose variance grows with a squared slope, and whose.

    Level and growth are the likeliest, against each axle's own level in each run.

    Parameters
    ----------
    where, stage : Dataset, FittedModel
        Recordings, and a model at its mode.
    settled : (N,) bool array
        Innovations that count.
    """
    squared = np.asarray(stage.mode.slopes.nu**2, np.float64)
    for group in _groups(where):
        squared[group] /= np.mean(squared[group & settled])
    steep = _steep(where, stage)[:, settled]
    squared = squared[settled]
    even = 0.5 * len(squared)
    nats = [even - _likeliest(squared, own) for own in steep]
    best = int(np.argmax(nats))
    return nats[best], CHANNELS[best]


def _groups(where: Dataset) -> Iterator[NDArray[np.bool_]]:
    """Yield what picks an axle's readings in a run out of all."""
    axle = [np.nonzero(line.kind == VALUE)[1] for line in where.lines]
    of = np.concatenate([2 * run + own for run, own in enumerate(axle)])
    for group in np.unique(of):
        yield of == group


def _likeliest(squared: Array, steep: Array) -> float:
    """Least negative log-likelihood of squares, their variance a level and so much a slope."""
    level = float(np.mean(squared))

    def loss(logs: Array) -> float:
        variance = np.exp(logs[0]) + np.exp(logs[1]) * steep
        return 0.5 * float(np.sum(np.log(variance) + squared / variance))

    half = math.log(0.5 * level)
    return float(minimize(loss, [half, half], method="Nelder-Mead").fun)


def _steep(where: Dataset, stage: FittedModel) -> Array:
    """Squared slopes (4, N) at the innovations of all runs."""
    return np.hstack([_slopes(stage, line, run) for run, line in enumerate(where.lines)])


def _slopes(stage: FittedModel, line: PreparedRecording, run: int) -> Array:
    """Squared slope of each channel at every reading (4, N), in the order of the innovations.

    A wheel is heard in both chassis channels, so its slope counts at either's readings.
    """
    output = free_run(stage.target, stage.mode.z, run)[0]
    at, axle = np.nonzero(line.kind == VALUE)
    out = np.zeros((4, len(at)))
    for k in range(2):
        wheel = line.wheels[k].spline(line.instants, 1)
        chassis = CubicSpline(line.instants, output[:, k])(line.instants, 1)
        out[2 * k] = wheel[at] ** 2
        out[2 * k + 1] = np.where(axle == k, chassis[at] ** 2, 0.0)
    out /= np.maximum(out.mean(axis=1, keepdims=True), 1e-30)
    return np.asarray(np.minimum(out, _STEEPEST))
