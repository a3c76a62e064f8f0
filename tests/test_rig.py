"""The rig is right before anything is judged by it.

Truths used here: the exact linear frequency response and the equations of motion written out a
second time (both in ``rig/exact.py``), energy, and textbook properties of filters and noise.
"""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

import tests.rig as rig
from tests.rig.__main__ import main
from tests.rig.exact import SPEED, exact, linear_car, nonlinear_rates, on_the_waves, worst
from tests.rig.motion import lagrange
from tests.rig.road import lay
from tests.rig.sensors import low_pass, sense
from tests.rig.units import INCH, LBF_PER_INCH, LBF_S2_INCH, MPH

Reals = npt.NDArray[np.float64]

# --- the integrator ----------------------------------------------------------------------------


def test_linear_car_follows_the_exact_frequency_response() -> None:
    car = linear_car()
    motion = on_the_waves(car, 16_000.0)
    states, acceleration, jerk = exact(car, motion.time)
    assert worst(motion.states[:, :8].T, states) < 1e-7
    assert worst(motion.acceleration, acceleration) < 1e-6
    error = motion.acceleration - acceleration
    lag = -(error * jerk).sum(axis=1) / (jerk**2).sum(axis=1)  # a(t - lag) = a - lag a'
    assert np.abs(lag).max() < 1e-8  # s; the demand is a microsecond
    assert abs(lag[0] - lag[1]) < 1e-8


def test_integrator_is_of_fourth_order() -> None:
    car = linear_car()
    errors = []
    for rate in (250.0, 500.0, 1000.0):
        motion = on_the_waves(car, rate)
        errors.append(worst(motion.acceleration, exact(car, motion.time)[1]))
    ratios = [errors[0] / errors[1], errors[1] / errors[2]]
    assert all(14.0 < ratio < 18.5 for ratio in ratios), ratios


def test_nonlinear_car_that_lifts_agrees_with_another_solver() -> None:
    car = rig.with_terms(replace(linear_car(), tyre_lifts=True), "both", rig.Coulomb(60.0, 0.05))
    terrain = rig.Terrain("bump", ((0.0, rig.Haversine(0.1, 1.2)),), 0.1)
    motion = rig.simulate(car, terrain, SPEED, 0.0, 1.2)
    assert motion.tyre_force.min() == 0.0
    other = solve_ivp(
        nonlinear_rates, (0.0, 1.2), np.zeros(8), "DOP853", t_eval=motion.time[::16],
        rtol=1e-10, atol=1e-12, max_step=5e-4, args=(car,),
    )  # fmt: skip
    assert worst(motion.states[::16, :8].T, other.y) < 3e-6


def test_rest_stays_rest_with_every_term() -> None:
    car = rig.with_terms(
        rig.baja(),
        "both",
        rig.AsymmetricDamper(500.0, 3.0),
        rig.DigressiveDamper(500.0, 0.2),
        rig.Coulomb(40.0),
        rig.SinhSpring(1e4, 20.0),
        rig.SmoothStop(0.02, 1e5),
        rig.SmoothStop(0.02, 1e5, droop=True),
        rig.FadingDamper(300.0, 0.2),
        rig.CurveDamper((-1.0, -0.1, 0.1, 1.0), (-900.0, -200.0, 300.0, 1500.0)),
        rig.CurveSpring((-0.1, 0.0, 0.1), (-2000.0, 0.0, 3000.0)),
        rig.PositionDamper(300.0, 50.0),
        rig.QuadraticDamper(300.0),
        rig.MaxwellMount(500.0, 1e5),
        rig.BoucWen(50.0),
    )
    car = replace(car, seat=rig.Seat(70.0, 3e4, 800.0))
    run = rig.drive(car, rig.flat(), 4.0, 400, 1.0, rig.SensorSpec.clean(), 0, keep_motion=True)
    assert run.motion is not None
    assert np.abs(run.motion.states).max() < 1e-12
    assert np.abs(run.channels).max() < 1e-9
    np.testing.assert_allclose(run.tyre_force[0], car.load_f, rtol=1e-12)


