"""Max-score test: force pulses as pairs of steps, and their share of the family-wise error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from bayes_asv.diagnosis.denoised_model import denoised_model, fit_denoised
from bayes_asv.diagnosis.score_test import (
    ScoreTest,
    family_p_value,
    pulse_p_value,
    score_test,
    with_best_pulses,
)
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import EFFECTS, PlacedEffect
from bayes_asv.posterior.effect_fit import Candidate, candidates
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel
from tests.battery.cases import case
from tests.diagnosis.models import fit_linear, prepared


def _linear(name: str) -> tuple[Dataset, FittedModel]:
    one = case(name, 5, 0)
    return fit_linear(prepared(one.recordings, one.vehicle))


def _steps(count: int, rng: np.random.Generator) -> ScoreTest:
    """Steps of a force at both axles of one run: a response that dies away, in white noise."""
    effect = EFFECTS["external_force"]
    steps, sensitivities = [], []
    for axle in ("front", "rear"):
        response = rng.standard_normal(12)
        for k in range(count):
            row = np.zeros(6 * count + 20)
            row[6 * k : 6 * k + 12] = response
            sensitivities.append(row)
            values = {"force": 1.0, "start": 0.03 * k, "duration": 1e4, "rise": 0.03}
            steps.append(
                Candidate(PlacedEffect(effect, axle, 0), values, False, False, is_step=True)
            )
    g = np.array(sensitivities)
    n = g.shape[1]
    none = np.zeros((0, n))
    derivatives = ScoreAndInformation(np.zeros(n), np.zeros(n), none, none, 0.0, none[:, 0])
    return ScoreTest(tuple(steps), g, np.zeros(len(g)), g @ g.T, derivatives, none)


def _with_noise(steps: ScoreTest, rng: np.random.Generator) -> ScoreTest:
    noise = rng.standard_normal(steps.sensitivities.shape[1])
    return replace(steps, gradient=steps.sensitivities @ noise)


def test_the_best_pulse_is_the_best_of_all_pairs_of_steps() -> None:
    rng = np.random.default_rng(3)
    steps = _steps(12, rng)
    g = steps.sensitivities
    for _ in range(20):
        test = _with_noise(steps, rng)
        best = 0.0
        for front, rear in ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5)):
            sensitivity = front * g[:12] + rear * g[12:]
            gradient = front * test.gradient[:12] + rear * test.gradient[12:]
            for begin in range(12):
                for end in range(begin + 2, 13):
                    pulse = sensitivity[begin] - (sensitivity[end] if end < 12 else 0.0)
                    along = gradient[begin] - (gradient[end] if end < 12 else 0.0)
                    best = max(best, along**2 / float(pulse @ pulse))
        found = with_best_pulses(test)
        assert float(np.max(found.standardized_scores**2)) == pytest.approx(best, rel=1e-9)


def test_without_a_pulse_the_p_value_is_uniform() -> None:
    """300 draws, seed 4; Kolmogorov's test at 0.1 %."""
    rng = np.random.default_rng(4)
    steps = _steps(8, rng)
    p_values = [pulse_p_value(_with_noise(steps, rng), k) for k in range(300)]
    assert kstest(p_values, "uniform").pvalue > 1e-3


def test_the_p_value_of_a_pulse_is_that_of_the_largest_of_all_pairs() -> None:
    """600 draws of every pair one by one, seed 5; within four standard deviations."""
    rng = np.random.default_rng(5)
    steps = _steps(8, rng)

    def largest() -> tuple[float, ScoreTest]:
        test = _with_noise(steps, rng)
        return float(np.max(with_best_pulses(test).standardized_scores ** 2)), test

    drawn = np.array([largest()[0] for _ in range(600)])
    for _ in range(5):
        observed, test = largest()
        share = float(np.mean(drawn >= observed))
        p = pulse_p_value(test, 1)
        variance = max(share * (1.0 - share), 1e-3) / len(drawn) + p**2 / 50
        assert p == pytest.approx(share, abs=4.0 * np.sqrt(variance))


