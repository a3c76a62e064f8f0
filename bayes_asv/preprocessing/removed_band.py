"""Correction of the likelihood for bands that a filter removed from all channels.

A Kalman filter assumes noise over the whole band: the quadratic form of the likelihood lacks the
removed band, but its determinant includes it.  Without a correction, the noise levels would be
underestimated, and their spectrum distorted.  The correction is Whittle's form of the determinant,
½ Σ log det S(f).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import SensorNoise, StateSpace

__all__ = ["RemovedBand", "frequency_response", "log_determinant", "removed_band"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class RemovedBand(NamedTuple):
    """A band that a filter removed.

    Parameters
    ----------
    frequency : (K,) array
        Frequencies in the removed band, Hz.
    readings : (K,) array
        Number of removed groups of readings that each frequency represents.
    transfer : (K, ny, nu) complex array
        Frequency response from inputs to outputs of the nominal car.
    step : float
        Time between readings, s.
    retained_power : float
        Share of the power of white noise that remains.
    """

    frequency: Array
    readings: Array
    transfer: Complex
    step: float
    retained_power: float


def frequency_response(system: StateSpace, frequency: Array) -> Complex:
    """Return outputs over inputs (F, ny, nu) of parameter set 0 at frequencies (F,), Hz."""
    A, B, C = system.A[0], system.B[0], system.C[0]
    s = 2j * np.pi * frequency
    resolvent = s[:, None, None] * np.eye(len(A)) - A
    return np.asarray(C @ np.linalg.solve(resolvent, np.broadcast_to(B, (len(s), *B.shape))))


def removed_band(power: Array, groups: int, step: float, system: StateSpace) -> RemovedBand:
    """Describe the band that a filter removed.

    Parameters
    ----------
    power : (256,) array
        Squared gain of the filter in the middle of equal bands from zero to half the sampling rate.
    groups : int
        Number of groups of readings.
    step : float
        Time between them, s.
    system : StateSpace
        Nominal system, for the response to noise of the inputs, which is small above the car's own
        modes.
    """
    bins = len(power)
    frequency = (np.arange(bins) + 0.5) / (2.0 * bins * step)
    removed = 1.0 - np.minimum(power, 1.0)
    affected = removed > 1e-3
    return RemovedBand(
        np.asarray(frequency[affected]),
        np.asarray(groups * removed[affected] / bins),
        frequency_response(system, np.asarray(frequency[affected], np.float64)),
        step,
        float(1.0 - removed.mean()),
    )


def log_determinant(band: RemovedBand, noise: SensorNoise) -> Array:
    """½ Σ log det S(f) of the missing band (W,), to be added to the log-likelihood.

    Parameters
    ----------
    band : RemovedBand
        The removed band.
    noise : SensorNoise
        Sensor noise of W parameter sets.
    """
    ny, nu = band.transfer.shape[1:]
    omega = 2.0 * np.pi * band.frequency
    poles = noise.poles[:, :, None]
    # the noise of inputs drives the car in continuous time, that of outputs is sampled
    inputs = noise.white[:, :nu, None] + noise.filtered[:, :nu, None] * (
        2.0 * poles[:, :nu] / np.maximum(poles[:, :nu] ** 2 + omega**2, 1e-300) / band.step
    )
    correlation = np.exp(-poles[:, nu:] * band.step)
    outputs = noise.white[:, nu:, None] + noise.filtered[:, nu:, None] * (1.0 - correlation**2) / (
        np.maximum(1.0 + correlation**2 - 2.0 * correlation * np.cos(omega * band.step), 1e-300)
    )
    density = np.einsum("kyu,wuk,kzu->wkyz", band.transfer, inputs, band.transfer.conj())
    diagonal = np.arange(ny)
    density[:, :, diagonal, diagonal] += np.moveaxis(outputs, 1, 2)
    _, log_det = np.linalg.slogdet(density)
    # lower bound, against rounding errors: the noise of the outputs alone
    least = np.sum(np.log(np.maximum(outputs, 1e-300)), axis=1)
    return np.asarray(0.5 * np.maximum(log_det.real, least) @ band.readings)
