"""One car, its shipped recordings, and one estimate that several tests look at."""

from __future__ import annotations

import matplotlib as mpl
import pytest

import bayes_asv as asv
from tests.cli.conftest import invoke

__all__ = ["invoke"]  # runs the program inside this process

mpl.use("Agg")


@pytest.fixture(scope="session")
def car() -> asv.Vehicle:
    """Return the shipped car."""
    return asv.read_vehicle(asv.example("baja2008.toml"))


@pytest.fixture(scope="session")
def stops() -> asv.Recording:
    """Return a recording of it."""
    return asv.read_recording(asv.example("stops-400hz.csv"))


@pytest.fixture(scope="session")
def bump() -> asv.Recording:
    """Return another recording of it."""
    return asv.read_recording(asv.example("bump-400hz.csv"))


@pytest.fixture(scope="session")
def short(stops: asv.Recording) -> asv.Recording:
    """Return a quarter of a second, too short for an answer."""
    return asv.Recording(stops.time[:100], stops.values[:, :100], stops.units)


@pytest.fixture(scope="session")
def result(stops: asv.Recording, bump: asv.Recording, car: asv.Vehicle) -> asv.Estimate:
    """Estimate both recordings once."""
    return asv.estimate([stops, bump], car, seed=1)


@pytest.fixture(scope="session")
def refused(short: asv.Recording, car: asv.Vehicle) -> asv.Estimate:
    """Return a refusal."""
    return asv.estimate(short, car)
