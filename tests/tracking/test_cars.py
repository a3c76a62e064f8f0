"""Cars other than the half car, and other sensors, on drives of the rig: parameters come out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Sensor, Vehicle
from bayes_asv.tracking.track import TrackResult, track
from tests.posterior import test_roll as wide
from tests.posterior.cases import DECLARED, INCH, vehicle
from tests.rig import SensorSpec, baja, draw, draw_biases, drive
from tests.rig.terrain import bump, rough_road
from tests.rig.wide import shifted, wide_drive

SECONDS, RATE = 4.0, 400.0


def _faults(found: TrackResult, truth: dict[str, float]) -> list[str]:
    """Answers that were not learnt or lie where the filter does not say, and its own verdict."""
    faults = [] if (found.verdict, found.reasons) == ("ok", ()) else [found.verdict]
    faults += ["inconsistent"] if found.consistency.verdict == "inconsistent" else []
    for name in found.coordinates.estimands:
        mean, sd = found.log_moments(name)
        if not (sd < 0.05 and abs(mean - np.log(truth[name])) < 3.5 * sd):
            faults.append(name)
    return faults


def test_a_quarter_car() -> None:
    """The front axle of a car whose other axle does not move the body above it: i = m l_f l_r."""
    seed = 1
    rng = np.random.default_rng([seed, 61])
    nominal = baja()
    l_f, l_r = nominal.l * (1.0 - nominal.wdf), nominal.l * nominal.wdf
    car = replace(draw(nominal, rng, DECLARED), wdf=nominal.wdf)
    car = replace(car, i=car.m * l_f * l_r)
    run = drive(
        car, rough_road(seed, "D"), 5.4, RATE, SECONDS, draw_biases(SensorSpec(), rng), seed
    )
    front = Recording(
        run.time, run.channels[:2] / INCH, ("in/s^2",) * 2, (), "front.csv",
        channels=("front_wheel", "front_chassis"),
    )  # fmt: skip
    found = track(front, vehicle(DECLARED), car="quarter-front")
    assert _faults(found, {"c_f": car.c_f}) == []
    assert set(found.derived) == {"zeta_f"}


def test_potentiometers_and_a_gyro() -> None:
    rng = np.random.default_rng(62)
    car = draw(baja(), rng, DECLARED)
    run = drive(
        car, rough_road(3, "D"), 5.4, RATE, SECONDS, draw_biases(SensorSpec(), rng), 3,
        keep_motion=True,
    )  # fmt: skip
    assert run.motion is not None
    time, moved = run.motion.time, run.motion.deflection
    travel = [np.interp(run.time, time, d) + 2e-4 * rng.normal(size=len(run.time)) for d in moved]
    turning = (run.motion.acceleration[1] - run.motion.acceleration[3]) / car.l
    step = float(time[1] - time[0])
    rate = np.concatenate([[0.0], np.cumsum(0.5 * step * (turning[1:] + turning[:-1]))])
    gyro = np.interp(run.time, time, rate) + 2e-3 * rng.normal(size=len(run.time)) + 0.02
    recording = Recording(
        run.time, np.stack([*run.channels[[0, 2]], *travel, gyro]),
        ("m/s^2", "m/s^2", "m", "m", "rad/s"), (), "drive.csv",
        channels=(
            "front_wheel", "rear_wheel", "front_travel", "rear_travel", "body_pitch_rate",
        ),
    )  # fmt: skip
    known = vehicle(DECLARED)
    given = replace(
        known,
        sensors={
            **known.sensors, "front_travel": Sensor(noise=2e-4), "rear_travel": Sensor(noise=2e-4),
            "body_pitch_rate": Sensor(noise=2e-3),
        },
    )  # fmt: skip
    assert (
        _faults(track(recording, given), {name: getattr(car, name) for name in ("c_f", "c_r", "i")})
        == []
    )


def _given(folder: Path) -> Vehicle:
    """With a bar of no stiffness, so that its filter is the one of ``test_engines``."""
    car = wide.vehicle(folder, {"m": 0.01, "k": 0.05})
    assert car.roll is not None
    return replace(car, roll=replace(car.roll, front_bar=1e-6))


def test_a_roll_car_from_standstill(tmp_path: Path) -> None:
    """Biases of the wheels along their twist are learnt from the first half second."""
    car, road = wide.worn(), bump()
    run = wide_drive(car, (road, shifted(road, 0.6)), 4.4, RATE, 2.5, 5)
    found = track(wide.as_recording(run), _given(tmp_path), car="roll")
    assert _faults(found, wide.truth(car)) == []
