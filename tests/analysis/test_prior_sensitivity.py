"""Power-scaling sensitivity against ArviZ's own, and its size in a conjugate model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bayes_asv.analysis.prior_sensitivity import prior_sensitivity


def _conjugate(prior_sd: float) -> tuple[Any, Any]:
    """Draws of a normal mean with a likelihood of unit deviation at 1, and their log prior."""
    rng = np.random.default_rng(3)
    precision = 1.0 + prior_sd**-2
    draws = rng.normal(1.0 / precision, precision**-0.5, size=(4, 2000))
    return draws, -0.5 * (draws / prior_sd) ** 2


@pytest.mark.parametrize("prior_sd", [0.7, 2.0, 20.0])
def test_it_is_that_of_arviz(prior_sd: float) -> None:
    arviz = pytest.importorskip("arviz")
    draws, prior = _conjugate(prior_sd)
    # Older versions find a prior in no group of the data that they make, but scale any component
    # alike.
    groups = {"posterior": {"x": draws}, "log_likelihood": {"y": prior[..., None]}}
    if int(arviz.__version__.split(".")[0]) < 1:
        expected = float(arviz.psens(arviz.from_dict(**groups), component="likelihood")["x"])
    else:
        expected = float(arviz.psense(arviz.from_dict(groups), group="likelihood")["x"])
    found = prior_sensitivity({"x": prior}, {"x": draws})["x"]
    assert found.sensitivity["x"] == pytest.approx(expected, rel=0.1, abs=2e-3)


def test_a_tight_prior_is_noticed_and_a_wide_one_is_not() -> None:
    sizes = {}
    for sd in (0.5, 50.0):
        draws, prior = _conjugate(sd)
        other = np.random.default_rng(1).permutation(draws.ravel()).reshape(draws.shape)
        found = prior_sensitivity({"x": prior}, {"x": draws, "other": other})["x"]
        sizes[sd] = found.sensitivity["x"]
        assert found.pareto_k < 0.7
        assert found.sensitivity["other"] < 0.05  # of draws that have nothing to do with it
    assert sizes[0.5] > 0.05 > sizes[50.0]
