"""Models of the battery's cases, for the tests of the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from bayes_asv.diagnosis.model_assessment import AssessedModel, assess
from bayes_asv.diagnosis.workflow import DiagnosisResult, diagnose
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.fitted_model import (
    Dataset,
    FittedModel,
    fit_linear_car,
    make_dataset,
    update_corrections,
)
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.battery.cases import Case, case
from tests.battery.vehicles import Fleet

__all__ = [
    "assess_case",
    "assess_linear",
    "diagnose_case",
    "fit_linear",
    "ignore_progress",
    "prepared",
]


def prepared(recordings: Sequence[Recording], vehicle: Vehicle) -> Dataset:
    """Recordings prepared for a fit."""
    lines, reasons, _ = prepare_runs(recordings, vehicle)
    assert not reasons
    return make_dataset(vehicle, lines)


def fit_linear(dataset: Dataset) -> tuple[Dataset, FittedModel]:
    """The linear half car, and recordings whose sensor corrections follow from its predictions."""
    model = fit_linear_car(dataset)
    dataset = update_corrections(dataset, model)
    return dataset, replace(
        model, posterior=replace(model.posterior, sensor_corrections=dataset.sensor_corrections)
    )


def assess_linear(one: Case, seed: int = 1) -> AssessedModel:
    """The linear half car on the fitted recordings of a case, assessed."""
    dataset = prepared(one.recordings, one.vehicle)
    return assess(dataset, fit_linear_car(dataset), seed)


@cache  # several tests begin with the same one
def assess_case(name: str, seed: int, number: int, fleet: Fleet) -> AssessedModel:
    """Assess a case of the battery, given by its name, as :func:`assess_linear` does."""
    return assess_linear(case(name, seed, number, fleet))


@cache
def diagnose_case(
    name: str, seed: int, number: int, fleet: Fleet, fitted: int = 2
) -> tuple[Case, DiagnosisResult]:
    """Diagnose the first recordings of a case of the battery, given by its name, with seed 0."""
    one = case(name, seed, number, fleet)
    return one, diagnose(one.recordings[:fitted], one.holdout, one.vehicle, 0)


def ignore_progress(share: float, text: str) -> None:
    """Ignore the progress of a selection."""
