"""The extended Kalman filter against the linear one, free responses against a general solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayes_asv.filters.free_response import free_response
from bayes_asv.filters.kalman import (
    Laws,
    filter_pass,
    linearise,
    log_likelihood,
)
from bayes_asv.filters.linearised_filter import perturbation_response
from bayes_asv.models.effects import EFFECTS, placed_effect
from bayes_asv.posterior.effects import Values, law_table, sensor_corrections
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, case, vehicle

CASES = {
    "bound_rebound@front": {"ratio": 3.0, "rounding": 0.02},
    "digressive_damper@rear": {"knee": 0.2, "drop": 6.0},
    "coulomb_friction@front": {"force": 60.0, "slip": 0.02, "presliding": 4e-4},
    "coulomb_friction@rear": {"force": 40.0, "slip": 0.02, "presliding": 1e-3},
    "progressive_spring@rear": {"kappa": 200.0, "curl": 0.15},
    "bump_stop@front": {"gap": 0.02, "rate": 60000.0, "onset": 0.003, "power": 1.3},
    "damper_fade@rear": {"loss": 0.4, "bend": 1.2},
    "spring_curve@rear": {
        **{f"compression_{k}": 0.2 for k in range(1, 11)},
        **{f"extension_{k}": -0.06 for k in range(1, 11)},
    },
    "damper_curve@front": {
        **{f"compression_{k}": -0.3 for k in range(1, 16)},
        **{f"extension_{k}": 0.09 for k in range(1, 16)},
    },
}
APART = {
    placed_effect("damper_hysteresis@front"): {"stiffness": 90000.0},
    placed_effect("coulomb_friction@rear"): {"force": 40.0, "slip": 0.02, "presliding": 1e-3},
}
STIFFNESS = placed_effect("damper_hysteresis@front")
SERIES = {
    STIFFNESS: {"stiffness": 90000.0},
    placed_effect("digressive_damper@front"): {"knee": 0.15, "drop": 6.0},
    placed_effect("coulomb_friction@front"): {"force": 20.0, "slip": 0.02, "presliding": 4e-4},
}


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    _, _, recording = case("bump", 1, DECLARED)
    car = vehicle(DECLARED)
    lines, _, _ = prepare_runs((recording,), car)
    known = tuple(sensor_corrections(line, car, line.reading) for line in lines)
    return Posterior(make_parameter_space(car, lines), (WHITE,), sensor_corrections=known)


def test_without_laws_it_is_the_linear_recursion(posterior: Posterior) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        z = rng.normal(0.0, 0.3, posterior.space.dimension)
        plain = posterior.innovations(z, 0)
        nu, logs, _ = posterior.innovations_and_variances(z, 0)
        np.testing.assert_allclose(nu, plain, rtol=1e-8, atol=1e-8)
        log_p = float(posterior.log_likelihood(z[None])[0])
        there = logs != 0.0
        again = -0.5 * np.sum(np.log(2.0 * np.pi) + logs[there] + nu[there] ** 2)
        assert again == pytest.approx(log_p, abs=1e-6)


def test_a_law_that_changes_nothing_is_no_law(posterior: Posterior) -> None:
    """Without a law forces and their slopes are not computed at all."""
    rng = np.random.default_rng(4)
    where = {placed_effect("progressive_spring@front"): {"kappa": 0.0, "curl": 0.15}}
    table = law_table(posterior.space.car, where, 0)[None]
    recording, known = posterior.space.recordings[0], posterior.sensor_corrections[0]
    z = rng.normal(0.0, 0.3, (1, posterior.space.dimension))
    added = rng.normal(0.0, 5.0, recording.reading.shape)
    system, noise = posterior.space.state_space(z, 0), posterior.space.noises(z, 0)
    found = [
        filter_pass(
            system, noise, recording.measurements,
            Laws(laws, known.pole, known.wheel, recording.elapsed, added),
        )
        for laws in (table, table[:, :0])
    ]  # fmt: skip
    for with_law, without in zip(*found, strict=True):
        np.testing.assert_allclose(with_law, without, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", [name for name in CASES if "friction" not in name])
def test_a_free_run_is_what_a_general_solver_gives(posterior: Posterior, name: str) -> None:
    """The car moves, then the sensors filter: states of the true motion, not of the filtered.

    Forces that went straight from sample to sample would miss 0.28 % of unequal sides and 0.22 % of
    a stop.
    """
    where = placed_effect(name)
    law = EFFECTS[where.effect.name].force
    assert law is not None
    axle = 0 if where.where == "front" else 1

    def force(x: np.ndarray, share: float, c: float, k: float) -> float:
        return float(law(CASES[name], c, k, x[2 * axle], x[2 * axle + 1], share))

    output, wanted = _simulated(posterior, {where: CASES[name]}, axle, force)
    linear, _ = _simulated(posterior, {}, axle, lambda x, share, c, k: 0.0)
    error = np.sqrt(np.mean((output - wanted) ** 2))
    assert error < 0.002 * np.sqrt(np.mean((wanted - linear) ** 2))


def _rubs(values: Mapping[str, float], rate: float, elastic: float) -> float:
    """Rate of the elastic displacement of friction, of which Dahl's law is that without slip."""
    speed = np.hypot(rate, values["slip"])
    return float(rate - speed * elastic / values["presliding"])


