"""A damper whose force rises less beyond a knee.

F = −c δ̇ (1 − s + s/√(1 + (δ̇/knee)²)) with s = drop/(1 + drop): c is the slope at rest, c (1 − s)
that far beyond the knee.  An arc tangent, a power of speed, an orifice with a blow-off valve and a
dynamometer's table of such a damper differ from it by 1 % of the power of what they change, and up
to 5 % if the knee is hardly reached; from a law without a slope that remains, by up to two thirds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import DIGRESSIVE
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]

_KNEE_RATIO = 5.0  # ratio of knee to speed at which the law reduces the force by 2 %
_MIN_SPEED = 0.1  # least speed of the dampers in an informative drive, m/s


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return 1.0 / values["knee"], _lost(values)


def _lost(values: Mapping[str, float]) -> float:
    """Share of the slope at rest that is lost far beyond the knee."""
    return values["drop"] / (1.0 + values["drop"])


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    flat = 1.0 / np.hypot(1.0, rate / values["knee"])
    return np.asarray(c * rate * _lost(values) * (1.0 - flat))


def _scaled_to_speed(values: Mapping[str, float], travel: float, speed: float) -> dict[str, float]:
    """Values with 2 % less force at the largest speed."""
    return {**values, "knee": min(values["knee"], _KNEE_RATIO * max(speed, _MIN_SPEED))}


def _loss_ratio(values: Mapping[str, float], tolerance: Mapping[str, float]) -> float:
    """Ratio of the losses of force at the speed at which one tolerance loses 2 %."""
    speed = tolerance["knee"] / _KNEE_RATIO

    def loss(law: Mapping[str, float]) -> float:
        return -_lost(law) * math.expm1(-0.5 * math.log1p((speed / law["knee"]) ** 2))

    return loss(values) / loss(tolerance)


EFFECT = Effect(
    name="digressive_damper",
    title="a damper whose force rises less at speed",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("knee", "m/s", "log", 0.5, 1.2, (0.1, 0.25, 0.6, 1.5, 4.0), form_spread=0.166),
        Parameter("drop", "", "log", 2.0, 1.3, (2.0,), shape=True),
    ),
    tolerance_values={"knee": 2.5, "drop": 50.0},  # 2 % less at 0.5 m/s
    scaled_to_range=_scaled_to_speed,
    tolerance_ratio=_loss_ratio,
    one_sided=True,
    code=DIGRESSIVE,
    packed=_packed,
    force=_force,
    on_damper=True,
    drive="a sharper bump, so that the damper moves faster",
)
