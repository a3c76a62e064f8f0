"""Chapter 4's drive: both wheels follow independent white noise, and the chassis is watched.

The vertical velocity of the wheels is the white noise, as it is on a road of the usual spectrum n⁻²
at constant speed.  The chassis' velocity then has the half car's transmissibility for its spectrum,
and is the output of a linear system of four states driven by white noise, which is what
operational modal methods assume.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from bayes_asv.models.discretization import exact_step
from bayes_asv.models.half_car import HalfCar, LinearSystem, deflection_form

__all__ = ["expected_spectrum", "velocity_form", "white_drive"]

Array = NDArray[np.float64]


def velocity_form(car: HalfCar) -> LinearSystem:
    """State (δ_f, ẋ_f, δ_r, ẋ_r), input the wheel velocities, output the chassis velocities.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units; x is the chassis at an axle, δ = x − u.

    Returns
    -------
    LinearSystem
        A (4, 4), B (4, 2), C (2, 4), D (2, 2); the poles are those of the deflection form.
    """
    A, B, _, _ = deflection_form(car)
    B = np.zeros_like(B)
    B[0, 0] = B[2, 1] = -1.0
    # forces come from δ̇ = ẋ − u̇, so the wheel velocity enters through the dampers as well
    B[1], B[3] = -A[1, [1, 3]], -A[3, [1, 3]]
    C = np.zeros((2, 4))
    C[0, 1] = C[1, 3] = 1.0
    return LinearSystem(A, B, C, np.zeros((2, 2)))


def white_drive(
    car: HalfCar, seconds: float, rate: float, runs: int, rng: np.random.Generator
) -> Array:
    """Drive over white noise several times and read the chassis' velocity.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.
    seconds, rate : float
        Length (s) and samples a second (Hz).  The noise is held between samples.
    runs : int
        Number of independent drives.
    rng : numpy Generator
        Draws start and noise.

    Returns
    -------
    (runs, N, 2) array
        Chassis velocity, front and rear, where the wheels' velocity has a spectral density of
        one (m/s)²/Hz; the start is drawn from the steady state.
    """
    system = velocity_form(car)
    step = exact_step(system, 1.0 / rate)
    held = step.Gamma0 + step.Gamma1
    deviation = np.sqrt(0.5 * rate)  # one-sided density of one up to half the rate
    settled = solve_discrete_lyapunov(step.Phi, deviation**2 * held @ held.T)
    n = round(seconds * rate)
    x = rng.standard_normal((runs, 4)) @ np.linalg.cholesky(settled).T
    pushes = deviation * rng.standard_normal((n, runs, 2)) @ held.T
    out = np.empty((n, runs, 2))
    for k in range(n):
        out[k] = x[:, [1, 3]]
        x = x @ step.Phi.T + pushes[k]
    return np.moveaxis(out, 0, 1)


def expected_spectrum(car: HalfCar, frequency: Array) -> Array:
    """Spectral density of the chassis' velocity over that of the wheels', for an endless record.

    Parameters
    ----------
    car : HalfCar
        Parameters in SI units.
    frequency : (F,) array
        Hz.

    Returns
    -------
    (F, 2) array
        |T_ff|² + |T_fr|² at the front axle, |T_rf|² + |T_rr|² at the rear.
    """
    A, B, C, _ = velocity_form(car)
    s = 2j * np.pi * frequency[:, None, None]
    transfer = C @ np.linalg.solve(s * np.eye(4) - A, np.broadcast_to(B, (len(frequency), 4, 2)))
    return np.asarray(np.sum(np.abs(transfer) ** 2, axis=2))
