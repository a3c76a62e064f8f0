"""The bound once more, with whole covariance matrices: slow, and shares no code with the product.

Readings of the chassis less the car's response to the readings of the wheels are normal with

    S(θ) = S_y + G(θ) S_u G(θ)ᵀ + what initial state and biases may be,

where G(θ) takes the wheels' samples, through a cubic spline, to the chassis' instants.  Information
about θ is in the mean, (∂m/∂θ)ᵀ S⁻¹ (∂m/∂θ) with m = G(θ) u, and a little in the noise,
½ tr(S⁻¹ ∂N/∂θ S⁻¹ ∂N/∂θ) with N = G S_u Gᵀ.  Initial state and biases have one value in a drive,
which S only integrates over: a swing that did not happen tells nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_factor, cho_solve, expm

__all__ = ["Drive", "Noise", "information", "respond", "suspension"]

Array = NDArray[np.float64]

_SAME = 1e-9  # s
_STEP = 1e-4  # of a logarithm
_PIECES = 4  # straight pieces of the spline in each interval between wheel samples


@dataclass(frozen=True)
class Noise:
    """Noise of one channel.

    Parameters
    ----------
    white, filtered : float
        Variances of one sample, m²/s⁴.
    pole : float
        Of the filter that the second passed, rad/s.
    """

    white: float
    filtered: float
    pole: float

    def covariance(self, time: Array) -> Array:
        """Covariance (N, N) of samples at times (N,)."""
        apart = np.abs(time[:, None] - time[None, :])
        return np.asarray(
            self.filtered * np.exp(-self.pole * apart) + self.white * np.eye(len(time))
        )


@dataclass(frozen=True)
class Drive:
    """What an ideal estimator is given.

    Parameters
    ----------
    fine : (K,) array
        Times at which the wheels' motion is known, s.
    wheels : (2, K) array
        Front and rear wheel acceleration there, straight in between, m/s².
    samples : (M,) array
        Times of the wheels' readings, s.
    readings : (N,) array
        Times of the chassis' readings, s.
    noise : four Noise
        Front wheel, front chassis, rear wheel, rear chassis.
    start : (6,) array
        Variances of δ_f, δ̇_f, δ_r, δ̇_r at the first reading, and of the biases.
    """

    fine: Array
    wheels: Array
    samples: Array
    readings: Array
    noise: tuple[Noise, Noise, Noise, Noise]
    start: Array


def suspension(car: Array) -> tuple[Array, Array]:
    """Matrices A (4, 4) and C (2, 4) of a half car (c_f, c_r, i, m, l, wdf, k_f, k_r).

    With T taking heave and pitch to the chassis over the axles and H = T M⁻¹ Tᵀ, chassis
    accelerations are a = −H (K δ + D δ̇) and deflections obey δ̈ = a − ü; states are
    δ_f, δ̇_f, δ_r, δ̇_r.
    """
    c_f, c_r, i, m, l, wdf, k_f, k_r = (float(v) for v in car)
    T = np.array([[1.0, l * (1.0 - wdf)], [1.0, -l * wdf]])
    H = T @ np.diag([1.0 / m, 1.0 / i]) @ T.T
    C = np.empty((2, 4))
    C[:, 0::2] = -H @ np.diag([k_f, k_r])
    C[:, 1::2] = -H @ np.diag([c_f, c_r])
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1::2] = C
    return A, C


def respond(car: Array, time: Array, wheels: Array, at: Array, x0: Array | None = None) -> Array:
    """Chassis accelerations (2, N, Q) at times (N,) for Q histories of wheel accelerations.

    Parameters
    ----------
    car : (8,) array
        As :func:`suspension` takes it.
    time : (K,) array
        Increasing, s.
    wheels : (2, K, Q) array
        Straight between these times, m/s².
    at : (N,) array
        Increasing, within ``time``.
    x0 : (4, Q) array, optional
        State at the first time; zero by default.
    """
    A, C = suspension(car)
    every = np.unique(np.concatenate([time, at]))
    every = every[np.append(True, np.diff(every) > _SAME)]
    big = np.zeros((8, 8))
    big[:4, :4] = A
    big[1, 4] = big[3, 5] = -1.0
    big[4, 6] = big[5, 7] = 1.0
    flows: dict[int, Array] = {}
    x = np.zeros((4, wheels.shape[2])) if x0 is None else x0
    wanted = np.searchsorted(every, at - _SAME)
    out = np.empty((2, len(at), wheels.shape[2]))
    row, piece = 0, 0
    for k, t in enumerate(every):
        while row < len(at) and wanted[row] == k:
            out[:, row] = C @ x
            row += 1
        if k + 1 == len(every) or row == len(at):
            break
        h = float(every[k + 1] - t)
        while piece < len(time) - 2 and time[piece + 1] <= t + _SAME:
            piece += 1
        slope = (wheels[:, piece + 1] - wheels[:, piece]) / (time[piece + 1] - time[piece])
        value = wheels[:, piece] + slope * (t - time[piece])
        key = round(h * 1e12)
        if key not in flows:
            flows[key] = expm(big * h)[:4]
        flow = flows[key]
        x = flow[:, :4] @ x + flow[:, 4:6] @ value + flow[:, 6:] @ slope
    return out


def _mean(car: Array, drive: Drive) -> Array:
    """Mean (2N,) of the readings, front then rear."""
    return respond(car, drive.fine, drive.wheels[:, :, None], drive.readings)[:, :, 0].ravel()


def _passed_on(car: Array, drive: Drive) -> Array:
    """N (2N, 2N): what the wheel sensors' noise does to the readings, front then rear."""
    n, m = len(drive.readings), len(drive.samples)
    between = np.linspace(0.0, 1.0, _PIECES, endpoint=False)
    fine = (drive.samples[:-1, None] + np.diff(drive.samples)[:, None] * between).ravel()
    fine = np.append(fine, drive.samples[-1])
    basis = CubicSpline(drive.samples, np.eye(m))(fine)  # one sample's share of the spline
    N = np.zeros((2 * n, 2 * n))
    for axle, channel in enumerate((0, 2)):
        alone = np.zeros((2, len(fine), m))
        alone[axle] = basis
        G = respond(car, fine, alone, drive.readings).reshape(2 * n, m)
        N += G @ drive.noise[channel].covariance(drive.samples) @ G.T
    return N


