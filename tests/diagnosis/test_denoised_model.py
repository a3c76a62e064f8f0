"""Quiet wheels: what signatures are worked out on must not share noise with the innovations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bayes_asv.diagnosis.denoised_model import clear, on_quiet_wheels, quieted
from bayes_asv.diagnosis.score_test import signatures
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.effect_candidates import candidates
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, base, foretold, setting
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.input_noise_smoother import without_noise
from bayes_asv.posterior.map_fit import lay_out
from tests.battery.cases import case
from tests.rig import SensorSpec, baja, drive, parking_stops, vehicle_toml
from tests.rig.units import INCH


def _driven(noise: SensorSpec, seed: int) -> Recording:
    run = drive(baja(), parking_stops(2.5 * INCH), 2.5, 400.0, 2.5, noise, seed)
    return Recording(run.time, run.channels, ("m/s^2",) * 4, (), "drive.csv")


@cache
def _setting(vehicle: Vehicle, seed: int) -> tuple[Dataset, FittedModel]:
    lines, reasons, _ = lay_out([_driven(SensorSpec(adc=None), seed)], vehicle)
    assert not reasons
    where = setting(vehicle, lines)
    stage = base(where)
    where = foretold(where, stage)
    return where, replace(stage, target=replace(stage.target, patterns=where.patterns))


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Vehicle:
    from bayes_asv.domain.vehicle import read_vehicle

    path = tmp_path_factory.mktemp("car") / "car.toml"
    path.write_text(vehicle_toml(baja(), SensorSpec(adc=None)), encoding="utf-8")
    return read_vehicle(path)


def test_quiet_wheels_leave_the_innovations_as_they_were(vehicle: Vehicle) -> None:
    where, stage = _setting(vehicle, 3)
    quiet = quieted(where, stage)
    before, _, _ = stage.target.scored(stage.mode.z, 0)
    after, _, _ = quiet.target(()).scored(stage.mode.z, 0)
    np.testing.assert_allclose(after, before, atol=1e-9)
    change = quiet.lines[0].moments[:, :, 0] - where.lines[0].moments[:, :, 0]
    assert np.std(change) > 0.0


def test_what_is_taken_from_a_wheel_is_its_noise(vehicle: Vehicle) -> None:
    """Over 12 drives (seeds 20 to 31) less of it is left, and knows nothing of a free run's rest.

    The reading's own noise goes with that rest: their product is ten of its deviations from zero.
    """
    raw: list[list[float]] = []
    left: list[list[float]] = []
    clean = _driven(SensorSpec.clean(), 0).values
    for seed in range(20, 32):
        _, stage = _setting(vehicle, seed)
        target, z = stage.target, stage.mode.z
        line = target.space.timelines[0]
        rest = line.reading - free_run(target, z, 0)[0]
        quiet = without_noise(target, z, 0)
        for axle in range(2):
            knots = line.wheels[axle].knots
            truth = np.interp(knots, line.times[2 * axle], clean[2 * axle])
            r = np.interp(knots, line.instants, rest[:, axle])
            late = knots > knots[0] + 0.2
            for wheel, out in ((line.wheels[axle], raw), (quiet.wheels[axle], left)):
                noise = (wheel.spline(knots) - truth)[late]
                out.append([float(np.std(noise)), float(noise @ r[late]), float(r[late] @ r[late])])
    first, last = np.array(raw), np.array(left)
    assert np.all(last[:, 0] < first[:, 0])
    shared = [float(x[:, 1].mean() / (x[:, 1].std() / np.sqrt(len(x)))) for x in (first, last)]
    assert shared[0] < -6.0  # a free run leaves e − G n
    assert abs(shared[1]) < 3.5


def test_a_score_asks_about_predictions_and_not_about_deviations(vehicle: Vehicle) -> None:
    """A stiffer spring as an effect has the slope of the car's own spring rate."""
    where, stage = _setting(vehicle, 3)
    wanted = [c for c in candidates(stage, vehicle) if str(c.site) == "spring_rate@front"]
    quiet = clear(*on_quiet_wheels(where, stage))
    found = signatures(quiet, wanted)
    slope = quiet.slopes.means.T
    rest = found.rows[0] - slope @ np.linalg.lstsq(slope, found.rows[0])[0]
    # The effect is a sum of the car's own slopes.  With the change of the deviations in its row,
    # which goes with the innovations' squares, 0.37 deviations of its score would be left.
    nu = quiet.slopes.nu
    assert abs(rest @ nu) < 0.1 * np.sqrt(found.gram[0, 0])
    assert np.all(found.rows[0][~quiet.settled] == 0.0)


def test_scores_where_nothing_is_wrong_stand_about_zero() -> None:
    """8 drives without a fault, seed 7: springs and friction, mean score; 0.9 when they do not."""
    scores = []
    for number in range(8):
        one = case(f"null/{('bump', 'stops')[number % 2]}", 7, number)
        where = setting(one.vehicle, lay_out(one.recordings, one.vehicle)[0])
        stage = base(where)
        where = foretold(where, stage)
        stage = replace(stage, target=replace(stage.target, patterns=where.patterns))
        wanted = [
            c
            for c in candidates(stage, one.vehicle)
            if c.site.effect.name in ("spring_rate", "coulomb_friction")
        ]
        scores += signatures(clear(*on_quiet_wheels(where, stage)), wanted).score.tolist()
    assert len(scores) >= 40
    assert abs(np.mean(scores)) < 0.4
    assert np.mean(np.square(scores)) < 1.5
