"""Tails of the normal distribution to full precision, compiled."""

from __future__ import annotations

import math

from numba import njit

__all__ = ["upper_tail"]

_LOG_2PI = math.log(2.0 * math.pi)
_SQRT_2 = math.sqrt(2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def upper_tail(z: float) -> tuple[float, float]:
    """Logarithm of P(Z > z), and the hazard φ(z)/P(Z > z) of a standard normal Z."""
    if z < 25.0:
        tail = 0.5 * math.erfc(z / _SQRT_2)
        return math.log(tail), math.exp(-0.5 * z * z - 0.5 * _LOG_2PI) / tail
    hazard = z + 1.0 / (z + 2.0 / (z + 3.0 / (z + 4.0 / z)))  # Laplace's continued fraction
    return -0.5 * z * z - 0.5 * _LOG_2PI - math.log(hazard), hazard
