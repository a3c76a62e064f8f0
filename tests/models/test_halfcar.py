"""The half car against textbook formulas, other coordinates and energy."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import simpson, solve_ivp

from bayes_asv.models.discretization import exact_step, simulate_linear
from bayes_asv.models.half_car_equations import (
    Array,
    HalfCar,
    LinearSystem,
    deflection_form,
    position_form,
)
from bayes_asv.models.modes import modes

LBF_PER_INCH = 175.12683524647636
INCH = 0.0254
BAJA = HalfCar(
    c_f=7.2 * LBF_PER_INCH,
    c_r=10.0 * LBF_PER_INCH,
    i=626.0 * 0.11298482902761671,
    m=1.294 * LBF_PER_INCH,
    l=68.0 * INCH,
    wdf=0.47,
    k_f=100.0 * LBF_PER_INCH,
    k_r=100.0 * LBF_PER_INCH,
)


@st.composite
def cars(draw: st.DrawFn) -> HalfCar:
    def around(value: float, factor: float) -> float:
        return value * draw(st.floats(1.0 / factor, factor))

    return BAJA._replace(
        c_f=around(BAJA.c_f, 4.0),
        c_r=around(BAJA.c_r, 4.0),
        i=around(BAJA.i, 3.0),
        m=around(BAJA.m, 3.0),
        wdf=draw(st.floats(0.3, 0.7)),
        k_f=around(BAJA.k_f, 3.0),
        k_r=around(BAJA.k_r, 3.0),
    )


def test_nominal_car_has_the_published_geometry_and_ratios() -> None:
    assert BAJA.l_r / INCH == pytest.approx(31.96)
    assert BAJA.l_f / INCH == pytest.approx(36.04)
    assert BAJA.k_g / INCH == pytest.approx(22.0, abs=0.01)
    assert BAJA.zeta_f == pytest.approx(0.461, abs=1e-3)
    assert BAJA.zeta_r == pytest.approx(0.603, abs=1e-3)


def test_nominal_modes_agree_with_a_hand_calculation() -> None:
    slow, fast = modes(BAJA)
    assert (slow.natural, slow.ratio) == pytest.approx((2.03, 0.54), abs=0.005)
    assert (fast.natural, fast.ratio) == pytest.approx((2.99, 0.82), abs=0.005)
    assert (slow.damped, fast.damped) == pytest.approx((1.71, 1.70), abs=0.01)


@given(car=cars(), seed=st.integers(0, 1000))
def test_both_forms_give_the_same_accelerations(car: HalfCar, seed: int) -> None:
    """Eq. 5.5 with wheel positions in, against deflections with wheel accelerations in."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.0005, 0.002, 300))
    waves = rng.normal(size=(2, 3))
    rate = rng.uniform(3.0, 20.0, size=(2, 3))

    def wheel(t: Array, order: int) -> Array:
        """Position, rate or acceleration of both wheels."""
        phase = rate[:, :, None] * t + 0.5 * np.pi * order
        wave = waves[:, :, None] * rate[:, :, None] ** order * np.sin(phase)
        return np.asarray(0.01 * np.sum(wave, axis=1))

    def positions(t: float, x: Array) -> Array:
        at = np.array([t])
        u = np.array([wheel(at, 0)[0], wheel(at, 1)[0], wheel(at, 0)[1], wheel(at, 1)[1]])[:, 0]
        system = position_form(car)
        return np.asarray(system.A @ x + system.B @ u)

    def deflections(t: float, x: Array) -> Array:
        system = deflection_form(car)
        return np.asarray(system.A @ x + system.B @ wheel(np.array([t]), 2)[:, 0])

    span = (time[0], time[-1])
    start = np.array([0.01, 0.1, 0.005, -0.05])
    u0, v0 = wheel(time[:1], 0)[:, 0], wheel(time[:1], 1)[:, 0]
    lever = np.array([car.l_f, -car.l_r])
    delta0 = start[2] + lever * start[0] - u0
    rate0 = start[3] + lever * start[1] - v0
    accuracy: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-12, "t_eval": time}
    one = solve_ivp(positions, span, start, **accuracy).y
    two = solve_ivp(deflections, span, [delta0[0], rate0[0], delta0[1], rate0[1]], **accuracy).y

    system = position_form(car)
    u = np.stack([wheel(time, 0)[0], wheel(time, 1)[0], wheel(time, 0)[1], wheel(time, 1)[1]])
    motion = system.A @ one + system.B @ u
    chassis = motion[3] + lever[:, None] * motion[1]
    np.testing.assert_allclose(deflection_form(car).C @ two, chassis, atol=1e-6)


@given(car=cars())
def test_energy_leaves_only_through_the_dampers(car: HalfCar) -> None:
    """On a flat road the loss of energy is the work of the dampers, never negative."""
    time = np.linspace(0.0, 1.0, 4001)
    states = simulate_linear(
        deflection_form(car), time, np.zeros((len(time), 2)), np.array([0.05, 0.3, -0.03, -0.2])
    )
    delta, rate = states[:, [0, 2]], states[:, [1, 3]]
    heave = car.wdf * rate[:, 0] + (1.0 - car.wdf) * rate[:, 1]
    pitch = (rate[:, 0] - rate[:, 1]) / car.l
    stiffness, damping = np.array([car.k_f, car.k_r]), np.array([car.c_f, car.c_r])
    energy = 0.5 * (car.m * heave**2 + car.i * pitch**2 + (delta**2) @ stiffness)
    power = (rate**2) @ damping
    assert np.all(np.diff(energy) <= 1e-9 * energy[0])
    lost = float(simpson(power, x=time))
    assert energy[0] - energy[-1] == pytest.approx(lost, rel=1e-5)


def test_exact_step_agrees_with_many_small_steps() -> None:
    system = deflection_form(BAJA)
    coarse = simulate_linear(system, np.array([0.0, 0.02]), np.array([[1.0, -2.0], [3.0, 0.5]]))
    time = np.linspace(0.0, 0.02, 401)
    u = np.stack([np.interp(time, [0, 0.02], [1.0, 3.0]), np.interp(time, [0, 0.02], [-2.0, 0.5])])
    fine = simulate_linear(system, time, u.T)
    np.testing.assert_allclose(coarse[-1], fine[-1], rtol=1e-10)


@given(h=st.floats(1e-5, 0.5))
def test_exact_step_of_one_pole_has_its_closed_form(h: float) -> None:
    pole = 30.0
    system = LinearSystem(np.array([[-pole]]), np.array([[pole]]), np.eye(1), np.zeros((1, 1)))
    step = exact_step(system, h)
    decay = np.exp(-pole * h)
    ramp = 1.0 - (1.0 - decay) / (pole * h)
    assert step.Phi[0, 0] == pytest.approx(decay, rel=1e-10)
    assert step.Gamma1[0, 0] == pytest.approx(ramp, rel=1e-6)
    assert step.Gamma0[0, 0] == pytest.approx(1.0 - decay - ramp, rel=1e-6, abs=1e-12)


def test_an_overdamped_mode_has_two_real_poles() -> None:
    found = modes(BAJA._replace(c_f=4.0 * BAJA.c_f, c_r=4.0 * BAJA.c_r))
    assert len(found) == 4
    assert all(mode.damped == 0.0 and mode.ratio == pytest.approx(1.0) for mode in found)
