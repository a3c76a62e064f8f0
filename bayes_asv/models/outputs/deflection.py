"""Suspension deflection, extension positive."""

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
    by_states = np.zeros((len(motion.by_states), motion.by_states.shape[2]))
    deflection, rate = motion.element_states(channel)
    by_states[:, deflection], by_states[:, rate] = 1.0, lead
    return by_states, np.zeros((len(by_states), motion.by_forces.shape[2]))


# A potentiometer's zero is as uncertain as the deflection itself: 0.1 m.
EQUATION = OutputEquation("deflection", 0.1, _rows)
