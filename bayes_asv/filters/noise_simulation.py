"""What the sensors' noise makes of the half car's output, drawn at random; compiled.

The same model of noise as in :mod:`.innovations`, run forwards: noise of the wheel sensors
drives the car, noise of the chassis sensors adds to what it puts out::

    x⁺ = Φ x + Γ w + white, intensity q      w⁺ = ρ w + …      v⁺ = ρ v + …
    y  = C x + v + white, variance r

It starts at x = 0 and adds no bias, so what comes out is noise alone.  The tests pass it
through the innovations recursion, which has to find white noise of variance one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS, ORDER, TAYLOR, series, transition

__all__ = ["NORMALS", "noise_path"]

NORMALS = 10  # that an instant takes: 4 for the car, 4 for filtered noise, 2 for white

Array = NDArray[np.float64]


@njit(**OPTIONS)
def noise_path(
    car: Array,
    noise: Array,
    step: Array,
    spread: Array,
    extra: Array,
    normals: Array,
    out: Array,
) -> None:
    """Fill ``out`` with K records of noise.

    Parameters
    ----------
    car : (8,) array
        c_f, c_r, i, m, l, wdf, k_f, k_r in SI units.
    noise : (12,) array
        As in :func:`bayes_asv.filters.kalman.log_likelihood`.
    step : (N,) array
        Time since the instant before, s; zero for the first.
    spread : (N, 4) array
        As in the same place.
    extra : (N, 2) array
        Variance added to single readings, m²/s⁴.
    normals : (N, K, NORMALS) array
        Independent standard normal numbers.
    out : (N, K, 2) array
        Noise of the chassis readings at the instants, m/s².
    """
    C = np.empty((2, 4))
    powers = np.empty((TAYLOR + 1, 4, 4))
    drive = np.empty((2, ORDER, 4))
    series(car, C, powers, drive)
    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    decay = np.ones(6)
    poles = noise[8:12].copy()
    node = np.zeros((4, 4))  # Φ(s) e at the two Gauss nodes of each axle, whose squares add to q
    kick = np.zeros(4)
    rest = np.zeros(4)
    fresh = np.empty(4)
    n, paths = normals.shape[0], normals.shape[1]
    x = np.zeros((paths, 4))
    slow = np.empty((paths, 4))
    for p in range(paths):
        for c in range(4):
            slow[p, c] = math.sqrt(noise[4 + c]) * normals[0, p, 4 + c]
    known = -1.0
    for k in range(n):
        h = step[k]
        if h > 0.0:
            if abs(h - known) > 1e-12:
                known = h
                transition(h, powers, poles, phi, gamma, qf, qr, decay)
                for b in range(4):
                    s = h * (0.5 + (b % 2 - 0.5) / math.sqrt(3.0))
                    for a in range(4):
                        acc = powers[TAYLOR, a, 2 * (b // 2) + 1]
                        for j in range(TAYLOR - 1, -1, -1):
                            acc = acc * s + powers[j, a, 2 * (b // 2) + 1]
                        node[a, b] = acc
                for c in range(4):
                    rest[c] = math.sqrt(noise[4 + c] * (1.0 - decay[2 + c] ** 2))
            for b in range(4):
                intensity = noise[b // 2] * spread[k, b // 2] + spread[k, 2 + b // 2]
                kick[b] = math.sqrt(0.5 * h * intensity)
            for p in range(paths):
                for a in range(4):
                    acc = gamma[a, 0] * slow[p, 0] + gamma[a, 1] * slow[p, 1]
                    for b in range(4):
                        acc += phi[a, b] * x[p, b]
                        acc += node[a, b] * kick[b] * normals[k, p, b]
                    fresh[a] = acc
                for a in range(4):
                    x[p, a] = fresh[a]
                for c in range(4):
                    slow[p, c] = decay[2 + c] * slow[p, c] + rest[c] * normals[k, p, 4 + c]
        for axle in range(2):
            white = math.sqrt(noise[2 + axle] + extra[k, axle])
            for p in range(paths):
                acc = slow[p, 2 + axle] + white * normals[k, p, 8 + axle]
                for b in range(4):
                    acc += C[axle, b] * x[p, b]
                out[k, p, axle] = acc
