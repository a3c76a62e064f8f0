"""Whether a vehicle's numbers go together: a wrong unit of one shows in what they give."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.errors import InputError

if TYPE_CHECKING:
    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["make_sense"]

_BOUNCE: Final = (0.3, 15.0)
"""Hz: scale models and racing cars with aero springs among them."""
_PITCH: Final = (0.01, 100.0)
"""Of the dynamic index i / (m l_f l_r); cars have about one, the strangest rig 0.06."""


def make_sense(vehicle: Vehicle) -> None:
    """Refuse a vehicle whose numbers no car has together.

    Parameters
    ----------
    vehicle : Vehicle
        As read.

    Raises
    ------
    InputError
        When it would bounce, or pitch against its bouncing, as no car does.
    """
    m, l, wdf = vehicle.m.value, vehicle.l.value, vehicle.wdf.value
    bounce = math.sqrt((vehicle.k_f.value + vehicle.k_r.value) / m) / (2.0 * math.pi)
    if not _BOUNCE[0] < bounce < _BOUNCE[1]:
        raise InputError(
            f"{vehicle.source}: [known]",
            f"{m:.4g} kg on these springs bounce at {bounce:.2g} Hz, as no car does",
            "check the units of sprung_mass and of the spring rates",
        )
    index = vehicle.i.value / (m * l**2 * wdf * (1.0 - wdf))
    if not _PITCH[0] < index < _PITCH[1]:
        raise InputError(
            vehicle.source,
            f"its pitch inertia is {index:.2g} times that of its mass put on its axles, as no "
            "car's is",
            "check the units of wheelbase, sprung_mass and pitch_inertia",
        )
