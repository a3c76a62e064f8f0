"""What a sensor on the car measures, in terms of the car's motion, one file a quantity.

To add one, write a file with its :class:`OutputEquation` and list it here.
"""

from __future__ import annotations

from typing import Final

from bayes_asv.models.outputs import acceleration, angular_rate, deflection
from bayes_asv.models.outputs.base import Motion, OutputEquation

__all__ = ["OUTPUTS", "Motion", "OutputEquation"]

OUTPUTS: Final[dict[str, OutputEquation]] = {
    equation.quantity: equation
    for equation in (acceleration.EQUATION, deflection.EQUATION, angular_rate.EQUATION)
}
"""Equations of the measured outputs by quantity."""
