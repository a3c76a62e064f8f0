"""Cars beyond the half car against printed figures, closed forms, each other, and energy."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from bayes_asv.models.assembly import Array, SecondOrder, state_form
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import HalfCar
from bayes_asv.models.mode_shapes import Car, car_modes, places
from bayes_asv.models.modes import modes
from bayes_asv.models.textbook_cars import (
    FullCar7,
    HalfCar4,
    QuarterCar,
    RollCar,
    deflections,
    sensor_places,
    warp,
)
from bayes_asv.simulation.simulate import response

# Barton & Fieldhouse, Automotive Chassis Engineering (Springer 2018), section 3.13, p. 209: rear
# corner of a saloon car.
SALOON = QuarterCar(m=317.5, m_u=45.4, k=22e3, c=0.0, k_t=192e3)
STIFF = 1e11  # N/m, a tyre that gives way by nothing

ROLLING = RollCar(
    c_fl=700.0, c_fr=560.0, c_rl=900.0, c_rr=850.0, i=70.0, i_roll=28.0, m=227.0, l=1.73, wdf=0.47,
    k_fl=8800.0, k_fr=8400.0, k_rl=9100.0, k_rr=9300.0, t_f=1.32, t_r=1.27, bar_f=2000.0,
    bar_r=500.0, s_f=1.1,
)  # fmt: skip


def naturals(system: SecondOrder) -> Array:
    """Undamped frequencies, rad/s, by another way than the package's: roots of |K − ω² M|."""
    root = np.diag(np.diag(system.M) ** -0.5)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(root @ system.K @ root), 0.0)))


def whole(**changes: Any) -> FullCar7:
    plain: dict[str, Any] = {
        "m": 1270.0, "i": 1800.0, "i_roll": 500.0, "l_f": 1.2, "l_r": 1.5, "t_f": 1.4, "t_r": 1.3,
        "m_u": (40.0, 40.0, 45.0, 45.0), "k": (20e3, 20e3, 24e3, 24e3),
        "c": (1500.0, 1500.0, 1800.0, 1800.0), "k_t": (190e3,) * 4, "c_t": (60.0,) * 4,
    }  # fmt: skip
    return FullCar7(**(plain | changes))


def test_quarter_car_has_the_printed_modes() -> None:
    """x⁴ − 4786 x² + 293·10³ = 0, 1.25 and 10.9 Hz, and 0.104 of the body's motion at the wheel."""
    M, _, K, _, _ = SALOON.system()
    pencil = np.linalg.solve(M, K)
    assert np.trace(pencil) == pytest.approx(4786.0, abs=5.0)  # they rounded on the way
    assert np.linalg.det(pencil) == pytest.approx(293e3, abs=500.0)
    slow, fast = car_modes(SALOON)
    assert (slow.mode.natural, fast.mode.natural) == pytest.approx((1.25, 10.9), abs=0.05)
    assert 2.0 * np.pi * fast.mode.natural == pytest.approx(68.73, abs=0.05)
    assert slow.mode.shape[1].real == pytest.approx(0.104, abs=5e-4)
    assert (slow.kind, fast.kind) == ("bounce", "hop")