def test_tyres_lift_on_a_hard_bump_and_never_pull() -> None:
    car = rig.baja()
    motion = rig.simulate(car, rig.bump(6.0 * INCH, 1.0), 10.0 * MPH, -0.2, 2.0)
    assert motion.tyre_force.min() == 0.0
    airborne = motion.tyre_force[0] == 0.0
    assert 0.02 < airborne.mean() < 0.5
    # in the air nothing but gravity and the suspension moves the hub
    free = -motion.suspension_force[0] - car.load_f
    np.testing.assert_allclose(motion.acceleration[0][airborne] * car.m_uf, free[airborne])


@pytest.mark.parametrize("lifts", [False, True])
def test_energy_only_leaves_on_a_flat_road(lifts: bool) -> None:
    car = replace(rig.baja(), tyre_lifts=lifts)
    start = np.array([0.12, 0.05, 0.09, 0.08, 0.3, -0.2, 1.0, 0.6])
    motion = rig.simulate(car, rig.flat(), 0.0, 0.0, 2.0, initial=start)
    assert (motion.tyre_force.min() <= 0.0) or not lifts
    x = motion.states.T
    energy = 0.5 * (car.m * x[4] ** 2 + car.i * x[5] ** 2 + car.m_uf * x[6] ** 2)
    energy += 0.5 * car.m_ur * x[7] ** 2
    rates = ((car.k_f, car.k_tf, car.load_f), (car.k_r, car.k_tr, car.load_r))
    for j, (k, k_t, load) in enumerate(rates):
        depth = load / k_t - x[2 + j]
        depth = np.maximum(depth, 0.0) if lifts else depth
        energy += 0.5 * k * motion.deflection[j] ** 2 + 0.5 * k_t * depth**2 + load * x[2 + j]
    energy -= 0.5 * (car.load_f**2 / car.k_tf + car.load_r**2 / car.k_tr)
    assert np.diff(energy).max() < 1e-9 * energy[0]
    assert 0.0 <= energy[-1] < 0.01 * energy[0]


# --- suspension terms and forces ---------------------------------------------------------------


def apart(a: rig.RigCar, b: rig.RigCar) -> float:
    runs = [rig.simulate(car, rig.bump(), 10.0 * MPH, -0.2, 1.5) for car in (a, b)]
    return worst(runs[0].acceleration, runs[1].acceleration)


def test_terms_fall_back_on_the_linear_ones_in_their_limits() -> None:
    car = rig.baja()
    c = car.c_f
    for term, tolerance in (
        (rig.AsymmetricDamper(c, 1.0), 1e-12),
        (rig.DigressiveDamper(c, 1e4), 1e-7),
        (rig.FadingDamper(c, 0.0), 1e-12),
        (rig.CurveDamper((-0.2, 0.0, 0.2), (-0.2 * c, 0.0, 0.2 * c)), 1e-9),
        (rig.PositionDamper(c, 0.0), 1e-12),
        (rig.MaxwellMount(c, 2e7), 2e-2),
        (rig.CustomLaw(lambda _d, v, _t: -1260.9132738 * v), 1e-6),
        (rig.CustomLaw(lambda _d, v, _t: -c * v, native=False), 1e-12),
    ):
        assert apart(rig.with_terms(car, "front", term, damper=False), car) < tolerance
    soft = rig.SinhSpring(car.k_f, 1e-6)
    assert apart(rig.with_terms(car, "front", soft, spring=False), car) < 1e-6
    assert apart(replace(car, seat=rig.Seat(70.0, 7e7, 7e4, -0.3)), car) < 3e-3


