"""What no listed effect explains joins the model without a name, and the held-out error falls."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.denoised_model import denoised_model
from bayes_asv.diagnosis.fault_regression import _Scores, regress_on_unlisted_faults
from bayes_asv.diagnosis.model_comparison import draw_quantities, weighted_posterior
from bayes_asv.diagnosis.simulation_error import compare_errors
from bayes_asv.diagnosis.unlisted_fault_models import FaultTerm, fault_terms
from bayes_asv.models.effects import EFFECTS, PlacedEffect
from bayes_asv.posterior.fitted_model import FittedModel, fit_again, make_dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Perturbation
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.battery.cases import case
from tests.diagnosis.models import assess_case, prepared


@pytest.mark.parametrize(
    ("name", "like", "least"),
    [
        # a resonance on the car, off the grid of frequencies, and one of an input's sensor, which
        # reads several times what is there
        ("panel_resonance-4000", ("a sensor mount that resonates", "(rear chassis)"), 0.85),
        ("bracket_resonance-4000", ("a sensor mount that resonates", "(rear wheel)"), 0.9),
    ],
)
def test_the_held_out_error_falls(name: str, like: tuple[str, str], least: float) -> None:
    one, assessed = case(name, 191, 0, "dev"), assess_case(name, 191, 0, "dev")
    holdout = prepared(one.holdout, one.vehicle)
    regression = regress_on_unlisted_faults(assessed, holdout)
    assert regression is not None
    cause = regression.causes[0]
    assert (cause.kind, cause.place) == like
    error = compare_errors(
        holdout, assessed.model, regression.assessed.model, 1, perturbed=regression.holdout
    )
    assert error.closed is not None
    assert error.closed > least
    found = regression.assessed
    draws = draw_quantities(weighted_posterior(found.model, found.evidence), 1)
    for parameter, (low, high) in one.truth.meant.items():
        if parameter in ("c_f", "c_r", "i"):
            begin, end = np.quantile(draws[parameter], [0.001, 0.999])
            assert begin < high, parameter
            assert end > low, parameter


def test_a_fault_with_the_opposite_sign_has_its_own_name() -> None:
    """A damper in a soft mount, which acts against an inertia."""
    regression = regress_on_unlisted_faults(assess_case("maxwell_mount-20000", 191, 0, "dev"), None)
    assert regression is not None
    cause = regression.causes[0]
    assert (cause.kind, cause.element) == ("a damper in a soft mount", "rear")


def test_a_free_law_contains_every_function_of_its_variable() -> None:
    dataset = assess_case("null/bump~baja", 3, 0, "dev").denoised
    car, terms = dataset.recordings[0].car, fault_terms(dataset, np.array([0.01, 0.01]))
    for law, at, fault in (
        ("damper_curve", "rear", ("a progressive damper", "at the rear")),
        ("spring_curve", "front", ("an asymmetric spring", "at the front")),
    ):
        placed = PlacedEffect(EFFECTS[law], at)
        assert {term.fault for term in terms if term.kind.within(placed, car)} == {fault}
    placed = PlacedEffect(EFFECTS["damper_hysteresis"], "rear")
    assert not any(term.kind.within(placed, car) for term in terms)


def test_an_exact_car_needs_nothing() -> None:
    one = case("null/bump~baja", 3, 0)
    holdout = prepared(one.holdout, one.vehicle)
    assert regress_on_unlisted_faults(assess_case("null/bump~baja", 3, 0, "dev"), holdout) is None


def test_faults_with_which_the_fit_diverges_explain_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fitted = []

    def diverging(*given: Any) -> FittedModel:
        fitted.append(fit_again(*given))
        mode = fitted[-1].mode
        slopes = replace(mode.slopes, means=1e30 * mode.slopes.means)
        return replace(fitted[-1], mode=replace(mode, slopes=slopes))

    monkeypatch.setattr("bayes_asv.diagnosis.fault_regression.fit_again", diverging)
    assessed = assess_case("panel_resonance-4000", 191, 0, "dev")
    assert regress_on_unlisted_faults(assessed, None) is None
    assert len(fitted) == 1


def test_no_fault_is_larger_a_priori_than_is_usual() -> None:
    """Two faults that do not resemble each other, one of which is usually small."""
    kinds: list[Any] = [
        SimpleNamespace(name=name, place="front", usual=usual)
        for name, usual in (("small", 0.5), ("any", 50.0))
    ]
    gradient, own, factor = np.array([30.0, -30.0]), 100.0, 2.0
    scores = _Scores(
        tuple(FaultTerm(kind, ()) for kind in kinds), np.sqrt(own) * np.eye(2),
        np.full(2, factor), gradient, own * np.eye(2),
    )  # fmt: skip
    found = scores.regression({("small", "front"): 4.0, ("any", "front"): 4.0})
    deviation = np.array([0.5 / factor, 4.0])
    assert found.sizes == pytest.approx(factor * gradient / (own + deviation**-2))
    gain = scores.log_bayes_factor({("small", "front"): 4.0, ("any", "front"): 4.0})
    widened = 1.0 + own * deviation**2
    each = (deviation * gradient) ** 2 / widened - np.log(widened)
    assert gain == pytest.approx(0.5 * each.sum())


def test_known_changes_of_the_readings_are_those_of_the_recording() -> None:
    """A recording and its changes are as good as the changed recording."""
    one = case("null/bump~baja", 3, 0)
    runs, _, _ = prepare_runs(one.recordings[:1], one.vehicle)
    dataset = make_dataset(one.vehicle, runs)
    (recording,) = dataset.recordings
    wave = np.sin(30.0 * recording.instants)
    change = Perturbation(
        np.zeros_like(recording.moments),
        0.1 * np.outer(wave, [1.0, -2.0]) * (recording.kind != 0),
        np.zeros((len(recording.elapsed), 2)),
    )
    known = replace(dataset, perturbations=(change,)).posterior(())
    changed = replace(recording, reading=recording.reading + change.reading)
    other = replace(dataset, recordings=(changed,)).posterior(())
    z = 0.3 * np.random.default_rng(1).standard_normal((3, known.space.dimension))
    assert np.allclose(known.log_posterior(z), other.log_posterior(z), rtol=0.0, atol=1e-6)
    assert np.allclose(known.innovations(z[0], 0), other.innovations(z[0], 0), atol=1e-9)
    # what the sensors read beyond what was declared belongs to the simulated reading
    expected = free_run(other, z[0], 0).output - change.reading
    assert np.allclose(free_run(known, z[0], 0).output, expected, atol=1e-9)


def test_a_known_force_moves_the_simulation_as_it_moves_the_filter() -> None:
    """The innovations are linear in a force: adding it twice changes them twice."""
    assessed = assess_case("null/bump~baja", 3, 0, "dev")
    model = assessed.model
    at = denoised_model(assessed.denoised, model).filters[0]
    recording = assessed.denoised.recordings[0]
    force = np.outer(np.sin(12.0 * recording.elapsed), [30.0, 0.0])
    nothing = Perturbation(
        np.zeros_like(recording.moments), np.zeros_like(recording.reading), 0.0 * force
    )
    once = at.response(nothing._replace(force=force))
    others = tuple(
        Perturbation(np.zeros_like(r.moments), np.zeros_like(r.reading), np.zeros((len(r.step), 2)))
        for r in assessed.denoised.recordings[1:]
    )
    with_force = replace(
        assessed.denoised, perturbations=(nothing._replace(force=force), *others)
    ).posterior(model.placed_effects)
    own = with_force.innovations_and_variances(model.mode.z, 0)[0][at.has_reading]
    assert np.allclose(at.innovations[at.has_reading] - own, once, atol=1e-6)
    twice = at.response(nothing._replace(force=2.0 * force))
    assert np.allclose(twice, 2.0 * once, atol=1e-5)
    still, moved = (
        free_run(posterior, model.mode.z, 0).output for posterior in (model.posterior, with_force)
    )
    assert np.std(moved - still) > 1e-3
