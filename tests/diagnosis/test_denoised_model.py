"""Denoised inputs and sensitivities at fixed gain, which share no noise with the innovations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.diagnosis.denoised_model import (
    coordinate_sensitivities,
    denoise,
    denoised_model,
    fit_denoised,
    fixed_gain_filter,
)
from bayes_asv.diagnosis.score_test import score_test
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.denoised_inputs import without_noise
from bayes_asv.posterior.effect_fit import candidates, read_effect, with_effects
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_linear_car
from bayes_asv.posterior.free_simulation import free_run, simulate_from
from bayes_asv.posterior.likelihood import Posterior
from tests.battery.cases import case as battery_case
from tests.diagnosis.models import fit_linear, prepared
from tests.posterior.cases import DECLARED, INCH, case, vehicle
from tests.rig import SensorSpec, baja, drive, parking_stops, vehicle_toml

Array = NDArray[np.float64]

_NOISY = SensorSpec(noise=(4.0 * INCH, 2.0 * INCH, 4.0 * INCH, 2.0 * INCH))


def _driven(noise: SensorSpec, seed: int) -> Recording:
    run = drive(baja(), parking_stops(2.5 * INCH), 2.5, 400.0, 2.5, noise, seed)
    return Recording(run.time, run.channels, ("m/s^2",) * 4, (), "drive.csv")


@cache
def _linear(car: Vehicle, seed: int) -> tuple[Dataset, FittedModel]:
    return fit_linear(prepared([_driven(SensorSpec(adc=None), seed)], car))


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Vehicle:
    path = tmp_path_factory.mktemp("car") / "car.toml"
    path.write_text(vehicle_toml(baja(), SensorSpec(adc=None)), encoding="utf-8")
    return read_vehicle(path)


def test_denoising_leaves_the_innovations_unchanged(car: Vehicle) -> None:
    dataset, model = _linear(car, 3)
    denoised = denoise(dataset, model)
    before, _, _ = model.posterior.innovations_and_variances(model.mode.z, 0)
    after, _, _ = denoised.posterior(()).innovations_and_variances(model.mode.z, 0)
    np.testing.assert_allclose(after, before, atol=1e-9)
    change = denoised.recordings[0].moments[:, :, 0] - dataset.recordings[0].moments[:, :, 0]
    assert np.std(change) > 0.0


def test_denoising_removes_the_noise_of_a_wheel(car: Vehicle) -> None:
    """Over 12 drives (seeds 20 to 31) the noise falls, and no longer correlates with the residuals.

    That of the readings does, since a free simulation leaves e − G n: their product is more than
    six of its standard deviations from zero.
    """
    read: list[list[float]] = []
    smoothed: list[list[float]] = []
    clean = _driven(SensorSpec.clean(), 0).values
    for seed in range(20, 32):
        _, model = _linear(car, seed)
        posterior, z = model.posterior, model.mode.z
        recording = posterior.space.recordings[0]
        residuals = recording.reading - free_run(posterior, z, 0).output
        denoised = without_noise(posterior, z, 0)
        for axle in range(2):
            knots = recording.wheels[axle].knots
            truth = np.interp(knots, recording.times[2 * axle], clean[2 * axle])
            r = np.interp(knots, recording.instants, residuals[:, axle])
            late = knots > knots[0] + 0.2
            for wheel, out in (
                (recording.wheels[axle], read),
                (denoised.wheels[axle], smoothed),
            ):
                noise = (wheel.spline(knots) - truth)[late]
                out.append([float(np.std(noise)), float(noise @ r[late]), float(r[late] @ r[late])])
    first, last = np.array(read), np.array(smoothed)
    assert np.all(last[:, 0] < first[:, 0])
    common = [float(x[:, 1].mean() / (x[:, 1].std() / np.sqrt(len(x)))) for x in (first, last)]
    assert common[0] < -6.0
    assert abs(common[1]) < 3.5


def test_a_score_is_of_the_predictions_and_not_of_their_variances(car: Vehicle) -> None:
    """A stiffer spring as an effect has the sensitivity of the car's own spring rate."""
    dataset, model = _linear(car, 3)
    springs = [c for c in candidates(model, car) if str(c.placed) == "spring_rate@front"]
    denoised = denoised_model(*fit_denoised(dataset, model))
    test = score_test(denoised, springs)
    own = denoised.derivatives.means.T
    rest = test.sensitivities[0] - own @ np.linalg.lstsq(own, test.sensitivities[0])[0]
    # The effect is a sum of the car's own sensitivities.  With the change of the variances in them,
    # which goes with the squares of the innovations, 0.37 standard deviations of its score remain.
    nu = denoised.derivatives.nu
    assert abs(rest @ nu) < 0.1 * np.sqrt(test.information[0, 0])
    assert np.all(test.sensitivities[0][~denoised.settled] == 0.0)