def test_forces_of_terms_against_their_formulas() -> None:
    """Move an axle, read its force: bound and rebound rates, stiffening, stops, friction."""

    def force(term: rig.Term, delta: float = 0.0, rate: float = 0.0) -> float:
        car = rig.with_terms(rig.baja(), "front", term, spring=False, damper=False)
        start = np.array([delta, 0.0, 0.0, 0.0, rate, 0.0, 0.0, 0.0])
        return float(rig.simulate(car, rig.flat(), 0.0, 0.0, 0.01, initial=start)
                     .suspension_force[0, 0])  # fmt: skip

    both = rig.AsymmetricDamper(1000.0, 3.0)
    assert force(both, rate=1.0) - force(both, rate=2.0) == pytest.approx(1500.0, rel=1e-3)
    assert force(both, rate=-2.0) - force(both, rate=-1.0) == pytest.approx(500.0, rel=2e-3)
    assert force(rig.SinhSpring(2e4, 30.0), 0.03) == pytest.approx(
        -2e4 * 0.03 * (1.0 + 30.0 * 0.03**2), rel=1e-3
    )
    assert force(rig.SmoothStop(0.05, 1e5), -0.07) == pytest.approx(2000.0, rel=1e-3)
    assert force(rig.SmoothStop(0.05, 1e5, droop=True), 0.07) == pytest.approx(-2000.0, rel=1e-3)
    assert force(rig.Coulomb(50.0), rate=0.5) == pytest.approx(-50.0, rel=1e-6)
    assert force(rig.CurveDamper((-1.0, 0.0, 1.0), (-400.0, 0.0, 900.0)), rate=1.0) == -900.0


def test_outside_force_shakes_the_chassis_as_newton_says() -> None:
    """A force far above all modes meets only the inertia seen at its axle line."""
    car, omega = linear_car(), 2.0 * math.pi * 400.0
    shake = rig.ForceFunction(rear=lambda t: 500.0 * np.sin(omega * t))
    motion = rig.simulate(car, rig.flat(), 0.0, 0.0, 0.5, (shake,), rate=64_000.0)
    late = motion.acceleration[:, -16_000:]
    assert late[3].std() == pytest.approx(
        500.0 / math.sqrt(2.0) * (1.0 / car.m + car.l_r**2 / car.i), rel=0.02
    )
    assert late[0].std() < 0.02 * late[3].std()
    run = rig.drive(rig.baja(), rig.flat(), 0.0, 400, 2.0, rig.SensorSpec.clean(), 0,
                    forces=(rig.Engine(seed=3), rig.Push(100.0, 0.5, 0.2)))  # fmt: skip
    assert run.channels[3].std() > 3.0 * run.channels[2].std() > 0.0


# --- sensors -----------------------------------------------------------------------------------


def test_channels_are_the_exact_filtered_delayed_response() -> None:
    car = linear_car()
    motion = on_the_waves(car, 16_000.0)
    spec = rig.SensorSpec.clean()
    # the filter starts at its input, so its own transient is left to die for 0.3 s
    reading = sense(motion, spec, car.l, 400.0, 1.9, np.random.SeedSequence(0))
    for j in range(4):
        _, true, jerk = exact(car, reading.time + spec.delay[j], 50.0)
        late = reading.time > 0.3
        error = (reading.values - true)[j, late]
        assert np.abs(error).max() < 1e-6 * np.abs(true[j]).max()
        lag = -(error @ jerk[j, late]) / (jerk[j, late] @ jerk[j, late])
        assert abs(lag) < 1e-8


def test_common_filter_cancels_for_a_linear_car() -> None:
    """Filtered chassis = deflection model driven by filtered wheels, a second formulation."""
    car, rate = rig.baja(), 8000.0
    spec = replace(rig.SensorSpec.clean(), delay=(0.0,) * 4)
    run = rig.drive(car, rig.parking_stops(), 7.0 * MPH, rate, 2.0, spec, 0)
    b = np.array(
        [
            [1 / car.m + car.l_f**2 / car.i, 1 / car.m - car.l_f * car.l_r / car.i],
            [1 / car.m - car.l_f * car.l_r / car.i, 1 / car.m + car.l_r**2 / car.i],
        ]
    )
    out = b @ np.array([[-car.k_f, 0, -car.c_f, 0], [0, -car.k_r, 0, -car.c_r]])
    a = np.vstack([np.eye(4)[2:], out])
    drive = np.vstack([np.zeros((2, 2)), -np.eye(2)])
    _, chassis, _ = lsim((a, drive, out, np.zeros((2, 2))), run.channels[[0, 2]].T, run.time)
    # the limit is lsim's straight lines between samples, (omega dt)^2/12
    assert worst(chassis.T, run.channels[[1, 3]]) < 2e-5


