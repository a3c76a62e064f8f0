"""A damper whose force flattens out.

F = −c δ̇ (1 + |δ̇/knee|ᵖ)^(−1/p): c is the slope at rest and c·knee the force far out.  p = 2 is the
form of reference; p is free about it, since dampers bend more or less sharply.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import DIGRESSIVE
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]

_STRAIGHT = 5.0  # times a speed, of a knee that takes 2 % there
_SLOWEST = 0.1  # m/s, of a drive whose dampers have been seen at all


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return 1.0 / values["knee"], values["sharpness"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    p = values["sharpness"]
    factor = (1.0 + np.abs(rate / values["knee"]) ** p) ** (-1.0 / p)
    return np.asarray(-c * rate * (factor - 1.0))


def _straight(values: Mapping[str, float], travel: float, speed: float) -> dict[str, float]:
    """2 % less at the largest speed."""
    return {**values, "knee": min(values["knee"], _STRAIGHT * max(speed, _SLOWEST))}


def _times(values: Mapping[str, float], little: Mapping[str, float]) -> float:
    """By what is lost at that speed, however sharply the curve bends."""
    speed = little["knee"] / _STRAIGHT

    def lost(law: Mapping[str, float]) -> float:
        p = law["sharpness"]
        return float(-np.expm1(-np.log1p((speed / law["knee"]) ** p) / p))

    return lost(values) / lost(little)


EFFECT = Effect(
    name="digressive_damper",
    title="a damper whose force flattens out at speed",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("knee", "m/s", "log", 0.5, 1.2, (0.1, 0.25, 0.6, 1.5, 4.0)),
        Parameter("sharpness", "", "log", 2.2, 0.25, (2.2,), shape=True),
    ),
    tolerance_values={"knee": 2.5, "sharpness": 2.0},  # 2 % less at 0.5 m/s
    scaled_to_range=_straight,
    tolerance_ratio=_times,
    one_sided=True,
    code=DIGRESSIVE,
    packed=_packed,
    force=_force,
    on_damper=True,
    drive="a sharper bump, so that the damper moves faster",
)
