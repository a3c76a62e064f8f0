"""Where the suspension is at rest matters to stops and springs, and to nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.diagnosis.model_assessment import assess
from bayes_asv.posterior.effect_fit import fit_with_effect, read_effect, with_effects
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from bayes_asv.preprocessing.measured_inputs import without_mean_input
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.battery.cases import Case, case

_OFF = np.array([0.4, 0.4, -0.3, -0.3])  # m/s², wheel and chassis of each axle alike


def _lines(one: Case, off: float) -> tuple[PreparedRecording, ...]:
    moved = [replace(r, values=r.values + off * _OFF[:, None]) for r in one.recordings]
    lines, reasons, _ = prepare_runs(moved, one.vehicle)
    assert not reasons
    return lines


def test_a_level_of_wheel_and_chassis_is_taken_off() -> None:
    one = case("droop_stop-400", 5, 0)
    for plain, shifted in zip(_lines(one, 0.0), _lines(one, 1.0), strict=True):
        a, b = without_mean_input(plain), without_mean_input(shifted)
        np.testing.assert_allclose(a.moments, b.moments, atol=1e-9)
        np.testing.assert_allclose(a.reading, b.reading, atol=1e-9)
        time = a.wheels[0].knots
        np.testing.assert_allclose(a.wheels[0].spline(time), b.wheels[0].spline(time), atol=1e-9)


def test_a_zero_is_what_a_level_would_be() -> None:
    """Innovations with a level in the readings and the zero that says so, and with neither."""
    one = case("droop_stop-400", 5, 0)
    where = make_dataset(one.vehicle, _lines(one, 0.0))
    placed = read_effect("droop_stop@front")
    posterior = where.posterior((placed,))
    names = posterior.space.names
    assert [n for n in names if n.startswith("input bias")] == [
        "input bias front 0",
        "input bias front 1",
    ]
    z = 0.1 * np.random.default_rng(3).standard_normal(len(names))
    at = names.index("input bias front 0")
    level = float(posterior.space.input_biases(z[None], 0)[0, 0])
    assert level == pytest.approx(0.15 * z[at])
    one_axle = np.array([level, 0.0])
    recording, known = where.recordings[0], where.sensor_corrections[0]
    lower = replace(
        recording,
        moments=recording.moments - one_axle[:, None] * known.unit_moments[:, None],
        reading=recording.reading - one_axle,
    )
    space = replace(posterior.space, recordings=(lower, where.recordings[1]))
    corrections = (replace(known, wheel=known.wheel - one_axle), where.sensor_corrections[1])
    without = z.copy()
    without[at] = 0.0
    expected, _, _ = replace(
        posterior, space=space, sensor_corrections=corrections
    ).innovations_and_variances(without, 0)
    found, _, _ = posterior.innovations_and_variances(z, 0)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_stop_is_found_where_it_is_though_wheels_read_wrong() -> None:
    """Readings off by 0.15 m/s² move the rest by 1 to 3 mm; a stop of 2 cm is found within 2 mm."""
    one = case("droop_stop@front-4000", 5, 1)
    truth = one.truth.effects[0].parameters
    rng = np.random.default_rng(4)
    runs = []
    for run in one.recordings:
        off = np.zeros(4)
        off[0] = 0.15 * rng.choice((-1.0, 1.0))
        runs.append(replace(run, values=run.values + off[:, None]))
    lines, _, _ = prepare_runs(runs, one.vehicle)
    _, stage = with_effects(make_dataset(one.vehicle, lines), (read_effect("droop_stop@front"),))
    (found,) = stage.space.effects(stage.mode.z).values()
    assert found["gap"] == pytest.approx(truth["gap"], abs=0.002)
    assert float(np.mean(stage.mode.slopes.nu**2)) < 1.1


def test_a_recording_begins_no_further_from_rest_than_the_car_goes() -> None:
    """A damper that bends, on a light car: with the true law, dry friction is not asked for.

    With an initial state that may be a decimetre away its score was 5.
    """
    one = case("digressive_damper-4000", 1, 0, "test")
    (true,) = one.truth.effects
    lines, _, _ = prepare_runs(one.recordings, one.vehicle)
    placed = read_effect(f"digressive_damper@{true.where}")
    where, stage = with_effects(make_dataset(one.vehicle, lines), (placed,))
    found = assess(where, stage, 1).test
    friction = [c.placed.effect.name == "coulomb_friction" for c in found.candidates]
    assert np.max(np.abs(found.standardized_scores[friction])) < 3.0
    (values,) = stage.space.effects(stage.mode.z).values()
    assert values["knee"] == pytest.approx(true.parameters["knee"], rel=0.15)


def test_a_filter_begins_where_the_whole_recording_shows() -> None:
    """A bump stop on a car that begins at rest, its sensors' zeros off by up to 0.6 m/s^2.

    With a beginning anywhere within the motion the filter took that for travel of 49 mm where there
    were 40, and met the stop before the drive began: from the true gap a fit lost 660 nats.
    """
    one = case("pair-40", 32, 4, "test")
    true = one.truth.effects[0]
    assert true.name == "bump_stop"
    lines, _, _ = prepare_runs(one.recordings, one.vehicle)
    where = make_dataset(one.vehicle, lines)
    for recording in where.recordings:
        assert np.all(np.sqrt(np.diag(recording.initial_covariance)[[0, 2]]) < 0.01)
    model = assess(where, fit_linear_car(where), 1)
    stops = [c for c in model.test.candidates if str(c.placed) == f"bump_stop@{true.where}"]
    gaps = [c.values["gap"] for c in stops]
    assert max(gaps) < 1.05 * true.parameters["gap"]
    fits = [fit_with_effect(model.denoised, model.model, [stops[k]]) for k in (2, 9)]
    best = [fit.mode.log_posterior - model.model.mode.log_posterior for fit in fits]
    assert best[0] == pytest.approx(best[1], abs=0.5)
    assert min(best) > 80.0
    (values,) = fits[0].space.effects(fits[0].mode.z).values()
    assert values["gap"] == pytest.approx(true.parameters["gap"], rel=0.08)
