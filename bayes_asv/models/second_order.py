"""Eigenvalue modes of M q̈ + C q̇ + K q = 0, whatever the coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from bayes_asv.models.modes import Mode

__all__ = ["second_order_modes"]

Array = NDArray[np.float64]


def second_order_modes(M: Array, C: Array, K: Array) -> list[Mode]:
    """Modes of a damped system, slowest first.

    Solved as the generalised eigenproblem of the symmetric pencil ``[C M; M 0]``, ``[K 0; 0 −M]``
    (Craig & Kurdila, Fundamentals of Structural Dynamics, 2006, ch. 10), which the reference uses
    in App. C.1 and which has no inverse in it.

    Parameters
    ----------
    M, C, K : (n, n) arrays
        Mass, damping and stiffness, in any one system of units.

    Returns
    -------
    list of Mode
        Frequencies in cycles per unit of time; an oscillating mode is one entry, each real pole
        one of its own.  Shapes are (n,), in the coordinates of the matrices, the largest entry 1.
    """
    n = len(M)
    zero = np.zeros((n, n))
    left = np.block([[K, zero], [zero, -M]])
    right = -np.block([[C, M], [M, zero]])
    values, vectors = eig(left, right)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0.0:
            continue  # the conjugate says the same
        shape = vector[:n] / vector[int(np.argmax(np.abs(vector[:n])))]
        size = float(abs(value))
        found.append(
            Mode(
                natural=size / (2.0 * np.pi),
                damped=float(value.imag / (2.0 * np.pi)),
                # a free coordinate (no spring) has its pole at zero, and no ratio
                ratio=float(-value.real / size) if size > 0.0 else 0.0,
                shape=shape.astype(np.complex128),
            )
        )
    return sorted(found, key=lambda mode: mode.natural)
