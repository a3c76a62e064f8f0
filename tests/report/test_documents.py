"""Documents of results that the commands' own tests do not reach: recordings with more channels."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording
from bayes_asv.posterior.fitted_model import fit_linear_car, make_dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.report.documents.estimate import estimate_document
from bayes_asv.report.page import report_page
from bayes_asv.report.schema import EstimateDocument, read_saved
from bayes_asv.shipped import shipped
from tests.report.conftest import figures, table, without_pictures


@pytest.fixture(scope="module")
def document() -> EstimateDocument:
    """Document of an estimate with a travel sensor at the front, made from the simulation."""
    car = read_vehicle(shipped("vehicles", "baja2008.toml"))
    run = read_recording(shipped("recordings", "stops-400hz.csv"))
    lines, _, _ = prepare_runs((run,), car)
    fit = fit_linear_car(make_dataset(car, lines))
    states = free_run(fit.posterior, fit.mode.z, 0).states  # behind the accelerometers' filter
    moved = states[:, 0] + states[:, 1] / fit.posterior.sensor_corrections[0].pole
    deflection = np.interp(run.time, lines[0].instants, moved)
    noise = np.random.default_rng(5).normal(scale=2e-4, size=len(run.time))
    more = replace(
        run,
        channels=(*run.channels, "front_travel"),
        units=(*run.units, "m"),
        values=np.vstack([run.values, deflection + noise]),
    )
    return estimate_document(estimate([more], car))


def test_a_travel_sensor_is_in_the_document(document: EstimateDocument, tmp_path: Path) -> None:
    assert document.verdict == "ok"
    (run,) = document.runs
    assert list(run.chassis) == ["front_chassis", "rear_chassis"]
    assert list(run.outputs) == ["front_travel"]
    assert run.outputs["front_travel"].unit == "in"
    travel = np.array(run.outputs["front_travel"].measured, dtype=float)
    # the travel of a run is that behind the filter of its accelerometers, 3 ms later
    shown = np.array(run.travel.entries["front"].deflection, dtype=float)
    assert np.sqrt(np.mean((travel - shown) ** 2)) < 0.05 * np.sqrt(np.mean(travel**2))
    assert "front_travel" in run.missing
    fit = document.fit.entries["front_travel"].nrmse_percent
    assert fit is not None
    assert 0.0 < fit < 10.0
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(document.to_dict()), encoding="utf-8")
    assert read_saved(file) == document


def test_a_travel_sensor_is_in_the_report(document: EstimateDocument) -> None:
    with without_pictures():
        drawn = figures(document)
        page, _ = report_page(document)
    assert [p.key for p in drawn["run-0"].panels] == [
        "motion-front-0", "motion-rear-0", "motion-front-travel-0", "wheels-0",
        "spectrum-front-0", "spectrum-front-travel-0", "whiteness-0", "travel-0",
    ]  # fmt: skip
    fits = table(document, "Fit of the simulation")
    assert fits is not None
    assert fits.columns[-1] == "front travel, rms error"
    assert [p["key"] for p in page["overview"]["panels"]] == [
        "overview-front", "overview-rear", "overview-front-travel",
    ]  # fmt: skip


def test_shares_of_time_by_speed_follow_the_velocity(document: EstimateDocument) -> None:
    (run,) = document.runs
    travel = run.travel
    assert travel.low_speed == pytest.approx(0.025 / 0.0254)  # in/s
    for curves in travel.entries.values():
        velocity = np.array(curves.velocity, dtype=float)
        assert sum(share.mean for share in curves.speed_shares) == pytest.approx(1.0)
        for share in curves.speed_shares:
            side = velocity <= 0.0 if share.side == "compression" else velocity > 0.0
            fast = np.abs(velocity) > travel.low_speed
            here = side & (fast if share.speed == "high" else ~fast)
            assert share.mean == pytest.approx(float(np.mean(here)), abs=0.02)
            low, high = share.eti95
            assert 0.0 <= low <= high <= 1.0
            assert low - 0.02 <= share.mean <= high + 0.02


def test_the_force_of_a_linear_damper_is_rate_times_velocity(document: EstimateDocument) -> None:
    for name, force in document.forces.items():
        rate = document.parameters[f"c_{name[0]}"]
        for v, median, low, high, nominal in zip(
            force.velocity, force.median, *force.band95, force.nominal or [], strict=True
        ):
            assert None not in (v, median, low, high, nominal)
            assert median == pytest.approx((rate.median or 0.0) * (v or 0.0), rel=1e-3, abs=1e-6)
            assert nominal == pytest.approx((rate.nominal or 0.0) * (v or 0.0), rel=1e-3, abs=1e-6)
            edges = sorted(end * (v or 0.0) for end in rate.eti95)
            assert [low, high] == pytest.approx(edges, rel=1e-3, abs=1e-6)


def test_transmissibility_is_one_of_slow_motion_and_small_of_fast(
    document: EstimateDocument,
) -> None:
    (run,) = document.runs
    for curves in run.chassis.values():
        curve = curves.transmissibility
        assert curve is not None
        measured, simulated = (np.array(x, float) for x in (curve.measured, curve.simulated))
        np.testing.assert_allclose(measured, simulated, rtol=0.1)
        assert 0.5 < measured[0] < 2.0
        assert measured[-1] < 0.7 < measured[0]


def test_the_answers_depend_on_the_mass_and_not_on_their_priors(
    document: EstimateDocument,
) -> None:
    sensitivity = document.sensitivity
    assert set(sensitivity) == {"m", "wdf", "k_f", "k_r", "c_f", "c_r", "i"}
    for name in ("c_f", "c_r", "i"):
        assert sensitivity["m"].sensitivity[name] > 0.05
        assert sensitivity[name].sensitivity[name] < 0.05
    shown = table(document, "Power-scaling sensitivity")
    assert shown is not None
    assert len(shown.rows) == len(sensitivity)
    with without_pictures():
        page, _ = report_page(document)
    (part,) = [p for p in page["appendix"] if p["title"] == "Sensitivity to the priors"]
    assert "depend on the given sprung mass." in part["sections"][0]["lines"][0]
