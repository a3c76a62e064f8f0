"""A spring that stiffens: F = −k δ (1 + κ δ² + q κ² δ⁴); κ is asked for, q only shapes the rest."""

from __future__ import annotations

from collections.abc import Mapping

from bayes_asv.filters.force_laws import PROGRESSIVE
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]

_LEAST = 0.005  # m, of a drive whose springs have been seen at all


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["kappa"], values["curl"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    x = values["kappa"] * delta**2
    return -k * delta * (x + values["curl"] * x**2)


def _straight(values: Mapping[str, float], travel: float, speed: float) -> dict[str, float]:
    """1.5 % more at the largest travel."""
    return {**values, "kappa": max(values["kappa"], 0.015 / max(travel, _LEAST) ** 2)}


EFFECT = Effect(
    name="progressive_spring",
    title="a spring that stiffens with travel",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        # 0.4 at 5 cm of travel, but as much within 1 cm on a car that has no more
        Parameter("kappa", "1/m^2", "sinh", 0.0, 150.0, (20.0, 150.0)),
        Parameter("curl", "", "linear", 0.15, 0.15, (0.15,), shape=True),
    ),
    tolerance_values={"kappa": 6.0, "curl": 0.15},  # 1.5 % at 5 cm
    scaled_to_range=_straight,
    code=PROGRESSIVE,
    packed=_packed,
    force=_force,
    on_spring=True,
    drive="a higher bump, so that more of the travel is used",
    travel=True,
)
