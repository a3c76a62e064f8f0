"""The equation of a measured output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Channel
    from bayes_asv.models.car_model import CarModel, Values

__all__ = ["Motion", "OutputEquation"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Motion of a car for W sets of values, as a linear function of its states and forces.

    Parameters
    ----------
    car : CarModel
        The car, with ne suspension elements and n coordinates of the body.
    values : dict of str to (W,) array
        Its parameters.
    by_states : (W, n, nx) array
        Accelerations of the coordinates per state.
    by_forces : (W, n, ne) array
        Accelerations of the coordinates per force of an element, 1/kg or rad/(s² N).
    """

    car: CarModel
    values: Values
    by_states: Array
    by_forces: Array

    def element_states(self, channel: Channel) -> tuple[int, int]:
        """Return the numbers of deflection and deflection rate of the element at a channel."""
        e = self.car.element_of(channel)
        return 2 * e, 2 * e + 1


@dataclass(frozen=True)
class OutputEquation:
    """How one quantity is read: y = C x + G f.

    Parameters
    ----------
    quantity : str
        As in :class:`bayes_asv.domain.channels.Channel`.
    offset : float
        Standard deviation of a sensor's constant offset, SI units.
    rows : callable
        From the motion, the channel, the number of the channel's own state (the rate about its
        axis, -1 for a channel without one) and the lead 1/λ (s) of a reading that did not pass
        the common filter (zero for one that did) to the rows (W, nx) of C and (W, ne) of G.
        Such a reading is y + ẏ/λ of the filtered motion.
    """

    quantity: str
    offset: float
    rows: Callable[[Motion, Channel, int, float], tuple[Array, Array]]
