"""The band of real road drives, where they lie beside the project; nobody knows their truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.preprocessing.data_checks import suggest_band
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import prepared

DRIVES = Path(__file__).resolve().parents[3] / "shared" / "data" / "roomster"

pytestmark = pytest.mark.skipif(
    not DRIVES.is_dir(), reason="the road drives do not travel with the project"
)


def _drive(name: str) -> Recording:
    return read_recording(DRIVES / f"drive{name}.csv")


def _below_4(recording: Recording) -> MapFit:
    car = read_vehicle(DRIVES / "roomster.toml")
    lines, reasons, _ = prepare_runs((recording,), car, 4.0)
    assert not reasons
    return best_fit(lines, car)


@pytest.mark.parametrize("name", ["04_1", "06_1", "08_1", "08_2"])
def test_the_mend_is_the_band_that_the_wheels_explain(name: str) -> None:
    car = read_vehicle(DRIVES / "roomster.toml")
    line = prepared(_drive(name), car)
    (said,) = suggest_band(line, np.array([1.0, 0.8]), 5.0)  # as a fit at full band may leave it
    assert said.endswith("try 'bayes-asv estimate --below 4'")
    assert suggest_band(line, np.array([0.2, 0.1]), 5.0) == []


def test_two_drives_in_the_band_tell_of_one_car() -> None:
    fits = [_below_4(_drive(name)) for name in ("06_1", "08_1")]
    answers = []
    for fit in fits:
        assert fit.reasons == ()
        assert fit.mode.converged
        assert fit.posterior.space.likelihood == "coloured"
        (share,) = fit.shares
        assert share is not None
        assert 0.1 < share < 0.9  # less steady than it looks, and not worthless
        car = fit.space.cars(fit.mode.z[None])[0]
        answers.append(
            [
                (np.log(car[k]), fit.space.log_deviation(fit.mode.covariance, n))
                for k, n in enumerate(("c_f", "c_r", "i"))
            ]
        )
    for (one, own), (other, sd) in zip(*answers, strict=True):
        assert abs(one - other) < 2.5 * np.hypot(own, sd)
        assert 0.03 < own < 0.2


def test_a_chassis_that_the_wheels_did_not_move_is_refused() -> None:
    recording = _drive("08_1")
    rows = slice(1000, 2800)
    values = recording.values[:, rows].copy()
    values[[1, 3]] = values[[1, 3], ::-1]
    fit = _below_4(replace(recording, time=recording.time[rows], values=values))
    assert any("explains only" in reason for reason in fit.reasons)
