"""Given values that are wrong: a factor on an axle's spring rate or on the front weight share."""

from __future__ import annotations

from bayes_asv.models.effects.base import AXLES, Effect, Parameter

__all__ = ["SPRING_RATE", "WEIGHT_DISTRIBUTION"]

SPRING_RATE = Effect(
    name="spring_rate",
    title="a spring rate that is not the given one",
    acts="car",
    sites=AXLES,
    parameters=(Parameter("factor", "", "log", 1.0, 0.3, (1.0,)),),
    slight={"factor": 1.003},
    drive="a long ride at the frequency of the body's own motion",
)
WEIGHT_DISTRIBUTION = Effect(
    name="weight_distribution",
    title="a weight distribution that is not the given one",
    acts="car",
    sites=("",),
    parameters=(Parameter("factor", "", "log", 1.0, 0.1, (1.0,)),),
    slight={"factor": 1.002},
    drive="front and rear over bumps one at a time",
)