@pytest.mark.parametrize(
    ("m", "i", "l_f", "l_r", "k_f", "k_r", "printed", "digits"),
    [
        # Rao, Mechanical Vibrations, example 5.7
        (1000.0, 810.0, 1.0, 1.5, 18e3, 22e3, (5.8593, 9.4341), 5e-5),
        # Edwards & Penney, Differential Equations and Linear Algebra, 2nd ed., 7.4-24, whose digits
        # are cut off and not rounded
        (100.0, 1000.0, 6.0, 4.0, 2000.0, 2000.0, (6.13, 10.31), 1e-2),
    ],
)
def test_half_car_on_stiff_tyres_has_the_printed_modes(
    m: float, i: float, l_f: float, l_r: float, k_f: float, k_r: float,
    printed: tuple[float, float], digits: float,
) -> None:  # fmt: skip
    car = HalfCar4(m, i, l_f, l_r, 1.0, 1.0, k_f, k_r, 0.0, 0.0, STIFF, STIFF)
    found = [2.0 * np.pi * mode.natural for mode, _, _ in car_modes(car)[:2]]
    assert found == pytest.approx(printed, abs=digits)
    rolling = RollCar(
        0.0, 0.0, 0.0, 0.0, i, 1.0, m, l_f + l_r, l_r / (l_f + l_r), k_f / 2, k_f / 2, k_r / 2,
        k_r / 2, 1.0, 1.0, 0.0, 0.0, 1.0,
    )  # fmt: skip
    kinds = {kind: 2.0 * np.pi * mode.natural for mode, kind, _ in car_modes(rolling)}
    assert sorted((kinds["bounce"], kinds["pitch"])) == pytest.approx(printed, abs=digits)
    roll = np.sqrt(0.25 * (k_f + k_r))  # ω² = Σ k (t/2)² / i_roll
    assert kinds["roll"] == pytest.approx(roll, rel=1e-9)


def test_uncoupled_masses_are_quarter_cars() -> None:
    """With i = m l_f l_r, and i_roll = m (t/2)², every corner is the printed quarter car."""
    k, k_t, m_u = SALOON.k, SALOON.k_t, SALOON.m_u
    quarter = naturals(SALOON.system())
    half = HalfCar4(
        2 * SALOON.m, 2 * SALOON.m * 1.3**2, 1.3, 1.3, m_u, m_u, k, k, 0.0, 0.0, k_t, k_t
    )
    np.testing.assert_allclose(naturals(half.system()), np.repeat(quarter, 2), rtol=1e-9)
    m = 4 * SALOON.m
    car = whole(
        m=m, i=m * 1.3**2, i_roll=m * 0.7**2, l_f=1.3, l_r=1.3, t_f=1.4, t_r=1.4, m_u=(m_u,) * 4,
        k=(k,) * 4, k_t=(k_t,) * 4,
    )  # fmt: skip
    hop_alone = np.sqrt((k + k_t) / m_u)  # the warp, which a rigid chassis does not follow
    expected = np.sort(np.concatenate([np.repeat(quarter, 3), [hop_alone]]))
    np.testing.assert_allclose(naturals(car.system()), expected, rtol=1e-9)


def test_a_symmetric_car_decouples_into_half_car_and_roll() -> None:
    car = whole(bar_f=9e3, bar_r=4e3)
    half = HalfCar4(
        car.m, car.i, car.l_f, car.l_r, 80.0, 90.0, 40e3, 48e3, 3000.0, 3600.0, 380e3, 380e3,
        120.0, 120.0,
    )  # fmt: skip
    # roll φ and the half differences of each axle's wheels, written out by hand
    a, b = 0.5 * car.t_f, 0.5 * car.t_r
    M = np.diag([car.i_roll, 80.0, 90.0])

    def rolling(front: float, rear: float, under: tuple[float, float]) -> Array:
        return np.array(
            [
                [front * a * a + rear * b * b, -front * a, -rear * b],
                [-front * a, front + under[0], 0.0],
                [-rear * b, 0.0, rear + under[1]],
            ]
        )

    K = rolling(40e3 + 4 * 9e3, 48e3 + 4 * 4e3, (380e3, 380e3))
    C = rolling(3000.0, 3600.0, (120.0, 120.0))
    companion = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]]
    )
    apart = np.concatenate(
        [np.linalg.eigvals(state_form(half.system()).A), np.linalg.eigvals(companion)]
    )
    together = np.linalg.eigvals(state_form(car.system()).A)
    assert len(together) == len(apart) == 14
    for value in apart:
        assert np.min(np.abs(together - value)) < 1e-8 * abs(value)


