"""Pitch or roll rate of the body; the rate is a state of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.outputs.base import Motion, OutputEquation

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Channel

__all__ = ["EQUATION"]

Array = NDArray[np.float64]


def _rows(motion: Motion, channel: Channel, own: int, lead: float) -> tuple[Array, Array]:
    axis = motion.car.coordinates.index(str(channel.axis))
    by_states = lead * motion.by_states[:, axis]
    by_states[:, own] += 1.0
    return by_states, lead * motion.by_forces[:, axis]


# A gyroscope at standstill reads less than 0.1 rad/s (5.7 °/s), the offset of a cheap one.
EQUATION = OutputEquation("angular_rate", 0.1, _rows)
