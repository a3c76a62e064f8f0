"""The climb to a mode, where ridges are bent."""

from __future__ import annotations

from bayes_asv.inference.adding import added
from bayes_asv.inference.bestfit import lay_out
from bayes_asv.inference.candidates import candidates
from bayes_asv.inference.stage import base, setting
from tests.battery.cases import case


def test_a_weight_that_is_wrong_is_reached_along_a_bent_ridge() -> None:
    """The linear car puts a weight share that is 13 % off into five deviations of a spring.

    The way back from there is bent; with damping alone 20 rounds covered a thirtieth of it.
    """
    one = case("weight_distribution-40", 31, 0)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    plain = base(where)
    group = [c for c in candidates(plain, one.vehicle) if str(c.site) == "weight_distribution"]
    stage = added(where, plain, group)
    assert stage.mode.converged
    assert stage.mode.log_posterior > plain.mode.log_posterior + 15.0
