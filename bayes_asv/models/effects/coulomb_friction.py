"""Dry friction, which gives before it slips: a force m on the body against δ̇, with memory.

ṁ = (force δ̇ − w m)/presliding with w = √(δ̇² + slip²).  In steady motion m is force δ̇/w.  Where δ̇
is far above ``slip`` this is the law of Dahl (1968, Aerospace TOR-0158(3107-18)-1): at first an
elastic force of stiffness force/presliding, as bushings, seals and leaf springs have it, and
sliding friction after a few times that displacement.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import COULOMB
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["force"], values["slip"], values["presliding"]


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
        Parameter("presliding", "m", "log", 1e-4, 2.0, (1e-4,), shape=True, memory=True),
    ),
    tolerance_values={"force": 0.0015, "slip": 0.01, "presliding": 1e-4},
    one_sided=True,
    code=COULOMB,
    packed=_packed,
    force=_force,
    dissipative=True,
    drive="a long, gentle ride, so that friction is large against the damper's force",
)
