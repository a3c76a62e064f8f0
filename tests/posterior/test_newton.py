"""Climbing to the mode."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.newton import derivatives, find_mode
from bayes_asv.posterior.parameters import make_parameter_space
from tests.posterior.cases import DECLARED, case, prepared, vehicle


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    car = vehicle(DECLARED)
    lines = tuple(prepared(case(terrain, 31, DECLARED)[2], car) for terrain in ("bump", "rough"))
    return Posterior(make_parameter_space(car, lines), (WHITE, WHITE))


def test_derivatives_run_by_run_are_those_of_the_whole(posterior: Posterior) -> None:
    mode = find_mode(posterior)
    scale = mode.sd
    _, gradient, hessian = derivatives(posterior, mode.z, scale)
    rng = np.random.default_rng(0)
    for _ in range(5):
        u = rng.normal(size=len(scale))
        line = mode.z + np.outer([-1e-1, 0.0, 1e-1], u * scale)
        low, middle, high = posterior.log_posterior(line)
        assert (high - low) / 0.2 == pytest.approx(gradient @ u, abs=0.05)
        assert (high - 2 * middle + low) / 0.01 == pytest.approx(u @ hessian @ u, rel=0.05)


def test_the_mode_is_higher_than_its_surroundings(posterior: Posterior) -> None:
    mode = find_mode(posterior)
    assert mode.converged
    rng = np.random.default_rng(1)
    around = mode.z + 0.2 * rng.normal(size=(200, len(mode.z))) * mode.sd
    assert np.max(posterior.log_posterior(around)) < mode.log_posterior + 0.05


def test_a_start_some_deviations_away_comes_back(posterior: Posterior) -> None:
    mode = find_mode(posterior)
    rng = np.random.default_rng(2)
    again = find_mode(posterior, mode.z + 4.0 * rng.normal(size=len(mode.z)) * mode.sd)
    assert np.max(np.abs(again.z - mode.z) / mode.sd) < 0.1
