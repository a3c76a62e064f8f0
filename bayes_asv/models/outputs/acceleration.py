"""Vertical acceleration of a point of the body."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.outputs.base import Motion, OutputEquation

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Channel

__all__ = ["EQUATION"]

Array = NDArray[np.float64]

# One accelerometer 0.7 m/s², so that one against another is off by 1 m/s²: a tenth of gravity,
# from tilt and offset.
_OFFSET = math.sqrt(0.5)


def _rows(motion: Motion, channel: Channel, own: int, lead: float) -> tuple[Array, Array]:
    # Without a bandwidth of its own an accelerometer is taken to be like the others: no lead.
    heights = motion.car.point(motion.values, channel)[:, None, :]
    return (heights @ motion.by_states)[:, 0], (heights @ motion.by_forces)[:, 0]


EQUATION = OutputEquation("acceleration", _OFFSET, _rows)
