"""Checks of the simulator, of the linear car, and of the cases. ``pytest`` takes under a minute."""

from __future__ import annotations

import multiprocessing
import tomllib
import zlib
from concurrent.futures import ProcessPoolExecutor
from functools import cache

import numpy as np
import pytest

from benchmarks.blind import __main__ as command
from benchmarks.blind.simulator import CELLS, make
from benchmarks.blind.simulator.blueprint import Outcome
from benchmarks.blind.simulator.cars import FAMILIES, GRAVITY, Car, draw_car
from benchmarks.blind.simulator.cases import SEED, _draw_faults
from benchmarks.blind.simulator.disguise import left_by_each
from benchmarks.blind.simulator.kinds import CHANNELS, UnreachableError
from benchmarks.blind.simulator.listed import LISTED_FORMS, listed_fault
from benchmarks.blind.simulator.pulses import PULSES, page_pulse
from benchmarks.blind.simulator.scene import Scene, Wish, draw_scene
from benchmarks.blind.simulator.sensors import Motion, Sensing, Sensor, pure_rows
from benchmarks.blind.simulator.signals import LinearSystem, filtered, interpolated
from benchmarks.blind.simulator.simulate import Drive, integrate
from benchmarks.blind.simulator.sizing import build, sized
from benchmarks.blind.simulator.strength import half_car
from benchmarks.blind.simulator.suspension import FORMS, suspension_fault


@cache
def _scene(seed: int, fine: float = 2600.0, roads: tuple[str, ...] = ()) -> Scene:
    return draw_scene(np.random.default_rng(seed), Wish(roads, fine=fine))


def _car() -> Car:
    return draw_car(FAMILIES["golf cart"], np.random.default_rng(5))


def _flat(step: float, count: int) -> Drive:
    still = np.zeros((2 * count - 1, 2))
    return Drive(0.0, step, step * (count - 1), 1.0, still, still)


class _Tug:
    """A force on both ends of the chassis for half a second, N."""

    states = 0

    def __init__(self, step: float) -> None:
        self.step = step

    def act(self, now: object) -> None:
        """Push until half a second has gone."""
        half = now.half  # type: ignore[attr-defined]
        if 0.5 * half * self.step < 0.5:
            now.force[4] += 300.0  # type: ignore[attr-defined]
            now.force[5] -= 100.0  # type: ignore[attr-defined]


def test_energy_that_is_lost_is_the_work_of_dampers_and_tyres() -> None:
    """What kinetic and spring energy (J) lose is what dampers and tyres take."""
    car, step, count = _car(), 1.0 / 8000.0, 12001
    history = integrate(car, [_flat(step, count)], np.zeros(1, int), [_Tug(step)])
    x, delta, rate = history.state[:, :, 0], history.delta[:, :, 0], history.rate[:, :, 0]
    masses = np.array([car.m, car.i, *car.unsprung])
    energy = 0.5 * (x[:, 4:8] ** 2 @ masses + delta**2 @ np.array(car.k))
    energy += 0.5 * x[:, 2:4] ** 2 @ np.array(car.tyre)
    power = rate**2 @ np.array(car.c) + x[:, 6:8] ** 2 @ np.array(car.tyre_damping)
    begin = 4200
    work = np.cumsum(0.5 * (power[begin:-1] + power[begin + 1 :])) * step
    assert energy[begin] > 0.5
    np.testing.assert_allclose(energy[begin] - energy[begin + 1 :], work, atol=1e-5 * energy[begin])


def test_wheels_that_hang_fall_freely() -> None:
    """A tyre does not pull: an axle that is thrown up leaves the road."""
    car, step = _car(), 1.0 / 5000.0
    drive = _flat(step, 2001)
    height = drive.height.copy()
    height[400:] = -0.5
    drop = Drive(0.0, step, drive.length, 1.0, height, drive.rate)
    history = integrate(car, [drop], np.zeros(1, int))
    first = history.flow[205, :, 0]
    load = GRAVITY * car.m * car.wdf
    assert first[6] == pytest.approx(-(load + GRAVITY * car.unsprung[0]) / car.unsprung[0], rel=0.1)


