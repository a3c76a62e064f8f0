"""What a coarse converter makes of a channel that stands still.

While a signal crosses many steps the error of its converter is white noise of step²/12.  While it
stands still a part of it stays as it is, up to (step/π) exp(−2π² (σ/step)²) with noise σ (Widrow &
Kollár 2008, Quantization Noise, ch. 4), and what toggles between two counts is up to step²/4 and
remembers as the noise does.  To a filter either is news that lasts: a car that waited for its bump,
with converters of ten bits, had been pushed.  So readings of a chassis that stands still count as
few times as they tell something new, and a wheel that stands still is noisier below the frequencies
of a suspension by what stays and what remembers.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from bayes_asv.inference.timeline import Timeline
from bayes_asv.kernels.innovations import MISSING

__all__ = ["offset", "still_channels_doubted"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_WINDOW = 0.1  # s
_SPAN = 2.5  # steps that a channel which stands still covers in a window
_FORGOTTEN = 0.15  # s after which a suspension has forgotten what its wheel did
_APART = 0.05  # correlation of noise below which readings tell something new
_LEAST = 2  # readings of each standstill that are kept
_SLIGHT = 0.05  # of the noise's power, below which nothing is doubted


def offset(step: float, noise: float) -> float:
    """Largest error of a converter that stays while a reading with noise ``noise`` stands still.

    Both in the unit of the reading.
    """
    return step / math.pi * math.exp(-2.0 * (math.pi * noise / step) ** 2) if step > 0.0 else 0.0


def still_channels_doubted(line: Timeline) -> Timeline:
    """Return a recording that is believed as little as its converters deserve where it is still."""
    kind, doubt = line.kind.copy(), np.zeros((len(line.step), 2))
    for c in range(4):
        error = _error(line, c)
        if error is None:
            continue
        axle = c // 2
        if c % 2:
            at = np.flatnonzero(kind[:, axle] != MISSING)
            here = np.interp(line.instants[at], error.time, error.still) > 0.5
            kind[at[_too_many(here, error)], axle] = MISSING
        else:
            here = np.interp(line.instants, error.time, error.still.astype(float))
            doubt[:, axle] = error.low * here * line.spread[:, axle]
    spread = line.spread + np.hstack([np.zeros_like(doubt), doubt])
    return replace(line, kind=kind, spread=spread, doubt=doubt)


class _Error(NamedTuple):
    """Error of a channel that stands still.

    Parameters
    ----------
    time, still : (N,) arrays
        When it does.
    apart : int
        Readings from one that tells something new to the next.
    few : float
        Readings that would tell what stays as well as it matters.
    low : float
        Variance of as strong white noise below the frequencies of a suspension, m²/s⁴, beyond what
        is believed anyway.
    """

    time: Array
    still: Bools
    apart: int
    few: float
    low: float


def _error(line: Timeline, c: int) -> _Error | None:
    """Return it for a channel; nothing where its noise covers its steps."""
    there = np.isfinite(line.acceleration[c])
    time, signal = line.times[c, there], line.acceleration[c, there]
    step, noise = float(line.steps[c]), float(line.noise[c] or 0.0)
    if step <= 0.0 or len(time) < 3:
        return None
    every = float(np.median(np.diff(time)))
    memory = math.exp(-line.poles[c] * every) if line.poles[c] else 0.0
    lags = memory ** np.arange(1, 50) if memory else np.zeros(1)
    stays = 0.5 * offset(step, noise) ** 2
    torn = 0.25 * step**2 * (1.0 + 4.0 / math.pi * float(np.arcsin(lags).sum()))
    known = step**2 / 12.0 + noise**2 * (1.0 + 2.0 * float(lags.sum()))
    low = max(torn - known, 0.0) + _FORGOTTEN / every * stays
    if low < _SLIGHT * known:
        return None
    n = max(round(_WINDOW / every), 3)
    still = maximum_filter1d(signal, n) - minimum_filter1d(signal, n) < _SPAN * step
    apart = math.ceil(math.log(_APART) / math.log(memory)) if memory else 1
    return _Error(time, still, apart, (step**2 / 12.0 + noise**2) / stays, low)


def _too_many(still: Bools, error: _Error) -> Bools:
    """Say which readings of each standstill tell nothing new."""
    out = np.zeros(len(still), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        kept = max(_LEAST, min(error.few, (end - begin) / error.apart))
        at = begin + np.round(np.linspace(0, end - begin - 1, round(kept))).astype(int)
        out[begin:end] = True
        out[at] = False
    return out