def test_low_pass_and_interpolation_are_exact_enough() -> None:
    t = np.arange(8000) / 16_000.0
    omega = 2.0 * math.pi * 30.0
    filtered = low_pass(np.sin(omega * t), 1.0 / 16_000.0, 50.0)
    true = np.imag(np.exp(1j * omega * t) / (1.0 + 30j / 50.0))
    assert np.abs(filtered - true)[(t > 0.1) & (t < 0.49)].max() < 1e-8
    at = np.linspace(10.0, 7900.0, 1234)
    between = lagrange(np.sin(omega * t)[None], at)[0]
    assert np.abs(between - np.sin(omega * at / 16_000.0)).max() < 1e-8


@pytest.mark.parametrize(("rate", "correlation"), [(400.0, 0.456), (800.0, 0.675)])
def test_noise_remembers_what_the_filter_lets_through(rate: float, correlation: float) -> None:
    spec = replace(rig.SensorSpec(), adc=None, noise=(1.0, 2.0, 3.0, 0.5))
    run = rig.drive(rig.baja(), rig.flat(), 0.0, rate, 120.0, spec, 5, internal_rate=1000.0)
    noise = run.channels
    np.testing.assert_allclose(noise.std(axis=1), spec.noise, rtol=0.02)
    lag_one = (noise[:, 1:] * noise[:, :-1]).mean(axis=1) / noise.var(axis=1)
    np.testing.assert_allclose(lag_one, correlation, atol=0.02)
    uneven = replace(spec, jitter=1e-9)  # takes the other way through the code, sample by sample
    again = rig.drive(rig.baja(), rig.flat(), 0.0, rate, 2.0, uneven, 5)
    np.testing.assert_allclose(again.channels, noise[:, : again.time.size], atol=1e-4)


def test_counts_rails_and_seeds() -> None:
    hard = (rig.baja(), rig.parking_stops(6.0 * INCH), 10.0 * MPH, 400, 2.0)
    run = rig.drive(*hard, rig.SensorSpec(), 1)
    assert run.counts is not None
    assert run.counts.min() >= 0
    assert run.counts.max() == 1023
    assert run.clipped[1].sum() > 5
    steps = run.channels[0] / (5.945 * INCH) + 569.5
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert run.channels[1].max() == pytest.approx((1023 - 641) * 2.470 * INCH)
    free = ~run.clipped & (np.abs(run.clean) > 0.0)
    scatter = ((run.channels - run.clean)[0][free[0]] / INCH).std()
    assert scatter == pytest.approx(math.hypot(1.6, 5.945 / math.sqrt(12.0)), rel=0.1)
    np.testing.assert_array_equal(rig.drive(*hard, rig.SensorSpec(), 1).channels, run.channels)
    assert np.any(rig.drive(*hard, rig.SensorSpec(), 2).channels != run.channels)


