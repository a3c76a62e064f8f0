"""How sure an engine is, from how often white runs hum as loudly."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit

from bayes_asv.diagnosis.engine_force import probability
from bayes_asv.diagnosis.model_comparison import NONE
from bayes_asv.diagnosis.tone_detection import humming


@given(st.floats(-1e4, -1.0), st.floats(0.0, 1e4))
def test_the_rarer_the_surer(log_p: float, more: float) -> None:
    assert 0.0 < probability(0.0) <= probability(log_p) <= probability(log_p - more) <= 1.0


@given(st.floats(-300.0, -1.01))
def test_odds_are_those_of_the_bound(log_p: float) -> None:
    p = math.exp(log_p)
    factor = -1.0 / (math.e * p * math.log(p))
    prior = (1.0 - NONE) / 15.0 / NONE  # fourteen effects, and an engine
    assert math.isclose(probability(log_p), expit(math.log(prior * factor)), rel_tol=1e-9)


def test_a_faint_tone_is_not_certain_and_a_loud_one_is() -> None:
    """A tone at 30 Hz in two runs of 2.5 s; energies 45 and 400, seed 10."""
    rng = np.random.default_rng(10)
    t = np.arange(1000) / 400.0

    def sure(energy: float) -> float:
        size = math.sqrt(energy / 2.0 / 1000.0)
        tone = size * np.sin(2.0 * math.pi * 30.0 * t)[:, None]
        runs = [rng.normal(size=(1000, 2)) + tone for _ in range(2)]
        return probability(humming(runs, 400.0, 10.0, 0.05).log_p)

    faint = [sure(45.0) for _ in range(20)]
    assert float(np.median(faint)) > 0.2
    assert min(faint) < 0.9
    assert all(sure(400.0) > 0.999 for _ in range(5))
