"""One more effect in a model, where a law's shape has more than one hill."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.domain.errors import FitError, InputError
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.filters.kalman import MISSING
from bayes_asv.io import read_recording
from bayes_asv.models.effects import placed_effect
from bayes_asv.posterior.effect_fit import candidates, fit_with_effect, with_effects
from bayes_asv.posterior.fitted_model import (
    fit_linear_car,
    fit_model,
    make_dataset,
    update_corrections_at,
)
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.cli.conftest import ROOT
from tests.posterior.cases import DECLARED, case, prepared, vehicle


@pytest.mark.parametrize("silent", [0, 38])
def test_a_rounding_that_the_data_hardly_know_is_looked_for_at_both_ends(silent: int) -> None:
    """A bump whose first tenth of a second is silent: a climb from the usual rounding ends on the
    hill of hardly any, where no step along the rounding alone is a gain and the other hill, 17 nats
    higher, is four deviations off."""
    data = ROOT / "data"
    vehicle = read_vehicle(data / "vehicles" / "baja2008.toml")
    run = read_recording(data / "recordings" / "valved-bump-400hz.csv")
    lines, reasons, _ = prepare_runs([run], vehicle)
    assert not reasons
    where = make_dataset(vehicle, lines)
    where.recordings[0].kind[:silent] = MISSING
    linear = fit_linear_car(where)
    group = [c for c in candidates(linear, vehicle) if str(c.placed) == "bound_rebound@front"]
    found = fit_with_effect(where, linear, group)
    k = found.space.names.index("effect bound_rebound@front rounding")
    for end in (-2.0, 0.0, 2.5):
        start = found.mode.z.copy()
        start[k] = end
        assert fit_model(found.posterior, start).mode.log_posterior < found.mode.log_posterior + 0.1


def test_stops_are_tried_within_the_travel_to_their_own_side() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 3, DECLARED)
    linear = fit_linear_car(make_dataset(car, (prepared(recording, car),)))
    found = candidates(linear, car)
    _, states, _ = free_run(linear.posterior, linear.mode.z, 0)
    shares = []
    for e, axle in enumerate(("front", "rear")):
        compressed, extended = -states[:, 2 * e].min(), states[:, 2 * e].max()
        assert abs(compressed / extended - 1.0) > 0.02
        for name, travel in (("bump_stop", compressed), ("droop_stop", extended)):
            gaps = [c.values["gap"] for c in found if str(c.placed) == f"{name}@{axle}"]
            shares.append(max(gaps) / travel)
    assert shares == pytest.approx([shares[0]] * 4)
    assert 0.5 < shares[0] < 1.0


def test_a_fit_that_is_no_car_is_refused_in_one_sentence() -> None:
    """A rear damper a thousand times too stiff, as a fit finds it for exchanged columns."""
    car = vehicle(DECLARED)
    _, _, recording = case("stops", 2, DECLARED)
    dataset = make_dataset(car, (prepared(recording, car),))
    z = np.zeros(dataset.posterior(()).space.dimension)
    z[1] = 9.0
    assert dataset.posterior(()).space.values(z[None])["c_r"] > 1e3 * car.c_r.value
    with pytest.raises(FitError, match="fit of the half car diverges") as refused:
        update_corrections_at(dataset, dataset.posterior(()), z)
    assert "check channels, signs, units and clocks" in refused.value.fix


def test_an_effect_that_is_in_the_model_already_is_refused() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 3, DECLARED)
    dataset = make_dataset(car, (prepared(recording, car),))
    twice = (placed_effect("bound_rebound@front"), placed_effect("bound_rebound@both"))
    with pytest.raises(InputError, match="in the model already, in bound_rebound@front"):
        with_effects(dataset, twice)
