"""The last interval of the online filter against the posterior of the whole recording."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.estimation import estimate
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, EXACT, case, vehicle
from tests.tracking.drives import tracked

NAMES = ("c_f", "c_r", "i")
DRIVES = [("bump", 41), ("bump", 42), ("stops", 41), ("stops", 42),
          ("rough", 41), ("rough", 42), ("rollers", 41), ("rollers", 42)]  # fmt: skip


def test_last_estimate_agrees_with_the_map_estimate() -> None:
    """Mode and curvature of the posterior over eight drives, given values exact.

    The posterior has a noise level for each sensor, the filter one factor for each axle, so that
    the widths differ by what two seconds tell about the noise.
    """
    shifts, ratios = [], []
    for terrain, seed in DRIVES:
        _, _, recording = case(terrain, seed, EXACT)
        lines, _, _ = prepare_runs([recording], vehicle(EXACT))
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


def test_last_interval_agrees_with_the_sampled_posterior() -> None:
    """Overlap of both 95 % intervals, with uncertain given values; seed 43."""
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
