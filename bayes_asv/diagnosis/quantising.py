"""What a coarse converter may do to the slow part of a channel.

The error of a converter is noise as long as what it reads moves over several steps, by itself or by
its noise.  While a channel stands still it is an offset that stays: for a reading with Gaussian
noise σ its size is (step/π) exp(−2π² (σ/step)²) at most (Widrow & Kollár 2008, Quantization Noise,
ch. 4).  A zero that wanders by as much between the beginning and the end of a run is no fault.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.channels import CHANNELS
from bayes_asv.inference.still import offset
from bayes_asv.inference.timeline import Timeline

__all__ = ["wandering"]

Array = NDArray[np.float64]

_WINDOW = 0.2  # s over which a channel that moves by less than a step stands still


def wandering(line: Timeline, channel: str) -> float:
    """Slope (m/s³) of a channel's zero that its converter alone may feign over a recording."""
    c = CHANNELS.index(channel)
    step, noise = float(line.steps[c]), line.noise[c] or 0.0
    if step <= 0.0:
        return 0.0
    signal = line.acceleration[c]
    signal = signal[np.isfinite(signal)]
    time = line.times[c][np.isfinite(line.acceleration[c])]
    length = float(time[-1] - time[0])
    n = max(int(_WINDOW / float(np.median(np.diff(time)))), 2)
    pieces = signal[: len(signal) // n * n].reshape(-1, n)
    still = float(np.mean(pieces.std(axis=1) < step)) if len(pieces) else 1.0
    return 2.0 * offset(step, noise) * still / length
