"""Whether innovations remember their past."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from bayes_asv.inference.stage import Stage
from bayes_asv.inference.still import crawling

__all__ = ["LAGS", "memory"]

LAGS = 12

_FEWEST = 10 * LAGS  # pairs of readings


def memory(stage: Stage) -> tuple[float, float]:
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
        inverse = np.linalg.inv(nu.T @ nu / n)
        for lag in range(1, LAGS + 1):
            c = nu[lag:].T @ nu[:-lag] / n
            statistic += n**2 / (n - lag) * float(np.trace(c.T @ inverse @ c @ inverse))
        freedom += 4 * LAGS
    return statistic - freedom, float(chi2.sf(statistic, freedom)) if freedom else 1.0
