"""Parameters of the car that the online filter estimates, their coordinates and their priors.

Each quantity that is not exact is one coordinate with a standard normal prior: c_f, c_r and i
first, then every given value with a standard deviation.  All are logarithms but the weight share.
The accelerations depend on ratios to the mass alone; the mass is a coordinate all the same, so that
its uncertainty is part of every answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.priors import DAMPING_FACTOR, INERTIA_FACTOR, prior_log_sd

__all__ = ["WALK_SHARE", "Coordinates", "coordinates"]

Array = NDArray[np.float64]

WALK_SHARE = 0.1
"""Relative change of a parameter during the time constant of its random walk, one standard
deviation."""


@dataclass(frozen=True)
class Coordinates:
    """Coordinates z of the filter, and the parameter vector of the model at z.

    Parameters
    ----------
    names : tuple of str
        ``c_f``, ``c_r``, ``i``, then names of given values and ``gain <channel>``.
    base : (12,) array
        Parameter vector where no coordinate changes it: eight parameters of the car in the order of
        ``CAR``, then the gains of the four sensors.
    element : (p,) int array
        Element of that vector which each coordinate determines.
    log : (p,) bool array
        Whether that element is exp(centre + scale z) or centre + scale z.
    centre, scale : (p,) arrays
        Prior mean and standard deviation of the element or of its logarithm.
    """

    names: tuple[str, ...]
    base: Array
    element: NDArray[np.int64]
    log: NDArray[np.bool_]
    centre: Array
    scale: Array

    def __len__(self) -> int:
        return len(self.names)

    def log_parameters(self, z: Array) -> Array:
        """Logarithms (…, 3) of c_f, c_r and i (SI units) at coordinates (…, 3 or more)."""
        return np.asarray(self.centre[:3] + self.scale[:3] * z[..., :3])

    def parameter_vectors(self, z: Array) -> Array:
        """Parameter vectors (W, 12) of the model at coordinates (W, p)."""
        out = np.tile(self.base, (len(z), 1))
        value = self.centre + self.scale * z
        out[:, self.element] = np.where(self.log, np.exp(np.where(self.log, value, 0.0)), value)
        return out

    def parameter_noise(self, seconds: float | None) -> Array:
        """Process noise of the coordinates' random walk, variance per second (p,).

        Parameters
        ----------
        seconds : float or None
            Time constant: in this time c_f, c_r and i change by :data:`WALK_SHARE`, one standard
            deviation; None for constant parameters.  Given values are always constant.
        """
        out = np.zeros(len(self))
        if seconds is not None:
            out[:3] = math.log1p(WALK_SHARE) ** 2 / seconds / self.scale[:3] ** 2
        return out


def coordinates(vehicle: Vehicle, scale_sd: Sequence[float] = (0.0,) * 4) -> Coordinates:
    """Set up the coordinates for a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
        Gives nominal values, known values and their standard deviations.
    scale_sd : (4,) sequence of float
        Relative standard deviation of each sensor's scale, zero where it is exact.

    Returns
    -------
    Coordinates
        With the priors of :mod:`bayes_asv.posterior.parameters`.
    """
    base = np.ones(12)
    base[: len(HalfCar._fields)] = [getattr(vehicle, name).value for name in HalfCar._fields]
    rows: list[tuple[str, int, bool, float, float]] = []
    for number, name in enumerate(HalfCar._fields):
        if name == "wdf":
            if vehicle.wdf.sd > 0.0:
                rows.append((name, number, False, vehicle.wdf.value, vehicle.wdf.sd))
            continue
        factor = INERTIA_FACTOR if name == "i" else DAMPING_FACTOR
        sd = prior_log_sd(getattr(vehicle, name), factor)
        if sd > 0.0:
            rows.append((name, number, True, math.log(base[number]), sd))
    for number, (channel, sd) in enumerate(
        zip(CHANNELS, scale_sd, strict=True), len(HalfCar._fields)
    ):
        if sd > 0.0:
            rows.append((f"gain {channel}", number, True, 0.0, sd))
    names, element, log, centre, scale = zip(*rows, strict=True)
    return Coordinates(
        names=tuple(names),
        base=base,
        element=np.array(element, np.int64),
        log=np.array(log, np.bool_),
        centre=np.array(centre, np.float64),
        scale=np.array(scale, np.float64),
    )