def test_scores_are_unbiased_without_a_fault() -> None:
    """24 drives, seed 7: springs and friction; a bias makes their mean 0.9.

    Scores of one drive go together: with 8 drives their mean square is 1.0 or 1.5 by chance.
    """
    scores = []
    for number in range(24):
        one = battery_case(f"null/{('bump', 'stops')[number % 2]}", 7, number)
        dataset, model = fit_linear(prepared(one.recordings, one.vehicle))
        tested = [
            c
            for c in candidates(model, one.vehicle)
            if c.placed.effect.name in ("spring_rate", "coulomb_friction")
        ]
        test = score_test(denoised_model(*fit_denoised(dataset, model)), tested)
        scores += test.standardized_scores.tolist()
    assert len(scores) >= 120
    assert abs(np.mean(scores)) < 0.4
    assert np.mean(np.square(scores)) < 1.4


@cache
def _fitted(law: str | None) -> tuple[Dataset, FittedModel]:
    _, _, recording = case("bump", 3, DECLARED, sensors=_NOISY)
    dataset = prepared([recording], vehicle(DECLARED, _NOISY))
    if law is None:
        return dataset, fit_linear_car(dataset)
    return with_effects(dataset, [read_effect(law)])


def _on_own_prediction(law: str | None) -> tuple[Posterior, Array, int]:
    """A model on readings that it predicts exactly, from rest, none of them at a rail."""
    dataset, model = _fitted(law)
    z, recording = model.mode.z, model.space.recordings[0]
    inputs = model.posterior.as_declared(z, 0)
    output, _ = simulate_from(model.posterior, z, 0, inputs, np.zeros(6))
    reading = output + recording.reading - inputs.reading
    kind = np.minimum(recording.kind, VALUE)
    exact = replace(dataset, recordings=(replace(recording, reading=reading, kind=kind),))
    posterior = replace(
        exact.posterior(model.placed_effects), sensor_corrections=model.posterior.sensor_corrections
    )
    return posterior, z, model.space.shared_dimension


def _sensitivities(posterior: Posterior, z: Array, count: int) -> Array:
    return coordinate_sensitivities([fixed_gain_filter(posterior, z, 0)], count)


def _relative_difference(one: Array, other: Array) -> Array:
    """Length of the difference of rows over that of the rows; zero for rows of zeros."""
    size, difference = np.linalg.norm(one, axis=1), np.linalg.norm(one - other, axis=1)
    return np.asarray(difference / np.maximum(size, 1e-6))


@pytest.mark.parametrize("law", [None, "bound_rebound@rear"])
def test_without_innovations_the_gain_does_not_matter(law: str | None) -> None:
    """A filter that has nothing to correct has the same sensitivities at fixed gain."""
    posterior, z, n = _on_own_prediction(law)
    assert np.mean(posterior.innovations_and_variances(z, 0)[0] ** 2) < 1e-3
    free, fixed = slopes(posterior, z).means[:n], _sensitivities(posterior, z, n)
    assert np.all(_relative_difference(free, fixed) < 0.01)


def test_sensitivities_at_fixed_gain_do_not_depend_on_the_noise() -> None:
    posterior, z, n = _on_own_prediction(None)
    rng = np.random.default_rng(0)
    recording = posterior.space.recordings[0]
    noise = 5.0 * INCH * rng.standard_normal((len(recording.step), 2))
    noisy = replace(recording, reading=recording.reading + noise)
    with_noise = replace(posterior, space=replace(posterior.space, recordings=(noisy,)))
    before, after = _sensitivities(posterior, z, n), _sensitivities(with_noise, z, n)
    assert np.all(_relative_difference(before, after) < 0.006)
    free = slopes(with_noise, z).means[:n]
    assert np.max(_relative_difference(before, free)) > 0.012


def test_the_sensitivity_towards_the_same_model_is_zero() -> None:
    posterior, z, _ = _on_own_prediction(None)
    at = fixed_gain_filter(posterior, z, 0)
    assert np.all(at.sensitivity(posterior, z) == 0.0)
    assert at.sensitivity(posterior, z).shape == (np.count_nonzero(at.has_reading),)
