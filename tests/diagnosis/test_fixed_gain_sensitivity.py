"""Changes of the predictions by a filter that stays as it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.diagnosis.fixed_gain_sensitivity import along, steady
from bayes_asv.posterior.effect_fit import read_site, with_effects
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, base, setting
from bayes_asv.posterior.free_simulation import simulated
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.map_fit import lay_out
from tests.posterior.cases import DECLARED, INCH, case, vehicle
from tests.rig import SensorSpec

Array = NDArray[np.float64]

_LOUD = SensorSpec(noise=(4.0 * INCH, 2.0 * INCH, 4.0 * INCH, 2.0 * INCH))


@cache
def _fitted(law: str | None) -> tuple[Dataset, FittedModel]:
    _, _, recording = case("bump", 3, DECLARED, sensors=_LOUD)
    car = vehicle(DECLARED, _LOUD)
    lines, _, _ = lay_out([recording], car)
    where = setting(car, lines)
    return (where, base(where)) if law is None else with_effects(where, [read_site(law)])


def _foretold(law: str | None) -> tuple[Posterior, Array, int]:
    """A model on readings that it foretells to the last digit, from rest."""
    where, stage = _fitted(law)
    z, line = stage.mode.z, stage.space.timelines[0]
    inputs = stage.target.as_declared(z, 0)
    output, _ = simulated(stage.target, z, 0, inputs, np.zeros(6))
    reading = output + line.reading - inputs.reading
    exact = replace(where, lines=(replace(line, reading=reading),))
    target = replace(exact.target(stage.sites), patterns=stage.target.patterns)
    return target, z, stage.space.lasting_dimension


def _along(target: Posterior, z: Array, first: int) -> Array:
    return along([steady(target, z, 0)], first)


def _apart(one: Array, other: Array) -> Array:
    """Length of the difference of rows over that of the rows; nothing for rows of nothing."""
    size, left = np.linalg.norm(one, axis=1), np.linalg.norm(one - other, axis=1)
    return np.asarray(left / np.maximum(size, 1e-6))


@pytest.mark.parametrize("law", [None, "bound_rebound@rear"])
def test_without_innovations_it_is_the_derivative_of_the_filter(law: str | None) -> None:
    """Where a filter has nothing to correct, how it corrects makes no difference."""
    target, z, n = _foretold(law)
    assert np.mean(target.scored(z, 0)[0] ** 2) < 1e-3
    whole, alone = slopes(target, z).means[:n], _along(target, z, n)
    assert np.all(_apart(whole, alone) < 0.01)


def test_with_innovations_only_the_filter_knows_what_it_corrects() -> None:
    """The same readings with noise: the rows by the filter as it stands do not change with them."""
    target, z, n = _foretold(None)
    rng = np.random.default_rng(0)
    line = target.space.timelines[0]
    noisy = replace(
        line, reading=line.reading + 5.0 * INCH * rng.standard_normal((len(line.step), 2))
    )
    loud = replace(target, space=replace(target.space, timelines=(noisy,)))
    still, moved = _along(target, z, n), _along(loud, z, n)
    assert np.all(_apart(still, moved) < 0.006)
    assert np.max(_apart(still, slopes(loud, z).means[:n])) > 0.012


def test_another_model_that_is_the_same_changes_nothing() -> None:
    target, z, _ = _foretold(None)
    here = steady(target, z, 0)
    assert np.all(here.row(target, z) == 0.0)
    assert here.row(target, z).shape == (np.count_nonzero(here.there),)
