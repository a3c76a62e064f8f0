"""Prediction step and measurement update of a Kalman filter, compiled into each filter.

The model of one recording is linear in its state.  Over a step of length h that ends at an instant
of observation::

    x⁺ = Φ x + ∫ Φ(h−s) B û(s) ds − Γ (N d + w) + white noise      Φ = exp(A h),  Γ = ∫ Φ(s) B ds
    w⁺ = ρ w + …      d⁺ = d      b⁺ = b      v⁺ = ρ v + …

û is a spline through the measured inputs, entered through its moments ∫ (h−s)ʲ/j! û(s) ds; d are
the biases of the input sensors along the columns of N, w and v the noise that passed the filters of
input and output sensors, b the biases of the outputs.  The order of the filter's state is
(x, d, w, b, v); the first three groups drive x, so Φ, Γ N and Γ stand side by side in ``carry``.

Every array ends in an axis of L lanes, each of which holds one set of parameters: the compiler
takes lanes side by side.  Sizes are arguments that each filter fixes when it is compiled.

The measurement update takes one output at a time: y reads C x + b + v + white noise.  A reading at
the rail of its sensor is a bound: its log-likelihood is that of a tail of the normal distribution,
and the state is conditioned on it by matching two moments.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "AT_LEAST",
    "AT_MOST",
    "INLINE",
    "IN_PLACE",
    "LOG_2PI",
    "MISSING",
    "OPTIONS",
    "ORDER",
    "STEP_LENGTHS",
    "STEP_SERIES",
    "TAYLOR",
    "VALUE",
    "condition_on_bound",
    "condition_on_value",
    "decays",
    "find_step",
    "gained_noise",
    "power_series",
    "sizes_of_one_type",
    "step_weights",
    "upper_tail",
]

LOG_2PI = math.log(2.0 * math.pi)
_SQRT_2 = math.sqrt(2.0)


def _cacheable() -> bool:
    """Whether what is compiled can be kept, beside its module or in the user's cache folder.

    Where neither can be written, as in a read-only container, every process compiles again.
    """
    try:
        njit(cache=True)(_cacheable)
    except RuntimeError:
        return False
    return True


_CACHE = _cacheable()


@njit(cache=_CACHE, nogil=True, error_model="numpy")
def upper_tail(z: float) -> tuple[float, float]:
    """Logarithm of P(Z > z), and the hazard φ(z)/P(Z > z) of a standard normal Z."""
    if z < 25.0:
        tail = 0.5 * math.erfc(z / _SQRT_2)
        return math.log(tail), math.exp(-0.5 * z * z - 0.5 * LOG_2PI) / tail
    hazard = z + 1.0 / (z + 2.0 / (z + 3.0 / (z + 4.0 / z)))  # Laplace's continued fraction
    return -0.5 * z * z - 0.5 * LOG_2PI - math.log(hazard), hazard


ORDER = 8
"""Input moments that are kept; with `TAYLOR` it bounds the step, see ``preprocessing.prepare``."""
TAYLOR = 12
"""Powers of A h that are kept."""
STEP_SERIES = 4
"""Series in them that a step needs, of :func:`step_weights`."""

OPTIONS = {"cache": _CACHE, "nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}
INLINE = {**OPTIONS, "forceinline": True}
"""Of functions whose sizes become constants of the filter that calls them."""
IN_PLACE = {**OPTIONS, "inline": "always"}
"""Of functions that become part of the filter that calls them before anything is optimised.