@pytest.mark.parametrize(("axle", "presliding"), [(0, 2e-5), (0, 4e-4), (0, 3e-3), (1, 4e-4)])
def test_friction_gives_before_it_slips(posterior: Posterior, axle: int, presliding: float) -> None:
    """Against a solver whose state is what has given."""
    values = {"force": 60.0, "slip": 0.02, "presliding": presliding}
    where = placed_effect(f"coulomb_friction@{('front', 'rear')[axle]}")

    def force(x: np.ndarray, share: float, c: float, k: float) -> float:
        return float(-values["force"] * x[6] / presliding)

    output, wanted = _simulated(
        posterior, {where: values}, axle, force,
        lambda x, c: [_rubs(values, x[2 * axle + 1], x[6])],
    )  # fmt: skip
    linear, _ = _simulated(posterior, {}, axle, lambda x, share, c, k: 0.0)
    error = np.sqrt(np.mean((output - wanted) ** 2))
    assert error < 0.01 * np.sqrt(np.mean((wanted - linear) ** 2))


def test_a_damper_in_series_with_a_stiffness_lags(posterior: Posterior) -> None:
    """Against a solver that has the deflection of the stiffness as its state, not the force."""
    stiffness, digressive, friction = SERIES.values()
    curve = EFFECTS["digressive_damper"].force
    assert curve is not None

    def damper(u: float, c: float) -> float:
        return float(c * u - curve(digressive, c, 0.0, 0.0, np.asarray(u), 0.0))

    def rate(x: np.ndarray, c: float) -> float:
        return brentq(lambda u: damper(u, c) - stiffness["stiffness"] * x[6], -9.0, 9.0)

    def force(x: np.ndarray, share: float, c: float, k: float) -> float:
        rubs = friction["force"] * x[7] / friction["presliding"]
        return float(c * x[1] - stiffness["stiffness"] * x[6] - rubs)

    output, wanted = _simulated(
        posterior, SERIES, 0, force,
        lambda x, c: [x[1] - rate(x, c), _rubs(friction, x[1], x[7])],
    )  # fmt: skip
    linear, _ = _simulated(posterior, {}, 0, lambda x, share, c, k: 0.0)
    error = np.sqrt(np.mean((output - wanted) ** 2))
    assert error < 0.0013 * np.sqrt(np.mean((wanted - linear) ** 2))


def test_a_very_stiff_mount_is_none(posterior: Posterior) -> None:
    """But for what white noise of the wheels does within a step, which it leaves out."""
    z = np.full((1, posterior.space.dimension), 0.1)
    straight = {placed_effect("digressive_damper@front"): {"knee": 50.0, "drop": 6.0}}
    without = _filtered(posterior, z, straight)
    found = [
        _filtered(posterior, z, {**straight, STIFFNESS: {"stiffness": K}}) for K in (1e5, 1e6, 1e7)
    ]
    apart = [np.sqrt(np.mean((one - without) ** 2)) for one in found]
    assert apart[0] / apart[1] == pytest.approx(10.0, rel=0.1)
    assert apart[2] < 0.02 * np.sqrt(np.mean(without**2))


def test_innovations_of_a_series_damper_do_not_depend_on_their_lanes(posterior: Posterior) -> None:
    z = np.random.default_rng(2).normal(0.0, 0.2, (20, posterior.space.dimension))
    values = _log_likelihood(posterior, z, SERIES)
    alone = [_log_likelihood(posterior, z[k : k + 1], SERIES)[0] for k in range(len(z))]
    np.testing.assert_allclose(values, alone, rtol=1e-9)


