"""Linear systems and filters on a fine, even grid of times."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from .kinds import Complexes, Vector

__all__ = ["LinearSystem", "filtered", "interpolated", "one_pole", "spline"]


def spline(x: Vector, y: Vector) -> CubicSpline[np.float64]:
    """Cubic spline through points (x, y); y may have further axes behind the first."""
    return CubicSpline(x, y)


def interpolated(values: Vector, begin: float, step: float, times: Vector) -> Vector:
    """Values at ``times`` (s) of a signal on an even grid, by cubic interpolation.

    The grid begins at ``begin`` (s) and has the spacing ``step`` (s). Times beyond the grid take
    the values at its ends.
    """
    place = np.clip((times - begin) / step, 1.0, len(values) - 2.000001)
    low = np.floor(place).astype(np.int64)
    u = place - low
    weights = (
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    )
    found = np.zeros(len(times))
    for shift, weight in zip((-1, 0, 1, 2), weights, strict=True):
        found += weight * values[np.clip(low + shift, 0, len(values) - 1)]
    return found


def one_pole(signal: Vector, step: float, pole: complex) -> Complexes:
    """Response of 1/(1 − s/pole) to a signal on a grid of spacing ``step`` (s), from rest.

    Between its points the signal is a cubic through four of them, whose response is exact.
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    u = 0.5 * (nodes + 1.0)
    kernel = -pole * step * np.exp(pole * step * (1.0 - u)) * 0.5 * weights
    shapes = (
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    )
    padded = np.concatenate([signal[:1], signal, signal[-1:]])
    count = len(signal) - 1
    drive = np.zeros(len(signal), complex)
    drive[0] = signal[0]
    for number, shape in enumerate(shapes):
        drive[1:] += np.sum(kernel * shape) * padded[number : number + count]
    out: Complexes = np.asarray(lfilter([1.0 + 0j], [1.0, -np.exp(pole * step)], drive))
    return out


def filtered(signal: Vector, step: float, poles: tuple[complex, ...]) -> Vector:
    """Response of the all-pole filter ∏ 1/(1 − s/p) of unit gain at rest, poles p in rad/s.

    The poles differ from each other, and complex ones come in conjugate pairs.
    """
    if not poles:
        return signal
    total = np.zeros(len(signal))
    for number, pole in enumerate(poles):
        share = 1.0 + 0j
        for other_number, other in enumerate(poles):
            if other_number != number:
                share *= other / (other - pole)
        total += np.real(share * one_pole(signal, step, pole))
    return total


class LinearSystem:
    """ẋ = A x + B u, y = C x + D u, solved exactly for inputs that are straight between points."""

    def __init__(self, a: Vector, b: Vector, c: Vector, d: Vector) -> None:
        """Split the system into its modes; A must not be defective."""
        values, modes = np.linalg.eig(a)
        self.values: Complexes = np.asarray(values, complex)
        self.into: Complexes = np.asarray(np.linalg.solve(modes, b.astype(complex)))
        self.start_into: Complexes = np.asarray(np.linalg.inv(modes), complex)
        self.out_of: Complexes = np.asarray(c @ modes, complex)
        self.d = d

    def response(self, u: Vector, step: float) -> Vector:
        """Return outputs (N, outputs) for inputs (N, inputs), ``step`` (s) apart, from rest.

        The input is taken as straight between points, with the correction by its second
        difference that makes it a parabola.
        """
        z = self.values * step
        grow = np.exp(z)
        # integrals of e^{z(1-s)} times 1, s and s(s-1)/2 over 0..1
        one = np.expm1(z) / z
        ramp = (one - 1.0) / z
        bow = ((2.0 * ramp - 1.0) / z - ramp) / 2.0
        modal = u @ self.into.T
        bent = np.zeros_like(modal)
        bent[1:-1] = modal[2:] - 2.0 * modal[1:-1] + modal[:-2]
        drive = np.zeros_like(modal)
        drive[1:] = step * (
            (one - ramp) * modal[:-1] + ramp * modal[1:] + bow * 0.5 * (bent[:-1] + bent[1:])
        )
        state = np.empty_like(drive)
        for mode, factor in enumerate(grow):
            state[:, mode] = lfilter([1.0 + 0j], [1.0, -factor], drive[:, mode])
        return np.asarray(np.real(state @ self.out_of.T) + u @ self.d.T, float)

    def free(self, times: Vector) -> Vector:
        """Return outputs (N, outputs, states) at ``times`` (s) from one in each state."""
        grow = np.exp(np.outer(times, self.values))
        return np.asarray(np.real(np.einsum("om,nm,ms->nos", self.out_of, grow, self.start_into)))

    def transfer(self, frequency: Vector) -> Complexes:
        """Transfer matrices (frequencies, outputs, inputs) at frequencies in Hz."""
        s = 2j * np.pi * frequency
        modal = 1.0 / (s[:, None] - self.values[None, :])
        return np.asarray(np.einsum("om,fm,mi->foi", self.out_of, modal, self.into) + self.d[None])