They are compiled again with every filter, and belong in the innermost loops alone.
"""


def sizes_of_one_type(*sizes: int) -> tuple[Any, ...]:
    """Return sizes for a filter such that what it calls is compiled once for all sizes.

    To numba the value of a Python integer is part of its type, that of NumPy's is not.
    """
    return tuple(np.int64(size) for size in sizes)


Array = NDArray[np.float64]


@njit(**INLINE)
def power_series(
    nx: int, nu: int, lanes: int, A: Array, B: Array, powers: Array, drive: Array
) -> None:
    """Fill Aʲ/j! (TAYLOR + 1, nx, nx, L) and Aʲ B (nu, ORDER, nx, L)."""
    for a in range(nx):
        for b in range(nx):
            for q in range(lanes):
                powers[0, a, b, q] = 1.0 if a == b else 0.0
    for j in range(1, TAYLOR + 1):
        for a in range(nx):
            for b in range(nx):
                for q in range(lanes):
                    total = 0.0
                    for c in range(nx):
                        total += A[a, c, q] * powers[j - 1, c, b, q]
                    powers[j, a, b, q] = total / j
    factorial = 1.0
    for j in range(ORDER):
        if j > 0:
            factorial *= j
        for u in range(nu):
            for a in range(nx):
                for q in range(lanes):
                    total = 0.0
                    for c in range(nx):
                        total += powers[j, a, c, q] * B[c, u, q]
                    drive[u, j, a, q] = total * factorial


@njit(**INLINE)
def step_weights(h: float, weights: Array) -> None:
    """Fill what a step of length h makes of the powers of A, (STEP_SERIES, TAYLOR + 1).

    With Aʲ/j! they add up to Φ, to −∫ Φ ds, and to Φ at the nodes of two-point Gauss quadrature
    times the root of their weight, h/2.
    """
    for row in range(STEP_SERIES):
        node = h if row < 2 else h * (0.5 + (row - 2.5) / math.sqrt(3.0))
        value = 1.0 if row == 0 else -h if row == 1 else math.sqrt(0.5 * h)
        for j in range(TAYLOR + 1):
            weights[row, j] = value / (j + 1) if row == 1 else value
            value *= node


STEP_LENGTHS = 4
"""Lengths of a step whose discretisations a filter keeps.

Sensors with delays of their own give a recording at an even rate as many lengths of step as there
are delays; stamps that are not even give it a new one at every row, and nothing is kept.
"""


@njit(**INLINE)
def find_step(h: float, lengths: Array, oldest: int) -> tuple[int, bool, int]:
    """Where a step of length h has its place among those that are kept.

    Parameters
    ----------
    h : float
        Its length, s.
    lengths : (STEP_LENGTHS,) array
        Those that are kept, s; gets h in place of the oldest where it is not among them.
    oldest : int
        Place of the oldest.

    Returns
    -------
    int, bool, int
        The place, whether the step was kept there, and the place of the oldest from now on.
    """
    for place in range(len(lengths)):
        if abs(h - lengths[place]) <= 1e-12:
            return place, True, oldest
    lengths[oldest] = h
    return oldest, False, (oldest + 1) % len(lengths)


@njit(**INLINE)
def decays(
    coupled: int, nu: int, ny: int, lanes: int, h: float, poles: Array, decay: Array
) -> None:
    """Fill what a step of length h leaves of filtered noise, exp(−λ h), in ``decay`` (n, L).

    ``poles`` (nu + ny, L) are those of inputs, then outputs; biases keep one.
    """
    for s in range(nu + ny):
        at = coupled - nu + s if s < nu else coupled + ny + s - nu
        for q in range(lanes):
            if q > 0 and poles[s, q] == poles[s, q - 1]:  # most sensors are the same in all sets
                decay[at, q] = decay[at, q - 1]
            else:
                decay[at, q] = math.exp(-poles[s, q] * h)


@njit(**INLINE)
def gained_noise(
    coupled: int, nu: int, ny: int, lanes: int, filtered: Array, decay: Array, gained: Array
) -> None:
    """Fill the variances (nu + ny, L) that filtered noise gains in a step, stationary as it is."""
    for s in range(nu + ny):
        at = coupled - nu + s if s < nu else coupled + ny + s - nu
        for q in range(lanes):
            gained[s, q] = filtered[s, q] * (1.0 - decay[at, q] * decay[at, q])


MISSING, VALUE, AT_LEAST, AT_MOST = 0, 1, 2, 3  # kinds of reading


@njit(**INLINE)
def condition_on_value(
    lanes: int, reading: float, S: Array, shift: Array, shrink: Array, squared: Array
) -> None:
    """Fill the gains of a reading whose predictions stand in ``shift``; add ν² to ``squared``."""
    for q in range(lanes):
        left = reading - shift[q]
        inverse = 1.0 / S[q]
        shift[q] = left * inverse
        shrink[q] = inverse
        squared[q] += left * left * inverse


@njit(**INLINE)
def condition_on_bound(
    lanes: int, at_least: bool, bound: float, S: Array, shift: Array, shrink: Array, total: Array
) -> None:
    """Fill the gains of a bound, predictions being in ``shift``; add its log p to ``total``."""
    sign = 1.0 if at_least else -1.0
    for q in range(lanes):
        root = math.sqrt(S[q])
        z = sign * (bound - shift[q]) / root
        log_tail, hazard = upper_tail(z)
        total[q] += log_tail
        shift[q] = sign * hazard / root
        shrink[q] = hazard * (hazard - z) / S[q]