@pytest.mark.parametrize(
    ("name", "form", "size"),
    [
        ("coulomb_friction", "Bouc-Wen", 0.006),
        ("bump_stop", "pad with dashpot", 0.08),
        ("damper_hysteresis", "aerated oil", 0.0008),
    ],
)
def test_finer_steps_change_nothing(name: str, form: str, size: float) -> None:
    """Steps 2.5 times as fine, whose error is some forty times less."""
    rows, noise = [], np.zeros(4)
    for fine in (2600.0, 6500.0):
        scene = _scene(31, fine)
        part = suspension_fault(name, scene, "front", form, np.random.default_rng(1))
        built = build(scene, [(part, size)])
        rows.append([scene.pure(m, n, built.sensing) for n, m in enumerate(built.motions)])
        noise = np.array([scene.declared.sensors[c].noise for c in CHANNELS])
    for coarse, fine_rows in zip(*rows, strict=True):
        error = (coarse - fine_rows) / noise
        assert float(np.sqrt(np.mean(error**2))) < 0.01
        assert float(np.max(np.abs(error))) < 0.3


def test_linear_car_has_its_transfer_function() -> None:
    """Two uncoupled axles where i = m a b: (c s + k)/(m s² + c s + k) each; a sine's answer."""
    m, length, wdf = 300.0, 1.8, 0.45
    a, b = (1.0 - wdf) * length, wdf * length
    p = np.array([900.0, 1300.0, m * a * b, m, wdf, 15e3, 21e3])
    car = half_car(p, length)
    f = np.linspace(0.2, 40.0, 60)
    s = 2j * np.pi * f
    answer = car.transfer(f)
    for axle, (c, k, mass) in enumerate(((900.0, 15e3, m * wdf), (1300.0, 21e3, m * (1 - wdf)))):
        np.testing.assert_allclose(answer[:, axle, axle], (c * s + k) / (mass * s**2 + c * s + k))
        np.testing.assert_allclose(answer[:, axle, 1 - axle], 0.0, atol=1e-12)
    coupled = half_car(np.array([900.0, 1300.0, 0.7 * m * a * b, m, wdf, 15e3, 21e3]), length)
    step, turn = 1.0 / 3000.0, 2.0 * np.pi * 9.0
    t = step * np.arange(30000)
    u = np.stack([np.sin(turn * t), np.zeros_like(t)], 1)
    gain = coupled.transfer(np.array([9.0]))[0, :, 0]
    late = slice(24000, None)
    for axle in range(2):
        steady = np.imag(gain[axle] * np.exp(1j * turn * t))
        y = coupled.response(u, step)[:, axle]
        np.testing.assert_allclose(y[late], steady[late], atol=1e-5)


def test_filters_and_interpolation_are_exact_enough() -> None:
    """Responses to a sine of 25 Hz are those of the formula."""
    step, turn = 1.0 / 4000.0, 2.0 * np.pi * 25.0
    t = step * np.arange(8000)
    for poles in ((-300.0 + 0j,), (complex(-400.0, 300.0), complex(-400.0, -300.0))):
        gain = np.prod([1.0 / (1.0 - 1j * turn / p) for p in poles])
        y, answer = filtered(np.sin(turn * t), step, poles), np.imag(gain * np.exp(1j * turn * t))
        np.testing.assert_allclose(y[4000:-2], answer[4000:-2], atol=1e-5)
    at = t[100:-100] + 0.37 * step
    np.testing.assert_allclose(
        interpolated(np.sin(turn * t), 0.0, step, at), np.sin(turn * at), atol=1e-5
    )


def test_late_channels_read_what_comes_later() -> None:
    """A positive lag is a later sample: the reading is ahead of its stamp."""
    step = 1.0 / 4000.0
    t = step * np.arange(8000)
    wave = np.sin(2.0 * np.pi * 3.0 * t)
    motion = Motion(0.0, step, dict.fromkeys(CHANNELS, wave))
    sensors = {c: Sensor(0.1, 0.01, 20.0, None, 0.0) for c in CHANNELS}
    late = Sensing(late={"rear_chassis": lambda times, run: np.full(len(times), 0.004)})
    at = np.arange(0.2, 1.6, 0.005)
    rows = pure_rows(motion, at, 0, sensors, [late])
    np.testing.assert_allclose(rows[:, 3], np.sin(2.0 * np.pi * 3.0 * (at + 0.004)), atol=1e-6)
    np.testing.assert_allclose(rows[:, 1], np.sin(2.0 * np.pi * 3.0 * at), atol=1e-6)


