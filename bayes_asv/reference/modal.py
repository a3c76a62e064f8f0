"""Modal analysis: Table 4.2 as printed and corrected, and identification from outputs alone.

The coordinates of Table 4.2 are the displacements of the chassis at the axles.  App. C.1 writes
their mass matrix with m/4, which places the centre of gravity at mid-wheelbase whatever ``wdf`` is,
and computes the damped frequency as ω(1−ζ): the square in ``sqrt(1-zeta)^2`` is outside the root.

Covariance-driven stochastic subspace identification follows Peeters & De Roeck, Reference-based
stochastic subspace identification for output-only modal analysis, Mechanical Systems and Signal
Processing 13 (1999) 855-878, with all outputs as references.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.half_car_equations import HalfCar
from bayes_asv.models.mode_shapes import second_order_modes
from bayes_asv.models.modes import VibrationMode

__all__ = [
    "Frequencies",
    "axle_matrices",
    "corrected_modes",
    "covariances",
    "poles_from_covariances",
    "printed_damped",
    "printed_matrices",
    "printed_modes",
    "subspace_modes",
]

Array = NDArray[np.float64]


class Frequencies(NamedTuple):
    """One mode: damped frequency, Hz, damping ratio and natural frequency, Hz."""

    damped: float
    ratio: float
    natural: float


def axle_matrices(car: HalfCar) -> tuple[Array, Array, Array]:
    """Return M, C, K of the half car in displacements at the axles, SI units.

    With x = wdf·x_f + (1−wdf)·x_r (eq. 6.2 without its division by l) and θ = (x_f − x_r)/l
    (eq. 6.1), the kinetic energy ½mẋ² + ½iθ̇² gives M.  Springs and dampers act at the axles.
    """
    heave = np.array([car.wdf, 1.0 - car.wdf])
    pitch = np.array([1.0, -1.0]) / car.l
    M = car.m * np.outer(heave, heave) + car.i * np.outer(pitch, pitch)
    return M, np.diag([car.c_f, car.c_r]), np.diag([car.k_f, car.k_r])


def printed_matrices(car: HalfCar) -> tuple[Array, Array, Array]:
    """Return M, C, K as in App. C.1, M with m/4 throughout."""
    _, C, K = axle_matrices(car)
    rotation = car.i / car.l**2
    quarter = car.m / 4.0
    M = np.array(
        [[quarter + rotation, quarter - rotation], [quarter - rotation, quarter + rotation]]
    )
    return M, C, K


def printed_damped(mode: VibrationMode) -> float:
    """Return the damped frequency as in App. C.1, ω(1−ζ)/2π, Hz."""
    return mode.natural * (1.0 - mode.ratio)


def printed_modes(car: HalfCar) -> tuple[Frequencies, ...]:
    """Compute Table 4.2 as the reference does."""
    found = second_order_modes(*printed_matrices(car))
    return tuple(Frequencies(printed_damped(m), m.ratio, m.natural) for m in found)


def corrected_modes(car: HalfCar) -> tuple[Frequencies, ...]:
    """Compute Table 4.2 with the mass distribution of ``wdf`` and ω√(1−ζ²)."""
    found = second_order_modes(*axle_matrices(car))
    return tuple(Frequencies(m.damped, m.ratio, m.natural) for m in found)


def covariances(output: Array, lags: int) -> Array:
    """Estimate the covariances R_k = E[y(t+k) y(t)ᵀ].

    Parameters
    ----------
    output : (N, q) array
        Samples; their mean is removed.
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
    """Compute the poles of the system whose output has the covariances ``R``.

    Parameters
    ----------
    R : (2p, q, q) array
        Covariances at lags 0 to 2p − 1.
    rate : float
        Sampling rate, Hz.
    order : int
        Number of states.

    Returns
    -------
    (order,) complex array
        Poles in continuous time, rad/s; nan for a discrete-time pole that is zero or negative real.
    """
    p, q = len(R) // 2, R.shape[1]
    # R_k = C A^(k-1) G: the block Toeplitz matrix is observability times controllability
    toeplitz = np.block([[R[p + i - j] for j in range(p)] for i in range(p)])
    U, s, _ = np.linalg.svd(toeplitz)
    observability = U[:, :order] * np.sqrt(s[:order])
    A = np.linalg.lstsq(observability[:-q], observability[q:], rcond=None)[0]
    mu = np.linalg.eigvals(A).astype(np.complex128)
    real = np.abs(mu.imag) < 1e-12
    mu[(np.abs(mu) < 1e-9) | (real & (mu.real <= 0.0))] = np.nan
    return np.asarray(np.log(mu) * rate, np.complex128)


def subspace_modes(output: Array, rate: float, blocks: int, order: int = 4) -> list[Frequencies]:
    """Identify the modes of a structure driven by unmeasured white noise.

    Parameters
    ----------
    output : (N, q) array
        Samples of its response.
    rate : float
        Sampling rate, Hz.
    blocks : int
        Block rows p of the Toeplitz matrix, which uses the covariances up to lag 2p − 1.
    order : int
        Number of states; the half car has four.

    Returns
    -------
    list of Frequencies
        Stable modes, slowest first.  Each real pole is a separate entry with damped frequency zero.
    """
    poles = poles_from_covariances(covariances(output, 2 * blocks - 1), rate, order)
    kept = [p for p in poles if np.isfinite(p) and p.real < 0.0 and p.imag >= -1e-9]
    identified = [
        Frequencies(
            damped=abs(float(p.imag)) / (2.0 * np.pi),
            ratio=float(-p.real / abs(p)),
            natural=float(abs(p)) / (2.0 * np.pi),
        )
        for p in kept
    ]
    return sorted(identified, key=lambda mode: mode.natural)
