"""Dry friction: F = −force δ̇/√(δ̇² + s²), where s is the speed at which it begins to slip."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import COULOMB
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["force"], values["slip"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    return -values["force"] * rate / np.hypot(rate, values["slip"])


EFFECT = Effect(
    name="coulomb_friction",
    title="dry friction",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("force", "N", "positive", 0.0, 0.06, (0.005, 0.03), "load", form_spread=0.056),
        Parameter("slip", "m/s", "log", 0.01, 0.45, (0.01,), shape=True),
    ),
    tolerance_values={"force": 0.0015, "slip": 0.01},
    one_sided=True,
    code=COULOMB,
    packed=_packed,
    force=_force,
    dissipative=True,
    drive="a long, gentle ride, so that friction is large against the damper's force",
)
