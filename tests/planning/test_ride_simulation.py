"""The ride simulation against the independent simulator of the rig."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.channels import CHANNELS, channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Given
from bayes_asv.models.cars import car_model
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import HalfCar, deflection_form
from bayes_asv.planning.drives import LEAD_IN, RoadProfile
from bayes_asv.planning.ride_simulation import Pass, Tyres, default_tyres, simulate_passes
from tests.posterior.cases import DECLARED, vehicle
from tests.rig import RigCar, baja, drive
from tests.rig import SensorSpec as Spec
from tests.rig.terrain import Haversine, Terrain

HALF = HalfCar(*(getattr(baja(), name) for name in HalfCar._fields))
CAR = car_model("half", vehicle(DECLARED))
FOUR = [channel(name) for name in CHANNELS]


def _same_car(tyres: Tyres) -> RigCar:
    """Return the rig's car with the tyres of the plan."""
    return replace(
        baja(), m_uf=float(tyres.mass[0]), m_ur=float(tyres.mass[1]),
        k_tf=float(tyres.rate[0]), k_tr=float(tyres.rate[1]),
        c_tf=float(tyres.damping[0]), c_tr=float(tyres.damping[1]),
        tyre_radius=0.27,
        contact_patch=(8.0 / 3.0) * math.sqrt(2.0 * 0.27 * tyres.static_deflection),
    )  # fmt: skip


@pytest.mark.parametrize(("height", "speed"), [(0.03, 4.0), (0.1, 5.0)])
def test_hubs_and_chassis_move_as_on_the_rig(height: float, speed: float) -> None:
    tyres = default_tyres(CAR)
    (found,) = simulate_passes(
        CAR, tyres, [Pass(RoadProfile("bump", height, 1.2, 1), speed, 1.6)], FOUR
    )
    terrain = Terrain("bump", ((0.0, Haversine(height, 1.2)),), lead_in=LEAD_IN)
    rig = drive(_same_car(tyres), terrain, speed, 400.0, 1.6, Spec.ideal(), 1, keep_motion=True)
    assert rig.motion is not None
    at = rig.motion.time
    use = (at > 0.0) & (at < 1.6)
    for row in range(4):
        mine = np.interp(at[use], found.time, found.signals[row])
        true = rig.motion.acceleration[row][use]
        # lift-off and landing are kinks, which both resolve to one of their own steps
        assert np.sqrt(np.mean((mine - true) ** 2)) < 0.02 * np.sqrt(np.mean(true**2))
    for axle in range(2):
        mine = np.interp(at[use], found.time, found.deflection[axle])
        assert mine == pytest.approx(rig.motion.deflection[axle][use], abs=1e-3 * height + 2e-4)
    off = rig.motion.tyre_force.min(axis=1) <= 0.0
    assert (found.airborne > 0.0).tolist() == off.tolist()
    assert off.any() == (height > 0.05)


def test_the_chassis_responds_to_its_hubs_as_the_half_car() -> None:
    """Driven by the simulated hubs, the estimator's model gives the same chassis motion."""
    (found,) = simulate_passes(
        CAR, default_tyres(CAR), [Pass(RoadProfile("stops", 0.06, 0.3, 2), 3.0, 2.0)], FOUR
    )
    system = deflection_form(HALF)
    states = simulate_linear(system, found.time, found.signals[[0, 2]].T)
    chassis = states @ system.C.T
    assert states[:, [0, 2]] == pytest.approx(found.deflection.T, abs=2e-5)
    largest = np.abs(found.signals).max()
    assert chassis[:, 0] == pytest.approx(found.signals[1], abs=2e-3 * largest)
    assert chassis[:, 1] == pytest.approx(found.signals[3], abs=2e-3 * largest)


def test_parallel_passes_equal_single_passes() -> None:
    passes = [
        Pass(RoadProfile("bump", 0.05, 0.9, 1), 3.0, 1.8),
        Pass(RoadProfile("rough", iso="D"), 8.0, 2.0, 4),
        Pass(RoadProfile("bump", 0.05, 0.9, 1), 6.0, 1.2),
    ]
    together = simulate_passes(CAR, default_tyres(CAR), passes, FOUR)
    for one, motion in zip(passes, together, strict=True):
        (alone,) = simulate_passes(CAR, default_tyres(CAR), [one], FOUR)
        assert motion.time == pytest.approx(alone.time)
        assert motion.time[-1] >= one.seconds
        scale = np.abs(alone.signals).max()
        # the spline of the road begins elsewhere, so its knots differ
        assert motion.signals == pytest.approx(alone.signals, abs=0.02 * scale)


def test_the_lead_in_is_level() -> None:
    (found,) = simulate_passes(
        CAR, default_tyres(CAR), [Pass(RoadProfile("rough", iso="E"), 2.0, 1.0)], FOUR
    )
    still = found.time < LEAD_IN - 0.3  # the tyre touches the road ahead of its axle
    assert np.abs(found.signals[:, still]).max() < 1e-6
    assert np.abs(found.signals).max() > 0.1


def test_an_implausible_car_is_refused() -> None:
    known = vehicle(DECLARED)
    stiff = car_model("half", replace(known, k_f=Given(1e9 * known.k_f.value)))
    passes = [Pass(RoadProfile("bump", 0.05, 0.9, 1), 3.0, 1.0)]
    with pytest.raises(InputError, match="check the units of masses"):
        simulate_passes(stiff, default_tyres(stiff), passes, FOUR)


def test_every_channel_is_read_from_the_same_motion() -> None:
    """Travel and pitch rate against the deflections and the two chassis accelerometers."""
    names = (*CHANNELS, "front_travel", "rear_travel", "body_pitch_rate")
    channels = [channel(name) for name in names]
    (found,) = simulate_passes(
        CAR, default_tyres(CAR), [Pass(RoadProfile("bump", 0.06, 0.9, 1), 3.0, 2.0)], channels
    )
    read = dict(zip(names, found.signals, strict=True))
    assert read["front_travel"] == pytest.approx(found.deflection[0], abs=1e-12)
    assert read["rear_travel"] == pytest.approx(found.deflection[1], abs=1e-12)
    turning = (read["front_chassis"] - read["rear_chassis"]) / HALF.l
    step = found.time[1] - found.time[0]
    rate = np.concatenate([[0.0], np.cumsum(0.5 * (turning[1:] + turning[:-1])) * step])
    assert read["body_pitch_rate"] == pytest.approx(rate, abs=2e-3 * np.abs(rate).max())
