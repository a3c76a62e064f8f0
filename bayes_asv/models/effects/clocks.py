"""A clock offset: a group of channels sampled later than the others by the same time.

``offset`` is positive if the group is late.  :func:`bayes_asv.estimation.estimate` replaces the
effect by a clock of :mod:`bayes_asv.domain.clocks`, which has an offset in each run and a drift.
"""

from __future__ import annotations

from bayes_asv.domain.clocks import GROUPS, OFFSET_SD
from bayes_asv.models.effects.base import Effect, Parameter

__all__ = ["EFFECT"]

EFFECT = Effect(
    name="clock_offset",
    title="an offset between clocks",
    acts="reading",
    allowed_places=tuple(GROUPS),
    parameters=(
        Parameter(
            "offset", "s", "linear", 0.0, OFFSET_SD, (0.0, -0.4 * OFFSET_SD, 0.4 * OFFSET_SD)
        ),
    ),
    tolerance_values={"offset": 1.5e-5},
    fault="lag",
    drive="knock on one plate that carries all sensors, before and after the drive",
)
