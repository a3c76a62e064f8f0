"""Predicted deviations against the estimator's formula, closed forms and invariants."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS, channel
from bayes_asv.domain.vehicle import Given, Vehicle, read_vehicle
from bayes_asv.models.car_model import Output
from bayes_asv.models.cars import car_model
from bayes_asv.planning.drive_information import correlated_pairs
from bayes_asv.planning.predicted_sd import (
    limiting_values,
    predicted_sd,
    required_passes,
    sd_floors,
)
from bayes_asv.posterior.information import ParameterPrior, make_parameter_prior
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.shipped import shipped
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate

Array = NDArray[np.float64]

BAJA = read_vehicle(shipped("vehicles", "baja2008.toml"))
DRAWN = settings(max_examples=40, deadline=None)
IDENTIFIABLE = ("c_f", "c_r", "i", "k_f", "k_r", "wdf")
PARAMETERS = ("c_f", "c_r", "i", "k_g")
GIVEN = ("m", "l", "wdf", "k_f", "k_r")
OUTPUTS = [Output(channel(name)) for name in CHANNELS[1::2]]
NAMES = make_parameter_prior(car_model("half", BAJA), OUTPUTS).names
# Accelerations depend on c/m, k/m, i/(m l²) and the weight fraction.
RATIOS = np.array(
    [
        [
            float(name == own)
            - float(name == "m" and own != "wdf")
            - 2.0 * float(name == "l" and own == "i")
            for name in NAMES
        ]
        for own in IDENTIFIABLE
    ]
)


def _prior(vehicle: Vehicle) -> ParameterPrior:
    return make_parameter_prior(car_model("half", vehicle), OUTPUTS)


def _of_ratios(J: Array) -> Array:
    """Information about all unknowns from that about the identifiable ratios."""
    return np.asarray(RATIOS.T @ J @ RATIOS)


def _information(seed: int, strength: float = 1e4) -> Array:
    """Draw an information matrix that is positive definite in the identifiable ratios."""
    root = np.random.default_rng(seed).normal(size=(6, 9))
    return _of_ratios(strength * root @ root.T)


def _car(m: float, l: float, wdf: float, k: float) -> Vehicle:
    return replace(
        BAJA,
        m=Given(BAJA.m.value, m * BAJA.m.value),
        l=Given(BAJA.l.value, l * BAJA.l.value),
        wdf=Given(BAJA.wdf.value, wdf * BAJA.wdf.value),
        k_f=Given(BAJA.k_f.value, k * BAJA.k_f.value),
        k_r=Given(BAJA.k_r.value, 2.0 * k * BAJA.k_r.value),
    )


@pytest.mark.parametrize("car", [BAJA, _car(0.0, 0.0, 0.01, 0.05), _car(0.02, 0.01, 0.0, 0.0)])
def test_predicted_deviations_are_those_of_the_estimators_coordinates(car: Vehicle) -> None:
    """The same precision in the sampled coordinates, mapped back by the estimator."""
    passes = 4
    root = np.random.default_rng(3).normal(size=(6, 9))
    J: Array = 1e4 * root @ root.T
    drive = simulate(car, road("bump", np.random.default_rng(0)))
    parameters = make_parameter_space(car, (prepare(drive.recording, car, car_model("half", car)),))
    d = parameters.car_dimension
    # ∂ ln θ / ∂z of the identifiable parameters, by central differences
    step = 1e-5
    slope = np.zeros((len(IDENTIFIABLE), d))
    for k in range(d):
        by = np.zeros((1, parameters.dimension))
        by[0, k] = step
        up, down = np.log(parameters.cars(by)[0]), np.log(parameters.cars(-by)[0])
        change = dict(zip(parameters.car.names, (up - down) / (2.0 * step), strict=True))
        for row, name in enumerate(IDENTIFIABLE):
            slope[row, k] = change[name]
            if name != "wdf":
                slope[row, k] -= change["m"] + (2.0 * change["l"] if name == "i" else 0.0)
    precision: Array = np.eye(d) + passes * slope.T @ J @ slope
    covariance: Array = np.linalg.inv(precision).astype(np.float64)
    found = predicted_sd(_of_ratios(J), passes, _prior(car))
    for name in PARAMETERS[:3]:
        sd = parameters.log_deviation(covariance, name)
        assert found[name] == pytest.approx(math.sqrt(math.expm1(sd**2)), rel=1e-5)


def test_without_data_the_deviations_are_those_of_the_prior() -> None:
    found = predicted_sd(np.zeros((8, 8)), 1, _prior(BAJA))
    assert found["c_f"] == pytest.approx(math.sqrt(math.expm1(math.log(3.0) ** 2)))
    assert found["i"] == pytest.approx(math.sqrt(math.expm1(math.log(2.0) ** 2)))
    own, m = math.log(2.0), _prior(BAJA).sd("m")
    assert found["k_g"] == pytest.approx(math.sqrt(math.expm1(0.25 * (own**2 + m**2))))


def test_infinitely_many_passes_leave_mass_and_wheelbase() -> None:
    """Closed form where springs are wide: c as m, i as m l², k_g as l."""
    wide = {"c_f": 1.1, "c_r": 1.1, "i": 0.7, "k_f": 9.0, "k_r": 9.0, "wdf": 0.01}
    prior = _prior(BAJA).replaced({**wide, "m": 0.02, "l": 0.01})
    found = sd_floors(prior)
    wanted = {"c_f": 0.02, "c_r": 0.02, "i": math.hypot(0.02, 0.02), "k_g": 0.01}
    assert found == pytest.approx(wanted, rel=2e-3)
    assert predicted_sd(_information(1), 1e7, prior) == pytest.approx(found, rel=1e-3)
    exact = sd_floors(prior.with_exact_given())
    assert exact == pytest.approx(dict.fromkeys(PARAMETERS, 0.0), abs=1e-12)


@given(
    seed=st.integers(0, 10_000), strength=st.floats(1.0, 1e6),
    sds=st.lists(st.sampled_from([0.0, 0.003, 0.02, 0.1]), min_size=4, max_size=4),
)  # fmt: skip
@DRAWN
def test_more_passes_and_better_given_values_reduce_deviations(
    seed: int, strength: float, sds: list[float]
) -> None:
    J, prior = _information(seed, strength), _prior(_car(*sds))
    one, many = predicted_sd(J, 1, prior), predicted_sd(J, 7, prior)
    floor = sd_floors(prior)
    assert all(many[name] <= one[name] * (1.0 + 1e-9) for name in PARAMETERS)
    assert all(floor[name] <= many[name] * (1.0 + 1e-6) + 1e-12 for name in PARAMETERS)
    for given_value in GIVEN:
        better = predicted_sd(J, 7, prior.replaced({given_value: 0.5 * prior.sd(given_value)}))
        assert all(better[name] <= many[name] * (1.0 + 1e-9) for name in PARAMETERS)


@given(seed=st.integers(0, 10_000), want=st.floats(0.002, 0.5))
@DRAWN
def test_the_required_passes_are_the_smallest_number(seed: int, want: float) -> None:
    J, prior = _information(seed, 100.0), _prior(BAJA)
    for name, n in required_passes(J, prior, dict.fromkeys(PARAMETERS, want)).items():
        if n is None:
            assert predicted_sd(J, 1000, prior)[name] > want
        else:
            assert predicted_sd(J, n, prior)[name] <= want
            assert n == 1 or predicted_sd(J, n - 1, prior)[name] > want


@given(
    seed=st.integers(0, 10_000), parameter=st.sampled_from(PARAMETERS), want=st.floats(0.001, 0.05),
    sds=st.lists(st.sampled_from([0.0, 0.01, 0.05]), min_size=4, max_size=4),
)  # fmt: skip
@DRAWN
def test_the_required_accuracy_of_given_values_is_sufficient_and_necessary(
    seed: int, parameter: str, want: float, sds: list[float]
) -> None:
    J, prior, index = _information(seed, 3e4), _prior(_car(*sds)), parameter
    limiting = limiting_values(J, 5, prior, parameter, want)
    if limiting is None:
        assert predicted_sd(J, 5, prior)[index] <= want
        return
    if not limiting.required_sd:
        assert predicted_sd(J, 5, prior.with_exact_given())[index] > want
        return
    # one given value improves alone, or all improve by the same factor
    factor = max(sd / prior.sd(name) for name, sd in limiting.required_sd.items())
    assert factor < 1.0
    if len(limiting.required_sd) == 1:
        improved = prior.replaced(limiting.required_sd)
        slightly_worse = prior.replaced(
            {name: 1.01 * sd for name, sd in limiting.required_sd.items()}
        )
        if predicted_sd(J, 5, improved)[index] <= want * (1.0 + 1e-6):
            assert predicted_sd(J, 5, slightly_worse)[index] > want * (1.0 - 1e-3)
            return
    improved = prior.replaced({name: factor * prior.sd(name) for name in GIVEN})
    assert predicted_sd(J, 5, improved)[index] <= want * (1.0 + 1e-6)


def test_a_mass_known_to_one_per_cent_limits_the_rates() -> None:
    limiting = limiting_values(_information(2, 1e7), 10, _prior(BAJA), "c_f", 0.005)
    assert limiting is not None
    assert list(limiting.required_sd) == ["m"]
    assert limiting.required_sd["m"] == pytest.approx(0.005, rel=0.02)
    assert limiting_values(_information(2, 1e7), 10, _prior(BAJA), "c_f", 0.02) is None
    weak = limiting_values(_information(2, 1.0), 1, _prior(BAJA), "c_f", 0.005)
    assert weak is not None
    assert weak.required_sd == {}


def test_strongly_correlated_parameters_are_found() -> None:
    """Two columns of sensitivities at a known angle: the estimates' correlation is −cos."""
    for angle, correlated in ((0.3, True), (1.2, False)):
        slope = np.eye(6) * 100.0
        slope[IDENTIFIABLE.index("k_f")] = 0.0
        slope[IDENTIFIABLE.index("k_f"), :4] = 0.0
        slope[IDENTIFIABLE.index("k_f"), IDENTIFIABLE.index("c_f")] = 100.0 * math.cos(angle)
        slope[IDENTIFIABLE.index("k_f"), IDENTIFIABLE.index("k_f")] = 100.0 * math.sin(angle)
        information = np.zeros((8, 8))
        at = [NAMES.index(name) for name in IDENTIFIABLE]
        information[np.ix_(at, at)] = slope @ slope.T
        found = correlated_pairs(information, _prior(BAJA))
        assert bool(found) == correlated
        if correlated:
            assert found[0].names == ("c_f", "k_f")
            assert found[0].correlation == pytest.approx(-math.cos(angle), abs=1e-3)
            assert found[0].sd_inflation == pytest.approx(1.0 / math.sin(angle), rel=0.01)


def test_an_uninformative_drive_has_no_correlated_pairs() -> None:
    assert correlated_pairs(np.zeros((8, 8)), _prior(BAJA)) == []
