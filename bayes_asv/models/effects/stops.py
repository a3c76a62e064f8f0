"""Travel stops: beyond a gap from rest a second spring acts, its onset rounded over a width.

F = −rate · w (d/w)ᵖ against the motion, minus the same at rest, with d = ½ (e + √(e² + w²)) and e
the travel beyond the gap.  Steel has p = 1, compressed rubber p > 1; at light contact, the power
determines the onset.  A bump stop acts in compression, a droop stop in extension.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from bayes_asv.filters.force_laws import BUMP_STOP, DROOP_STOP
from bayes_asv.models.effects.base import AXLES, Array, Effect, Parameter

__all__ = ["BUMP", "DROOP"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["gap"], values["rate"], values["onset"], values["power"]


def _force(sign: float) -> Callable[..., Array]:
    def force(
        values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
    ) -> Array:
        gap, width = values["gap"], values["onset"]
        deep, at_rest = (
            width * (0.5 * (beyond + np.hypot(beyond, width)) / width) ** values["power"]
            for beyond in (sign * delta - gap, np.asarray(-gap))
        )
        return np.asarray(-sign * values["rate"] * (deep - at_rest))

    return force


def _stop(name: str, title: str, code: int, sign: float, drive: str) -> Effect:
    return Effect(
        name=name,
        title=title,
        acts="suspension",
        allowed_places=AXLES,
        parameters=(
            Parameter("rate", "N/m", "log", 4.0, 1.2, (2.0, 10.0), "spring", form_spread=0.3),
            Parameter("gap", "m", "log", 0.04, 0.8, (), form_spread=0.04),
            Parameter("onset", "m", "log", 0.002, 0.9, (0.002,), shape=True),
            Parameter("power", "", "log", 1.0, 0.25, (1.0,), shape=True),
        ),
        code=code,
        packed=_packed,
        force=_force(sign),
        drive=drive,
        travel=True,
        stops="compression" if sign < 0.0 else "extension",
    )


BUMP = _stop(
    "bump_stop",
    "bump-stop contact",
    BUMP_STOP,
    -1.0,
    "a higher bump, so that the stop is met more than once",
)
DROOP = _stop(
    "droop_stop",
    "droop-stop contact",
    DROOP_STOP,
    1.0,
    "a drop off a kerb, so that the wheel hangs down",
)
