"""The example of a car in ``docs/extending.md`` can be followed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.extension_steps import ROOT, apply, blocks, copy_package, run

PAGE = ROOT / "docs" / "extending.md"
HEADING = "A car"
VEHICLE = ROOT / "data" / "vehicles" / "baja2008.toml"

# The equation of a trailer, integrated here on its own: i_h θ'' = -l F at the axle, l behind the
# hitch, with F = -k δ - c δ' and δ = -l θ - z for a hub that moves by z.
SIMULATION = """
import numpy as np

import bayes_asv as asv
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate

assert asv.__file__.startswith({folder!r})
car = asv.read_vehicle("car.toml")
drive = simulate(car, road("bump", np.random.default_rng(1)), seconds=1.0, car="trailer")
step = drive.time[1] - drive.time[0]
hub, body = drive.truth
arm = car.l.value * (1.0 - car.wdf.value)
inertia = car.i.value + car.m.value * arm**2
l, k, c = car.l.value, car.k_r.value, car.c_r.value
state = np.zeros(2)  # deflection and its rate


def slope(state, acceleration):
    force = -k * state[0] - c * state[1]
    return np.array([state[1], l**2 * force / inertia - acceleration]), l**2 * force / inertia


expected = np.zeros(len(hub))
for n in range(len(hub) - 1):
    expected[n] = slope(state, hub[n])[1]
    middle = 0.5 * (hub[n] + hub[n + 1])
    half = state + 0.5 * step * slope(state, hub[n])[0]
    state = state + step * slope(half, middle)[0]
expected[-1] = slope(state, hub[-1])[1]
assert np.ptp(body) > 5.0
assert np.abs(body - expected).max() < 1e-3 * np.ptp(body)
"""

FIT = """
import numpy as np

import bayes_asv as asv
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.posterior.residual_ar import WHITE

car = asv.read_vehicle("car.toml")
worn = dict(c_r=0.7)
run = asv.simulate(car, "stops", car="trailer", change=worn, seconds=1.5, seed=3)
assert run.channels == ("rear_wheel", "rear_chassis")
lines, reasons, _ = prepare_runs([run], car, car="trailer")
assert not reasons, reasons
where = make_parameter_space(car, lines)
factors = np.array([0.5, 0.6, 0.7, 0.8, 1.0])
points = np.stack([where.from_logs(dict(c_r=x)) for x in np.log(factors)])
values = Posterior(where, (WHITE,)).log_posterior(points)
assert factors[np.argmax(values)] == 0.7
assert values.max() - values[-1] > 20.0
"""


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the package and follow the steps of the page in it."""
    folder = tmp_path_factory.mktemp("copy")
    package = copy_package(folder)
    (file,) = blocks(PAGE, HEADING, "python")
    (package / "models" / "cars" / "trailer.py").write_text(file, encoding="utf-8")
    *lines, names = blocks(PAGE, HEADING, "diff")
    apply(package / "models" / "cars" / "__init__.py", lines)
    apply(package / "cli" / "common.py", [names])
    (folder / "car.toml").write_text(VEHICLE.read_text(encoding="utf-8"), encoding="utf-8")
    return folder


@pytest.mark.parametrize("code", [SIMULATION, FIT], ids=["simulated", "explained"])
def test_the_steps_make_a_car(extended: Path, code: str) -> None:
    code = code.replace("{folder!r}", repr(str(extended)))
    # Interpreted: compiling the filter again would take longer.
    done = run(extended, "-c", code, environment={"NUMBA_DISABLE_JIT": "1"})
    assert done.returncode == 0, done.stderr


def test_the_command_takes_the_car(extended: Path) -> None:
    done = run(extended, "-m", "bayes_asv", "estimate", "--help")
    assert "trailer" in done.stdout