@pytest.mark.parametrize("name", [*CASES, "damper_hysteresis@front", "apart", "none"])
@pytest.mark.parametrize("changed", ["inputs", "readings", "forces"])
def test_the_linearised_filter_responds_as_the_filter_does(
    posterior: Posterior, name: str, changed: str
) -> None:
    """To a small push, where readings are as predicted: gains that change have nothing to weight.

    The Jacobian of a step leaves out the bend of the forces' path.  With what the bend owes to the
    step alone, the response of a damper in series with a stiffness would be off by a third.
    """
    values: Values = {placed_effect(name): CASES[name]} if name in CASES else {}
    values = {"damper_hysteresis@front": SERIES, "apart": APART}.get(name, values)
    recording = posterior.space.recordings[0]
    z = np.full((1, posterior.space.dimension), 0.1)
    system, noise = posterior.space.state_space(z, 0), posterior.space.noises(z, 0)
    laws, data = _laws(posterior, values), recording.measurements
    begin = np.zeros((1, len(data.initial_covariance)))
    output, _ = free_response(system, data, begin, laws)
    data = data._replace(reading=output[0])

    time = recording.elapsed
    push = np.exp(-0.5 * ((time - 0.4 * time[-1]) / 0.02) ** 2)
    change = {
        "inputs": np.zeros_like(data.moments),
        "readings": np.zeros_like(data.reading),
        "forces": np.zeros_like(laws.added),
    }
    if changed == "inputs":
        change["inputs"] = 1e-4 * push[:, None, None] * data.moments.std(axis=0)
    else:
        change[changed] = 1e-3 * push[:, None] * [1.0, 0.4]

    def innovations(sign: float) -> np.ndarray:
        nudged = data._replace(
            moments=data.moments + sign * change["inputs"],
            reading=data.reading + sign * change["readings"],
        )
        forces = laws._replace(added=laws.added + sign * change["forces"])
        return np.asarray(filter_pass(system, noise, nudged, forces).innovations[0])

    filtered, linearised = linearise(system, noise, data, laws)
    assert np.max(np.abs(filtered.innovations)) < 1e-6
    found = perturbation_response(linearised, *change.values())
    wanted = 0.5 * (innovations(1.0) - innovations(-1.0))
    assert np.linalg.norm(found - wanted) < 0.01 * np.linalg.norm(wanted)


def _laws(posterior: Posterior, values: Values) -> Laws:
    recording, known = posterior.space.recordings[0], posterior.sensor_corrections[0]
    table = law_table(posterior.space.car, values, 0)[None]
    return Laws(table, known.pole, known.wheel, recording.elapsed, np.zeros_like(recording.reading))


def _filtered(posterior: Posterior, z: np.ndarray, values: Values) -> np.ndarray:
    system, noise = posterior.space.state_space(z, 0), posterior.space.noises(z, 0)
    recording = posterior.space.recordings[0]
    return filter_pass(system, noise, recording.measurements, _laws(posterior, values)).innovations


def _log_likelihood(posterior: Posterior, z: np.ndarray, values: Values) -> np.ndarray:
    system, noise = posterior.space.state_space(z, 0), posterior.space.noises(z, 0)
    recording = posterior.space.recordings[0]
    return log_likelihood(system, noise, recording.measurements, _laws(posterior, values))


def _simulated(
    posterior: Posterior,
    values: Values,
    axle: int,
    force: Callable[[np.ndarray, float, float, float], float],
    further: Callable[[np.ndarray, float], list[float]] = lambda x, c: [],
) -> tuple[np.ndarray, np.ndarray]:
    """One second of outputs by the kernel and by a general solver.

    ``force`` is what is added to an axle (N), from the true motion, the share of the recording,
    damping and spring rate; ``further`` the rates of further states behind the others.
    """
    recording, known = posterior.space.recordings[0], posterior.sensor_corrections[0]
    centre = np.zeros((1, posterior.space.dimension))
    c_f, c_r, i, m, l, wdf, k_f, k_r = posterior.space.cars(centre)[0]
    l_f, l_r = l * (1.0 - wdf), l * wdf
    give = np.array([[1 / m + l_f**2 / i, 1 / m - l_f * l_r / i], [0.0, 1 / m + l_r**2 / i]])
    give[1, 0] = give[0, 1]
    begin_t, end_t = recording.instants[0], recording.instants[-1]
    pole = known.pole
    own = (c_f, k_f) if axle == 0 else (c_r, k_r)

    def wheels(t: float) -> np.ndarray:
        """What the wheels did before the filter: û + û'/λ."""
        return np.array([w.spline(t) + w.spline(t, 1) / pole for w in recording.wheels])

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        forces = np.array([-k_f * x[0] - c_f * x[1], -k_r * x[2] - c_r * x[3]])
        forces[axle] += force(x, (t - begin_t) / (end_t - begin_t), *own)
        acc = give @ forces
        u = wheels(t)
        passed = pole * (acc - x[4:6])
        return np.array([x[1], acc[0] - u[0], x[3], acc[1] - u[1], *passed, *further(x, own[0])])

    n = 400
    first = np.zeros(6 + len(further(np.zeros(8), own[0])))
    # the kernel's states are filtered motions at rest: true ones lie δ + δ̇/λ and δ̇ + δ̈/λ away
    first[[1, 3]] = [-w.spline(begin_t) / pole for w in recording.wheels]
    solved = solve_ivp(
        slope, (begin_t, recording.instants[n]), first, t_eval=recording.instants[: n + 1],
        rtol=1e-8, atol=1e-10, max_step=5e-4,
    )  # fmt: skip
    begin, laws = np.zeros((1, 6)), _laws(posterior, values)
    (output,), _ = free_response(
        posterior.space.state_space(centre, 0), recording.measurements, begin, laws
    )
    return output[: n + 1], solved.y[4:6].T
