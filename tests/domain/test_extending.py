"""The example of a channel in ``docs/extending.md`` can be followed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.extension_steps import ROOT, apply, blocks, copy_package, run

PAGE = ROOT / "docs" / "extending.md"
HEADING = "A channel"
VEHICLE = ROOT / "data" / "vehicles" / "baja2008_roll.toml"

BEGIN = """
from dataclasses import replace

import numpy as np

import bayes_asv as asv
from bayes_asv.domain.vehicle import write_vehicle

assert asv.__file__.startswith({folder!r})
car = asv.read_vehicle("car.toml")
"""

FILES = """
sensor = car.sensor("body_roll_rate")
assert (sensor.noise, sensor.high) == (np.radians(0.2), np.radians(100.0))
write_vehicle(car, "again.toml")
assert asv.read_vehicle("again.toml") == car
again = asv.read_recording("run.csv")
assert again.channels == run.channels == (*wheels, "rear_chassis", "body_roll_rate")
assert again.units[-1] == "deg/s"
assert np.array_equal(again.values, run.values)
"""

# The chassis accelerations of both sides differ by the roll acceleration times their distance.
SIMULATION = """
ideal = replace(car, sensors={})
names = ["front_left_chassis", "front_right_chassis", "body_roll_rate"]
run = asv.simulate(ideal, "rough", car="roll", channels=names, rate=4000.0, seed=2)
left, right, rate = run.values
rolling = (left - right) * 0.0254 / car.roll.front_track.value
expected = np.degrees(np.cumsum(0.5 * (rolling[1:] + rolling[:-1])) / 4000.0)
assert np.ptp(rate) > 5.0
assert np.abs(rate[1:] - rate[0] - expected).max() < 0.005 * np.ptp(rate)
"""

# No other sensor on the body: the roll inertia is known from its rate alone.
FIT = """
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.posterior.residual_ar import WHITE

names = [f"{axle}_{side}_wheel" for axle in ("front", "rear") for side in ("left", "right")]
run = asv.simulate(
    car, "stops", car="roll", channels=[*names, "body_roll_rate"],
    change={"i_roll": 1.2}, rate=200.0, seconds=1.0, seed=3,
)
lines, _, _ = prepare_runs([run], car, car="roll")
where = make_parameter_space(car, lines)
factors = np.array([1.0, 1.1, 1.2, 1.3, 1.44])
points = np.stack([where.from_logs({"i_roll": x}) for x in np.log(factors)])
values = Posterior(where, (WHITE,)).log_posterior(points)
assert np.all(np.isfinite(values))
assert factors[np.argmax(values)] == 1.2
assert values.max() - values[0] > 20.0
"""


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the package and follow the steps of the page in it."""
    folder = tmp_path_factory.mktemp("copy")
    channels = copy_package(folder) / "domain" / "channels"
    file, _ = blocks(PAGE, HEADING, "python")
    (channels / "roll_rate.py").write_text(file, encoding="utf-8")
    apply(channels / "__init__.py", blocks(PAGE, HEADING, "diff"))
    (sensor,) = blocks(PAGE, HEADING, "toml")
    text = VEHICLE.read_text(encoding="utf-8")
    (folder / "car.toml").write_text(f"{text}\n{sensor}", encoding="utf-8")
    return folder


def _errors(folder: Path, code: str) -> str:
    """Run a script with assertions of its own in the copy; return what fails, empty if all hold."""
    begin = BEGIN.format(folder=str(folder))
    # Interpreted: compiling the filter for this set of channels would take longer.
    done = run(folder, "-c", begin + code, environment={"NUMBA_DISABLE_JIT": "1"})
    return done.stderr if done.returncode else ""


def test_the_steps_make_a_channel_of_files(extended: Path) -> None:
    _, simulated = blocks(PAGE, HEADING, "python")
    assert _errors(extended, simulated + FILES) == ""


def test_the_channel_is_simulated(extended: Path) -> None:
    assert _errors(extended, SIMULATION) == ""


def test_the_channel_is_explained(extended: Path) -> None:
    assert _errors(extended, FIT) == ""
