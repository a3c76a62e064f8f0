"""Fisher information of one recording against the curvature of the posterior with free noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtri

from bayes_asv.models.car_model import Output
from bayes_asv.models.cars import car_model
from bayes_asv.planning.drive_information import inseparable_groups
from bayes_asv.planning.predicted_sd import predicted_sd
from bayes_asv.posterior.information import fisher_information, make_parameter_prior, sd_floor
from bayes_asv.posterior.likelihood import WHITE, Posterior, shared_work
from bayes_asv.posterior.newton import derivatives
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.run_preparation import prepare_runs
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
    lines, reasons, _ = prepare_runs([recording], car)
    assert not reasons
    where = make_parameter_space(car, lines)
    logs = {
        name: math.log(getattr(truth, name) / getattr(car, name).value)
        for name in ("c_f", "c_r", "i")
    }
    z = where.from_logs(logs)
    z[where.names.index("filtered share 0")] = ndtri(0.98)
    scale = np.full(where.dimension, 0.3)
    scale[: where.car_dimension] = 0.003
    with shared_work(Posterior(where, (WHITE,))) as posterior:
        _, _, hessian = derivatives(posterior, z, scale)
    covariance = np.asarray(np.linalg.inv(-hessian) * np.outer(scale, scale), dtype=np.float64)
    about = make_parameter_prior(lines[0].car, lines[0].output_models)
    found = predicted_sd(fisher_information(lines[0], car, about), 1, about)
    # the drawn dampers are not the nominal ones, so information is taken at the wrong car: that
    # and the free noise are what the tolerance is for
    for name in ("c_f", "c_r", "i"):
        assert found[name] == pytest.approx(where.log_deviation(covariance, name), rel=0.05)
    k_g = 0.5 * (where.log_slopes("i") - where.log_slopes("m"))
    r = len(k_g)
    sd = math.sqrt(k_g @ covariance[:r, :r] @ k_g)
    assert found["k_g"] == pytest.approx(sd, rel=0.35)


def test_the_information_is_that_of_what_the_model_depends_on() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 6, DECLARED)
    lines, _, _ = prepare_runs([recording], car)
    about = make_parameter_prior(lines[0].car, lines[0].output_models)
    J = fisher_information(lines[0], car, about)
    assert pytest.approx(J.T) == J
    inside = about.identified.T @ J @ about.identified
    assert np.linalg.eigvalsh(inside)[0] > 0.0
    # one common factor on c, i, k and m moves nothing; at fixed mass it does
    powers = {"c_f": 1.0, "c_r": 1.0, "i": 1.0, "k_f": 1.0, "k_r": 1.0, "m": 1.0}
    heavier = np.array([powers.get(name, 0.0) for name in about.names])
    assert heavier @ J @ heavier < 1e-9 * np.trace(J)
    stiffer = heavier * np.array([name != "m" for name in about.names])
    assert stiffer @ J @ stiffer > 0.0


NAMES = {
    "half": ("front_wheel", "rear_wheel", "front_chassis", "rear_chassis"),
    "half with travel": ("front_wheel", "rear_wheel", "front_travel"),
    "half with pitch rate": ("front_wheel", "rear_wheel", "front_chassis", "body_pitch_rate"),
    "quarter-front": ("front_wheel", "front_chassis"),
}


@pytest.mark.parametrize(
    ("case", "heads"),
    [
        ("half", {"m", "l"}), ("half with travel", {"m", "l"}),
        # a pitch rate has a scale of its own: i, and not i / l², is measured against the mass
        ("half with pitch rate", {"m"}), ("quarter-front", {"m"}),
    ],
)  # fmt: skip
def test_what_no_drive_separates_follows_from_the_channels(case: str, heads: set[str]) -> None:
    given = vehicle({**DECLARED, "l": 0.01})
    model = car_model(case.split(" ")[0], given)
    outputs = [Output(c) for c in map(given.channel, NAMES[case]) if not c.is_input]
    about = make_parameter_prior(model, outputs)
    assert {group.names[0] for group in inseparable_groups(about)} == heads
    floor = sd_floor(about, about.estimands)
    # springs known to 5 % hardly help to weigh the car
    assert floor[model.estimated[0]] == pytest.approx(0.01, rel=0.1)
