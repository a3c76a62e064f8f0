"""Runs of the rig held against each other: one car twice, and a damper that changed between."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayes_asv.analysis.run_consistency import RunConsistency, compare_runs, fit_single_run
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from bayes_asv.library.inference_data import write_netcdf
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.report.documents.estimate import estimate_document
from tests.posterior.cases import DECLARED, EXACT, as_recording, case, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, RigCar, SensorSpec, baja, draw, drive

TERRAIN = ("bump", "stops", "rough")


def recordings(car: RigCar, factors: tuple[float, ...], seed: int) -> list[Recording]:
    """Drives of one car whose front damping is multiplied by a factor each."""
    out = []
    for k, factor in enumerate(factors):
        name = TERRAIN[k % 3]
        changed = replace(car, c_f=factor * car.c_f)
        run = drive(
            changed, TERRAINS[name](seed + k), DEFAULT_SPEEDS[name], 400.0, 2.0, SensorSpec(),
            seed + 100 + k,
        )  # fmt: skip
        out.append(as_recording(run, f"{name}-{k}.csv"))
    return out


def held(runs: list[Recording], known: Vehicle) -> RunConsistency:
    lines, reasons, _ = prepare_runs(runs, known)
    assert not reasons
    return compare_runs([fit_single_run(line, known, 0) for line in lines], 4000, 0)


def car_of(given: dict[str, float], seed: int) -> RigCar:
    return draw(baja(), np.random.default_rng(seed), given)


@pytest.fixture(scope="module")
def apart() -> tuple[RigCar, EstimationResult]:
    """Two runs, the front damper 5 % stiffer in the second."""
    car = car_of(DECLARED, 2)
    return car, estimate(recordings(car, (1.0, 1.05), 20), vehicle(DECLARED))


@pytest.mark.parametrize("given", [EXACT, DECLARED], ids=["exact", "declared"])
def test_runs_of_one_car_agree_and_each_knows_it(given: dict[str, float]) -> None:
    car = car_of(given, 1)
    found = held(recordings(car, (1.0, 1.0, 1.0), 10), vehicle(given))
    assert found.verdict == "agree"
    assert found.overall_test.freedom == 6
    assert found.compared == ("c_f", "c_r", "i")
    for name in found.compared:
        assert found.parameter_tests[name].p > 1e-3
        for run in found.runs:
            x = run.fit.space.quantities(run.z, 0)[name]
            assert abs(x.mean() - getattr(car, name)) < 4.5 * x.std()
    together = found.quantities(found.joint(4000, 0), 0)["c_f"]
    each = [run.fit.space.quantities(run.z, 0)["c_f"].std() for run in found.runs]
    assert together.std() < min(each)


def test_two_percent_of_one_damper_is_found_and_named() -> None:
    """With a mass known to 1 %: its error is common to both runs."""
    car = car_of(DECLARED, 3)
    found = held(recordings(car, (1.0, 1.02), 30), vehicle(DECLARED))
    assert found.verdict == "disagree"
    assert found.overall_test.p < 1e-6
    assert found.differing == ("c_f",)
    assert found.parameter_tests["c_r"].p > 1e-3
    k = found.compared.index("c_f")
    between = found.shift[1, k] - found.shift[0, k]
    assert between == pytest.approx(np.log(1.02), abs=4.5 * float(np.hypot(*found.sd[:, k])))
    low, _, high = found.spread_percent("c_f")
    assert low < 1.0 < high
    assert "the front damping rate differs from run to run" in found.sentence()


def test_a_run_that_cannot_be_summarised_leaves_the_verdict_open(
    apart: tuple[RigCar, EstimationResult],
) -> None:
    assert apart[1].run_consistency is not None
    one, other = apart[1].run_consistency.runs
    assert compare_runs([one, other], 500, 0).verdict == "disagree"
    assert compare_runs([one, replace(other, effective=3.0)], 500, 0).verdict == "unknown"


def test_an_answer_from_runs_that_disagree_allows_for_it(
    apart: tuple[RigCar, EstimationResult],
) -> None:
    car, result = apart
    assert result.verdict == "ok"
    assert result.run_consistency is not None
    assert result.run_consistency.verdict == "disagree"
    low, high = np.quantile(result.draws["c_f"], [0.025, 0.975])
    assert low < car.c_f < 1.05 * car.c_f < high
    assert result.pooled_draws["c_f"].std() < 0.5 * result.draws["c_f"].std()
    for name in ("c_r", "i"):
        x = result.draws[name]
        assert abs(x.mean() - getattr(car, name)) < 4.5 * x.std()
        assert x.std() < 0.02 * x.mean()
    assert result.rhat_max < 1.01
    assert min(result.ess_bulk_min, result.ess_tail_min) >= 1000.0
    assert any(warning.startswith("the runs do not agree") for warning in result.warnings)
    # each run is explained at its own posterior, so that no misfit is left in its residuals
    for run in result.runs:
        assert min(check.p_family for check in run.checks) > 1e-3


def test_the_document_and_the_file_hold_the_same_draws(
    apart: tuple[RigCar, EstimationResult], tmp_path: Path
) -> None:
    _, result = apart
    document = estimate_document(result).to_dict()
    write_netcdf(result, tmp_path / "draws.nc")
    saved = xr.open_dataset(tmp_path / "draws.nc", group="posterior", engine="h5netcdf")
    with saved:
        for name in ("c_f", "c_r", "i", "k_g"):
            told = document["parameters"][name]
            assert float(saved[name].mean()) == pytest.approx(told["si"]["mean"], rel=1e-9)
            thinned = np.array(document["draws"][name])
            assert abs(thinned.mean() - told["mean"]) < 5.0 * told["sd"] / np.sqrt(len(thinned))
        assert "noise_front_chassis_1" in saved
    found = document["agreement"]
    assert found["verdict"] == "disagree"
    assert found["mean_car"]["c_f"]["eti95"] == document["parameters"]["c_f"]["eti95"]
    assert found["joint"]["c_f"]["sd"] < found["mean_car"]["c_f"]["sd"]
    assert found["next_run"]["c_f"]["sd"] > found["mean_car"]["c_f"]["sd"]
    assert [run["source"] for run in found["runs"]] == ["bump-0.csv", "stops-1.csv"]
    own = [run["parameters"]["c_f"]["own"] for run in found["runs"]]
    assert own[1]["mean"] / own[0]["mean"] == pytest.approx(1.05, rel=0.005)
    assert own[0]["sd"] < 0.2 * found["runs"][0]["parameters"]["c_f"]["sd"]
    assert document["diagnostics"]["sampler"] == "random effects"


def test_same_seed_same_answer_whatever_the_order(apart: tuple[RigCar, EstimationResult]) -> None:
    car, result = apart
    assert result.run_consistency is not None
    one, two = result.run_consistency.runs
    lines, _, _ = prepare_runs(recordings(car, (1.0, 1.05), 20)[:1], vehicle(DECLARED))
    again = fit_single_run(lines[0], vehicle(DECLARED), 0)
    assert np.array_equal(again.z, one.z)
    found, same, turned = (
        compare_runs(pair, 4000, 0) for pair in ([one, two], [one, two], [two, one])
    )
    assert np.array_equal(found.population.centre, same.population.centre)
    assert turned.overall_test.q == pytest.approx(found.overall_test.q, rel=1e-9)
    assert turned.population.spread.mean() == pytest.approx(
        found.population.spread.mean(), rel=0.05
    )


def test_one_run_is_held_against_nothing() -> None:
    _, _, recording = case("bump", 3, EXACT)
    result = estimate([recording], vehicle(EXACT))
    assert result.run_consistency is None
    assert estimate_document(result).agreement is None
    assert result.runs[0].checks


def test_white_residuals_are_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """They claim two to three times too much, so that equal runs would disagree."""

    class ReachedSamplingError(Exception):
        pass

    def stop(*_: object, **__: object) -> None:
        raise ReachedSamplingError

    def asked(*_: object) -> None:
        pytest.fail("a run was asked alone")

    monkeypatch.setattr("bayes_asv.posterior.sampler.importance_resample", stop)
    monkeypatch.setattr("bayes_asv.estimation.fit_single_run", asked)
    runs = recordings(car_of(EXACT, 1), (1.0, 1.0), 10)
    with pytest.raises(ReachedSamplingError):
        estimate(runs, vehicle(EXACT), likelihood="output-error")


@pytest.mark.usefixtures("without_input_search")
def test_a_run_that_is_not_of_this_car_is_refused_by_name() -> None:
    """The other run is in order, and nothing is said against it.

    The search for a mistake of one recording has a test in ``test_input_mistakes.py``.
    """
    (_, _, plain), (_, _, other) = (case(road, 1, EXACT, seconds=1.2) for road in ("bump", "stops"))
    swapped = replace(other, values=other.values[[1, 0, 3, 2]])
    result = estimate([plain, swapped], vehicle(EXACT))
    assert result.verdict == "refused"
    assert any("explains only" in reason for reason in result.reasons)
    assert not any(plain.source in reason for reason in result.reasons)
