"""Fisher information of one recording against the curvature of the posterior with free noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtri

from bayes_asv.planning.information import IDENTIFIABLE, fisher_information
from bayes_asv.planning.predicted_sd import predicted_sd, prior_sd
from bayes_asv.posterior.likelihood import WHITE, Posterior, shared_work
from bayes_asv.posterior.map_fit import lay_out
from bayes_asv.posterior.newton import derivatives
from bayes_asv.posterior.parameters import space
from tests.posterior.cases import DECLARED, case, vehicle


@pytest.mark.parametrize("terrain", ["bump", "rough"])
def test_it_equals_the_curvature_of_the_posterior_at_the_true_car(terrain: str) -> None:
    """Both at the nominal car, which made the rig's recording up to its draw.

    The Hessian is of one recording and the formula its expectation; noise levels and their
    filtered share are free in one and held in the other.
    """
    car = vehicle(DECLARED)
    still = dict.fromkeys(DECLARED, 0.0)
    truth, _, recording = case(terrain, 4, still)
    lines, reasons, _ = lay_out([recording], car)
    assert not reasons
    where = space(car, lines)
    logs = {
        name: math.log(getattr(truth, name) / getattr(car, name).value) for name in IDENTIFIABLE[:3]
    }
    z = where.from_logs(logs)
    z[where.names.index("filtered share 0")] = ndtri(0.98)
    scale = np.full(where.dimension, 0.3)
    scale[: where.car_dimension] = 0.003
    with shared_work(Posterior(where, (WHITE,))) as target:
        _, _, hessian = derivatives(target, z, scale)
    covariance = np.asarray(np.linalg.inv(-hessian) * np.outer(scale, scale), dtype=np.float64)
    found = predicted_sd(fisher_information(lines[0], car), 1, prior_sd(car))
    # the drawn dampers are not the nominal ones, so information is taken at the wrong car: that
    # and the free noise are what the tolerance is for
    for k, name in enumerate(("c_f", "c_r", "i")):
        assert found[k] == pytest.approx(where.log_deviation(covariance, name), rel=0.05)
    k_g = 0.5 * (where.log_slopes("i") - where.log_slopes("m"))
    r = len(k_g)
    sd = math.sqrt(k_g @ covariance[:r, :r] @ k_g)
    assert found[3] == pytest.approx(sd, rel=0.35)


def test_the_information_matrix_is_positive_definite() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 6, DECLARED)
    lines, _, _ = lay_out([recording], car)
    J = fisher_information(lines[0], car)
    assert pytest.approx(J.T) == J
    assert np.linalg.eigvalsh(J)[0] > 0.0
    # one common factor on c, k and m moves nothing: at fixed mass it does
    assert np.ones(6) @ J @ np.ones(6) > 0.0
