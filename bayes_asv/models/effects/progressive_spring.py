"""A spring that stiffens: F = −k δ (1 + κ δ² + q κ² δ⁴) with the size κ and a shape parameter q."""

from __future__ import annotations

from collections.abc import Mapping

from bayes_asv.filters.force_laws import PROGRESSIVE
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]

_MIN_TRAVEL = 0.005  # least travel of the springs in an informative drive, m


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return values["kappa"], values["curl"]


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    x = values["kappa"] * delta**2
    return -k * delta * (x + values["curl"] * x**2)


def _scaled_to_travel(values: Mapping[str, float], travel: float, speed: float) -> dict[str, float]:
    """Values with 1.5 % more force at the largest travel."""
    return {**values, "kappa": max(values["kappa"], 0.015 / max(travel, _MIN_TRAVEL) ** 2)}


EFFECT = Effect(
    name="progressive_spring",
    title="a spring that stiffens with travel",
    acts="suspension",
    allowed_places=(*AXLES, BOTH),
    parameters=(
        # κ δ² = 0.4 at 5 cm of travel; heavy-tailed, since it may be as large at 1 cm on a car with
        # little travel
        Parameter("kappa", "1/m^2", "sinh", 0.0, 150.0, (20.0, 150.0), form_spread=0.065),
        Parameter("curl", "", "linear", 0.15, 0.15, (0.15,), shape=True),
    ),
    tolerance_values={"kappa": 6.0, "curl": 0.15},  # 1.5 % at 5 cm
    scaled_to_range=_scaled_to_travel,
    code=PROGRESSIVE,
    packed=_packed,
    force=_force,
    on_spring=True,
    drive="a higher bump, so that more of the travel is used",
    travel=True,
)
