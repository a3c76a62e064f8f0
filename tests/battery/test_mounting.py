"""Sensor mounts and play in a damper against exact solutions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lsim

import tests.rig as rig
from tests.rig.mounting import oscillate, transfer_coordinates

Array = NDArray[np.float64]

T = np.arange(0.0, 3.0, 1.0 / 16_000.0)


def amplitude(mounting: rig.Mounting, hertz: float, channel: int) -> complex:
    """Settled complex amplitude of a channel whose point moves as a unit sine."""
    point = np.zeros((4, len(T)))
    point[channel] = np.sin(2.0 * np.pi * hertz * T)
    out = mounting.carry(point, T)
    others = [c for c in range(4) if c != channel]
    np.testing.assert_array_equal(out[others], 0.0)
    late = T > 2.0
    waves = np.exp(1j * 2.0 * np.pi * hertz * T[late])
    # conjugate of the analytic part: sin has amplitude 1 at phase -90 degrees
    return complex(2j * np.mean(out[channel, late] * np.conj(waves)))


@pytest.mark.parametrize("hertz", [10.0, 40.0, 55.0, 90.0])
def test_brackets_and_panels_have_the_textbook_transmissibility(hertz: float) -> None:
    f, zeta, share = 50.0, 0.05, 0.3
    r = hertz / f
    through = (1.0 + 2j * zeta * r) / (1.0 - r**2 + 2j * zeta * r)
    bracket = amplitude(rig.Bracket(1, f, zeta), hertz, 1)
    assert bracket == pytest.approx(through, rel=2e-3)
    panel = amplitude(rig.Panel(3, f, share, zeta), hertz, 3)
    assert panel == pytest.approx(1.0 + share * (through - 1.0), rel=2e-3)


def test_the_oscillator_agrees_with_scipy() -> None:
    base = np.random.default_rng(1).standard_normal(400).cumsum()
    step, omega, zeta = 1e-3, 60.0, 0.1
    w, v = oscillate(base, step, omega, zeta)
    a = np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]])
    _, _, x = lsim((a, [[0.0], [-1.0]], np.eye(2), np.zeros((2, 1))), base,
                   step * np.arange(400))  # fmt: skip
    np.testing.assert_allclose(w, x[:, 0], atol=1e-6 * np.abs(x[:, 0]).max())
    np.testing.assert_allclose(v, x[:, 1], atol=1e-6 * np.abs(x[:, 1]).max())


def test_a_kerb_lifts_one_side_temporarily() -> None:
    kerb = rig.OneSided(0.03, 0.5, 0.2, 0.3)
    out = kerb.carry(np.zeros((4, len(T))), T)
    lift = np.cumsum(np.cumsum(out[0])) / 16_000.0**2
    assert lift.max() == pytest.approx(0.03, rel=1e-3)
    assert abs(lift[-1]) < 1e-5
    np.testing.assert_allclose(out[2, 4800:], out[0, :-4800], atol=1e-3)  # the rear 0.3 s later
    np.testing.assert_array_equal(out[1], out[3])  # roll lifts both axles of a side alike
    assert np.abs(out[1, T < 0.5]).max() == 0.0
    assert 0.0 < np.abs(out[1]).max() < np.abs(out[0]).max()


def test_a_tone_has_its_amplitude_and_frequency() -> None:
    out = rig.SensorTone(2, 30.0, 0.7, wander=0.0, seed=4).carry(np.zeros((4, len(T))), T)
    power = np.abs(np.fft.rfft(out[2])) * 2.0 / len(T)
    assert np.argmax(power) / T[-1] == pytest.approx(30.0, abs=0.2)
    assert power.max() == pytest.approx(0.7, rel=1e-3)
    assert not out[[0, 1, 3]].any()


def test_a_compressed_sensor_reads_small_motion_correctly() -> None:
    point = np.linspace(-30.0, 30.0, 601)[None].repeat(4, axis=0)
    out = rig.Compressed(3, 20.0).carry(point, np.arange(601.0))
    np.testing.assert_array_equal(out[:3], point[:3])
    small = np.abs(point[3]) < 0.5
    np.testing.assert_allclose(out[3, small], point[3, small], rtol=3e-4)
    assert np.abs(out[3]).max() < 20.0
    assert np.all(np.diff(out[3]) > 0.0)


def test_mounts_act_in_succession_and_not_on_the_car() -> None:
    motion = rig.simulate(rig.baja(), rig.bump(), 4.4, -0.2, 0.5)
    tone, panel = rig.SensorTone(1, 30.0, 0.5), rig.Panel(1, 20.0, 0.2)
    one = panel.carry(tone.carry(motion.acceleration, motion.time), motion.time)
    np.testing.assert_array_equal(transfer_coordinates(motion, (tone, panel)), one)
    how = (rig.bump(), 4.4, 400.0, 0.5, rig.SensorSpec.clean(), 0)
    plain = rig.drive(rig.baja(), *how)
    mounted = rig.drive(rig.baja(), *how, mountings=(tone,))
    np.testing.assert_array_equal(plain.deflection, mounted.deflection)
    np.testing.assert_array_equal(plain.channels[[0, 2, 3]], mounted.channels[[0, 2, 3]])
    assert np.abs(plain.channels[1] - mounted.channels[1]).max() > 0.1
    assert mounted.truth["mountings"][0]["kind"] == "SensorTone"
    assert "mountings" not in plain.truth


def test_play_has_the_limits_of_a_mount_and_of_no_damper() -> None:
    car = rig.baja()

    def accelerations(*terms: rig.Term) -> Array:
        with_it = rig.with_terms(car, "front", *terms, damper=False)
        return rig.simulate(with_it, rig.bump(), 4.4, -0.2, 1.2).acceleration

    none = accelerations(rig.MaxwellMount(car.c_f, 4e6))
    small = accelerations(rig.Lash(car.c_f, 1e-8, 4e6))
    np.testing.assert_allclose(small, none, atol=1e-3 * np.abs(none).max())
    # play beyond the travel: no damper
    free = accelerations()
    wide = accelerations(rig.Lash(car.c_f, 1e3, 4e6))
    np.testing.assert_allclose(wide, free, atol=1e-3 * np.abs(free).max())
    between = accelerations(rig.Lash(car.c_f, 0.004, 4e6))
    assert np.abs(between - none).max() > 10.0 * np.abs(small - none).max()


def test_a_car_with_play_stays_at_rest() -> None:
    car = rig.with_terms(rig.baja(), "both", rig.Lash(500.0, 1e-3, 4e6))
    run = rig.drive(replace(car), rig.flat(), 0.0, 400, 0.5, rig.SensorSpec.clean(), 0)
    assert np.abs(run.channels).max() < 1e-9
    assert math.isclose(run.tyre_force[0, -1], car.load_f)
