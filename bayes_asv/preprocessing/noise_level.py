"""Noise of one sample of a channel, where none is given."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["noise_level", "quiet_level"]

Array = NDArray[np.float64]


def quiet_level(a: Array, step: float) -> float:
    """Noise of one sample (m/s²) of readings (N,), from the quietest quarter of their record.

    Third differences take out what is smooth; white noise of deviation σ gives them √20 σ.
    A hundredth of the channel's own deviation is the least that is believed.
    """
    a = a[np.isfinite(a)]
    quiet = float(np.quantile(np.abs(np.diff(a, 3)), 0.25)) / 0.3186 / math.sqrt(20.0)
    return max(quiet, 0.01 * float(np.std(a)), step / math.sqrt(12.0), 1e-6)


def noise_level(line: PreparedRecording, c: int) -> float:
    """Noise of one sample of a channel, m/s², from its quiet quarter."""
    if line.quiet is not None:
        return float(line.quiet[c])
    return quiet_level(line.values[c], float(line.steps[c]))
