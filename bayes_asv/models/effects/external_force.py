"""An external force on the chassis for part of one run.

It acts at one axle, or half of it at each.
"""

from __future__ import annotations

from collections.abc import Mapping

from bayes_asv.filters.force_laws import OUTSIDE
from bayes_asv.models.effects.base import AXLES, BOTH, Effect, Parameter

__all__ = ["EFFECT"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["force"], values["start"], values["duration"], values["rise"]


EFFECT = Effect(
    name="external_force",
    title="an external force",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        Parameter("force", "N", "linear", 0.0, 0.15, (0.05, -0.05), prior_unit="load"),
        Parameter("start", "s", "linear", 1.0, 1.0, ()),
        Parameter("duration", "s", "log", 0.4, 0.8, ()),
        Parameter("rise", "s", "log", 0.03, 0.6, (0.03,), shape=True),
    ),
    code=OUTSIDE,
    packed=_packed,
    split_between_axles=True,
    in_one_run=True,
    drive="the same drive again: an external force does not recur",
)
