"""Truths against which the rig is held; nothing here goes through its kernel.

The exact linear frequency response (complex arithmetic on mass, damping and stiffness matrices)
over a road of sine waves, and the equations of motion with lift written out a second time.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from .car import RigCar, baja
from .motion import Motion, simulate
from .terrain import Sine, Terrain
from .units import STANDARD_GRAVITY

__all__ = [
    "SPEED",
    "exact",
    "linear_car",
    "nonlinear_rates",
    "on_the_waves",
    "response",
    "worst",
]

Reals = npt.NDArray[np.float64]
Complexes = npt.NDArray[np.complex128]

# wavelengths (m) and amplitudes (m) of a smooth road without end: 2.2 to 14 Hz at 5 m/s
WAVES: Final = ((2.3, 0.02), (1.1, 0.006), (0.61, 0.002), (0.36, 0.0006))
SPEED: Final = 5.0  # m/s


def linear_car() -> RigCar:
    """Baja on linear tyres, touching the road as it is."""
    return replace(baja(), tyre_lifts=False, tyre_radius=0.0, contact_patch=0.0)


def wavy() -> Terrain:
    """Return a road of sine waves; the front axle passed its place 0 a second ago."""
    return Terrain("wavy", tuple((0.0, Sine(a, length)) for length, a in WAVES), -1.0)


def response(car: RigCar, omega: float) -> Complexes:
    """Amplitudes of (x, theta, u_f, u_r) for a unit sine under the front axle, exactly."""
    mass = np.diag([car.m, car.i, car.m_uf, car.m_ur])
    # rows take (x, theta, u_f, u_r) to the deflections, and to the tyres' compressions
    d = np.array([[1.0, car.l_f, -1.0, 0.0], [1.0, -car.l_r, 0.0, -1.0]])
    h = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    spring = np.diag([car.k_f + 1j * omega * car.c_f, car.k_r + 1j * omega * car.c_r])
    tyre = np.diag([car.k_tf + 1j * omega * car.c_tf, car.k_tr + 1j * omega * car.c_tr])
    dynamic = d.T @ spring @ d + h.T @ tyre @ h - omega**2 * mass
    under = np.array([1.0, np.exp(-1j * omega * car.l / SPEED)])
    return np.asarray(np.linalg.solve(dynamic, h.T @ tyre @ under))


def exact(car: RigCar, t: Reals, bandwidth: float = math.inf) -> tuple[Reals, Reals, Reals]:
    """States (8, n), accelerations (4, n) and their rates over the waves, periodic for ever."""
    states = np.zeros((8, len(t)))
    acceleration = np.zeros((4, len(t)))
    jerk = np.zeros((4, len(t)))
    for length, amplitude in WAVES:
        omega = 2.0 * math.pi * SPEED / length
        q = response(car, omega)
        # the front axle is above place 0 one second before t = 0 (lead-in -1)
        turning = amplitude * np.exp(1j * omega * (t + 1.0))
        points = np.array([q[2], q[0] + car.l_f * q[1], q[3], q[0] - car.l_r * q[1]])
        points = points / (1.0 + 1j * omega / (2.0 * math.pi * bandwidth))
        states += np.imag(np.outer(np.concatenate([q, 1j * omega * q]), turning))
        acceleration += np.imag(np.outer(-(omega**2) * points, turning))
        jerk += np.imag(np.outer(-1j * omega**3 * points, turning))
    return states, acceleration, jerk


def on_the_waves(car: RigCar, rate: float) -> Motion:
    """Simulate two seconds of the periodic motion, begun on it."""
    start = exact(car, np.array([0.0]))[0][:, 0]
    return simulate(car, wavy(), SPEED, 0.0, 2.0, rate=rate, initial=start)


def worst(found: Reals, true: Reals) -> float:
    """Largest error over a channel's largest value, worst channel."""
    return float(np.max(np.abs(found - true).max(axis=1) / np.abs(true).max(axis=1)))


def nonlinear_rates(t: float, s: Reals, car: RigCar) -> list[float]:
    """Write the equations of motion a second time, with lift, over a haversine."""
    x, theta, u_f, u_r, vx, omega, v_f, v_r = s
    forces = []
    for arm, u, v, k, c in (
        (car.l_f, u_f, v_f, car.k_f, car.c_f),
        (-car.l_r, u_r, v_r, car.k_r, car.c_r),
    ):
        delta, rate = x + arm * theta - u, vx + arm * omega - v
        forces.append(-k * delta - c * rate - 60.0 * math.tanh(rate / 0.05))
    hubs = []
    for place, u, v, force, k, c, mass, sprung in (
        (SPEED * (t - 0.1), u_f, v_f, forces[0], car.k_tf, car.c_tf, car.m_uf, car.wdf),
        (SPEED * (t - 0.1) - car.l, u_r, v_r, forces[1], car.k_tr, car.c_tr, car.m_ur,
         1.0 - car.wdf),
    ):  # fmt: skip
        wave = 2.0 * math.pi / 1.2
        over = 0.0 < place < 1.2
        z = 0.05 * (1.0 - math.cos(wave * place)) if over else 0.0
        dz = 0.05 * wave * math.sin(wave * place) * SPEED if over else 0.0
        load = (mass + car.m * sprung) * STANDARD_GRAVITY
        depth = z - u + load / k
        fade = min(max(5.0 * depth * k / load, 0.0), 1.0)
        tyre = max(0.0, k * depth + fade**2 * (3.0 - 2.0 * fade) * c * (dz - v))
        tyre = tyre if depth > 0.0 else 0.0
        hubs.append((tyre - force) / mass - STANDARD_GRAVITY * (1.0 + car.m * sprung / mass))
    heave = sum(forces) / car.m
    pitch = (car.l_f * forces[0] - car.l_r * forces[1]) / car.i
    return [vx, omega, v_f, v_r, heave, pitch, *hubs]
