"""A damper whose force lags velocity, since it is in series with a stiffness (a Maxwell element).

ṁ = K (δ̇ − u) with F(u) = m: m is the damper's force, F its law and u the rate across the damper
without the series stiffness.  The stiffness K of the axle's dampers is due to gas, compressible oil
and rubber mounts.  The force of a linear damper lags by c/K.

Every damper has some of it.  Oil alone has a stiffness of β A²/V: with a bulk modulus β of 1.4 GPa,
a piston area A of 10 cm² and a volume V of 0.1 l that is 14 MN/m, and less with its joints.
"""

from __future__ import annotations

from collections.abc import Mapping

from bayes_asv.filters.force_laws import SERIES_STIFFNESS
from bayes_asv.models.effects.base import AXLES, BOTH, Effect, Parameter

__all__ = ["EFFECT"]


def _compliance_ratio(values: Mapping[str, float], tolerance: Mapping[str, float]) -> float:
    return tolerance["stiffness"] / values["stiffness"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return (values["stiffness"],)


EFFECT = Effect(
    name="damper_hysteresis",
    title="a damper force that lags velocity",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("stiffness", "N/m", "log", 12.0, 1.0, (5.0, 15.0, 50.0), "spring", memory=True),
    ),
    tolerance_values={"stiffness": 500.0},  # 9 MN/m on the Baja car
    tolerance_ratio=_compliance_ratio,
    one_sided=True,
    code=SERIES_STIFFNESS,
    packed=_packed,
    on_damper=True,
    drive="sharp bumps in quick succession, so that the damper turns round often",
)
