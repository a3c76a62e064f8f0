"""The bench in small: draws from the model, drives of the rig, and intervals that must hold.

Records are short and slow so that a run takes a fifth of a second.  A right estimator fails a
test here less than once in 10 000 times by chance (union over what the test looks at).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from benchmarks.calibration.cells import MODEL, NAMES, TERRAIN_NAMES, Cell, Group
from benchmarks.calibration.posterior import ENOUGH
from benchmarks.calibration.run import LOG_LIKELIHOOD, Row, one
from benchmarks.calibration.uniformity import departure

RUNS = 24
CHANCE = 1e-4
SHORT = Group("short", "Short form")
CELLS = [Cell(SHORT, t, rate=200.0, seconds=1.2, checked=0) for t in TERRAIN_NAMES]


@pytest.fixture(scope="module")
def model_rows() -> list[Row]:
    """Draws from the model, seed 11."""
    cell = Cell(SHORT, MODEL, rate=200.0, seconds=1.0, checked=0)
    return [one(cell, 11, run) for run in range(RUNS)]


@pytest.fixture(scope="module")
def rig_rows() -> list[Row]:
    """Drives of the rig over each terrain in turn, seed 12."""
    return [one(CELLS[run % len(CELLS)], 12, run) for run in range(RUNS)]


def test_truths_of_the_model_lie_anywhere_in_their_posteriors(model_rows: list[Row]) -> None:
    """Simulation-based calibration: every quantity and the log-likelihood."""
    names = list(model_rows[0].places)
    assert LOG_LIKELIHOOD in names
    assert len(names) == 14
    for name in names:
        places = np.array([row.places[name] for row in model_rows])
        assert departure(places) > CHANCE / len(names), name


def test_intervals_hold_the_truth_of_the_rig(rig_rows: list[Row]) -> None:
    """Hits of 95 % and 50 % intervals are no fewer than chance allows; at 50 % no more either."""
    answers = [row for row in rig_rows if row.places]
    assert len(answers) >= RUNS - 1
    share = CHANCE / (3 * len(NAMES))
    for name in NAMES:
        places = np.array([row.places[name] for row in answers])
        hits = np.count_nonzero(np.abs(places - 0.5) <= 0.475)
        assert hits >= binom.ppf(share, len(places), 0.95), name
        hits = np.count_nonzero(np.abs(places - 0.5) <= 0.25)
        assert binom.ppf(share, len(places), 0.5) <= hits, name
        assert hits <= binom.isf(share, len(places), 0.5), name


def test_widths_are_near_the_bound(rig_rows: list[Row]) -> None:
    for name in NAMES:
        ratio = [row.widths[name] / row.bounds[name] for row in rig_rows if row.places]
        assert 0.85 < np.median(ratio) < 1.3, name


def test_weights_were_fit_to_be_trusted(model_rows: list[Row], rig_rows: list[Row]) -> None:
    answers = [row for row in (*model_rows, *rig_rows) if row.places]
    assert all(row.effective >= ENOUGH for row in answers)
    assert np.mean([row.how == "512" for row in answers]) > 0.8


def test_a_run_is_the_same_again(rig_rows: list[Row]) -> None:
    assert one(CELLS[5 % len(CELLS)], 12, 5) == rig_rows[5]
    assert rig_rows[1].places != rig_rows[5].places  # the same terrain
