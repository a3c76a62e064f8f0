"""The draws as ArviZ sees them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bayes_asv as asv
from bayes_asv.library.inference_data import coordinates, groups


@pytest.fixture(scope="module")
def data(result: asv.Estimate) -> Any:
    """Convert the estimate of two recordings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return result.to_inference_data()


def test_draws_are_the_parameters_in_si_units(result: asv.Estimate, data: Any) -> None:
    for name in result:
        si = result[name].to("SI")
        draws = data["posterior"][name]
        assert draws.dims == ("chain", "draw")
        assert draws.sizes["chain"] == 4
        assert draws.values.ravel() == pytest.approx(si.draws)
        assert draws.attrs["units"] == si.unit
    assert "noise_front_wheel_1" in data["posterior"]


def test_likelihood_and_prior_add_up_to_the_posterior(result: asv.Estimate, data: Any) -> None:
    likelihood = data["log_likelihood"]["recordings"]
    assert likelihood.sizes["recording"] == 2
    engine = result.engine
    z = coordinates(engine)
    assert z is not None
    assert engine.space is not None
    prior = engine.space.log_prior(z.reshape(-1, z.shape[-1])).reshape(z.shape[:2])
    total = likelihood.sum("recording").values + prior
    assert total == pytest.approx(data["sample_stats"]["lp"].values, abs=1e-6)


def test_the_log_prior_is_a_density_of_each_parameter(car: asv.Vehicle, data: Any) -> None:
    z = np.log(data["posterior"]["c_f"].values / car.c_f.value) / np.log(3.0)
    expected = -0.5 * z**2 - 0.5 * np.log(2.0 * np.pi) - np.log(np.log(3.0))
    assert data["log_prior"]["c_f"].values == pytest.approx(expected)
    assert set(data["log_prior"].data_vars) <= set(data["posterior"].data_vars)


def test_the_prior_is_that_of_the_vehicle_file(car: asv.Vehicle, data: Any) -> None:
    logs = np.log(data["prior"]["c_f"].values)
    assert logs.mean() == pytest.approx(np.log(car.c_f.value), abs=0.15)
    assert logs.std() == pytest.approx(np.log(3.0), rel=0.1)
    mass = data["prior"]["m"].values
    assert mass.std() / mass.mean() == pytest.approx(0.01, rel=0.15)


def test_predicted_readings_cover_the_observed_ones(data: Any) -> None:
    for name, observed in data["observed_data"].data_vars.items():
        predicted = data["posterior_predictive"][name].values[0]
        low, high = np.quantile(predicted, [0.025, 0.975], axis=0)
        inside = np.mean((observed.values >= low) & (observed.values <= high))
        assert 0.90 < inside < 0.99, name


def test_predicted_readings_have_the_noise_of_their_own_recording(result: asv.Estimate) -> None:
    engine = result.engine
    name = "noise front_chassis 1"
    noisy = replace(engine, nuisance={**engine.nuisance, name: 20.0 * engine.nuisance[name]})
    predicted = groups(noisy)["posterior_predictive"]
    first, second = (
        float(predicted[f"front_chassis_{run}"].std("draw").median()) for run in (0, 1)
    )
    assert second == pytest.approx(20.0 * float(np.mean(engine.nuisance[name])), rel=0.2)
    assert first < 0.3 * second


def test_the_file_holds_the_same(result: asv.Estimate, data: Any, tmp_path: Path) -> None:
    import xarray as xr

    result.to_netcdf(tmp_path / "draws.nc")
    with xr.open_dataset(tmp_path / "draws.nc", group="posterior", engine="h5netcdf") as saved:
        assert np.array_equal(saved["c_f"], data["posterior"]["c_f"])


def test_a_model_with_effects_has_their_parameters(car: asv.Vehicle, tmp_path: Path) -> None:
    import xarray as xr

    run = asv.read_recording(asv.example("valved-bump-400hz.csv"))
    result = asv.estimate(run, car, effects=("bound_rebound@front",))
    assert [effect.name for effect in result.effects] == ["bound_rebound"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = result.to_inference_data()
    ratio = data["posterior"]["bound_rebound_front_ratio"].values
    assert ratio.mean() == pytest.approx(1.48, abs=0.03)
    assert "bound_rebound_front_ratio" in data["prior"]
    result.to_netcdf(tmp_path / "draws.nc")
    with xr.open_dataset(tmp_path / "draws.nc", group="posterior", engine="h5netcdf") as saved:
        assert np.array_equal(saved["bound_rebound_front_ratio"], ratio)
        assert saved["bound_rebound_front_ratio"].dims == ("chain", "draw")
        assert saved["bound_rebound_front_ratio"].attrs["units"] == ""
    assert "ratio" in str(result)


def test_an_effect_has_its_si_unit(car: asv.Vehicle) -> None:
    run = asv.read_recording(asv.example("valved-bump-400hz.csv"))
    data = asv.estimate(run, car, effects=("coulomb_friction@rear",)).to_inference_data()
    assert data["posterior"]["coulomb_friction_rear_force"].attrs["units"] == "N"
