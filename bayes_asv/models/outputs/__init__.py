"""What a sensor on the car measures, in terms of the car's motion, one file a quantity.

To add one, write a file with its :class:`OutputEquation` and list it here.
"""

from __future__ import annotations

from typing import Final

from bayes_asv.models.outputs import acceleration, angular_rate, deflection
from bayes_asv.models.outputs.base import Motion, OutputEquation

__all__ = ["OUTPUTS", "Motion", "OutputEquation", "relative_offset"]

OUTPUTS: Final[dict[str, OutputEquation]] = {
    equation.quantity: equation
    for equation in (acceleration.EQUATION, deflection.EQUATION, angular_rate.EQUATION)
}
"""Equations of the measured outputs by quantity."""


def relative_offset(quantity: str) -> float:
    """Offset of a sensor over that of an accelerometer, SI units: the scale of its drift."""
    return OUTPUTS[quantity].offset / OUTPUTS["acceleration"].offset