def test_gain_bias_drift_clocks_jitter_and_lost_rows() -> None:
    car = linear_car()
    motion = on_the_waves(car, 16_000.0)
    seed = np.random.SeedSequence(4)
    spec = replace(
        rig.SensorSpec.ideal(), gain=(1.03, 1.0, 1.0, 1.0), bias=(0.0, 0.2, 0.0, 0.0),
        drift=(0.0, 0.0, 0.5, 0.0), clock_offset=(0.0, 2e-3), clock_ppm=(0.0, 500.0),
        jitter=2e-4, dropped=0.1, burst=3,
    )  # fmt: skip
    reading = sense(motion, spec, car.l, 400.0, 1.9, seed)
    rear = reading.time * (1.0 + 500e-6) + 2e-3
    front_true, rear_true = exact(car, reading.time)[1], exact(car, rear)[1]
    np.testing.assert_allclose(reading.values[0], 1.03 * front_true[0], atol=1e-4)
    np.testing.assert_allclose(reading.values[1], front_true[1] + 0.2, atol=1e-4)
    np.testing.assert_allclose(reading.values[2], rear_true[2] + 0.5 * rear, atol=1e-4)
    np.testing.assert_allclose(reading.values[3], rear_true[3], atol=1e-4)
    assert 0.8 < reading.time.size / 760 < 0.97
    assert np.diff(reading.time).min() > 0.0
    assert np.diff(reading.time).std() > 1e-4
    hidden = replace(rig.SensorSpec.ideal(), hidden_jitter=2e-4)
    moved = sense(motion, hidden, car.l, 400.0, 1.9, seed)
    np.testing.assert_array_equal(moved.time, np.arange(760) / 400.0)
    assert np.abs(moved.values - exact(car, moved.time)[1]).max() > 1e-3


# --- road --------------------------------------------------------------------------------------


def test_disc_rolls_over_an_edge_and_the_patch_averages() -> None:
    radius, rise = 0.28, 0.1
    step = rig.Terrain("edge", ((-0.001, rig.Stop(rise, 3.0, 3.0 - 1e-6)),))
    road = lay(step, -1.0, 2.0, radius, 0.0)
    x = road.start + road.grid * np.arange(len(road.coefficients))
    before = (x > -0.25) & (x < -0.01)
    rolled = np.maximum(rise - radius + np.sqrt(radius**2 - x[before] ** 2), 0.0)
    np.testing.assert_allclose(road.coefficients[before, 0], rolled, atol=4e-4)
    wave = rig.Terrain("sine", ((0.0, rig.Sine(0.01, 1.0)),))
    smooth = lay(wave, -2.0, 2.0, 0.0, 0.3).coefficients[400:1600, 0]
    share = math.sin(math.pi * 0.3) / (math.pi * 0.3) / (1.0 - 0.3**2)  # raised cosine on a sine
    assert smooth.max() == pytest.approx(0.01 * share, rel=1e-3)


def test_rough_road_has_the_density_of_its_class_and_is_its_seeds() -> None:
    x = np.arange(0.0, 200.0, 0.02)
    densities = []
    for seed in range(40):
        z = rig.Rough(256e-6, seed, fade=1e-9).height(x)
        spectrum = np.abs(np.fft.rfft(z)) ** 2 * 2.0 * 0.02 / len(x)
        densities.append(spectrum)
    n = np.fft.rfftfreq(len(x), 0.02)
    for low, high in ((0.1, 0.4), (0.5, 2.0), (2.0, 7.0)):
        band = (n >= low) & (n < high)
        ratio = np.mean(densities, axis=0)[band] / (256e-6 * (n[band] / 0.1) ** -2.0)
        assert ratio.mean() == pytest.approx(1.0, abs=0.06)
    again = rig.Rough(256e-6, 3, fade=1e-9).height(x[:500])
    np.testing.assert_array_equal(again, rig.Rough(256e-6, 3, fade=1e-9).height(x)[:500])
    assert np.any(again != rig.Rough(256e-6, 4, fade=1e-9).height(x[:500]))


def test_rear_wheel_passes_later_by_the_wheelbase() -> None:
    car = rig.baja()
    motion = rig.simulate(car, rig.parking_stops(), 4.0, -0.2, 2.0)
    late = car.l / 4.0 / motion.step
    shifted = lagrange(motion.road[:1], np.arange(8000.0, 30_000.0))[0]
    rear = lagrange(motion.road[1:], np.arange(8000.0, 30_000.0) + late)[0]
    assert np.abs(shifted - rear).max() < 1e-6