@pytest.mark.parametrize("score", [0.0, 4.0, 40.0])
def test_the_family_wise_error_is_shared_whether_pulses_are_drawn_or_not(score: float) -> None:
    """The weights are those of Bonferroni."""
    rng = np.random.default_rng(6)
    steps = _steps(8, rng)
    spring = replace(
        steps.candidates[0], placed=PlacedEffect(EFFECTS["spring_rate"], "front"), is_step=False
    )
    row = rng.standard_normal((1, steps.sensitivities.shape[1]))
    g = np.concatenate([row / np.linalg.norm(row), steps.sensitivities])
    gradient = g @ rng.standard_normal(g.shape[1])
    gradient[0] = score
    both = replace(
        steps,
        candidates=(spring, *steps.candidates),
        sensitivities=g,
        gradient=gradient,
        information=g @ g.T,
    )
    alone = replace(
        both,
        candidates=(spring,),
        sensitivities=g[:1],
        gradient=gradient[:1],
        information=both.information[:1, :1],
    )
    scaled = replace(both, gradient=gradient / np.sqrt(1.03))  # variance of a score
    expected = min(family_p_value(alone, 1), pulse_p_value(scaled, 1) / 0.2, 1.0)
    assert family_p_value(both, 1) == expected


def test_the_difference_of_two_steps_is_a_pulse() -> None:
    dataset, model = _linear("null/bump~baja")
    steps = [c for c in candidates(model, dataset.vehicle) if c.is_step]
    denoised = denoised_model(*fit_denoised(dataset, model))
    found = with_best_pulses(score_test(denoised, steps))
    direct = score_test(denoised, list(found.candidates))
    error = np.abs(found.sensitivities - direct.sensitivities).max(axis=1)
    assert np.all(error < 1e-3 * np.abs(direct.sensitivities).max(axis=1))
    np.testing.assert_allclose(found.standardized_scores, direct.standardized_scores, atol=0.01)


def test_a_pulse_between_two_steps_keeps_most_of_its_information() -> None:
    """It begins and ends half way between them; with steps every 30 ms it keeps 0.27."""
    dataset, model = _linear("null/bump~baja")
    denoised = denoised_model(*fit_denoised(dataset, model))
    steps = [
        c
        for c in candidates(model, dataset.vehicle)
        if c.is_step and str(c.placed) == "external_force@rear" and not c.placed.run
    ]
    step = steps[1].values["start"] - steps[0].values["start"]
    between = {"start": steps[40].values["start"] + 0.5 * step, "duration": 11.0 * step}
    pulse = replace(steps[0], values={**steps[0].values, **between, "rise": 0.02}, is_step=False)
    joint = score_test(denoised, [pulse, *steps]).information
    cross = joint[0, 1:, None] - joint[0, None, 1:]
    own = np.diag(joint)[1:]
    information = own[:, None] + own[None] - 2.0 * joint[1:, 1:]
    later = np.triu(np.ones_like(information, bool), 2)
    kept = cross[later] ** 2 / information[later] / joint[0, 0]
    assert np.max(kept) > 0.7


def test_at_both_axles_a_force_law_acts_twice_and_a_pulse_in_halves() -> None:
    car = car_model("half", case("null/bump~baja", 5, 0).vehicle)
    friction = PlacedEffect(EFFECTS["coulomb_friction"], "both")
    table = law_table(car, {friction: {"force": 3.0, "slip": 0.01, "presliding": 2e-4}}, 0)
    assert table[:, 0].tolist() == [0.0, 1.0]
    assert table[:, 2].tolist() == [3.0, 3.0]
    pulse = PlacedEffect(EFFECTS["external_force"], "both", 0)
    values = {"force": 3.0, "start": 1.0, "duration": 0.2, "rise": 0.03}
    assert law_table(car, {pulse: values}, 0)[:, 2].tolist() == [1.5, 1.5]
    assert friction.overlaps(PlacedEffect(EFFECTS["coulomb_friction"], "rear"))
    assert not friction.overlaps(PlacedEffect(EFFECTS["bound_rebound"], "rear"))
