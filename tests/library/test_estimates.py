"""``asv.estimate`` and its result."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bayes_asv as asv
from bayes_asv.report.schema import read_saved
from tests.cli.conftest import Command

NAMES = ["c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r"]


def test_one_recording_is_as_good_as_a_list_of_one(
    stops: asv.Recording, car: asv.Vehicle, result: asv.Estimate
) -> None:
    one, listed = asv.estimate(stops, car, seed=7), asv.estimate([stops], car, seed=7)
    first, second = one["c_f"].draws, listed["c_f"].draws
    assert first is not None
    assert second is not None
    assert np.array_equal(first, second)
    assert one.recordings == listed.recordings == (stops,)
    assert len(result.recordings) == 2
    assert result["c_f"].mean == pytest.approx(one["c_f"].mean, rel=0.01)


def test_parameters_are_numbers_with_a_unit(result: asv.Estimate, car: asv.Vehicle) -> None:
    assert result.verdict == "ok"
    assert result.reasons == ()
    assert list(result) == NAMES
    assert dict(result)["i"] is result["i"]
    front = result["c_f"]
    assert isinstance(front, asv.Parameter)
    assert (front.unit, front.nominal, front.label) == ("lbf*s/in", 7.2, "front damping rate")
    low, high = front.interval(0.95)
    assert low < 5.76 < high  # the simulated car's
    assert low < front.interval(0.5)[0] < front.median < front.interval(0.5)[1] < high
    assert front.probability_below_nominal == 1.0
    assert front.draws is not None
    assert front.draws.mean() == pytest.approx(front.mean)
    si = front.to("SI")
    assert si.unit == "N*s/m"
    assert si.nominal == pytest.approx(car.c_f.value)
    assert si.interval() == pytest.approx([x * 175.12684 for x in front.interval()])
    assert si.to("US").mean == pytest.approx(front.mean)
    assert front.to("N*s/mm").sd == pytest.approx(1e-3 * si.sd)
    with pytest.raises(asv.InputError, match=r"write interval\(0.95\)"):
        front.interval(95)
    with pytest.raises(asv.InputError, match="damping"):
        front.to("kg")
    with pytest.raises(KeyError, match="there are c_f, c_r, i"):
        result["c_q"]


def test_the_table_has_units_intervals_and_nominal_values(result: asv.Estimate) -> None:
    table = result.summary()
    assert isinstance(table, pd.DataFrame)
    assert list(table.index) == NAMES
    assert table.loc["c_f", "mean"] == result["c_f"].mean
    assert table.loc["c_f", ["eti95_lb", "eti95_ub"]].tolist() == list(result["c_f"].interval())
    assert table.loc["i", "unit"] == "lbf*s^2*in"
    assert result.summary("SI").loc["i", "unit"] == "kg*m^2"
    assert (table["p_below_nominal"] == result.summary("SI")["p_below_nominal"]).all()
    with pytest.raises(asv.InputError, match='use "SI"'):
        result.summary("imperial")  # type: ignore[arg-type]


def test_without_pandas_the_message_says_what_to_install(
    result: asv.Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'bayes-asv\[notebook\]'"):
        result.summary()


def test_an_order_of_magnitude_that_is_open_has_no_mean(
    result: asv.Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    wide = dataclasses.replace(
        result["c_f"], mean=41.7, sd=60.3, _quantile=lambda p: 1.3 if p < 0.5 else 104.0
    )
    monkeypatch.setitem(result.parameters, "c_f", wide)
    for text in (repr(result), result._repr_html_()):
        assert "not determined" in text
        assert "41.7" not in text


def test_it_shows_itself_in_short(result: asv.Estimate, refused: asv.Estimate) -> None:
    for shown in (result, refused, result["c_f"]):
        assert len(repr(shown)) < 500
    assert "5.7" in repr(result)
    assert "too short" in repr(refused)
    html = result._repr_html_()
    assert "Front damper: 20 % softer than nominal" in html
    assert "<td>5.6" in html
    assert "<table>" not in refused._repr_html_()
    assert "too short" in refused._repr_html_()


def test_names_of_cars_and_files_are_escaped(short: asv.Recording, car: asv.Vehicle) -> None:
    evil = "<script>alert(1)</script>" * 20
    renamed = dataclasses.replace(car, name=evil)
    refused = asv.estimate(dataclasses.replace(short, source=evil), renamed)
    assert "<script" not in refused._repr_html_()
    assert len(repr(refused)) < 500


def test_it_says_and_writes_what_the_command_does(
    result: asv.Estimate, invoke: Command, tmp_path: Path
) -> None:
    files = [asv.example(name) for name in ("stops-400hz.csv", "bump-400hz.csv")]
    car = asv.example("baja2008.toml")
    said = invoke("estimate", *files, "-v", car, "--seed", 1, "--json", tmp_path / "a.json")
    table = [line for line in result.lines() if "(95 %: " in line]
    assert [line for line in said.sentences if line in result.lines()] == [
        line for line in result.lines() if line not in table
    ]
    for p in (result["c_f"], result["c_r"], result["i"]):
        assert any(f"{p.label.capitalize()} ".replace(" rate", "") in x for x in said.sentences)
    assert result.to_json(tmp_path / "b.json") is None
    text = (tmp_path / "b.json").read_text(encoding="utf-8")
    assert text == result.to_json()
    saved, made = (json.loads((tmp_path / f"{x}.json").read_text("utf-8")) for x in "ab")
    assert {**saved, "seconds": 0.0} == {**made, "seconds": 0.0}
    assert read_saved(tmp_path / "b.json") == result.document


def test_reports_with_what_was_found_beside(
    result: asv.Estimate, stops: asv.Recording, car: asv.Vehicle, tmp_path: Path
) -> None:
    result.report(tmp_path / "a.html")
    result.report(tmp_path / "b.html", track=asv.track(stops, car))
    alone, both = ((tmp_path / f"{x}.html").read_text("utf-8") for x in "ab")
    assert alone.startswith("<!DOCTYPE html>")
    assert len(both) > len(alone)
    with pytest.raises(asv.InputError, match=r"\.html or \.pdf"):
        result.report(tmp_path / "a.doc")


def test_a_refusal_is_a_value(refused: asv.Estimate, tmp_path: Path) -> None:
    assert refused.verdict == "refused"
    assert "too short" in refused.reasons[0]
    assert "recording 1" in refused.reasons[0]  # its name, where it has no file
    assert list(refused) == []
    assert len(refused.summary()) == 0
    refused.report(tmp_path / "x.html")
    with pytest.raises(KeyError, match="too short"):
        refused["c_f"]
    for call in (
        refused.to_inference_data, lambda: refused.to_netcdf(tmp_path / "x.nc"),
        refused.plot.posterior, refused.plot.simulation, refused.plot.damper_velocity,
    ):  # fmt: skip
        with pytest.raises(asv.InputError):
            call()


Misuse = Callable[[Any, Any], object]

wrong: Any = asv  # calls that a type checker would not let pass


@pytest.mark.parametrize(
    ("call", "fault", "words"),
    [
        (
            lambda run, car: wrong.estimate(car, run),
            TypeError,
            r"asv.estimate\(recordings, vehicle\)",
        ),
        (
            lambda run, car: wrong.estimate("a.csv", car),
            TypeError,
            r"asv.read_recording\('a.csv'\)",
        ),
        (
            lambda run, car: wrong.estimate(["a.csv"], car),
            TypeError,
            r"asv.read_recording\('a.csv'",
        ),
        (
            lambda run, car: wrong.estimate(run, "a.toml"),
            TypeError,
            r"asv.read_vehicle\('a.toml'\)",
        ),
        (lambda run, car: wrong.estimate(run, None), TypeError, "the vehicle is missing"),
        (lambda run, car: wrong.estimate(3, car), TypeError, "the recordings are a int"),
        (lambda run, car: wrong.estimate(run.to_dataframe(), car), TypeError, "from_dataframe"),
        (lambda run, car: wrong.estimate([], car), asv.InputError, "give at least one"),
        (lambda run, car: wrong.estimate([run, run], car), asv.InputError, "each recording once"),
        (lambda run, car: wrong.estimate(run, car, seed=-1), asv.InputError, "whole number from 0"),
        (lambda run, car: wrong.estimate(run, car, car="bus"), asv.InputError, "quarter-front"),
        (
            lambda run, car: wrong.estimate(run, car, car="roll"),
            asv.InputError,
            r"\[roll\]: is missing",
        ),
        (lambda run, car: wrong.estimate(run, car, effects="rust"), asv.InputError, "bump_stop"),
        (
            lambda run, car: wrong.estimate(run, car, effects="damper_fade@rear", below=9.0),
            asv.InputError,
            "leave out below",
        ),
        (
            lambda run, car: wrong.estimate(run, car, likelihood="white"),
            asv.InputError,
            "innovations, output-error",
        ),
        (lambda run, car: wrong.track([run, run], car), asv.InputError, "each recording once"),
        (
            lambda run, car: wrong.diagnose(run, car, holdout=run),
            asv.InputError,
            "each recording once",
        ),
        (lambda run, car: wrong.diagnose(run, car, holdout="b.csv"), TypeError, "read_recording"),
        (lambda run, car: wrong.plan(run), TypeError, r"asv.plan\(vehicle\)"),
        (lambda run, car: wrong.simulate("car.toml"), TypeError, "read_vehicle"),
        (
            lambda run, car: wrong.compare(run, run),
            TypeError,
            r"asv.compare\(before, after, vehicle\)",
        ),
    ],
)
def test_misuse_is_an_exception_with_the_fix(
    stops: asv.Recording, car: asv.Vehicle, call: Misuse, fault: type[Exception], words: str
) -> None:
    with pytest.raises(fault, match=words):
        call(stops, car)


def test_progress_is_reported_to_a_function_and_to_nobody_in_a_batch(
    stops: asv.Recording, car: asv.Vehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    told: list[tuple[float, str]] = []
    asv.estimate(stops, car, progress=lambda share, words: told.append((share, words)))
    assert told[0][0] == 0.0
    assert told[-1][0] == 1.0
    assert all(words for _, words in told)
    asv.estimate(stops, car)
    assert capsys.readouterr() == ("", "")


def test_a_car_is_recognised_by_its_channels(car: asv.Vehicle, tmp_path: Path) -> None:
    runs = [
        asv.simulate(car, road, car="quarter-rear", change={"c_r": 0.8}, seconds=1.5, seed=seed)
        for seed, road in enumerate(("bump", "stops"))
    ]
    assert runs[0].channels == ("rear_wheel", "rear_chassis")
    result = asv.estimate(runs, car)
    assert list(result) == ["c_r", "zeta_r"]
    low, high = result["c_r"].interval()
    assert low < 8.0 < high
    assert result["c_r"].probability_below_nominal > 0.999
    assert result.summary().loc["c_r", "unit"] == "lbf*s/in"
    assert str(result).startswith("Rear damper: 20 % softer than nominal.")
    table: Any = json.loads(result.to_json())["parameters"]["c_r"]
    assert result["c_r"].interval() == pytest.approx(table["eti95"], rel=1e-6)
    for axes in (
        result.plot.posterior(), result.plot.simulation(1), result.plot.damper_velocity(),
    ):  # fmt: skip
        assert len(axes) == 1
    result.report(tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text("utf-8")
    assert "own values beside the answer of all runs" in text
    assert "front" not in "".join(result.document.runs[0].travel.entries)
    assert asv.estimate(runs[0], car, below=30.0).verdict == "ok"
    assert list(result.to_inference_data()["log_likelihood"]["recording"].values) == [
        "simulated bump", "simulated stops",
    ]  # fmt: skip
