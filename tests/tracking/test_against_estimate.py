"""The last interval of the online filter against the whole posterior, on the same drives."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.estimation import estimate
from bayes_asv.posterior.map_fit import best_fit, lay_out
from tests.posterior.cases import DECLARED, EXACT, case, vehicle
from tests.tracking.drives import tracked

NAMES = ("c_f", "c_r", "i")
DRIVES = [("bump", 41), ("bump", 42), ("stops", 41), ("stops", 42),
          ("rough", 41), ("rough", 42), ("rollers", 41), ("rollers", 42)]  # fmt: skip


def test_it_ends_where_the_posterior_of_the_whole_recording_is() -> None:
    """Eight drives, given values exact, so that mass and springs do not make all widths alike.

    Mode and curvature of the posterior that learns the noise of each sensor too; the filter learns
    one level for an axle, so that its widths differ by as much as two seconds tell of noise.
    """
    shifts, ratios = [], []
    for terrain, seed in DRIVES:
        _, _, recording = case(terrain, seed, EXACT)
        lines, _, _ = lay_out([recording], vehicle(EXACT))
        found = best_fit(lines, vehicle(EXACT))
        mode = found.space.cars(found.mode.z[None])[0]
        _, frames = tracked(recording, vehicle(EXACT))
        for k, name in enumerate(NAMES):
            sd = found.space.log_deviation(found.mode.covariance, name)
            shifts.append(abs(np.log(frames.median[-1, k] / mode[k])) / sd)
            ratios.append(frames.log_sd[-1, k] / sd)
    assert np.max(shifts) < 0.5
    assert np.median(shifts) < 0.15
    assert np.min(ratios) > 0.8
    assert np.max(ratios) < 1.25
    assert np.median(ratios) == pytest.approx(1.0, abs=0.08)


def test_its_interval_is_the_one_that_estimate_samples() -> None:
    """With given values uncertain: share of both intervals that they have in common; seed 43."""
    _, _, recording = case("stops", 43, DECLARED)
    car = vehicle(DECLARED)
    sampled = estimate([recording], car, seed=1)
    assert sampled.verdict == "ok"
    _, frames = tracked(recording, car)
    for k, name in enumerate(NAMES):
        values = sampled.draws[name]
        low, high = np.quantile(values, [0.025, 0.975])
        ends = frames.median[-1, k] * np.exp(1.96 * frames.log_sd[-1, k] * np.array([-1.0, 1.0]))
        common = min(high, ends[1]) - max(low, ends[0])
        assert common > 0.88 * (max(high, ends[1]) - min(low, ends[0]))
