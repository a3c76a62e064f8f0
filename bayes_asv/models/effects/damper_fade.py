"""A damper that fades: rate c at the start of a run, (1 − ``loss``) c at its end.

After the share s of the run, (1 − e^{−b s}) / (1 − e^{−b}) of the loss has occurred: linear in time
for b = 0, levelling off for b > 0, as with oil that reaches its operating temperature.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import FADE
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["loss"], values["bend"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    b = values["bend"]
    come = share if abs(b) < 1e-6 else np.expm1(-b * share) / np.expm1(-b)
    return np.asarray(c * rate * values["loss"] * come)


EFFECT = Effect(
    name="damper_fade",
    title="a damper that fades during the run",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("loss", "", "linear", 0.0, 0.3, (0.1, 0.4), form_spread=0.04),
        Parameter("bend", "", "linear", 0.0, 1.5, (0.0,), shape=True),
    ),
    tolerance_values={"loss": 0.015, "bend": 0.0},
    code=FADE,
    packed=_packed,
    force=_force,
    drive="a long run with bumps from its beginning to its end",
)