@pytest.mark.parametrize("form", LISTED_FORMS["sensor_lag"])
def test_lags_are_those_of_slow_signals(form: str) -> None:
    """A slow signal comes as late or early as the span says."""
    scene = _scene(31)
    part = listed_fault("sensor_lag", scene, "front_wheel", form, np.random.default_rng(2))
    assert part.sensing is not None
    low, high = part.spans(Outcome(0.004, ())).parameters["lag"]
    step = 1.0 / 2600.0
    t = step * np.arange(8000)
    wave = np.sin(2.0 * np.pi * 2.0 * t)
    motion = Motion(0.0, step, dict.fromkeys(CHANNELS, wave))
    pick = (scene.times[0] > 0.8) & (scene.times[0] < 1.8)
    at = scene.times[0][pick]
    rows = pure_rows(motion, scene.times[0], 0, scene.declared.sensors, [part.sensing(0.004)])
    plain = pure_rows(motion, scene.times[0], 0, scene.declared.sensors)
    turn = np.stack([np.cos(4.0 * np.pi * at), np.sin(4.0 * np.pi * at)], 1)
    angle = [np.arctan2(*np.linalg.lstsq(turn, x[pick, 0])[0]) for x in (rows, plain)]
    lag = float(angle[0] - angle[1]) / (4.0 * np.pi)
    assert low - 2e-4 < lag < high + 2e-4


@pytest.mark.parametrize("form", sorted(PULSES))
def test_pushes_start_at_half_of_their_amplitude(form: str) -> None:
    """Start and duration of the page's pulse are near the times of half the peak."""
    u = np.linspace(-0.5, 1.5, 4001)
    high = u[PULSES[form](u) > 0.5 * np.max(PULSES[form](u))]
    found = page_pulse(PULSES[form], 2.0, 0.5)
    assert found["start"] == pytest.approx([2.0 + 0.5 * high[0]] * 3, abs=0.05)
    assert found["duration"] == pytest.approx([0.5 * (high[-1] - high[0])] * 3, abs=0.06)
    assert found["force"] == pytest.approx([1.0] * 3, abs=0.3)


@pytest.mark.parametrize(
    ("name", "size"), [("digressive_damper", 1.0), ("bound_rebound", 0.2), ("damper_fade", 0.2)]
)
def test_listed_effects_do_not_pass_for_unlisted(name: str, size: float) -> None:
    """The page's own effect, at its place, leaves the least of a listed fault, and little."""
    scene = _scene(31)
    part = suspension_fault(name, scene, "rear", FORMS[name][0], np.random.default_rng(1))
    built = build(scene, [(part, size)])
    best = left_by_each(scene, built)
    named = {"damper_curve", "spring_curve", name}
    assert best[0].effect in named
    own = min(one.left for one in best if one.effect == name and one.where == "rear")
    assert own - scene.yardstick.base < 0.15 * built.strength + 5.0


def test_simulator_and_linear_car_agree_without_faults() -> None:
    """What the linear car leaves of noise-free readings is far below their noise."""
    for seed in (1, 2, 3):
        assert _scene(seed).yardstick.floor < 0.2


def test_null_residuals_are_the_noise() -> None:
    """Whitened residuals of null cases have a variance of one."""
    ratios = []
    for seed in range(5):
        scene = _scene(100 + seed)
        built, rng = build(scene, []), np.random.default_rng(seed)
        rows = [scene.noisy(built.motions[n], n, rng) for n in range(2)]
        count = 2 * sum(len(y) for y in rows) - 19
        ratios.append(scene.yardstick.distance(rows) / count)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.025)
    assert max(ratios) < 1.12


