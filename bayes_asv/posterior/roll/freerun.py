"""What the fitted car makes of the wheels alone: nothing of the chassis' readings is fed back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bayes_asv.filters.discretization import ORDER
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.roll_car import RollCar, deflections, warp
from bayes_asv.posterior.roll.layout import RollLayout

__all__ = ["free_run", "left_over"]

Array = NDArray[np.float64]


def free_run(car: RollCar, line: RollLayout) -> Array:
    """Chassis accelerations from the wheels' splines, with the best start and biases.

    The twelve unknowns (initial deflections and rates, three biases, drift along the warp) enter
    linearly; they are fitted by least squares with their prior.

    Parameters
    ----------
    car : RollCar
        Parameters in SI units.
    line : RollLayout
        One recording, N instants.

    Returns
    -------
    (N, 3) array
        m/s².
    """
    system, n = deflections(car), warp(car)
    drive = np.empty((4, ORDER, 8))
    power = np.eye(8)
    for j in range(ORDER):
        drive[:, j] = -power[:, 4:].T
        power = system.A @ power
    forced = np.einsum("kuj,uja->ka", line.moments, drive)
    states = np.zeros((8, 10))  # driven, by each initial state, by the drift
    states[:, 1:9] = np.eye(8)
    out = np.empty((len(line.step), 3, 10))
    out[0] = system.C @ states
    known: dict[float, tuple[Array, Array]] = {}
    for k in range(1, len(line.step)):
        h = round(float(line.step[k]), 13)
        if h not in known:
            big = np.zeros((9, 9))
            big[:8, :8] = system.A * h
            big[4:8, 8] = n * h
            flow = expm(big)
            known[h] = flow[:8, :8], flow[:8, 8]
        Phi, drift = known[h]
        states = Phi @ states
        states[:, 0] += forced[k]
        states[:, 9] += drift
        out[k] = system.C @ states
    use = line.kind == VALUE
    biases = np.broadcast_to(np.eye(3), (len(line.step), 3, 3))
    columns = np.concatenate([out[..., 1:9], biases, out[..., 9:]], axis=-1)
    covariance = line.start[:12, :12]
    level = [
        line.noise[4 + y] or 0.01 * float(np.std(line.reading[use[:, y], y])) for y in range(3)
    ]
    weight = np.broadcast_to(1.0 / np.maximum(level, 1e-3), use.shape)[use]
    root = np.linalg.cholesky(np.linalg.inv(covariance)).T
    left = np.vstack([columns[use] * weight[:, None], root])
    right = np.concatenate([(line.reading - out[..., 0])[use] * weight, np.zeros(12)])
    found = np.linalg.lstsq(left, right, rcond=None)[0]
    return np.asarray(out[..., 0] + columns @ found)


def left_over(car: RollCar, line: RollLayout) -> dict[str, float]:
    """Rms of what a free run leaves over the rms of the readings, by chassis channel."""
    output = free_run(car, line)
    shares = {}
    for y, name in enumerate(("front_left_chassis", "front_right_chassis", "rear_chassis")):
        use = line.kind[:, y] == VALUE
        reading = line.reading[use, y]
        error = float(np.mean((reading - output[use, y]) ** 2))
        power = float(np.var(reading))
        shares[name] = math.sqrt(error / power) if power > 0.0 else math.inf
    return shares
