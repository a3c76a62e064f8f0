"""Diagnosis, track, plan, simulation and comparison."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes

import bayes_asv as asv
from bayes_asv.report.schema import read_saved


def _check_axes(axes: object) -> None:
    for ax in np.atleast_1d(np.asarray(axes)):
        assert isinstance(ax, Axes)
        assert ax.get_xlabel() or ax.get_ylabel()
    plt.close("all")


def test_figures_are_axes(result: asv.Estimate) -> None:
    _check_axes(result.plot.posterior())
    _check_axes(result.plot.posterior("zeta_f"))
    _check_axes(result.plot.simulation())
    _check_axes(result.plot.simulation(1))
    _check_axes(result.plot.damper_velocity())
    with pytest.raises(asv.InputError, match="there are 2"):
        result.plot.simulation(2)
    with pytest.raises(asv.InputError, match="no such parameter"):
        result.plot.posterior("mass")


def test_a_diagnosis_names_what_is_missing(
    car: asv.Vehicle, bump: asv.Recording, stops: asv.Recording, tmp_path: Path
) -> None:
    found = asv.diagnose([bump], car, holdout=[stops])
    assert found.verdict == "agreement"
    assert found.effects == []
    assert not found.unexplained
    assert len(repr(found)) < 500
    assert found.before["c_f"].mean == pytest.approx(found["c_f"].mean, rel=1e-3)
    assert found["c_f"].unit == "lbf*s/in"
    assert list(found.summary("SI")["unit"][:2]) == ["N*s/m", "N*s/m"]
    assert "agrees with the measurement" in str(found)
    assert "agrees with the measurement" in found._repr_html_()
    found.to_json(tmp_path / "d.json")
    assert read_saved(tmp_path / "d.json") == found.document
    found.report(tmp_path / "d.html")
    _check_axes(found.plot.simulation_error())
    _check_axes(found.plot.parameters())


def test_a_diagnosis_that_is_refused(car: asv.Vehicle, short: asv.Recording) -> None:
    found = asv.diagnose(short, car)
    assert found.verdict == "refused"
    assert "too short" in found.reasons[0]
    assert len(repr(found)) < 500
    with pytest.raises(asv.InputError, match="too short"):
        found.plot.parameters()


def test_a_track_has_every_row(car: asv.Vehicle, stops: asv.Recording, tmp_path: Path) -> None:
    track = asv.track([stops], car)
    assert (track.verdict, track.consistency) == ("ok", "consistent")
    trace = track.trace()
    assert isinstance(trace, pd.DataFrame)
    assert len(trace) == len(stops.time)
    last = track["c_f"]
    assert trace["c_f"].iloc[-1] == pytest.approx(last.median)
    assert trace[["c_f_lb", "c_f_ub"]].iloc[-1].tolist() == pytest.approx(last.interval(), rel=1e-6)
    assert track.trace("SI")["c_f"].iloc[-1] == pytest.approx(last.to("SI").median)
    assert last.draws is None
    document = json.loads(track.to_json())["parameters"]["c_f"]
    assert last.interval() == pytest.approx(document["eti95"], rel=1e-6)
    assert (last.mean, last.sd) == pytest.approx((document["mean"], document["sd"]), rel=1e-6)
    assert last.probability_below_nominal == pytest.approx(document["p_below_nominal"], abs=1e-6)
    track.write_trace(tmp_path / "trace.csv")
    assert len(pd.read_csv(tmp_path / "trace.csv")) == len(trace)
    assert json.loads(track.to_json())["trace"] == str(tmp_path / "trace.csv")
    assert len(repr(track)) < 500
    _check_axes(track.plot.parameters())
    _check_axes(track.plot.consistency())


def test_a_track_takes_one_recording(
    car: asv.Vehicle, stops: asv.Recording, bump: asv.Recording, short: asv.Recording
) -> None:
    with pytest.raises(asv.InputError, match="one after the other"):
        asv.track([stops, bump], car)
    refused = asv.track(short, car)
    assert refused.verdict == "refused"
    assert len(repr(refused)) < 500


def test_a_plan_compares_drives(car: asv.Vehicle) -> None:
    plan = asv.plan(car, want=4, rates=[400], roads=["bump"], speed_limit="8 mph")
    assert plan.verdict == "ok"
    assert plan.recommended is not None
    assert plan.recommended["words"] in str(plan)
    table = plan.summary()
    assert {"road", "speed", "rate", "c_f", "passes"} <= set(table.columns)
    assert table["speed"].max() == 8.0
    assert len(repr(plan)) < 500
    assert json.loads(plan.to_json())["want_percent"] == pytest.approx(
        dict.fromkeys(("c_f", "c_r", "i", "k_g"), 4.0)
    )
    impossible = asv.plan(car, want=0.2, rates=[400], roads=["bump"], speed_limit="8 mph")
    assert impossible.verdict == "refused"
    assert impossible.reasons


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"want": {"c_q": 2.0}}, "name c_f, c_r, i, k_g"),
        ({"want": 0.0}, "between 0.0001 and 100"),
        ({"roads": ["beach"]}, "bump, stops, rollers, rough"),
        ({"speed_limit": 12}, "write '12 mph'"),
        ({"speed_limit": "0.1 mph"}, "no drive of the plan is that slow"),
        ({"tyre_rate": "0 lbf/in"}, "above zero"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(
    car: asv.Vehicle, arguments: dict[str, object], words: str
) -> None:
    with pytest.raises(asv.InputError, match=words):
        asv.plan(car, **arguments)  # type: ignore[arg-type]


def test_a_simulated_drive_is_a_recording(car: asv.Vehicle) -> None:
    run = asv.simulate(car, "bump", rate=200, seconds=1.0, seed=5)
    assert isinstance(run, asv.Recording)
    assert run.rate == pytest.approx(200.0)
    again = asv.simulate(car, "bump", rate=200, seconds=1.0, seed=5)
    assert np.array_equal(run.values, again.values)
    worn = asv.simulate(car, "bump", rate=200, seconds=1.0, seed=5, change={"c_f": 0.5})
    assert not np.array_equal(run.values, worn.values)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"road": "moon"}, "rough"),
        ({"speed": 8}, "write '8 mph'"),
        ({"speed": "900 m/s"}, "between 0.1 and 60"),
        ({"rate": 1.0}, "10 to 10000 Hz"),
        ({"seconds": float("nan")}, "0.1 to 600 s"),
        ({"change": {"k": 2.0}}, "give one of c_f"),
        ({"change": {"wdf": 3.0}}, "no weight on one of the axles"),
        ({"car": "bus"}, "give one of half"),
        ({"skew": "20 in"}, "the half car has no right wheels"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(
    car: asv.Vehicle, arguments: dict[str, object], words: str
) -> None:
    with pytest.raises(asv.InputError, match=words):
        asv.simulate(car, **arguments)  # type: ignore[arg-type]