def test_without_wheels_the_full_car_is_the_roll_car() -> None:
    k, c = ROLLING[9:13], ROLLING[0:4]
    car = FullCar7(
        ROLLING.m, ROLLING.i, ROLLING.i_roll, ROLLING.l_f, ROLLING.l_r, ROLLING.t_f, ROLLING.t_r,
        (1e-3,) * 4, (k[0], k[1], k[2], k[3]), (c[0], c[1], c[2], c[3]), (STIFF,) * 4,
        bar_f=ROLLING.bar_f, bar_r=ROLLING.bar_r,
    )  # fmt: skip
    limit = np.linalg.eigvals(state_form(car.system()).A)
    for value in np.linalg.eigvals(state_form(ROLLING.system()).A):
        assert np.min(np.abs(limit - value)) < 1e-5 * abs(value)


def test_a_symmetric_roll_car_contains_the_half_car() -> None:
    half = HalfCar(1400.0, 1800.0, 70.0, 227.0, 1.73, 0.47, 17e3, 18e3)
    car = RollCar(
        700.0, 700.0, 900.0, 900.0, 70.0, 28.0, 227.0, 1.73, 0.47, 8.5e3, 8.5e3, 9e3, 9e3,
        1.3, 1.25, 3e3, 1e3, 1.3,
    )  # fmt: skip
    found = [m.mode for m in car_modes(car)]
    for mode in modes(half):
        near = min(found, key=lambda m: abs(m.natural - mode.natural))
        assert (near.natural, near.ratio) == pytest.approx((mode.natural, mode.ratio), rel=1e-9)
        front, rear = near.shape[0], near.shape[2]
        assert rear / front == pytest.approx(mode.shape[1] / mode.shape[0], rel=1e-6)
    roll = next(m for m in car_modes(car) if m.kind == "roll")
    stiff = 0.5 * (8.5e3 + 2 * 3e3) * 1.3**2 + 0.5 * (9e3 + 2 * 1e3) * 1.25**2
    assert roll.mode.natural == pytest.approx(np.sqrt(stiff / 28.0) / (2 * np.pi), rel=1e-9)
    lost = 0.5 * 700.0 * 1.3**2 + 0.5 * 900.0 * 1.25**2
    assert roll.mode.ratio == pytest.approx(lost / (2.0 * np.sqrt(stiff * 28.0)), rel=1e-9)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    which=st.sampled_from(["quarter", "half4", "full7", "roll"]),
)
def test_energy_leaves_only_through_the_dampers(seed: int, which: str) -> None:
    """Over still wheels or road d/dt (½ q̇ᵀ M q̇ + ½ qᵀ K q) = −q̇ᵀ C q̇ ≤ 0, for any corner rates."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.2, 5.0, 24)
    four = tuple(float(x) for x in u[:4])
    cars: dict[str, Car] = {
        "quarter": QuarterCar(300.0, 40.0, 2e4 * u[0], 1e3 * u[1], 2e5 * u[2], 50.0 * u[3]),
        "half4": HalfCar4(600.0, 900.0 * u[0], 1.2, 1.4, 60.0, 70.0, 4e4, 3e4 * u[1], 3e3 * u[2],
                          2e3, 3e5, 4e5 * u[3]),
        "full7": whole(
            c=(1500 * u[0], 1500 * u[1], 1800 * u[2], 1800 * u[3]), m_u=(40.0, 50.0, 60.0, 30.0),
            k=(2e4 * u[4], 2e4 * u[5], 2e4 * u[6], 2e4 * u[7]), bar_f=1e4 * u[8],
        ),
        "roll": ROLLING._replace(c_fl=700.0 * four[0], k_rr=9e3 * four[1], bar_r=3e3 * four[2]),
    }  # fmt: skip
    car = cars[which]
    system = car.system()
    form = state_form(system)
    n = len(system.M)
    state = rng.normal(size=2 * n)
    change = form.A @ state
    q, v, a = state[:n], state[n:], change[n:]
    power = float(v @ system.M @ a + q @ system.K @ v)
    lost = float(v @ system.C @ v)
    assert lost >= 0.0
    assert power == pytest.approx(-lost, rel=1e-8, abs=1e-6 * float(abs(q @ system.K @ v)))
    assert np.all(np.linalg.eigvals(form.A).real < 0.0)
    # lifted by one height, nothing is felt
    names, heights = places(car)
    lifted = np.linalg.lstsq(heights, np.ones(len(names)), rcond=None)[0]
    np.testing.assert_allclose(system.K @ lifted, system.K_u.sum(axis=1), atol=1e-6)


def test_deflection_form_agrees_with_the_second_order_form() -> None:
    """Wheel accelerations in, against wheel positions in: the same chassis accelerations."""
    rng = np.random.default_rng(8)
    size, pace = rng.normal(size=(4, 3)), rng.uniform(3.0, 15.0, size=(4, 3))
    time = np.linspace(0.0, 1.5, 601)

    def wheel(t: Array, order: int) -> Array:
        phase = pace[:, :, None] * t + 0.5 * np.pi * order
        return np.asarray(
            0.01 * np.sum(size[:, :, None] * pace[:, :, None] ** order * np.sin(phase), axis=1)
        )

    form, own = state_form(ROLLING.system()), deflections(ROLLING)
    H = ROLLING.corners

    def absolute(t: float, x: Array) -> Array:
        at = np.array([t])
        return np.asarray(form.A @ x + form.B @ np.concatenate([wheel(at, 0), wheel(at, 1)])[:, 0])

    def relative(t: float, x: Array) -> Array:
        return np.asarray(own.A @ x + own.B @ wheel(np.array([t]), 2)[:, 0])

    q0 = np.array([0.01, 0.02, -0.03, 0.1, -0.2, 0.3])
    at0 = np.zeros(1)
    d0 = np.concatenate([H @ q0[:3] - wheel(at0, 0)[:, 0], H @ q0[3:] - wheel(at0, 1)[:, 0]])
    accuracy: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-12, "t_eval": time}
    one = solve_ivp(absolute, (0.0, 1.5), q0, **accuracy).y
    two = solve_ivp(relative, (0.0, 1.5), d0, **accuracy).y
    inputs = np.vstack([wheel(time, 0), wheel(time, 1)])
    motion = (form.C @ one + form.D @ inputs)[3:]
    np.testing.assert_allclose(own.C @ two, sensor_places(ROLLING) @ motion, atol=1e-6)
    np.testing.assert_allclose(two[:4], H @ one[:3] - wheel(time, 0), atol=1e-8)


def test_no_force_acts_along_the_warp() -> None:
    n = warp(ROLLING)
    np.testing.assert_allclose(n @ ROLLING.corners, 0.0, atol=1e-12)
    assert np.linalg.norm(n) == pytest.approx(1.0)
    np.testing.assert_allclose(n @ deflections(ROLLING).A[4:], 0.0, atol=1e-9)


def test_response_to_a_slow_road_and_a_sine_agrees_with_theory() -> None:
    car = QuarterCar(300.0, 40.0, 2e4, 1500.0, 2e5, 60.0)
    omega = 12.0
    time = np.arange(0.0, 9.0, 2e-4)
    u, rate = np.sin(omega * time)[:, None], omega * np.cos(omega * time)[:, None]
    position, acceleration = response(car.system(), time, u, rate)
    s = 1j * omega  # both masses by hand, after the start has died away
    strut, tyre = 2e4 + 1500.0 * s, 2e5 + 60.0 * s
    matrix = np.array([[300.0 * s**2 + strut, -strut], [-strut, 40.0 * s**2 + strut + tyre]])
    body, wheel = np.linalg.solve(matrix, np.array([0.0, tyre]))
    late = time > 7.0
    expected = np.imag(np.outer([body, wheel], np.exp(s * time[late])))
    np.testing.assert_allclose(position[late], expected.T, atol=2e-5)
    np.testing.assert_allclose(acceleration[late], -(omega**2) * expected.T, atol=5e-3)
    flat = simulate_linear(state_form(car.system()), time[:50], np.zeros((50, 2)))
    assert not flat.any()
