"""Coordinates and priors."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.vehicle import Given
from bayes_asv.filters.kalman import log_likelihood
from bayes_asv.models.car_model import state_space
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from tests.posterior.cases import DECLARED, EXACT, case, prepared, vehicle


@pytest.fixture(scope="module")
def recording() -> PreparedRecording:
    _, _, raw = case("bump", 1, DECLARED, seconds=1.0)
    return prepared(raw, vehicle(DECLARED))


def test_the_prior_is_the_one_that_is_promised(recording: PreparedRecording) -> None:
    """Log-normal, independent, a factor 3 on damping and 2 on inertia at one deviation."""
    car = vehicle(DECLARED)
    car = replace(car, l=Given(car.l.value, 0.02 * car.l.value))
    where = make_parameter_space(car, (recording,))
    rng = np.random.default_rng(0)
    z = rng.normal(size=(200_000, where.dimension))
    cars = np.log(where.cars(z, rng.normal(size=(len(z), where.prior.unidentified.shape[1]))))
    sd = dict(zip(where.car.names, cars.std(axis=0), strict=True))
    expected = {"c_f": np.log(3), "c_r": np.log(3), "i": np.log(2), "m": 0.01, "l": 0.02,
                "k_f": 0.05, "k_r": 0.05}  # fmt: skip
    for name, value in expected.items():
        assert sd[name] == pytest.approx(value, rel=0.01), name
    correlation = np.corrcoef(cars.T)
    assert np.max(np.abs(correlation - np.eye(8))) < 0.01
    for k, name in enumerate(where.car.names):
        centre = getattr(car, name).value
        assert np.exp(np.median(cars[:, k])) == pytest.approx(centre, rel=0.01)


@pytest.mark.parametrize("sds", [EXACT, DECLARED, DECLARED | {"l": 0.02}])
def test_what_is_called_unseen_is_not_seen(
    recording: PreparedRecording, sds: dict[str, float]
) -> None:
    """Mass and wheel base scale the answer; the accelerations do not know them."""
    where = make_parameter_space(vehicle(sds), (recording,))
    rng = np.random.default_rng(1)
    z = np.repeat(0.3 * rng.normal(size=(1, where.dimension)), 6, axis=0)
    unseen = rng.normal(size=(6, where.prior.unidentified.shape[1]))
    system = state_space(where.car, where.values(z, unseen), recording.output_models)
    out = log_likelihood(system, where.noises(z, 0), recording.measurements)
    np.testing.assert_allclose(out, out[0], rtol=1e-9)


def test_only_what_has_a_deviation_is_sampled(recording: PreparedRecording) -> None:
    assert make_parameter_space(vehicle(EXACT), (recording,)).car_dimension == 3
    assert make_parameter_space(vehicle(DECLARED), (recording,)).car_dimension == 6
    assert "wdf" in make_parameter_space(vehicle(DECLARED), (recording,)).names
    assert not any(
        "wheel" in n
        for n in make_parameter_space(vehicle(EXACT), (recording,), "output-error").names
    )


def test_noise_that_is_not_sampled_is_that_of_the_centre_of_its_prior(
    recording: PreparedRecording,
) -> None:
    car = vehicle(DECLARED)
    sampled = make_parameter_space(car, (recording,))
    held = make_parameter_space(car, (recording,), fixed_noise_runs=frozenset({0}))
    assert not any(name.startswith("noise") for name in held.names)
    at_centre = [space.noises(space.origin[None], 0) for space in (sampled, held)]
    for one, other in zip(*at_centre, strict=True):
        np.testing.assert_allclose(one, other)


def test_shifted_logs_come_back(recording: PreparedRecording) -> None:
    where = make_parameter_space(vehicle(EXACT), (recording,))
    z = where.from_logs({"c_f": 0.4, "i": -0.2})
    car = where.cars(z[None])[0]
    nominal = vehicle(EXACT)
    assert car[0] == pytest.approx(nominal.c_f.value * np.exp(0.4))
    assert car[2] == pytest.approx(nominal.i.value * np.exp(-0.2))


def test_impossible_places_have_no_density(recording: PreparedRecording) -> None:
    where = make_parameter_space(vehicle(DECLARED), (recording,))
    z = np.zeros((3, where.dimension))
    z[0, 0] = 50.0
    z[1, 0] = np.nan
    assert np.isneginf(where.log_prior(z)[:2]).all()
    assert np.isfinite(where.log_prior(z)[2])


def test_deviation_of_a_logarithm_includes_what_is_unseen(recording: PreparedRecording) -> None:
    where = make_parameter_space(vehicle(DECLARED), (recording,))
    covariance = np.zeros((where.dimension, where.dimension))
    # known perfectly in every direction that is seen, c still scales with the mass
    assert where.log_deviation(covariance, "c_f") == pytest.approx(0.01, rel=0.05)
    assert where.log_deviation(np.eye(where.dimension), "c_f") == pytest.approx(np.log(3.0))
