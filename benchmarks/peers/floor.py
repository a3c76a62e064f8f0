"""The floor: the same likelihood in C, compiled for this machine."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bayes_asv.filters.kalman import Measurements, SensorNoise, StateSpace

__all__ = ["Floor"]

Array = NDArray[np.float64]

_SOURCE = Path(__file__).parent / "floor.c"


class Floor:
    """Likelihoods of ``lanes`` parameter sets of the half car at a time.

    Parameters
    ----------
    lanes : int
        One for the plain recursion, or as many as stand side by side in a vector.
    folder : Path
        For the compiled library.
    """

    def __init__(self, lanes: int, folder: Path) -> None:
        library = folder / f"floor{lanes}.so"
        command = ["gcc", "-O3", "-march=native", "-ffp-contract=fast", "-shared", "-fPIC"]
        command += [f"-DLANES={lanes}", str(_SOURCE), "-o", str(library), "-lm"]
        subprocess.run(command, check=True)
        self.lanes = lanes
        self._run = ctypes.CDLL(str(library)).run

    def prepared(self, system: StateSpace, noise: SensorNoise, data: Measurements) -> list[Any]:
        """Discretise W sets, as many as there are lanes, for :meth:`log_likelihood`."""
        h = float(data.step[1])
        carry, Q = np.empty((self.lanes, 4, 6)), np.zeros((self.lanes, 2, 4, 4))
        drive = np.empty((self.lanes, 2, 8, 4))
        for w, (A, B) in enumerate(zip(system.A, system.B, strict=True)):
            whole = expm(h * np.block([[A, B], [np.zeros((2, 6))]]))
            carry[w] = np.hstack([whole[:4, :4], -whole[:4, 4:]])
            for g in (-1.0, 1.0):  # two-point Gauss quadrature
                impulse = expm(0.5 * h * (1.0 + g / np.sqrt(3.0)) * A) @ B
                Q[w] += 0.5 * h * np.einsum("au,bu->uab", impulse, impulse)
            power = B
            for j in range(8):
                drive[w, :, j], power = power.T, A @ power
        keep = np.exp(-noise.poles * h)
        sets = (carry, Q, drive, system.C, noise.white, noise.filtered, keep)
        return [_aligned(np.moveaxis(x, 0, -1)) for x in sets]

    def log_likelihood(self, sets: list[Any], data: Measurements) -> Array:
        """Return the log likelihoods of the sets."""
        total = np.empty(self.lanes)
        plain = [np.ascontiguousarray(x) for x in data[:3]]
        arrays = [*plain, np.ascontiguousarray(data.reading), *sets, data.initial_covariance, total]
        self._run(ctypes.c_int(len(data.step)), *(ctypes.c_void_p(x.ctypes.data) for x in arrays))
        return total


def _aligned(values: Array) -> Array:
    """Copy to memory that begins at 64 bytes, as vectors have to."""
    room = np.empty(values.size + 8)
    first = (-room.ctypes.data // 8) % 8
    out = room[first : first + values.size].reshape(values.shape)
    out[...] = values
    return out