def test_noise_factor_is_seen() -> None:
    """Noise a fifth above declared shows as a variance of 1.44."""
    scene = _scene(104)
    built, rng = build(scene, []), np.random.default_rng(0)
    rows = [scene.noisy(built.motions[n], n, rng, factor=1.2) for n in range(2)]
    count = 2 * sum(len(y) for y in rows) - 19
    assert scene.yardstick.distance(rows) / count == pytest.approx(1.44, abs=0.12)


def test_strengths_hit_their_target() -> None:
    """The size that is found has a strength in the range wanted."""
    scene, rng = _scene(31), np.random.default_rng(8)
    name = "bound_rebound"
    part = suspension_fault(name, scene, "rear", FORMS[name][0], rng)
    found = sized(scene, part, (295.0, 480.0), rng)
    assert 270.0 < found.built.strength < 530.0


@pytest.mark.parametrize(
    ("cell", "number"), [("null", 7), ("single:sensor_lag", 3), ("outside:ac_coupling", 0)]
)
def test_cases_are_reproducible_and_well_formed(cell: str, number: int) -> None:
    """The same cell and number give the same case; its parts fit together."""
    one, two = make(cell, number), make(cell, number)
    assert one.vehicle_toml == two.vehicle_toml
    assert one.truth == two.truth
    for first, second in zip(one.runs + one.held_out, two.runs + two.held_out, strict=True):
        for channel in CHANNELS:
            np.testing.assert_array_equal(first.channels[channel], second.channels[channel])
            assert np.all(np.isfinite(first.channels[channel]))
            assert len(first.channels[channel]) == len(first.time)
        assert 2.0 <= first.time[-1] <= 5.0
    assert len(one.runs) == 2
    assert len(one.held_out) == 1
    assert one.truth.road != one.truth.held_out_road


def test_different_cases_differ() -> None:
    """Numbers give different cars."""
    assert make("null", 1).vehicle_toml != make("null", 2).vehicle_toml


def test_vehicle_file_has_what_the_page_asks_for() -> None:
    """All keys are there, and filters where the fault needs them."""
    text = tomllib.loads(make("single:sensor_bandwidth", 3).vehicle_toml)
    assert set(text["known"]) == {
        "sprung_mass",
        "wheelbase",
        "front_weight_fraction",
        "front_spring_rate",
        "rear_spring_rate",
    }
    assert set(text["nominal"]) == {"front_damping", "rear_damping", "pitch_inertia"}
    assert set(text["sensors"]) == set(CHANNELS)
    assert all("bandwidth" in sensor for sensor in text["sensors"].values())


def test_recordings_are_those_of_cars() -> None:
    """Peaks of readings, no clipping, and steps of the converter."""
    for number in range(4):
        case = make("null", 20 + number)
        limits = tomllib.loads(case.vehicle_toml)["sensors"]
        for run in case.runs + case.held_out:
            for channel, reading in run.channels.items():
                peak = float(np.max(np.abs(reading)))
                assert peak < limits[channel]["range"]["value"] * GRAVITY
                assert 0.3 < peak < 65.0


def test_truth_of_a_fault_lies_in_its_spans() -> None:
    """The strength in the truth is that of the case, and spans are ordered."""
    case = make("single:sensor_gain", 7)
    rng = np.random.default_rng([SEED, zlib.crc32(b"single:sensor_gain"), 7, 0])
    try:
        _, _, built, _ = _draw_faults("single:sensor_gain", 7, rng)
        assert built.strength == pytest.approx(case.truth.strength)
    except UnreachableError:
        pass
    for fault in case.truth.faults:
        for low, high in fault.parameters.values():
            assert low <= high
    assert 36.0 < case.truth.strength < 4400.0


def test_cells_are_complete() -> None:
    """The set has these cells."""
    assert CELLS["null"] == 600
    assert sum(name.startswith("outside:") for name in CELLS) >= 24
    assert sum(name.startswith("single:") for name in CELLS) == 17
    assert isinstance(
        LinearSystem(-np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1))), LinearSystem
    )


def test_another_process_finds_the_work() -> None:
    """What the command itself defines, a new process cannot import."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        assert (
            pool.submit(getattr, vars(command)["diagnosed"], "__module__").result()
            == "benchmarks.blind.run"
        )
