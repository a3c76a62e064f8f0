"""Parts of the diagnosis, each on its own: pushes, jitter, engines, effects on both axles."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import kstest

from bayes_asv.diagnosis.denoised_model import clear, on_quiet_wheels
from bayes_asv.diagnosis.engine_force import without_engine
from bayes_asv.diagnosis.free_force_test import push_p, with_pushes
from bayes_asv.diagnosis.max_score_test import family_p, one_sided
from bayes_asv.diagnosis.model_search import asked, without
from bayes_asv.diagnosis.score_test import ScoreTest, signatures
from bayes_asv.diagnosis.timing_jitter_test import jitter
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import EFFECTS, Site
from bayes_asv.posterior.effect_candidates import Candidate, candidates
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, base, foretold, setting
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case
from tests.posterior.cases import EXACT, vehicle


@cache
def fitted(name: str) -> tuple[Dataset, FittedModel]:
    one = case(name, 5, 0)
    lines, reasons, _ = lay_out(one.recordings, one.vehicle)
    assert not reasons
    where = setting(one.vehicle, lines)
    stage = base(where)
    where = foretold(where, stage)
    return where, replace(stage, target=replace(stage.target, patterns=where.patterns))


def _edges(count: int, rng: np.random.Generator) -> ScoreTest:
    """Signatures of edges at both axles of one run: a kernel that dies away, whitened noise."""
    effect = EFFECTS["external_force"]
    wanted, signature = [], []
    for axle in ("front", "rear"):
        shape = rng.standard_normal(12)
        for k in range(count):
            row = np.zeros(6 * count + 20)
            row[6 * k : 6 * k + 12] = shape
            signature.append(row)
            values = {"force": 1.0, "start": 0.03 * k, "duration": 1e4, "rise": 0.03}
            wanted.append(Candidate(Site(effect, axle, 0), values, False, False, edge=True))
    found = np.array(signature)
    n = found.shape[1]
    none = np.zeros((0, n))
    here = ScoreAndInformation(np.zeros(n), np.zeros(n), none, none, 0.0, none[:, 0])
    return ScoreTest(tuple(wanted), found, np.zeros(len(found)), found @ found.T, here, none)


def test_the_best_push_is_the_best_of_all_pairs() -> None:
    rng = np.random.default_rng(3)
    edges = _edges(12, rng)
    for _ in range(20):
        pull = edges.rows @ rng.standard_normal(edges.rows.shape[1])
        found = with_pushes(replace(edges, pull=pull))
        best = 0.0
        for shares in ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5)):
            whole = shares[0] * edges.rows[:12] + shares[1] * edges.rows[12:]
            own = shares[0] * pull[:12] + shares[1] * pull[12:]
            for begin in range(12):
                for end in range(begin + 2, 13):
                    row = whole[begin] - (whole[end] if end < 12 else 0.0)
                    score = own[begin] - (own[end] if end < 12 else 0.0)
                    best = max(best, score**2 / float(row @ row))
        assert float(np.max(found.score**2)) == pytest.approx(best, rel=1e-9)


def test_a_push_that_is_not_there_has_any_p_value() -> None:
    """300 draws, seed 4; Kolmogorov's test at 0.1 %."""
    rng = np.random.default_rng(4)
    edges = _edges(8, rng)
    found = []
    for k in range(300):
        pull = edges.rows @ rng.standard_normal(edges.rows.shape[1])
        found.append(push_p(replace(edges, pull=pull), k))
    assert kstest(found, "uniform").pvalue > 1e-3


def test_a_push_is_as_rare_as_the_best_of_all_pairs_is_large() -> None:
    """600 draws of every pair one by one, seed 5; four deviations of the share that they give."""
    rng = np.random.default_rng(5)
    edges = _edges(8, rng)

    def largest() -> tuple[float, ScoreTest]:
        pull = edges.rows @ rng.standard_normal(edges.rows.shape[1])
        there = replace(edges, pull=pull)
        return float(np.max(with_pushes(there).score ** 2)), there

    drawn = np.array([largest()[0] for _ in range(600)])
    for _ in range(5):
        seen, there = largest()
        share = float(np.mean(drawn >= seen))
        p = push_p(there, 1)
        variance = max(share * (1.0 - share), 1e-3) / len(drawn) + p**2 / 50
        assert p == pytest.approx(share, abs=4.0 * np.sqrt(variance))


