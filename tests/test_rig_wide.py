"""The rig's whole car against the rig's half car, and against complex arithmetic."""

from dataclasses import replace

import numpy as np

from tests.rig import SensorSpec, baja, bump, drive
from tests.rig.wide import shifted, wide_baja, wide_drive, wide_motion


def test_over_one_track_it_is_the_half_car() -> None:
    """Both sides over the same bump: other equations, another integrator, one motion."""
    road = bump(rise=0.04)
    wide = wide_drive(wide_baja(), (road, road), 4.0, 400.0, 1.5, 0, quiet=True)
    assert not wide.lifted  # the two have laws of their own for a tyre in the air
    half = drive(replace(baja(), tyre_lifts=False), road, 4.0, 400.0, 1.5, SensorSpec.clean(), 0)
    pairs = ((0, 0), (1, 0), (2, 2), (3, 2), (4, 1), (5, 1), (6, 3))
    for mine, theirs in pairs:
        size = np.std(half.clean[theirs])
        assert np.max(np.abs(wide.clean[mine] - half.clean[theirs])) < 2e-4 * size


def test_sine_waves_under_four_wheels() -> None:
    """Steady state of unlike corners, against the complex solution of its own matrices."""
    car = replace(
        wide_baja(), k=(8e3, 9e3, 1e4, 7e3), c=(500.0, 700.0, 900.0, 400.0),
        m_u=(14.0, 15.0, 18.0, 17.0), k_t=(26e3, 25e3, 27e3, 28e3), c_t=(80.0, 90.0, 70.0, 60.0),
    )  # fmt: skip
    omega, step, n = 15.0, 1.0 / 2000.0, 6001
    lag = np.exp(1j * np.array([0.0, 0.9, -1.4, 2.2])) * 0.002
    t = 0.5 * step * np.arange(2 * n - 1)
    road = np.imag(np.outer(np.exp(1j * omega * t), lag))
    road_rate = np.imag(np.outer(1j * omega * np.exp(1j * omega * t), lag))
    D = np.array(
        [
            [1.0, car.l_f, 0.5 * car.t_f, -1.0, 0.0, 0.0, 0.0],
            [1.0, car.l_f, -0.5 * car.t_f, 0.0, -1.0, 0.0, 0.0],
            [1.0, -car.l_r, 0.5 * car.t_r, 0.0, 0.0, -1.0, 0.0],
            [1.0, -car.l_r, -0.5 * car.t_r, 0.0, 0.0, 0.0, -1.0],
        ]
    )
    T = np.eye(7)[3:]
    strut = np.diag(np.array(car.k) + 1j * omega * np.array(car.c))
    tyre = np.diag(np.array(car.k_t) + 1j * omega * np.array(car.c_t))
    mass = np.diag([car.m, car.i, car.i_roll, *car.m_u])
    q = np.linalg.solve(D.T @ strut @ D + T.T @ tyre @ T - omega**2 * mass, T.T @ tyre @ lag)
    start = np.concatenate([np.imag(q), np.imag(1j * omega * q)])
    states, rates = wide_motion(car, road, road_rate, step, start)
    turning = np.exp(1j * omega * step * np.arange(n))
    np.testing.assert_allclose(states[:, :7], np.imag(np.outer(turning, q)), atol=1e-9)
    exact = np.imag(np.outer(turning, -(omega**2) * q))
    np.testing.assert_allclose(rates[:, 7:], exact, atol=1e-6)


def test_tracks_changed_over_change_the_sides() -> None:
    road = bump()
    later = shifted(road, 0.6)
    one = wide_drive(wide_baja(), (road, later), 4.0, 400.0, 1.5, 0, quiet=True).clean
    two = wide_drive(wide_baja(), (later, road), 4.0, 400.0, 1.5, 0, quiet=True).clean
    np.testing.assert_allclose(one, two[[1, 0, 3, 2, 5, 4, 6]], atol=1e-8)
    assert np.max(np.abs(one[0] - one[1])) > 5.0