def _covariance(car: Array, drive: Drive) -> Array:
    """S (2N, 2N) of the readings, front then rear."""
    n = len(drive.readings)
    S = _passed_on(car, drive)
    for axle, channel in enumerate((1, 3)):
        block = slice(axle * n, (axle + 1) * n)
        S[block, block] += drive.noise[channel].covariance(drive.readings) + drive.start[4 + axle]
    ends = drive.readings[[0, -1]]
    free = respond(car, ends, np.zeros((2, 2, 4)), drive.readings, np.eye(4)).reshape(2 * n, 4)
    S += (free * drive.start[:4]) @ free.T
    return S


def information(
    car: Array, drive: Drive, which: tuple[int, ...], noise_too: bool = False
) -> tuple[Array, Array]:
    """Information about logarithms of some of the car's parameters, from the mean and from noise.

    Parameters
    ----------
    car : (8,) array
        c_f, c_r, i, m, l, wdf, k_f, k_r in SI units.
    drive : Drive
        What is known.
    which : tuple of int
        Which parameters.
    noise_too : bool
        Work out the second part, which takes a while.

    Returns
    -------
    mean, noise : (n, n) arrays
        To be added; the second is small, and zero when not asked for.
    """

    def moved(k: int, by: float) -> Array:
        out = car.copy()
        out[k] *= np.exp(by)
        return out

    factor = cho_factor(_covariance(car, drive))
    J = np.stack(
        [(_mean(moved(k, _STEP), drive) - _mean(moved(k, -_STEP), drive)) for k in which], axis=1
    ) / (2.0 * _STEP)
    mean = J.T @ cho_solve(factor, J)
    if not noise_too:
        return np.asarray(mean), np.zeros_like(mean)
    turned = [
        cho_solve(factor, _passed_on(moved(k, _STEP), drive) - _passed_on(moved(k, -_STEP), drive))
        / (2.0 * _STEP)
        for k in which
    ]
    noise = np.array([[0.5 * np.sum(a * b.T) for b in turned] for a in turned])
    return np.asarray(mean), noise
