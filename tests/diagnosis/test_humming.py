"""Tones that wander are heard in all runs together, and silence is not."""

from __future__ import annotations

import math

import numpy as np

from bayes_asv.diagnosis.humming import humming


def test_white_runs_seldom_hum() -> None:
    """400 pairs of runs, seed 1, asked for 2 % false ones: at most 4 %, three deviations."""
    rng = np.random.default_rng(1)
    heard = sum(
        bool(humming([rng.normal(size=(1000, 2)), rng.normal(size=(900, 2))], 400.0, 10.0, 0.02))
        for _ in range(400)
    )
    assert heard <= 16


def test_a_weak_tone_that_wanders_is_heard_where_it_is() -> None:
    """A tone that wanders by 3 %, whose energy in two runs is 120: 20 draws, seed 2."""
    rng = np.random.default_rng(2)
    t = np.arange(1000) / 400.0
    near = 0
    for _ in range(20):
        runs = []
        for _ in range(2):
            drift = 1.0 + 0.03 * np.sin(2.0 * math.pi * (0.4 * t + rng.random()))
            tone = np.sin(2.0 * math.pi * np.cumsum(31.0 * drift) / 400.0 + 6.28 * rng.random())
            nu = rng.normal(size=(1000, 2))
            runs.append(nu + tone[:, None] * math.sqrt(30.0 / float(tone @ tone)))
        found = humming(runs, 400.0, 10.0, 2e-3)
        near += bool(found) and abs(found[0].frequency - 31.0) < 2.5
    assert near >= 12


def test_a_jolt_that_rings_is_no_engine() -> None:
    """Bursts at 12 Hz, a tenth of a second long, of energy 80 a run: 20 draws, seed 3."""
    rng = np.random.default_rng(3)
    t = np.arange(1000) / 400.0
    heard = 0
    for _ in range(20):
        runs = []
        for _ in range(2):
            burst = np.exp(-(((t - 1.6) / 0.1) ** 2)) * np.sin(2.0 * math.pi * 12.0 * (t - 1.6))
            nu = rng.normal(size=(1000, 2))
            runs.append(nu + burst[:, None] * math.sqrt(40.0 / float(burst @ burst)))
        heard += bool(humming(runs, 400.0, 10.0, 0.05))
    assert heard <= 2
