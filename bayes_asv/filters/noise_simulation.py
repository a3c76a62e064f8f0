"""Random draws of what the sensors' noise makes of a car's outputs, compiled.

The model of noise of :mod:`.prediction`, run forwards: noise of the input sensors drives the car,
noise of the output sensors adds to what it puts out.  It starts at x = 0 and adds no bias, so what
comes out is noise alone.  The tests pass it through the Kalman filter, which has to find white
innovations of variance one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.kalman import Measurements, SensorNoise, StateSpace
from bayes_asv.filters.prediction import (
    OPTIONS,
    ORDER,
    STEP_SERIES,
    TAYLOR,
    decays,
    power_series,
    step_weights,
)
from bayes_asv.filters.vector_code import LANES
from bayes_asv.filters.vector_steps import discretize_vectors

__all__ = ["normals_needed", "simulate_noise"]

Array = NDArray[np.float64]


def normals_needed(nu: int, ny: int) -> int:
    """Count the standard normal numbers of an instant: car, filtered noise, white noise."""
    return 2 * nu + (nu + ny) + ny


@lru_cache(maxsize=64)
def _compiled(nx: int, nu: int, ny: int) -> Callable[..., None]:
    lanes, coupled = LANES, nx + nu
    n = coupled + 2 * ny

    @njit(**OPTIONS)
    def run(
        A: Array,
        B: Array,
        C: Array,
        white: Array,
        filtered: Array,
        poles: Array,
        step: Array,
        spread: Array,
        extra: Array,
        normals: Array,
        out: Array,
    ) -> None:
        powers = np.empty((TAYLOR + 1, nx, nx, lanes))
        drive = np.empty((nu, ORDER, nx, lanes))
        power_series(nx, nu, lanes, A, B, powers, drive)
        carry = np.zeros((nx, coupled, lanes))
        Q = np.zeros((nu, nx, nx, lanes))
        decay = np.ones((n, lanes))
        weights = np.empty((STEP_SERIES, TAYLOR + 1))
        N = np.zeros((nu, 0))
        node = np.zeros((nx, 2, nu))  # whose squares add to Q
        kick = np.zeros(nu)
        rest = np.zeros(nu + ny)
        keep = np.ones(nu + ny)
        ahead = np.empty(nx)
        paths = normals.shape[1]
        x = np.zeros((paths, nx))
        slow = np.empty((paths, nu + ny))
        for p in range(paths):
            for c in range(nu + ny):
                slow[p, c] = math.sqrt(filtered[c, 0]) * normals[0, p, 2 * nu + c]
        known = -1.0
        for k in range(step.shape[0]):
            h = step[k]
            if h > 0.0:
                if abs(h - known) > 1e-12:
                    known = h
                    step_weights(h, weights)
                    discretize_vectors(nx, 0, nu, nx, coupled, weights, powers, B, N, carry, Q)
                    decays(coupled, nu, ny, lanes, h, poles, decay)
                    for g in range(2):
                        for a in range(nx):
                            for u in range(nu):
                                total = 0.0
                                for c in range(nx):
                                    for j in range(TAYLOR + 1):
                                        total += weights[2 + g, j] * powers[j, a, c, 0] * B[c, u, 0]
                                node[a, g, u] = total
                    for u in range(nu):
                        keep[u] = decay[nx + u, 0]
                    for y in range(ny):
                        keep[nu + y] = decay[coupled + ny + y, 0]
                    for c in range(nu + ny):
                        rest[c] = math.sqrt(filtered[c, 0] * (1.0 - keep[c] ** 2))
                for u in range(nu):
                    intensity = white[u, 0] * spread[k, u] + spread[k, nu + u]
                    kick[u] = math.sqrt(intensity)
                for p in range(paths):
                    for a in range(nx):
                        total = 0.0
                        for b in range(nx):
                            total += carry[a, b, 0] * x[p, b]
                        for u in range(nu):
                            total += carry[a, nx + u, 0] * slow[p, u]
                            for g in range(2):
                                total += node[a, g, u] * kick[u] * normals[k, p, 2 * u + g]
                        ahead[a] = total
                    for a in range(nx):
                        x[p, a] = ahead[a]
                    for c in range(nu + ny):
                        slow[p, c] = keep[c] * slow[p, c] + rest[c] * normals[k, p, 2 * nu + c]
            for y in range(ny):
                deviation = math.sqrt(white[nu + y, 0] + extra[k, y])
                for p in range(paths):
                    total = slow[p, nu + y] + deviation * normals[k, p, 3 * nu + ny + y]
                    for a in range(nx):
                        total += C[y, a, 0] * x[p, a]
                    out[k, p, y] = total

    return run  # type: ignore[no-any-return]


def simulate_noise(
    system: StateSpace, noise: SensorNoise, data: Measurements, normals: Array
) -> Array:
    """Draw K records of noise.

    Parameters
    ----------
    system, noise : StateSpace and SensorNoise
        Of one parameter set.
    data : Measurements
        Steps of the recording.
    normals : (N, K, normals_needed(nu, ny)) array
        Independent standard normal numbers.

    Returns
    -------
    (N, K, ny) array
        Noise of the outputs at the instants.
    """
    _, nx, nu = system.B.shape
    ny = system.C.shape[1]
    run = _compiled(nx, nu, ny)
    one = [
        np.ascontiguousarray(np.repeat(x[0, ..., None], LANES, axis=-1))
        for x in (system.A, system.B, system.C, *noise)
    ]
    out = np.empty((*normals.shape[:2], ny))
    run(*one, data.step, data.process_noise, data.extra_variance, normals, out)
    return out
