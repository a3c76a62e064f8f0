"""Registry of effects; each module has one effect, or several that are alike.

To add one: write a file with its :class:`Effect`, list it here, and give its force a branch in
:mod:`bayes_asv.filters.force_laws`; a test holds the branch against the readable form.
"""

from __future__ import annotations

from bayes_asv.models.effects import (
    bound_rebound,
    clocks,
    coulomb_friction,
    damper_curve,
    damper_fade,
    damper_hysteresis,
    digressive_damper,
    external_force,
    given_values,
    progressive_spring,
    sensors,
    spring_curve,
    stops,
)
from bayes_asv.models.effects.base import AXLES, BOTH, Effect, Parameter, PlacedEffect, Scale

__all__ = [
    "AXLES",
    "BOTH",
    "EFFECTS",
    "Effect",
    "Parameter",
    "PlacedEffect",
    "Scale",
    "placed_effect",
]

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        bound_rebound.EFFECT,
        digressive_damper.EFFECT,
        damper_curve.EFFECT,
        damper_hysteresis.EFFECT,
        coulomb_friction.EFFECT,
        progressive_spring.EFFECT,
        spring_curve.EFFECT,
        stops.BUMP,
        stops.DROOP,
        damper_fade.EFFECT,
        external_force.EFFECT,
        given_values.SPRING_RATE,
        given_values.WEIGHT_DISTRIBUTION,
        sensors.GAIN,
        sensors.LAG,
        clocks.EFFECT,
        sensors.BANDWIDTH,
        sensors.DRIFT,
    )
}


def placed_effect(text: str) -> PlacedEffect:
    """Read an effect and its place from ``name`` or ``name@where``.

    Raises
    ------
    KeyError
        When there is no such effect or place.
    """
    name, _, where = text.partition("@")
    effect = EFFECTS[name]
    if where not in effect.places:
        raise KeyError(where)
    return PlacedEffect(effect, where)
