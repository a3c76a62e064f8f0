"""A damper whose force flattens out.

F = −c δ̇ (1 + |δ̇/knee|ᵖ)^(−1/p): c is the slope at rest and c·knee the force far out.  p = 2 is the
form of reference; p has a prior around it, since the knee may be more or less sharp.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import DIGRESSIVE
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]

_KNEE_RATIO = 5.0  # ratio of knee to speed at which the law reduces the force by 2 %
_MIN_SPEED = 0.1  # least speed of the dampers in an informative drive, m/s


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return 1.0 / values["knee"], values["sharpness"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    p = values["sharpness"]
    factor = (1.0 + np.abs(rate / values["knee"]) ** p) ** (-1.0 / p)
    return np.asarray(-c * rate * (factor - 1.0))


def _scaled_to_speed(values: Mapping[str, float], travel: float, speed: float) -> dict[str, float]:
    """Values with 2 % less force at the largest speed."""
    return {**values, "knee": min(values["knee"], _KNEE_RATIO * max(speed, _MIN_SPEED))}


def _loss_ratio(values: Mapping[str, float], tolerance: Mapping[str, float]) -> float:
    """Ratio of the losses of force at the speed at which one tolerance loses 2 %."""
    speed = tolerance["knee"] / _KNEE_RATIO

    def loss(law: Mapping[str, float]) -> float:
        p = law["sharpness"]
        return float(-np.expm1(-np.log1p((speed / law["knee"]) ** p) / p))

    return loss(values) / loss(tolerance)


EFFECT = Effect(
    name="digressive_damper",
    title="a damper whose force flattens out at speed",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("knee", "m/s", "log", 0.5, 1.2, (0.1, 0.25, 0.6, 1.5, 4.0), form_spread=0.13),
        Parameter("sharpness", "", "log", 2.2, 0.25, (2.2,), shape=True),
    ),
    tolerance_values={"knee": 2.5, "sharpness": 2.0},  # 2 % less at 0.5 m/s
    scaled_to_range=_scaled_to_speed,
    tolerance_ratio=_loss_ratio,
    one_sided=True,
    code=DIGRESSIVE,
    packed=_packed,
    force=_force,
    on_damper=True,
    drive="a sharper bump, so that the damper moves faster",
)
