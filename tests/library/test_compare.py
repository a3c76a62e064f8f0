"""``asv.compare``: a change is found, the same car is not accused, a wrong mass does not matter."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

import bayes_asv as asv
from bayes_asv.analysis.random_effects import RunLikelihood
from bayes_asv.library import comparisons


def _estimate(car: asv.Vehicle, given: asv.Vehicle, *seeds: int, **change: float) -> asv.Estimate:
    """Estimate with one vehicle file what another car drove."""
    roads = ("stops", "bump")
    runs = [asv.simulate(car, roads[s % 2], change=change, seed=s) for s in seeds]
    return asv.estimate(runs, given)


@pytest.fixture(scope="module")
def before(car: asv.Vehicle) -> asv.Estimate:
    """Estimate the car as it was."""
    return _estimate(car, car, 1)


def test_a_worn_damper_is_found_whatever_the_error_of_the_mass(
    car: asv.Vehicle, before: asv.Estimate
) -> None:
    light = dataclasses.replace(car, m=dataclasses.replace(car.m, value=0.98 * car.m.value))
    for given, first in ((car, before), (light, _estimate(car, light, 1))):
        after = _estimate(car, given, 4, c_f=0.97)
        found = asv.compare(first, after)
        assert found.verdict == "changed"
        low, high = found["c_f"].interval(0.999)
        assert low < 0.97 < high
        assert high - low < 0.01  # the parameter itself is known to 1 %
        assert found["c_f"].probability_lower > 0.999
        for name in ("c_r", "i"):
            low, high = found[name].interval(0.999)
            assert low < 1.0 < high
            assert found[name].p > 0.001
        assert "Changed: front damping rate" in str(found)


def test_the_same_car_is_consistent(car: asv.Vehicle, before: asv.Estimate) -> None:
    found = asv.compare(before, _estimate(car, car, 5))
    assert found.verdict == "consistent"
    assert found.p > 0.01
    assert "No change is found" in str(found)
    assert len(repr(found)) < 500
    assert "<td>front damping rate</td>" in found._repr_html_()
    assert found.warnings == ()
    table = found.summary()
    assert list(table.index) == ["c_f", "c_r", "i"]
    assert table.loc["i", "ratio"] == found["i"].ratio
    document = json.loads(found.to_json())
    assert document["changes"]["c_f"]["eti95"] == pytest.approx(found["c_f"].interval())


def test_a_refused_estimate_cannot_be_compared(before: asv.Estimate, refused: asv.Estimate) -> None:
    found = asv.compare(before, refused)
    assert found.verdict == "refused"
    assert "the estimate after is refused" in found.reasons[0]
    assert list(found) == []
    with pytest.raises(KeyError, match="the estimate after is refused"):
        found["c_f"]
    assert json.loads(found.to_json())["p_value"] is None


def test_estimates_of_different_files_cannot_be_compared(
    car: asv.Vehicle, before: asv.Estimate, short: asv.Recording
) -> None:
    other = dataclasses.replace(car, m=dataclasses.replace(car.m, value=1.1 * car.m.value))
    with pytest.raises(asv.InputError, match="use one file for both"):
        asv.compare(before, asv.estimate(short, other))


def test_the_change_is_that_of_the_joint_normal_posterior(before: asv.Estimate) -> None:
    """Against least squares of the same model with one row a piece of information."""
    import numpy as np

    space = before.engine.space
    assert space is not None
    n = space.car_dimension
    rng = np.random.default_rng(0)
    names = ("c_f", "c_r", "i")
    way = np.stack([space.from_logs({name: 1.0})[:n] for name in names], axis=1)
    sigma = np.array([space.log_prior_of(name)[1] for name in names])
    prior = np.diag([*np.ones(n), *1.0 / (math.sqrt(2.0) * sigma)])
    rows, values, sites = [prior], [np.zeros(n + 3)], []
    for change in (0.0, 1.0):  # readings y = A (theta + change B u) + unit noise
        reading, y = rng.normal(size=(n, n)), rng.normal(size=n)
        rows.append(np.hstack([reading, change * reading @ way]))
        values.append(y)
        sites.append(RunLikelihood(reading.T @ reading, reading.T @ y))
    design = np.vstack(rows)
    solution = np.linalg.lstsq(design, np.concatenate(values))[0]
    covariance = np.linalg.inv(design.T @ design)
    mean, sd = comparisons._change(sites, way, space)
    assert mean == pytest.approx(solution[n:])
    assert sd == pytest.approx(np.sqrt(np.diag(covariance)[n:]))
