"""Coordinates of single runs are integrated out: exactly where normal, closely in a real fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.posterior.importance import importance_sample
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.posterior.newton import PosteriorMode
from bayes_asv.posterior.sampler import sample_mcmc
from bayes_asv.posterior.shared_posterior import SharedPosterior
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import as_recording, vehicle
from tests.rig import DECLARED_SDS, TERRAINS, SensorSpec, baja, draw_biases, drive

RUNS = (None, None, 0, 0, 1, 1, 1)


class Normal:
    """A normal density whose coordinates belong to runs."""

    def __init__(self, rng: np.random.Generator) -> None:
        root = rng.standard_normal((len(RUNS), len(RUNS)))
        self.covariance = root @ root.T + 0.1 * np.eye(len(RUNS))
        self.middle = rng.standard_normal(len(RUNS))
        coordinates = tuple(SimpleNamespace(run=run) for run in RUNS)
        self.space = SimpleNamespace(coordinates=coordinates)

    def log_posterior(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        away = z - self.middle
        solved = np.linalg.solve(self.covariance, away.T).T
        return np.asarray(-0.5 * np.sum(away * solved, axis=1))


def test_of_a_normal_density_the_marginal_and_the_joint_are_exact() -> None:
    rng = np.random.default_rng(3)
    normal: Any = Normal(rng)
    shared = SharedPosterior(normal, PosteriorMode(normal.middle, normal.covariance, 0.0, True))
    x = rng.standard_normal((40, 2))
    away = x - normal.middle[:2]
    exact = -0.5 * np.sum(away * np.linalg.solve(normal.covariance[:2, :2], away.T).T, axis=1)
    assert shared.log_posterior(x) == pytest.approx(exact)
    z, change = shared.completed(x, rng)
    assert z[:, :2] == pytest.approx(x)
    assert shared.log_posterior(x) + change == pytest.approx(normal.log_posterior(z))
    many = rng.multivariate_normal(normal.middle[:2], normal.covariance[:2, :2], size=40_000)
    z, _ = shared.completed(many, rng)
    assert np.cov(z.T) == pytest.approx(normal.covariance, abs=0.05 * np.max(normal.covariance))


def test_a_fit_of_two_runs_has_the_posterior_of_all_its_coordinates() -> None:
    car, rng = baja(), np.random.default_rng(5)
    declared = draw_biases(SensorSpec(), rng)
    runs = [
        as_recording(
            drive(car, TERRAINS["stops"](seed), 3.5, 400.0, 2.0, declared, seed), "run.csv"
        )
        for seed in (1, 2)
    ]
    about = vehicle(dict(DECLARED_SDS))
    lines, reasons, _ = prepare_runs(runs, about)
    assert not reasons
    found = best_fit(lines, about, "innovations", ())
    shared = SharedPosterior(found.posterior, found.mode)
    few = len(shared.mode.z)
    assert few < len(found.mode.z)
    ensembles = sample_mcmc(shared, shared.mode, 1)
    assert ensembles.converged
    sampled = ensembles.draws.reshape(-1, few)
    weighted = importance_sample(found.posterior, found.mode, 2048, 1)
    assert weighted.effective > 400
    for k in range(few):  # the shared coordinates come first
        sd = weighted.sd(weighted.z[:, k])
        assert abs(sampled[:, k].mean() - weighted.mean(weighted.z[:, k])) < 0.15 * sd
        assert sampled[:, k].std() == pytest.approx(sd, rel=0.1)
