"""What a notch takes out bears no witness, and every way to weigh a model says so."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from bayes_asv.diagnosis.engine_force import without_engine
from bayes_asv.diagnosis.tolerance_prior import granted
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import FittedModel, base, setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case


@cache
def _cut() -> FittedModel:
    one = case("engine_vibration-400", 5, 0)
    lines, _, _ = lay_out(one.recordings, one.vehicle)
    where = setting(one.vehicle, lines)
    _, stage, engine, _ = without_engine(where, base(where), (), base, base)
    assert engine is not None
    return stage


def test_a_little_of_nothing_leaves_the_posterior_where_it_was() -> None:
    stage = _cut()
    z = stage.mode.z[None]
    nothing = granted(stage, np.zeros((1, len(stage.mode.slopes.nu))), np.zeros(1))
    np.testing.assert_allclose(nothing.log_posterior(z), stage.target.log_posterior(z), atol=1e-6)
    # and the term is large enough to decide
    assert sum(abs(stage.target.given_back(z, run)[0]) for run in range(2)) > 20.0


def test_the_slope_of_noise_levels_knows_what_was_cut() -> None:
    """Against central differences of the log-posterior, a hundredth of a deviation wide."""
    stage = _cut()
    z = stage.mode.z + 0.2
    here = slopes(stage.target, z)
    levels = [k for k, name in enumerate(stage.space.names) if name.startswith("noise ")]
    assert levels
    plain = replace(here, given_back=np.zeros(len(z)))
    for k in levels:
        step = 0.01 * np.eye(len(z))[k]
        up, down = stage.target.log_posterior(np.array([z + step, z - step]))
        expected = (up - down) / 0.02
        assert abs(here.gradient(z)[k] - expected) < 0.02 * abs(expected) + 0.1
    assert np.max(np.abs((here.gradient(z) - plain.gradient(z))[levels])) > 1.0
