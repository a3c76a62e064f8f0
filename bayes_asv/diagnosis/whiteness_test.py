"""Whether innovations remember their past."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfreqz
from scipy.stats import chi2

from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.preprocessing.quantization import crawling
from bayes_asv.preprocessing.tone_removal import Notch, notch_filter

__all__ = ["LAGS", "memory"]

Array = NDArray[np.float64]

LAGS = 12

_FEWEST = 10 * LAGS  # pairs of readings
_CUT = 0.9  # of the power that a filter lets through, below which a band counts as cut


def memory(stage: FittedModel) -> tuple[float, float]:
    """Portmanteau over both channels and all runs (Hosking 1980, J. Am. Stat. Assoc. 75:602).

    Returns
    -------
    excess, p : float
        Statistic less its expectation, and its p-value from the χ² of 4 · 12 degrees a run;
        runs with too little that can be asked do not count.
    """
    statistic, freedom = 0.0, 0
    for run, line in enumerate(stage.space.timelines):
        nu = stage.target.scored(stage.mode.z, run)[0]
        # what a converter of few steps makes of slow motion remembers, and nothing is missing
        nu[crawling(line, 1) | crawling(line, 3)] = np.nan
        nu = line.paired(nu)
        nu = nu[np.all(np.isfinite(nu), axis=1)]
        n = len(nu)
        if n < _FEWEST:
            continue
        cut = notch_filter([Notch(*notch) for notch in line.notches], 1.0 / line.reading_step)
        covariances = _covariances(nu, cut)
        inverse = np.linalg.inv(covariances[0])
        for lag, c in enumerate(covariances[1:], 1):
            statistic += n**2 / (n - lag) * float(np.trace(c.T @ inverse @ c @ inverse))
        freedom += 4 * LAGS
    return statistic - freedom, float(chi2.sf(statistic, freedom)) if freedom else 1.0


def _covariances(nu: Array, sections: Array) -> Array:
    """Covariances (LAGS + 1, 2, 2) of innovations with those that come later.

    A band that was cut out bears no witness: it is filled with what the others hold on average.
    What the cut leaves in it is the edge of the notch, and where a law bends what the law makes of
    a signal without its tone.  With a part of the band left out the covariances scatter less than
    white ones: the test is on the safe side.

    Parameters
    ----------
    nu : (N, 2) array
        Without gaps.
    sections : (T, 6) array
        Of the filter that cut; none where T is 0.
    """
    n = len(nu)
    spectrum = np.fft.rfft(nu, 2 * n, axis=0)
    power = spectrum[:, :, None].conj() * spectrum[:, None, :] / n
    if len(sections):
        _, response = sosfreqz(sections, np.linspace(0.0, np.pi, len(power)))
        cut = np.abs(response) ** 2 < _CUT
        power[cut] = power[~cut].mean(axis=0)
    # later rows, earlier columns
    return np.asarray(np.fft.irfft(power, 2 * n, axis=0)[: LAGS + 1].transpose(0, 2, 1))
