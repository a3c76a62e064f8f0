"""What a filter common to all channels took out bears no witness to the noise.

The recursion sees the filtered readings through the noise of the whole band: in the quadratic
form the missing band is missing, but the determinant still charges for it.  Left alone, the
noise levels would come out too low, and their spectrum bent away from the band that was cut.
Whittle's form of the determinant, ½ Σ log det S(f), says what to give back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.half_car import HalfCar, deflection_form

__all__ = ["MissingBand", "cut_by", "given_back"]

Array = NDArray[np.float64]


class MissingBand(NamedTuple):
    """A missing band.

    Parameters
    ----------
    frequency : (K,) array
        Hz, where something is missing.
    readings : (K,) array
        How many pairs of readings each frequency stood for that are gone.
    transfer : (K, 2, 2) complex array
        From wheel accelerations to chassis accelerations, at the nominal car.
    step : float
        Time between readings, s.
    left : float
        Share of the power of white noise that is left.
    """

    frequency: Array
    readings: Array
    transfer: NDArray[np.complex128]
    step: float
    left: float


def cut_by(power: Array, pairs: int, step: float, car: HalfCar) -> MissingBand:
    """Describe what a filter took out.

    Parameters
    ----------
    power : (256,) array
        Squared gain of the filter at as many frequencies in the middle of equal bands from zero
        to half the sampling rate.
    pairs : int
        Number of pairs of readings.
    step : float
        Time between them, s.
    car : HalfCar
        For the transfer of the wheels' noise; above the car's own modes little of it arrives,
        so the nominal one will do.

    Returns
    -------
    MissingBand
    """
    lines = len(power)
    frequency = (np.arange(lines) + 0.5) / (2.0 * lines * step)
    gone = 1.0 - np.minimum(power, 1.0)
    some = gone > 1e-3
    system = deflection_form(car)
    s = 2j * np.pi * frequency[some]
    resolvent = s[:, None, None] * np.eye(4) - system.A
    transfer = system.C @ np.linalg.solve(resolvent, np.broadcast_to(system.B, (len(s), 4, 2)))
    return MissingBand(
        np.asarray(frequency[some]),
        np.asarray(pairs * gone[some] / lines),
        np.asarray(transfer),
        step,
        float(1.0 - gone.mean()),
    )


def given_back(cut: MissingBand, noises: Array) -> Array:
    """½ Σ log det S(f) of the missing band, to be added to the log-likelihood.

    Parameters
    ----------
    cut : MissingBand
        The missing band.
    noises : (W, 12) array
        Noise arguments of the kernel.

    Returns
    -------
    (W,) array
    """
    omega = 2.0 * np.pi * cut.frequency
    poles = noises[:, 8:, None]
    # The wheels' noise drives the car in continuous time, the chassis' is sampled.
    wheels = noises[:, 0:2, None] + noises[:, 4:6, None] * (
        2.0 * poles[:, 0:2] / np.maximum(poles[:, 0:2] ** 2 + omega**2, 1e-300) / cut.step
    )
    keep = np.exp(-poles[:, 2:4] * cut.step)
    chassis = noises[:, 2:4, None] + noises[:, 6:8, None] * (1.0 - keep**2) / np.maximum(
        1.0 + keep**2 - 2.0 * keep * np.cos(omega * cut.step), 1e-300
    )
    direct = np.abs(cut.transfer) ** 2
    front = chassis[:, 0] + direct[:, 0, 0] * wheels[:, 0] + direct[:, 0, 1] * wheels[:, 1]
    rear = chassis[:, 1] + direct[:, 1, 0] * wheels[:, 0] + direct[:, 1, 1] * wheels[:, 1]
    cross = (
        cut.transfer[:, 0, 0] * cut.transfer[:, 1, 0].conj() * wheels[:, 0]
        + cut.transfer[:, 0, 1] * cut.transfer[:, 1, 1].conj() * wheels[:, 1]
    )
    # The chassis' own noise alone is never more than the whole, whatever rounding says.
    det = np.maximum(front * rear - np.abs(cross) ** 2, chassis[:, 0] * chassis[:, 1])
    log_det = np.log(np.maximum(det, 1e-300))
    return np.asarray(0.5 * log_det @ cut.readings)