@pytest.mark.parametrize("name", sorted(rig.TERRAINS))
def test_default_runs_are_lively_and_do_not_clip(name: str) -> None:
    speed = rig.DEFAULT_SPEEDS[name]
    run = rig.drive(rig.baja(), rig.TERRAINS[name](5), speed, 400, 2.0, rig.SensorSpec(), 1)
    assert not run.clipped.any()
    assert (run.truth["peak_deflection"] < np.array(3.0 * INCH)).all()
    if name != "flat":
        assert (run.channels.std(axis=1) > 100.0 * INCH).all()


# --- cars and files ----------------------------------------------------------------------------


def test_cars_are_those_of_the_tables() -> None:
    car = rig.baja()
    assert [car.zeta_f, car.zeta_r] == pytest.approx([0.461, 0.603], abs=1e-3)
    assert car.k_g / INCH == pytest.approx(22.0, abs=0.01)
    other = rig.table51()
    assert [other.zeta_f, other.zeta_r] == pytest.approx([0.7, 0.5])
    rng = np.random.default_rng(0)
    drawn = [rig.draw(car, rng) for _ in range(2000)]
    assert np.std([one.k_f for one in drawn]) / car.k_f == pytest.approx(0.05, rel=0.1)
    assert np.std(np.log([one.c_r for one in drawn])) == pytest.approx(0.3, rel=0.1)
    assert {one.l for one in drawn} == {car.l}


def test_files_and_command_line(tmp_path: Path) -> None:
    assert main([str(tmp_path), "-t", "bump", "-n", "2", "--rate", "200", "--seed", "9"]) == 0
    first = tmp_path / "bump-200hz-0000.csv"
    lines = first.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "# sample_rate = 200 Hz"
    assert lines[2] == (
        "time [s],front_wheel [in/s^2],front_chassis [in/s^2],"
        "rear_wheel [in/s^2],rear_chassis [in/s^2]"
    )
    table = np.loadtxt(first, delimiter=",", skiprows=3)
    assert table.shape == (400, 5)
    truth = json.loads((tmp_path / "answers/bump-200hz-0000.json").read_text(encoding="utf-8"))
    assert truth["parameters"]["US"]["i"] * LBF_S2_INCH == pytest.approx(truth["car"]["i"])
    vehicle = tomllib.loads((tmp_path / "vehicle.toml").read_text(encoding="utf-8"))
    assert vehicle["known"]["sprung_mass"] == {"value": 1.294, "unit": "lbf*s^2/in", "sd": "1 %"}
    assert "sd" not in vehicle["known"]["wheelbase"]
    assert vehicle["nominal"]["rear_damping"] == {"value": 10.0, "unit": "lbf*s/in"}
    wheel = vehicle["sensors"]["front_wheel"]
    assert wheel["range"]["low"] == pytest.approx(-3386, abs=1)
    assert wheel["range"]["high"] == pytest.approx(2696, abs=1)
    assert vehicle["sensors"]["rear_chassis"]["delay"]["value"] == 0.000675
    written = first.read_bytes()
    assert main([str(tmp_path / "b"), "-t", "bump", "-n", "1", "--rate", "200", "--seed", "9"]) == 0
    assert (tmp_path / "b/bump-200hz-0000.csv").read_bytes() == written
    assert main([str(tmp_path / "c"), "-n", "1", "--counts", "--engine", "80"]) == 0
    counts = np.loadtxt(tmp_path / "c/stops-400hz-0000.csv", delimiter=",", skiprows=3)
    np.testing.assert_array_equal(counts[:, 1:], np.rint(counts[:, 1:]))


def test_rig_shares_nothing_with_what_it_judges() -> None:
    for source in Path(rig.__file__).parent.glob("*.py"):
        assert "bayes" + "_asv" not in source.read_text(encoding="utf-8")
    assert rig.baja().c_f / LBF_PER_INCH == pytest.approx(7.2)


def test_what_is_too_stiff_is_refused() -> None:
    mount = rig.with_terms(rig.baja(), "rear", rig.MaxwellMount(100.0, 1e9), damper=False)
    with pytest.raises(FloatingPointError, match="blows up"):
        rig.simulate(mount, rig.bump(), 4.0, -0.2, 1.5)
