"""Covariance-driven stochastic subspace identification: modes from outputs alone.

Peeters & De Roeck, Reference-based stochastic subspace identification for output-only modal
analysis, Mechanical Systems and Signal Processing 13 (1999) 855-878; all outputs are references.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.reference.modal import Frequencies

__all__ = ["covariances", "poles_from_covariances", "subspace_modes"]

Array = NDArray[np.float64]


def covariances(output: Array, lags: int) -> Array:
    """Covariances R_k = E[y(t+k) y(t)ᵀ].

    Parameters
    ----------
    output : (N, q) array
        Samples; their mean is taken off.
    lags : int
        Largest k.

    Returns
    -------
    (lags + 1, q, q) array
    """
    y = output - output.mean(axis=0)
    n = len(y)
    return np.stack([y[k:].T @ y[: n - k] / (n - k) for k in range(lags + 1)])


def poles_from_covariances(R: Array, rate: float, order: int) -> NDArray[np.complex128]:
    """Poles of the system whose output has the covariances ``R``.

    Parameters
    ----------
    R : (2p, q, q) array
        Covariances at lags 0 to 2p − 1.
    rate : float
        Samples a second, Hz.
    order : int
        Number of states.

    Returns
    -------
    (order,) complex array
        Poles in continuous time, rad/s.  A pole without a logarithm that a car could have (zero
        or negative real in discrete time) is nan.
    """
    p, q = len(R) // 2, R.shape[1]
    # R_k = C A^(k-1) G, so the block Toeplitz matrix is observability times controllability
    toeplitz = np.block([[R[p + i - j] for j in range(p)] for i in range(p)])
    U, s, _ = np.linalg.svd(toeplitz)
    seen = U[:, :order] * np.sqrt(s[:order])
    A = np.linalg.lstsq(seen[:-q], seen[q:], rcond=None)[0]
    mu = np.linalg.eigvals(A).astype(np.complex128)
    real = np.abs(mu.imag) < 1e-12
    mu[(np.abs(mu) < 1e-9) | (real & (mu.real <= 0.0))] = np.nan
    return np.asarray(np.log(mu) * rate, np.complex128)


def subspace_modes(output: Array, rate: float, blocks: int, order: int = 4) -> list[Frequencies]:
    """Modes of a structure shaken by white noise that nobody measured.

    Parameters
    ----------
    output : (N, q) array
        Samples of its motion.
    rate : float
        Samples a second, Hz.
    blocks : int
        Block rows p of the Toeplitz matrix: the covariances up to 2p − 1 samples are used.
    order : int
        Number of states; the half car has four.

    Returns
    -------
    list of Frequencies
        Stable modes, slowest first; each real pole is an entry of its own, damped frequency zero.
    """
    poles = poles_from_covariances(covariances(output, 2 * blocks - 1), rate, order)
    kept = [p for p in poles if np.isfinite(p) and p.real < 0.0 and p.imag >= -1e-9]
    found = [
        Frequencies(
            damped=abs(float(p.imag)) / (2.0 * np.pi),
            ratio=float(-p.real / abs(p)),
            natural=float(abs(p)) / (2.0 * np.pi),
        )
        for p in kept
    ]
    return sorted(found, key=lambda mode: mode.natural)
