"""Exact discretisation of a linear system for steps of any length.

The input runs straight from sample to sample (first-order hold).  The compiled kernels, which
take cubic inputs by their moments, are held against this on inputs that are straight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bayes_asv.models.half_car_equations import LinearSystem

__all__ = ["Step", "exact_step", "simulate_linear"]

Array = NDArray[np.float64]


class Step(NamedTuple):
    """x⁺ = Φ x + Γ₀ u + Γ₁ u⁺ over one step of length h."""

    Phi: Array
    Gamma0: Array
    Gamma1: Array


def exact_step(system: LinearSystem, h: float) -> Step:
    """Discretise over a step of length ``h`` with the input straight in between.

    One matrix exponential of the system augmented with the input and its slope gives all
    three matrices (Van Loan 1978).

    Parameters
    ----------
    system : LinearSystem
        n states, p inputs.
    h : float
        Length of the step, s.

    Returns
    -------
    Step
        Φ (n, n), Γ₀ (n, p), Γ₁ (n, p).
    """
    n, p = system.B.shape
    big = np.zeros((n + 2 * p, n + 2 * p))
    big[:n, :n] = system.A * h
    big[:n, n : n + p] = system.B * h
    big[n : n + p, n + p :] = np.eye(p)
    flow = expm(big)
    held, ramp = flow[:n, n : n + p], flow[:n, n + p :]
    return Step(flow[:n, :n], held - ramp, ramp)


def simulate_linear(system: LinearSystem, time: Array, u: Array, x0: Array | None = None) -> Array:
    """States of a linear system at the given times.

    Parameters
    ----------
    system : LinearSystem
        n states, p inputs.
    time : (N,) array
        Increasing times, s; steps may differ.
    u : (N, p) array
        Inputs at those times, straight in between.
    x0 : (n,) array, optional
        State at the first time, zero by default.

    Returns
    -------
    (N, n) array
    """
    n = system.A.shape[0]
    x = np.zeros((len(time), n))
    if x0 is not None:
        x[0] = x0
    steps: dict[float, Step] = {}
    for k in range(1, len(time)):
        h = float(time[k] - time[k - 1])
        key = round(h, 15)
        if key not in steps:
            steps[key] = exact_step(system, h)
        Phi, Gamma0, Gamma1 = steps[key]
        x[k] = Phi @ x[k - 1] + Gamma0 @ u[k - 1] + Gamma1 @ u[k]
    return x
