"""``asv.compare``: a change is found, the same car is not accused, a wrong mass does not matter."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import pytest

import bayes_asv as asv
from bayes_asv.report.schema import CompareDocument, read_saved
from tests.page_examples import run_examples

PAGE = Path(__file__).parents[2] / "docs" / "compare.md"


def _estimate(car: asv.Vehicle, given: asv.Vehicle, *seeds: int, **change: float) -> asv.Estimate:
    """Estimate with one vehicle file what another car drove."""
    roads = ("stops", "bump")
    runs = [asv.simulate(car, roads[s % 2], change=change, seed=s) for s in seeds]
    return asv.estimate(runs, given)


@pytest.fixture(scope="module")
def before(car: asv.Vehicle) -> asv.Estimate:
    """Estimate the car as it was."""
    return _estimate(car, car, 1)


@pytest.fixture(scope="module")
def worn(car: asv.Vehicle) -> asv.Estimate:
    """Estimate it with a front damper that lost three per cent."""
    return _estimate(car, car, 4, c_f=0.97)


def test_a_worn_damper_is_found_whatever_the_error_of_the_mass(
    car: asv.Vehicle, before: asv.Estimate, worn: asv.Estimate
) -> None:
    light = dataclasses.replace(car, m=dataclasses.replace(car.m, value=0.98 * car.m.value))
    others = _estimate(car, light, 1), _estimate(car, light, 4, c_f=0.97)
    for first, second in ((before, worn), others):
        found = asv.compare(first, second)
        assert found.verdict == "changed"
        low, high = found["c_f"].interval(0.999)
        assert low < 0.97 < high
        assert high - low < 0.01  # the parameter itself is known to 1 %
        assert found["c_f"].probability_lower > 0.999
        assert found["c_f"].probability_changed > 0.999
        for name in ("c_r", "i"):
            low, high = found[name].interval(0.999)
            assert low < 1.0 < high
            assert found[name].p > 0.001
            assert found[name].probability_changed < 0.33
        assert "Changed: the front damper (p < 0.001)." in str(found)
        assert found.document.shared == [
            "sprung mass", "front weight fraction", "front spring rate", "rear spring rate",
        ]  # fmt: skip


def test_the_same_car_is_consistent(car: asv.Vehicle, before: asv.Estimate) -> None:
    found = asv.compare(before, _estimate(car, car, 2))
    assert found.verdict == "consistent"
    assert found.p > 0.01
    assert found.probability_unchanged > 0.9
    assert "No change is found" in str(found)
    assert len(repr(found)) < 500
    assert "<td>Front damping rate</td>" in found._repr_html_()
    table = found.summary()
    assert list(table.index) == ["c_f", "c_r", "i"]
    assert table.loc["i", "ratio"] == found["i"].ratio
    document = json.loads(found.to_json())
    assert document["changes"]["c_f"]["eti95"] == pytest.approx(found["c_f"].interval())
    assert document["p_value_shared"] > 0.01
    # A bump moves the dampers slower than parking stops do.
    assert [w for w in found.warnings if "times as fast after as before" in w] == list(
        found.warnings
    )


def test_a_mass_that_was_changed_on_purpose_has_its_own_file(
    car: asv.Vehicle, before: asv.Estimate
) -> None:
    heavy = dataclasses.replace(car, m=dataclasses.replace(car.m, value=1.08 * car.m.value))
    run = asv.simulate(heavy, "bump", change={"c_r": 0.85}, seed=6)
    unknown = asv.compare(before, asv.estimate(run, car))
    assert unknown.verdict == "doubtful"
    assert "the sessions differ in more than" in unknown.document.doubts[-1]
    assert str(unknown).startswith("Not to be relied on: ")
    found = asv.compare(before, asv.estimate(run, heavy))
    assert found.verdict == "changed"
    assert found.document.different == ["sprung mass"]
    assert "sprung mass" not in found.document.shared
    for name, true in (("c_f", 1.0), ("c_r", 0.85), ("i", 1.0)):
        low, high = found[name].interval(0.999)
        assert low < true < high
    assert found["c_r"].probability_lower > 0.999
    assert found["c_f"].probability_changed < 0.5
    assert found["c_f"].log_sd > unknown["c_f"].log_sd  # two weighings, two errors


def test_recordings_are_estimated_first(car: asv.Vehicle, stops: asv.Recording) -> None:
    after = asv.simulate(car, "stops", change={"c_f": 0.8}, seed=9)
    shares: list[float] = []
    found = asv.compare(
        stops, [after], car, below=25, seed=3, progress=lambda share, _: shares.append(share)
    )
    assert found["c_f"].probability_changed > 0.99
    assert found.document.before.diagnostics.band == [0.0, 25]
    assert found.document.seed == 3
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_page_shows_the_change_and_is_made_again_from_the_document(
    before: asv.Estimate, worn: asv.Estimate, tmp_path: Path
) -> None:
    found = asv.compare(before, worn)
    found.to_json(tmp_path / "changes.json")
    saved = read_saved(tmp_path / "changes.json")
    assert isinstance(saved, CompareDocument)
    assert saved.to_dict() == json.loads((tmp_path / "changes.json").read_text("utf-8"))
    found.report(tmp_path / "changes.html")
    text = (tmp_path / "changes.html").read_text("utf-8")
    for part in (
        "Front damper: 3", "no change found", 'id="force-velocity"', 'id="motion"',
        "What both sessions share", "probability of a change",
    ):  # fmt: skip
        assert part in text
    assert text.count("<svg") == 3 + 2 + 4  # cards, dampers, two outputs of two sessions
    assert "Does the model hold after?" in text
    assert "Do the sessions differ in something else?" in text
    found.report(tmp_path / "changes.pdf")
    assert (tmp_path / "changes.pdf").read_bytes().startswith(b"%PDF")


def test_a_refused_estimate_cannot_be_compared(before: asv.Estimate, refused: asv.Estimate) -> None:
    found = asv.compare(before, refused)
    assert found.verdict == "refused"
    assert "the estimate after is refused" in found.reasons[0]
    assert list(found) == []
    with pytest.raises(KeyError, match="the estimate after is refused"):
        found["c_f"]
    document = json.loads(found.to_json())
    assert document["p_value"] is None
    assert math.isnan(found.p)
    assert "No answer" in str(found)


def test_wrong_use_says_what_to_write(
    car: asv.Vehicle, before: asv.Estimate, stops: asv.Recording, bump: asv.Recording
) -> None:
    with pytest.raises(TypeError, match="the vehicle is missing"):
        asv.compare(stops, bump)
    with pytest.raises(TypeError, match="one session is an estimate"):
        asv.compare(before, bump, car)
    with pytest.raises(asv.InputError, match="has its vehicle"):
        asv.compare(before, before, car)
    with pytest.raises(asv.InputError, match="name the effects"):
        asv.compare(stops, bump, car, effects="auto")
    with pytest.raises(asv.InputError, match="each recording once"):
        asv.compare(stops, stops, car)
    with pytest.raises(TypeError, match="read the file first"):
        asv.compare("stops.csv", bump, car)  # type: ignore[arg-type]


def test_every_example_of_the_page_runs_and_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_examples(PAGE) == 3
    assert {"changes.json", "changes.pdf"} <= {p.name for p in tmp_path.iterdir()}
