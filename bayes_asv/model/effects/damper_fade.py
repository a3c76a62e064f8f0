"""A damper that fades: c at the start of a run, ``loss`` the share gone at its end."""

from __future__ import annotations

from collections.abc import Mapping

from bayes_asv.kernels.forces import FADE
from bayes_asv.model.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return (values["loss"],)


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    return c * rate * values["loss"] * share


EFFECT = Effect(
    name="damper_fade",
    title="a damper that fades during the run",
    acts="suspension",
    sites=(*AXLES, BOTH),
    parameters=(Parameter("loss", "", "linear", 0.0, 0.3, (0.1, 0.4)),),
    slight={"loss": 0.015},
    code=FADE,
    packed=_packed,
    force=_force,
    drive="a long run with bumps from its beginning to its end",
)
