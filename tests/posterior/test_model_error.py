"""The error that a mode owes to what its model lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from bayes_asv.domain.errors import FitError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.fitted_model import FittedModel, fit_linear_car, make_dataset
from bayes_asv.posterior.model_error import _Band, draw_cars, model_error
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.real_cars import NAMES, driven


def _fit(recordings: Sequence[Recording], vehicle: Vehicle) -> FittedModel:
    lines, reasons, _ = prepare_runs(recordings, vehicle)
    assert not reasons
    return fit_linear_car(make_dataset(vehicle, lines))


def test_exact_cars_have_none() -> None:
    found = [model_error(_fit([recording], given)) for recording, given, _ in _drives(6, 0.0)]
    assert sum(bool(one.any()) for one in found) <= 1  # one in a hundred by chance


@pytest.mark.parametrize("size", [0.25, 1.0])
def test_intervals_hold_the_truth_of_cars_that_the_model_is_not_quite(size: float) -> None:
    rng = np.random.default_rng(0)
    inside = {True: 0, False: 0}
    drives = _drives(9, size)
    for recording, given, truth in drives:
        fit = _fit([recording], given)
        for allowed in inside:
            spread = fit.mode.covariance + model_error(fit) * allowed
            z = draw_cars(fit.space, fit.mode.z, spread, 4000, rng)
            draws = fit.space.quantities(z, 0)
            for name in NAMES:
                low, high = np.quantile(draws[name], [0.025, 0.975])
                inside[allowed] += bool(low <= truth[name] <= high)
    of = len(drives) * len(NAMES)
    assert inside[True] >= 0.85 * of
    assert inside[False] < 0.75 * of


def test_more_of_the_same_drive_does_not_average_it_out() -> None:
    recording, given, _ = driven(0, 0.5)
    once, four = (_fit([recording] * n, given) for n in (1, 4))
    of_car = slice(0, once.space.car_dimension)
    one, many = (np.diag(model_error(fit))[of_car] for fit in (once, four))
    assert np.all(many > 0.5 * one)
    noise = [np.trace(fit.mode.covariance[of_car, of_car]) for fit in (once, four)]
    assert noise[1] < noise[0]


def test_it_is_a_covariance_however_alike_coordinates_are() -> None:
    """Points of a curve at the ends of their heavy-tailed priors: only sums of them are known."""
    recording, given, _ = driven(0, 1.0)
    fit = _fit([recording], given)
    means = fit.mode.slopes.means.copy()
    means[0] *= 1e4
    means[1:3] += means[0]
    known = replace(fit, mode=replace(fit.mode, slopes=replace(fit.mode.slopes, means=means)))
    assert np.linalg.cond(known.mode.slopes.precision()) > 1e12
    found = model_error(known)
    assert found.any()
    np.testing.assert_allclose(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > -1e-12 * np.trace(found)
    assert not known.diverged
    means[0] *= 1e6
    assert known.diverged


def test_an_error_beyond_all_cars_is_not_drawn_for_ever() -> None:
    recording, given, _ = driven(0, 0.0)
    fit, rng = _fit([recording], given), np.random.default_rng(0)
    wide = 1e12 * np.eye(fit.space.dimension)
    with pytest.raises(FitError, match="err by more than any car allows"):
        draw_cars(fit.space, fit.mode.z, wide, 100, rng)
    assert len(draw_cars(fit.space, fit.mode.z, fit.mode.covariance, 100, rng)) == 100


@pytest.mark.parametrize("information", [(40.0, 40.0), (90.0, 20.0, 10.0), (5.0,) * 12])
def test_its_intervals_are_those_of_students_distribution(
    monkeypatch: pytest.MonkeyPatch, information: tuple[float, ...]
) -> None:
    """A single coordinate that a few bands of frequency determine, each with a score of its own."""
    known = np.array(information)
    precision, score = 1.0 + known.sum(), 6.0 * np.sqrt(known)
    bands = [
        _Band(np.array([s]), np.array([[f]]), 100.0, 10) for s, f in zip(score, known, strict=True)
    ]
    monkeypatch.setattr("bayes_asv.posterior.model_error._split_into_bands", lambda _: bands)
    fit: Any = SimpleNamespace()
    fit.mode = SimpleNamespace(slopes=SimpleNamespace(precision=lambda: np.array([[precision]])))
    moved = score / (precision - known)
    by_chance = known / (precision - known) ** 2
    sd = np.sqrt(np.sum(moved**2 - by_chance))
    degrees = known.sum() ** 2 / np.sum(known**2)
    half_width = 1.959964 * np.sqrt(model_error(fit)[0, 0])
    assert half_width == pytest.approx(student.ppf(0.975, degrees) * sd, rel=1e-5)


def _drives(count: int, size: float) -> list[tuple[Recording, Vehicle, dict[str, float]]]:
    return [driven(300 + seed, size) for seed in range(count)]
