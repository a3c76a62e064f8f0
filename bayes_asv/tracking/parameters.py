"""What the filter learns of the car, in which coordinates, and what it believes beforehand.

Each quantity that is not exact is one coordinate, standard normal beforehand: c_f, c_r and i
first, then whatever was given with a deviation, in logarithms but for the weight share.  Only
ratios to the mass show in the accelerations; the mass is a coordinate all the same, so that its
uncertainty is in every answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.parameters import CAR
from bayes_asv.models.priors import DAMPING_FACTOR, INERTIA_FACTOR, prior_log_sd

__all__ = ["Coordinates", "coordinates"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinates:
    """Coordinates of the filter and the way to cars.

    Parameters
    ----------
    names : tuple of str
        ``c_f``, ``c_r``, ``i``, then names of given values and ``gain <channel>``.
    base : (12,) array
        Car and sensors' gains where no coordinate says otherwise, in the kernels' order.
    which : (p,) int array
        Number of the car that a coordinate stands for.
    log : (p,) bool array
        Whether that number is exp(centre + scale z) or centre + scale z.
    centre, scale : (p,) arrays
        Mean and deviation of the number or of its logarithm beforehand.
    """

    names: tuple[str, ...]
    base: Array
    which: NDArray[np.int64]
    log: NDArray[np.bool_]
    centre: Array
    scale: Array

    def __len__(self) -> int:
        return len(self.names)

    def logs(self, z: Array) -> Array:
        """Logarithms (…, 3) of c_f, c_r and i (SI units) at coordinates (…, 3 or more)."""
        return np.asarray(self.centre[:3] + self.scale[:3] * z[..., :3])

    def cars(self, z: Array) -> Array:
        """Cars (W, 12) as the kernels take them, at coordinates (W, p)."""
        out = np.tile(self.base, (len(z), 1))
        value = self.centre + self.scale * z
        out[:, self.which] = np.where(self.log, np.exp(np.where(self.log, value, 0.0)), value)
        return out

    def walk(self, seconds: float | None) -> Array:
        """Variance (p,) that each coordinate gains in a second.

        Parameters
        ----------
        seconds : float or None
            Time in which c_f, c_r and i may each wander by :data:`WANDERED` at one deviation;
            None for constants.  Given values never wander.
        """
        out = np.zeros(len(self))
        if seconds is not None:
            out[:3] = math.log1p(WANDERED) ** 2 / seconds / self.scale[:3] ** 2
        return out


WANDERED = 0.1
"""Share by which a parameter that may wander does so in the time that is given, one deviation."""


def coordinates(vehicle: Vehicle, scale_sd: Sequence[float] = (0.0,) * 4) -> Coordinates:
    """Set up the coordinates for a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
        Gives nominal values, known values and their deviations.
    scale_sd : (4,) sequence of float
        Relative deviation of each sensor's scale, zero where it is exact.

    Returns
    -------
    Coordinates
        With the priors of :mod:`bayes_asv.posterior.parameters`.
    """
    base = np.ones(12)
    base[: len(CAR)] = [getattr(vehicle, name).value for name in CAR]
    rows: list[tuple[str, int, bool, float, float]] = []
    for number, name in enumerate(CAR):
        if name == "wdf":
            if vehicle.wdf.sd > 0.0:
                rows.append((name, number, False, vehicle.wdf.value, vehicle.wdf.sd))
            continue
        factor = INERTIA_FACTOR if name == "i" else DAMPING_FACTOR
        sd = prior_log_sd(getattr(vehicle, name), factor)
        if sd > 0.0:
            rows.append((name, number, True, math.log(base[number]), sd))
    for number, (channel, sd) in enumerate(zip(CHANNELS, scale_sd, strict=True), len(CAR)):
        if sd > 0.0:
            rows.append((f"gain {channel}", number, True, 0.0, sd))
    names, which, log, centre, scale = zip(*rows, strict=True)
    return Coordinates(
        names=tuple(names),
        base=base,
        which=np.array(which, np.int64),
        log=np.array(log, np.bool_),
        centre=np.array(centre, np.float64),
        scale=np.array(scale, np.float64),
    )
