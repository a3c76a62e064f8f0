"""Rates of a bent damper against its curve, and a free curve against the one that was driven."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayes_asv.analysis.damping_rates import _shapes, damping_rates
from bayes_asv.models.effects import placed_effect
from bayes_asv.posterior.fitted_model import make_dataset
from tests.posterior.cases import DECLARED, case, prepared, vehicle


def test_rates_are_those_of_the_curve() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 3, DECLARED)
    digressive = placed_effect("digressive_damper@front")
    posterior = make_dataset(car, (prepared(recording, car),)).posterior((digressive,))
    mode = np.zeros(posterior.space.dimension)
    z = np.tile(mode, (3, 1))
    draws = posterior.space.quantities(z, 0)
    (front,) = damping_rates(posterior, mode, z, draws)
    values = posterior.space.effects(mode)[digressive]
    c, knee, drop = draws["c_f"], values["knee"], values["drop"]
    lost = drop / (1.0 + drop)
    assert front.element == "front"
    np.testing.assert_allclose(front.at_rest, c, rtol=1e-5)
    falls = 1.0 - lost * (1.0 - 1.0 / np.hypot(1.0, front.speed / knee))
    np.testing.assert_allclose(front.compression, c * falls, rtol=1e-9)
    np.testing.assert_allclose(front.extension, front.compression)
    driven = posterior.innovations_and_variances(mode, 0)[2][:, 1]
    force = driven * (1.0 - lost * (1.0 - 1.0 / np.hypot(1.0, driven / knee)))
    np.testing.assert_allclose(
        front.equal_power, c * np.sum(force * driven) / np.sum(driven**2), rtol=1e-3
    )
    assert front.speed == pytest.approx(np.sqrt(np.mean(driven**2)))


def test_friction_takes_power_beside_the_damper() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 3, DECLARED)
    friction = placed_effect("coulomb_friction@front")
    posterior = make_dataset(car, (prepared(recording, car),)).posterior(
        (placed_effect("bound_rebound@front"), friction)
    )
    mode = np.zeros(posterior.space.dimension)
    force, presliding = (
        posterior.space.names.index(f"effect {friction} {name}") for name in ("force", "presliding")
    )
    mode[force], mode[presliding] = 1.0, 2.3  # 10 mm, where it gives for much of the motion
    z = np.tile(mode, (3, 1))
    draws = posterior.space.quantities(z, 0)
    (front,) = damping_rates(posterior, mode, z, draws)
    values = posterior.space.effects(mode)[friction]
    driven = posterior.innovations_and_variances(mode, 0)[2][:, 1]
    time = posterior.space.recordings[0].elapsed

    def slope(t: float, m: np.ndarray) -> np.ndarray:
        rate = np.interp(t, time, driven)
        given = values["force"] * rate - np.hypot(rate, values["slip"]) * m
        return np.asarray(given / values["presliding"])

    rubs = solve_ivp(slope, (time[0], time[-1]), [0.0], "LSODA", time, rtol=1e-8, max_step=1e-3).y[
        0
    ]
    power = float(rubs @ driven)
    sliding = values["force"] * np.sum(driven**2 / np.hypot(driven, values["slip"]))
    assert 0.2 * sliding < power < 0.8 * sliding
    damper = draws["c_f"] * np.sum(driven**2)  # the sides are equal where coordinates are zero
    added = front.equal_power - damper / np.sum(driven**2)
    np.testing.assert_allclose(added, power / np.sum(driven**2), rtol=0.01)
    np.testing.assert_allclose(front.at_rest, draws["c_f"])


def test_a_linear_car_has_no_curves() -> None:
    car = vehicle(DECLARED)
    _, _, recording = case("bump", 3, DECLARED)
    posterior = make_dataset(car, (prepared(recording, car),)).posterior(())
    mode = np.zeros(posterior.space.dimension)
    assert (
        damping_rates(posterior, mode, mode[None], posterior.space.quantities(mode[None], 0)) == ()
    )


def test_a_draw_that_does_not_resist_leaves_statements_finite() -> None:
    # forces at the five speeds; the first draw does not resist in fast compression
    extension = np.array([[0.1, 3.0, 1.0, 4.0, 8.0]] * 3)
    compression = np.array([[0.1, -1.0, 1.0, 2.0, 1.5], [0.1, 1.0, 1.0, 2.0, 2.5], [0.0] * 5])
    shapes = _shapes(compression, extension)
    assert {shape.name for shape in shapes} >= {"unequal_sides"}
    assert all(np.all(np.isfinite(shape.ratio)) for shape in shapes)
    assert all(np.all(shape.ratio > 0.0) for shape in shapes)
