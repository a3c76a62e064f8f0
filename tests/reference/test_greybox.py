"""The grey box in both coordinates, against the rig and exact data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording
from bayes_asv.io import read_recording
from bayes_asv.models.half_car_equations import position_form
from bayes_asv.reference.experiments import (
    fit_exact_accelerations,
    fit_exact_states,
    shipped_vehicle,
    simulate_exact_states,
    table_51_quantities,
)
from bayes_asv.reference.greybox import grey_box, nominal_car
from bayes_asv.reference.integrated import integrate, simulate_states
from bayes_asv.reference.printed import car_of_table_51, car_of_table_71
from bayes_asv.shipped import shipped
from tests.posterior.cases import EXACT, case, vehicle

SIMULATED = shipped_vehicle("thesis_simulation.toml")
BAJA = shipped_vehicle("baja2008.toml")


def test_table_51_is_recovered_to_a_hundredth_of_a_percent() -> None:
    estimate = fit_exact_accelerations(SIMULATED)
    found, put = table_51_quantities(estimate, SIMULATED), car_of_table_51()
    assert estimate.verdict == "ok"
    assert found["k_g"] == pytest.approx(put.k_g, rel=1e-4)
    assert found["zeta_f"] == pytest.approx(0.7, rel=1e-4)
    assert found["zeta_r"] == pytest.approx(0.5, rel=1e-4)


def test_held_inputs_bias_the_damping_ratios_as_printed() -> None:
    found = table_51_quantities(fit_exact_states(SIMULATED, "held"), SIMULATED)
    assert 1.01 < found["zeta_f"] / 0.7 < 1.10
    assert 1.01 < found["zeta_r"] / 0.5 < 1.10
    straight = table_51_quantities(fit_exact_states(SIMULATED, "straight"), SIMULATED)
    assert straight["zeta_f"] == pytest.approx(0.7, rel=2e-3)
    assert straight["zeta_r"] == pytest.approx(0.5, rel=2e-3)


@pytest.mark.parametrize(("terrain", "seed"), [("bump", 3), ("stops", 4)])
def test_parameters_of_the_rig_are_recovered_in_deflections(terrain: str, seed: int) -> None:
    car, _, recording = case(terrain, seed, EXACT)
    estimate = grey_box(recording, vehicle(EXACT))
    for name in ("c_f", "c_r", "i"):
        assert estimate.parameters[name].value == pytest.approx(getattr(car, name), rel=0.02)
    assert min(estimate.fit.values()) > 95.0


def test_the_block_recursion_solves_the_differential_equation() -> None:
    """Initial states and straight inputs against an adaptive integrator."""
    car, h, n = car_of_table_71(), 0.0025, 101
    rng = np.random.default_rng(6)
    knots = h * np.arange(n)
    u = np.cumsum(rng.normal(size=(n, 4)), axis=0) * 1e-3
    start = rng.normal(size=4) * 0.05
    system = position_form(car)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        now = np.array([np.interp(t, knots, column) for column in u.T])
        return np.asarray(system.A @ x + system.B @ now)

    truth = solve_ivp(rate, (0.0, knots[-1]), start, t_eval=knots, max_step=h, rtol=1e-9).y.T
    base, design = simulate_states(car, h, u, held=False, free=True)
    np.testing.assert_allclose(base + design @ start, truth, atol=1e-6)
    held, nothing = simulate_states(car, h, u, held=True, free=False)
    assert nothing.shape == (n, 4, 0)
    assert np.abs(held - base).max() > 1e-6


def test_integration_recovers_a_known_motion() -> None:
    """Smooth hubs and chassis: displacements to 0.1 %, pitch and heave from them."""
    time = np.arange(0.0, 1.0, 0.0025)
    shape = np.sin(np.pi * time) ** 6
    acceleration = CubicSpline(time, shape).derivative(2)(time)
    scale = np.array([0.05, 0.03, 0.02, -0.01])
    delay = np.array([s.delay for s in BAJA.sensors_of(CHANNELS)])
    spline = CubicSpline(time, acceleration)
    values = np.stack([a * spline(time + d) for a, d in zip(scale, delay, strict=True)])
    data = integrate(Recording(time, values, ("m/s^2",) * 4), BAJA, "none")
    want = np.interp(data.time, time, shape)
    for k in range(4):
        np.testing.assert_allclose(data.displacement[k], scale[k] * want, atol=2e-3 * 0.05)
    np.testing.assert_allclose(data.y[:, 0], (0.03 + 0.01) / BAJA.l.value * want, atol=2e-4)
    heave = BAJA.wdf.value * 0.03 - (1.0 - BAJA.wdf.value) * 0.01
    np.testing.assert_allclose(data.y[:, 2], heave * want, atol=2e-4)


def test_detrending() -> None:
    recording = read_recording(shipped("recordings", "stops-800hz.csv"))
    ended = integrate(recording, BAJA, "constant")
    assert np.abs(ended.displacement[:, -1]).max() < 1e-9
    trend = integrate(recording, BAJA, "trend")
    assert np.abs(trend.acceleration.mean(axis=1)).max() < 1e-9
    largest_travel = integrate(recording, BAJA, "none")
    assert np.abs(largest_travel.displacement[:, -1]).max() > 0.01
    with pytest.raises(ValueError, match="detrending"):
        integrate(recording, BAJA, "wishes")


def test_integrated_estimates_depend_on_detrending_and_deflections_do_not() -> None:
    """Shipped stops, m as given: 1 % in deflections, and a spread of several by what is removed."""
    recording = read_recording(shipped("recordings", "stops-400hz.csv"))
    straight = grey_box(recording, BAJA)
    truth = {"c_f": 1008.73, "c_r": 1786.29, "i": 75.68}
    for name, value in truth.items():
        assert straight.parameters[name].value == pytest.approx(value, rel=0.01)
    found = [
        grey_box(recording, BAJA, coordinates="integrated", initial="zero", detrending=r)
        for r in ("trend", "constant")
    ]
    rates = [e.parameters["c_r"].value for e in found]
    assert abs(rates[0] / rates[1] - 1.0) > 0.02
    # its standard deviation is far below its error
    assert abs(rates[1] - truth["c_r"]) > 5.0 * found[1].parameters["c_r"].sd
    assert max(w.p for w in found[0].whiteness.values()) < 1e-6


def test_an_uninformative_recording_is_refused() -> None:
    time = np.arange(400) / 400.0
    values = 0.01 * np.random.default_rng(0).normal(size=(4, 400))
    quiet = Recording(time, values, ("m/s^2",) * 4)
    estimate = grey_box(quiet, BAJA)
    assert estimate.verdict == "refused"
    assert estimate.reasons
    assert not estimate.parameters
    with pytest.raises(ValueError, match="wishes"):
        grey_box(quiet, BAJA, coordinates="wishes")


def test_exact_states_begin_at_rest() -> None:
    data = simulate_exact_states(nominal_car(SIMULATED))
    assert data.u.shape == data.y.shape == (300, 4)
    assert np.abs(data.y[0]).max() == 0.0
    assert np.abs(data.u).max() > 0.05
