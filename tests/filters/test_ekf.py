"""The extended Kalman filter against the linear one, free responses against a general solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayes_asv.filters.free_response import free_response
from bayes_asv.filters.kalman import Laws, filter_pass
from bayes_asv.models.effects import EFFECTS, site
from bayes_asv.posterior.effects import law_table, patterns
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.map_fit import prepare_runs
from bayes_asv.posterior.parameters import space
from tests.posterior.cases import DECLARED, case, vehicle

CASES = {
    "bound_rebound@front": {"ratio": 3.0, "rounding": 0.02},
    "digressive_damper@rear": {"knee": 0.2, "sharpness": 2.0},
    "coulomb_friction@front": {"force": 60.0, "slip": 0.02},
    "progressive_spring@rear": {"kappa": 200.0, "curl": 0.15},
    "bump_stop@front": {"gap": 0.02, "rate": 60000.0, "onset": 0.003, "power": 1.3},
    "damper_fade@rear": {"loss": 0.4, "bend": 1.2},
}


@pytest.fixture(scope="module")
def target() -> Posterior:
    _, _, recording = case("bump", 1, DECLARED)
    car = vehicle(DECLARED)
    lines, _, _ = prepare_runs((recording,), car)
    known = tuple(patterns(line, car, line.reading) for line in lines)
    return Posterior(space(car, lines), (WHITE,), patterns=known)


def test_without_laws_it_is_the_linear_recursion(target: Posterior) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        z = rng.normal(0.0, 0.3, target.space.dimension)
        plain = target.innovations(z, 0)
        nu, logs, _ = target.innovations_and_variances(z, 0)
        np.testing.assert_allclose(nu, plain, rtol=1e-8, atol=1e-8)
        log_p = float(target.log_likelihood(z[None])[0])
        there = logs != 0.0
        again = -0.5 * np.sum(np.log(2.0 * np.pi) + logs[there] + nu[there] ** 2)
        assert again == pytest.approx(log_p, abs=1e-6)


def test_a_law_that_changes_nothing_is_no_law(target: Posterior) -> None:
    """Without a law forces and their slopes are not computed at all."""
    rng = np.random.default_rng(4)
    where = {site("progressive_spring@front"): {"kappa": 0.0, "curl": 0.15}}
    table = law_table(target.space.car, where, 0)[None]
    line, known = target.space.timelines[0], target.patterns[0]
    z = rng.normal(0.0, 0.3, (1, target.space.dimension))
    added = rng.normal(0.0, 5.0, line.reading.shape)
    system, noise = target.space.state_space(z, 0), target.space.noises(z, 0)
    found = [
        filter_pass(
            system, noise, line.measurements,
            Laws(laws, known.pole, known.wheel, line.elapsed, added),
        )
        for laws in (table, table[:, :0])
    ]  # fmt: skip
    for with_law, without in zip(*found, strict=True):
        np.testing.assert_allclose(with_law, without, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_a_free_run_is_what_a_general_solver_gives(target: Posterior, name: str) -> None:
    """The car moves, then the sensors filter: states of the true motion, not of the filtered."""
    line, known = target.space.timelines[0], target.patterns[0]
    where = site(name)
    centre = np.zeros((1, target.space.dimension))
    table = law_table(target.space.car, {where: CASES[name]}, 0)[None]
    c_f, c_r, i, m, l, wdf, k_f, k_r = target.space.cars(centre)[0]
    l_f, l_r = l * (1.0 - wdf), l * wdf
    give = np.array([[1 / m + l_f**2 / i, 1 / m - l_f * l_r / i], [0.0, 1 / m + l_r**2 / i]])
    give[1, 0] = give[0, 1]
    effect = EFFECTS[where.effect.name]
    assert effect.force is not None
    begin_t, end_t = line.instants[0], line.instants[-1]
    pole = known.pole

    def wheels(t: float) -> np.ndarray:
        """What the wheels did before the filter: û + û'/λ."""
        return np.array([w.spline(t) + w.spline(t, 1) / pole for w in line.wheels])

    def forces(x: np.ndarray, t: float) -> np.ndarray:
        out = np.array([-k_f * x[0] - c_f * x[1], -k_r * x[2] - c_r * x[3]])
        axle = 0 if where.where == "front" else 1
        share = (t - begin_t) / (end_t - begin_t)
        own = (c_f, k_f) if axle == 0 else (c_r, k_r)
        out[axle] += effect.force(CASES[name], *own, x[2 * axle], x[2 * axle + 1], share)  # type: ignore[misc]
        return out

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        acc = give @ forces(x, t)
        u = wheels(t)
        passed = pole * (acc - x[4:6])
        return np.array([x[1], acc[0] - u[0], x[3], acc[1] - u[1], *passed])

    n = 400
    until = line.instants[n]
    first = np.zeros(6)
    # the kernel's states are filtered motions at rest: true ones lie δ + δ̇/λ and δ̇ + δ̈/λ away
    first[[1, 3]] = [-w.spline(begin_t) / pole for w in line.wheels]
    solved = solve_ivp(
        slope, (begin_t, until), first, t_eval=line.instants[: n + 1], rtol=1e-8, atol=1e-10,
        max_step=5e-4,
    )  # fmt: skip
    output, _ = free_response(
        target.space.state_space(centre, 0), line.measurements, np.zeros(6),
        Laws(table, pole, known.wheel, line.elapsed, np.zeros_like(line.reading)),
    )  # fmt: skip
    wanted = solved.y[4:6].T
    error = output[: n + 1] - wanted
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.sqrt(np.mean(wanted**2))
