"""What an undeclared fault is said to do, against putting it in and fitting again."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.analysis.uncertainty_budget import Shift, UncertaintyBudget, find_budget
from bayes_asv.analysis.uncertainty_budget.budget import in_logs, information, jacobian
from bayes_asv.analysis.uncertainty_budget.undeclared_faults import (
    DETECTABLE_NONCENTRALITY,
    Fault,
    with_fault,
)
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, EXACT, as_recording, case, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, SensorSpec, baja, draw, drive

Array = NDArray[np.float64]

STEPLESS = replace(SensorSpec(), adc=None)  # rounding is chance, and a fault changes it


def driven(spec: SensorSpec, seed: int, sds: dict[str, float]) -> Recording:
    """The same drive with the same noise, whatever its sensors are."""
    rng = np.random.default_rng([seed, 46])
    car = draw(baja(), rng, sds)
    road, noise = (int(v) for v in rng.integers(2**31, size=2))
    speed = DEFAULT_SPEEDS["bump"]
    run = drive(car, TERRAINS["bump"](road), speed, 400.0, 2.0, spec, noise)
    return as_recording(run, "drive.csv")


def fitted(car: Vehicle, recording: Recording) -> MapFit:
    lines, reasons, _ = prepare_runs((recording,), car)
    assert not reasons
    return best_fit(lines, car)


def answers(fit: MapFit) -> dict[str, float]:
    """Logarithms at the mode."""
    car = {name: float(x[0]) for name, x in fit.space.values(fit.mode.z[None]).items()}
    return {
        **{name: math.log(car[name]) for name in ("c_f", "c_r", "i")},
        "k_g": 0.5 * math.log(car["i"] / car["m"]),
    }


def faulty(spec: SensorSpec, shift: Shift) -> SensorSpec:
    """Sensors that really have the fault."""
    c = CHANNELS.index(shift.where)
    if shift.kind == "place":
        places = [0.0, 0.0]
        places[c // 2] = shift.size
        return replace(spec, chassis_offset=(places[0], places[1]))
    values: list[float] = list(getattr(spec, shift.kind))
    values[c] += shift.size * (1.0 if shift.kind == "delay" else values[c])
    changed: dict[str, Any] = {shift.kind: tuple(values)}
    return replace(spec, **changed)


class Case(NamedTuple):
    """A fitted drive."""

    car: Vehicle
    fit: MapFit
    width: UncertaintyBudget
    sds: dict[str, float]


def made(sds: dict[str, float]) -> Case:
    car = vehicle(sds, STEPLESS)
    fit = fitted(car, driven(STEPLESS, 7, sds))
    return Case(car, fit, find_budget(fit.posterior, fit.mode, car), sds)


Answers = dict[str, float]


@pytest.fixture(scope="module")
def declared() -> Case:
    return made(DECLARED)


@pytest.fixture(scope="module")
def exact() -> Case:
    return made(EXACT)


def moved_and_predicted(of: Case, kind: str, where: str) -> tuple[Answers, Answers]:
    """How a fault moves the answers, and what was predicted, in deviations of each."""
    shift = next(s for s in of.width.shifts if (s.kind, s.where) == (kind, where))
    before = answers(of.fit)
    after = answers(fitted(of.car, driven(faulty(STEPLESS, shift), 7, of.sds)))
    predicted = of.width.by_parameter(shift.moved)
    sd = {name: of.width.estimands[name].sd for name in predicted}
    return (
        {name: (after[name] - before[name]) / sd[name] for name in sd},
        {name: predicted[name] / sd[name] for name in sd},
    )


# The rig's sensors really have the fault; its noise is the same numbers again, seed 7.
@pytest.mark.parametrize(
    ("kind", "where"),
    [("gain", "rear_chassis"), ("delay", "front_chassis"), ("place", "front_chassis")],
)
def test_a_faulty_sensor_moves_the_answer_as_predicted(
    declared: Case, kind: str, where: str
) -> None:
    moved, predicted = moved_and_predicted(declared, kind, where)
    assert moved == pytest.approx(predicted, rel=0.2, abs=0.25)


@pytest.mark.parametrize(("kind", "where"), [("gain", "front_wheel"), ("bandwidth", "rear_wheel")])
def test_it_does_as_well_where_given_values_are_exact(exact: Case, kind: str, where: str) -> None:
    moved, predicted = moved_and_predicted(exact, kind, where)
    assert moved == pytest.approx(predicted, rel=0.2, abs=0.25)


@pytest.mark.parametrize("name", ["l", "wdf"])
def test_a_value_wrongly_given_as_exact_moves_the_answer_as_predicted(name: str) -> None:
    _, _, recording = case("stops", 8, EXACT)
    car = vehicle(EXACT)
    fit = fitted(car, recording)
    width = find_budget(fit.posterior, fit.mode, car)
    shift = next(s for s in width.shifts if (s.kind, s.where) == ("given", name))
    given = getattr(car, name)
    wrong = replace(car, **{name: replace(given, value=given.value / (1.0 + shift.size))})
    after, before = answers(fitted(wrong, recording)), answers(fit)
    for answer, predicted in width.by_parameter(shift.moved).items():
        sd = width.estimands[answer].sd
        came = (after[answer] - before[answer]) / sd
        assert came == pytest.approx(predicted / sd, rel=0.05, abs=0.25), answer


def test_the_same_fault_of_all_sensors_is_none(exact: Case) -> None:
    """A linear car does not know a common scale, a common delay or a common filter."""
    car, fit, width, _ = exact
    logs, z = in_logs(fit.posterior, fit.mode.z)
    j = jacobian(logs, z, 0)
    sd = np.array([width.estimands[name].sd for name in ("c_f", "c_r", "i")])
    for kind, size in (("gain", 0.01), ("delay", 1e-4), ("bandwidth", 0.1)):
        recording = sound = logs.space.recordings[0]
        one = []
        for channel in CHANNELS:
            recording = with_fault(recording, Fault(kind, channel, size), car)
            alone = with_fault(sound, Fault(kind, channel, size), car)
            one.append(_pulled(logs, z, j, alone))
        together = _pulled(logs, z, j, recording)
        largest = np.max(np.abs(one), axis=0)
        assert np.all(np.abs(together) < np.maximum(0.05 * largest, 0.1 * sd)), kind


def _pulled(logs: Posterior, z: Array, j: Array, recording: PreparedRecording) -> Array:
    """First-order shift of c_f, c_r and i."""
    changed = replace(logs, space=replace(logs.space, recordings=(recording,)))
    left = (changed.innovations(z, 0) - logs.innovations(z, 0)).ravel()
    free = [0, 1, 2]
    inner = information([j])[np.ix_(free, free)]
    return np.asarray(-np.linalg.solve(inner, j[:, free].T @ left))


def test_a_fault_is_cut_down_to_what_the_residuals_would_not_show(declared: Case) -> None:
    """By least squares: what parameters cannot make up for has the noncentrality it says."""
    car, fit, width, sds = declared
    logs, z = in_logs(fit.posterior, fit.mode.z)
    j = jacobian(logs, z, 0)
    wide = np.array([math.log(3.0), math.log(3.0), math.log(2.0)])
    assert width.parameters[:3] == ("c_f", "c_r", "i")
    given = np.array([sds[name] for name in width.parameters[3:]])
    prior = np.concatenate([wide, given])
    free = prior > 0.0
    design = np.concatenate([j[:, free], np.diag(1.0 / prior[free])])
    cut = 0
    for shift in width.shifts:
        if shift.kind == "given":
            continue
        recording = with_fault(
            logs.space.recordings[0], Fault(shift.kind, shift.where, shift.size), car
        )
        changed = replace(logs, space=replace(logs.space, recordings=(recording,)))
        left = (changed.innovations(z, 0) - logs.innovations(z, 0)).ravel()
        posterior = np.concatenate([left, np.zeros(int(free.sum()))])
        rest = posterior - design @ np.linalg.lstsq(design, posterior)[0]
        noncentrality = float(rest @ rest)
        if shift.shows:
            cut += 1
            assert noncentrality == pytest.approx(DETECTABLE_NONCENTRALITY, rel=0.02)
        else:
            assert noncentrality <= 1.02 * DETECTABLE_NONCENTRALITY
    assert cut > 2
