"""A damper that resists extension and compression differently.

F = −c δ̇ (1 + a δ̇/√(δ̇² + b²)) with a = (ratio − 1)/(ratio + 1): c is the mean of both rates,
ratio = rebound / bound, and b rounds the corner at rest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import BOUND_REBOUND
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]


def _share(values: Mapping[str, float]) -> float:
    return (values["ratio"] - 1.0) / (values["ratio"] + 1.0)


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return _share(values), values["rounding"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    return -c * rate * _share(values) * rate / np.hypot(rate, values["rounding"])


EFFECT = Effect(
    name="bound_rebound",
    title="unequal compression and rebound damping",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("ratio", "", "log", 1.0, 0.7, (1.5, 3.0, 0.6), form_spread=0.045),
        Parameter("rounding", "m/s", "log", 0.015, 0.7, (0.015,), shape=True),
    ),
    tolerance_values={"ratio": 1.03, "rounding": 0.015},
    code=BOUND_REBOUND,
    packed=_packed,
    force=_force,
    on_damper=True,
    drive="a bump taken fast, so that the damper moves both ways",
)