@pytest.mark.parametrize("size", [0.0, 4.0, 40.0])
def test_pushes_count_in_the_family_only_where_they_can_be_rarer(size: float) -> None:
    """The weights are those of Bonferroni whether pushes are asked or not."""
    rng = np.random.default_rng(6)
    edges = _edges(8, rng)
    plain = replace(edges.candidates[0], site=Site(EFFECTS["spring_rate"], "front"), edge=False)
    row = rng.standard_normal((1, edges.rows.shape[1]))
    rows = np.concatenate([row / np.linalg.norm(row), edges.rows])
    pull = rows @ rng.standard_normal(rows.shape[1])
    pull[0] = size
    both = replace(
        edges, candidates=(plain, *edges.candidates), rows=rows, pull=pull, gram=rows @ rows.T
    )
    alone = replace(both, candidates=(plain,), rows=rows[:1], pull=pull[:1], gram=both.gram[:1, :1])
    pushed = replace(both, pull=pull / np.sqrt(1.03))  # innovations are allowed to be 3 % louder
    expected = min(family_p(alone, 1), push_p(pushed, 1) / 0.2, 1.0)
    assert family_p(both, 1) == expected


def test_the_difference_of_two_edges_is_a_push() -> None:
    where, stage = fitted("null/bump~baja")
    edges = [c for c in candidates(stage, where.vehicle) if c.edge]
    quiet = clear(*on_quiet_wheels(where, stage))
    found = with_pushes(signatures(quiet, edges))
    direct = signatures(quiet, list(found.candidates))
    error = np.abs(found.rows - direct.rows).max(axis=1)
    assert np.all(error < 1e-3 * np.abs(direct.rows).max(axis=1))
    np.testing.assert_allclose(found.score, direct.score, atol=0.01)


def test_a_push_between_edges_keeps_most_of_what_it_tells() -> None:
    """Begun and ended half way between them; of edges every 30 ms it keeps 0.27."""
    where, stage = fitted("null/bump~baja")
    quiet = clear(*on_quiet_wheels(where, stage))
    every = candidates(stage, where.vehicle)
    edges = [c for c in every if c.edge and str(c.site) == "external_force@rear" and not c.site.run]
    step = edges[1].values["start"] - edges[0].values["start"]
    between = {"start": edges[40].values["start"] + 0.5 * step, "duration": 11.0 * step}
    push = replace(edges[0], values={**edges[0].values, **between, "rise": 0.02}, edge=False)
    gram = signatures(quiet, [push, *edges]).gram
    pairs = gram[0, 1:, None] - gram[0, None, 1:]
    own = np.diag(gram)[1:]
    information = own[:, None] + own[None] - 2.0 * gram[1:, 1:]
    later = np.triu(np.ones_like(information, bool), 2)
    kept = pairs[later] ** 2 / information[later] / gram[0, 0]
    assert np.max(kept) > 0.7


@pytest.mark.parametrize(("name", "seen"), [("null/bump~baja", 0), ("hidden_jitter-4000", 1)])
def test_jitter_is_seen_in_the_variance(name: str, seen: int) -> None:
    p, channel = jitter(*fitted(name))
    assert (p < 1e-3) == bool(seen)
    assert channel


@pytest.mark.parametrize(
    ("name", "there"), [("progressive_spring@rear-4000", 0), ("engine_vibration@both-400", 1)]
)
def test_lines_near_the_cars_own_frequencies_are_no_engine(name: str, there: int) -> None:
    where, stage = fitted(name)
    found = asked(where, stage, 1).found
    known = float(one_sided(found.score, found).max())
    _, _, engine, _ = without_engine(where, stage, (), base, base, known)
    assert (engine is not None) == bool(there)


def test_on_both_axles_a_law_acts_twice_and_a_push_in_halves() -> None:
    car = car_model("half", vehicle(EXACT))
    friction = Site(EFFECTS["coulomb_friction"], "both")
    table = law_table(car, {friction: {"force": 3.0, "slip": 0.01}}, 0)
    assert table[:, 0].tolist() == [0.0, 1.0]
    assert table[:, 2].tolist() == [3.0, 3.0]
    push = Site(EFFECTS["external_force"], "both", 0)
    table = law_table(car, {push: {"force": 3.0, "start": 1.0, "duration": 0.2, "rise": 0.03}}, 0)
    assert table[:, 2].tolist() == [1.5, 1.5]
    assert friction.meets(Site(EFFECTS["coulomb_friction"], "rear"))
    assert not friction.meets(Site(EFFECTS["bound_rebound"], "rear"))


def test_without_any_effect_a_model_is_the_linear_car_again() -> None:
    """Wherever what was taken out had drawn it."""
    where, stage = fitted("null/bump")
    astray = np.full_like(stage.mode.z, 9.0)
    model = asked(where, stage, 1)
    away = replace(model, stage=replace(stage, mode=replace(stage.mode, z=astray)))
    again, kept = without(away, [], [], 1)
    assert not kept
    np.testing.assert_allclose(again.stage.mode.z, stage.mode.z, atol=0.05)
