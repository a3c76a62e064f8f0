"""What a user would otherwise take, run in an environment of its own.

``python samplers.py NAME PROBLEM OUT SEED`` reads the arrays of :class:`.problem.Problem` and
writes draws (chains, N, 3) of c_f, c_r and i with the processor time and the evaluations that they
took.
Nothing of the package is imported here.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Problem = dict[str, Any]
Found = dict[str, Any]

FRACTION = 2  # place of the front weight fraction among the parameters
WANTED = (5, 6, 7)  # of c_f, c_r and i
ORDER = 8  # moments of the inputs


def parameters(logs: Any, xp: Any) -> list[Any]:
    """Return m, l, wdf, k_f, k_r, c_f, c_r, i from what the coordinates give."""
    return [logs[k] if k == FRACTION else xp.exp(logs[k]) for k in range(8)]


def half_car(logs: Any, xp: Any) -> Any:
    """Return A (4, 4) of (δ_f, δ̇_f, δ_r, δ̇_r); its second and fourth row give the accelerations."""
    m, length, wdf, k_f, k_r, c_f, c_r, i = parameters(logs, xp)
    front, rear = (1.0 - wdf) * length, wdf * length
    g_ff, g_rr, g_fr = 1.0 / m + front**2 / i, 1.0 / m + rear**2 / i, 1.0 / m - front * rear / i
    rows = [
        [0.0, 1.0, 0.0, 0.0],
        [-g_ff * k_f, -g_ff * c_f, -g_fr * k_r, -g_fr * c_r],
        [0.0, 0.0, 0.0, 1.0],
        [-g_fr * k_f, -g_fr * c_f, -g_rr * k_r, -g_rr * c_r],
    ]
    return xp.stack([xp.stack([xp.asarray(one) for one in row]) for row in rows])


# --- the exact likelihood in JAX, as a user of NumPyro or blackjax would write it ---


def jax_log_posterior(problem: Problem) -> Callable[[Any], Any]:
    """Return the log posterior of coordinates z, a Kalman filter under ``jax.lax.scan``."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from jax.scipy.linalg import expm
    from jax.scipy.stats import norm

    data = {name: jnp.asarray(value) for name, value in problem.items()}
    h = float(problem["step"][1])
    B = jnp.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 0.0], [0.0, -1.0]])

    def prepared(z: Any) -> Any:
        A = half_car(data["first"] + z @ data["slopes"], jnp)
        variance = jnp.exp(2.0 * (data["level_centre"] + data["level_scale"] * z[data["levels"]]))
        share = norm.cdf(data["share_centre"] + data["share_scale"] * z[problem["share"]])
        white = (1.0 - share) * variance + data["steps"] ** 2 / 12.0
        filtered = share * variance
        keep = jnp.exp(-data["poles"] * h)
        whole = expm(h * jnp.block([[A, B], [jnp.zeros((2, 6))]]))
        phi, gamma = whole[:4, :4], whole[:4, 4:]
        Q = jnp.zeros((2, 4, 4))
        for g in (0, 1):  # two-point Gauss quadrature
            impulse = expm(h * (0.5 + (g - 0.5) / math.sqrt(3.0)) * A) @ B
            Q = Q + 0.5 * h * jnp.einsum("au,bu->uab", impulse, impulse)
        drive, power = [], B
        for _ in range(ORDER):
            drive.append(power)
            power = A @ power
        # state: x (4), noise of the inputs (2), biases (2) and noise (2) of the outputs
        F = jnp.zeros((10, 10))
        F = F.at[:4, :4].set(phi).at[:4, 4:6].set(-gamma).at[4:6, 4:6].set(jnp.diag(keep[:2]))
        F = F.at[6:8, 6:8].set(jnp.eye(2)).at[8:, 8:].set(jnp.diag(keep[2:]))
        gained = filtered * (1.0 - keep**2)
        H = jnp.zeros((2, 10)).at[:, :4].set(A[1::2])
        H = H.at[:, 6:8].set(jnp.eye(2)).at[:, 8:].set(jnp.eye(2))
        P = jnp.zeros((10, 10)).at[:4, :4].set(data["start"][:4, :4])
        P = P.at[6:8, 6:8].set(data["start"][4:, 4:])
        P = P.at[4:6, 4:6].set(jnp.diag(filtered[:2])).at[8:, 8:].set(jnp.diag(filtered[2:]))
        forced = jnp.einsum("jau,kuj->ka", jnp.stack(drive), data["moments"])
        return F, H, P, Q, white, gained, forced

    def log_posterior(z: Any) -> Any:
        F, H, P, Q, white, gained, forced = prepared(z)

        def step(carry: Any, now: Any) -> Any:
            x, P, total = carry
            moves, spread, force, reading = now
            intensity = white[:2] * spread[:2] + spread[2:]
            noise = jnp.zeros((10, 10)).at[:4, :4].set(jnp.einsum("u,uab->ab", intensity, Q))
            noise = noise.at[4:6, 4:6].set(jnp.diag(gained[:2]))
            noise = noise.at[8:, 8:].set(jnp.diag(gained[2:]))
            ahead = (F @ x).at[:4].add(force)
            x = jnp.where(moves, ahead, x)
            P = jnp.where(moves, F @ P @ F.T + noise, P)
            for y in (0, 1):  # the noise of the outputs is independent
                PH = P @ H[y]
                S = H[y] @ PH + white[2 + y]
                left = reading[y] - H[y] @ x
                total = total - 0.5 * (left**2 / S + jnp.log(2.0 * math.pi * S))
                x, P = x + PH * (left / S), P - jnp.outer(PH, PH) / S
            return (x, P, total), None

        inputs = (data["step"] > 0.0, data["spread"], forced, data["reading"])
        (_, _, total), _ = jax.lax.scan(step, (jnp.zeros(10), P, 0.0), inputs)
        return total - 0.5 * z @ z - 0.5 * len(z) * math.log(2.0 * math.pi)

    return log_posterior


def of_the_car(problem: Problem, z: Any) -> Any:
    """Return c_f, c_r and i (…, 3) of draws (…, D)."""
    return np.exp(problem["first"] + z @ problem["slopes"])[..., WANTED]


def numpyro_nuts(problem: Problem, seed: int) -> Found:
    """NumPyro's NUTS, with a full matrix that it adapts, in coordinates whitened at the mode.

    In those of the prior it had not ended after 25 minutes: their scales differ by 3,000, and the
    adaptation adds to the covariance of its draws more than the narrowest direction has.
    """
    import jax
    from numpyro.infer import MCMC, NUTS

    log_posterior = jax_log_posterior(problem)
    mode, root = problem["mode"], np.linalg.cholesky(problem["covariance"])
    centre, scale = jax.numpy.asarray(mode), jax.numpy.asarray(root)
    kernel = NUTS(potential_fn=lambda x: -log_posterior(centre + scale @ x), dense_mass=True)
    mcmc = MCMC(kernel, num_warmup=200, num_samples=500, progress_bar=False)
    start, extra = jax.numpy.zeros(len(mode)), ("num_steps",)
    mcmc.warmup(
        jax.random.PRNGKey(seed), init_params=start, extra_fields=extra, collect_warmup=True
    )
    steps = int(np.sum(mcmc.get_extra_fields()["num_steps"]))
    mcmc.run(mcmc.post_warmup_state.rng_key, extra_fields=extra)
    steps += int(np.sum(mcmc.get_extra_fields()["num_steps"]))
    draws = mode + np.asarray(mcmc.get_samples(group_by_chain=True)) @ root.T
    return {"draws": of_the_car(problem, draws), "evaluations": steps}


def blackjax_nuts(problem: Problem, seed: int) -> Found:
    """Blackjax's NUTS from the mode, with the Laplace approximation as its metric."""
    import blackjax
    import jax

    log_posterior = jax_log_posterior(problem)
    key = jax.random.PRNGKey(seed)
    metric = jax.numpy.asarray(problem["covariance"])
    build, kernel = blackjax.nuts.init, blackjax.nuts.build_kernel()
    draws, evaluations = [], 0
    for _ in range(2):
        key, own = jax.random.split(key)
        state = build(jax.numpy.asarray(problem["mode"]), log_posterior)

        def one(state: Any, key: Any) -> Any:
            state, info = kernel(key, state, log_posterior, 0.7, metric)
            return state, (state.position, info.num_integration_steps)

        _, (positions, steps) = jax.lax.scan(one, state, jax.random.split(own, 600))
        draws.append(np.asarray(positions)[100:])
        evaluations += int(np.sum(steps))
    return {"draws": of_the_car(problem, np.stack(draws)), "evaluations": evaluations}


# --- output error with lsim, as a user of scipy and emcee would write it ---


def lsim_log_posterior(problem: Problem) -> Callable[[Any], float]:
    """Return the log posterior of the car's six coordinates and a logarithm of noise.

    The measured wheels drive the car, go straight between the samples and have no noise.
    """
    from scipy.signal import lsim

    time_, wheels, chassis = problem["time"], problem["wheels"].T, problem["chassis"].T
    B = np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 0.0], [0.0, -1.0]])
    slopes = problem["slopes"][:6]

    def log_posterior(z: Any) -> float:
        A = half_car(problem["first"] + z[:6] @ slopes, np)
        _, out, _ = lsim((A, B, A[1::2], np.zeros((2, 2))), wheels - wheels[:40].mean(0), time_)
        left = chassis - chassis[:40].mean(0) - out
        sd = math.exp(z[6])
        value = (
            -0.5 * float(np.sum(left**2)) / sd**2 - left.size * z[6] - 0.5 * float(z[:6] @ z[:6])
        )
        return value if math.isfinite(value) else -math.inf

    return log_posterior


def _start(problem: Problem, rng: Any, count: int) -> Any:
    z = np.append(problem["mode"][:6], math.log(0.05))
    return z + rng.normal(size=(count, 7)) * np.append(0.1 * np.ones(6), 0.05)


def emcee_lsim(problem: Problem, seed: int) -> Found:
    """Run emcee as its tutorial does: 32 walkers, 200 steps of burn-in and 400 that count."""
    import emcee

    np.random.seed(seed)  # noqa: NPY002 # whose state it takes
    sampler = emcee.EnsembleSampler(32, 7, lsim_log_posterior(problem))
    sampler.run_mcmc(_start(problem, np.random.default_rng(seed), 32), 600)
    z = sampler.get_chain(discard=200).transpose(1, 0, 2)
    logs = problem["first"] + z[..., :6] @ problem["slopes"][:6]
    return {"draws": np.exp(logs)[..., WANTED], "evaluations": 32 * 600}


def pints_lsim(problem: Problem, seed: int) -> Found:
    """PINTS' adaptive covariance sampler on the same posterior: three chains of 4,000."""
    import pints

    log_posterior = lsim_log_posterior(problem)

    class Density(pints.LogPDF):  # type: ignore[misc]
        def __call__(self, z: Any) -> float:
            return log_posterior(np.asarray(z))

        def n_parameters(self) -> int:
            return 7

    np.random.seed(seed)  # noqa: NPY002 # whose state it takes
    start = list(_start(problem, np.random.default_rng(seed), 3))
    controller = pints.MCMCController(Density(), 3, start, method=pints.HaarioBardenetACMC)
    controller.set_max_iterations(4000)
    controller.set_log_to_screen(False)
    z = np.asarray(controller.run())[:, 2000:]
    logs = problem["first"] + z[..., :6] @ problem["slopes"][:6]
    return {"draws": np.exp(logs)[..., WANTED], "evaluations": 3 * 4000}


def filterpy_likelihood(problem: Problem, seed: int) -> Found:
    """Five likelihoods with filterpy's Kalman filter, without coloured noise; it has no sampler."""
    from filterpy.kalman import KalmanFilter
    from scipy.linalg import expm

    h = float(problem["step"][1])
    A = half_car(problem["first"], np)
    B = np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 0.0], [0.0, -1.0]])
    whole = expm(h * np.block([[A, B], [np.zeros((2, 6))]]))
    wheels, chassis = problem["wheels"].T, problem["chassis"].T

    def likelihood() -> float:
        kf = KalmanFilter(dim_x=6, dim_z=2, dim_u=2)
        kf.F = np.block([[whole[:4, :4], np.zeros((4, 2))], [np.zeros((2, 4)), np.eye(2)]])
        kf.B = np.vstack([whole[:4, 4:], np.zeros((2, 2))])
        kf.H = np.hstack([A[1::2], np.eye(2)])
        kf.Q, kf.R, kf.P = 1e-6 * np.eye(6), 2.5e-3 * np.eye(2), problem["start"]
        total = 0.0
        for u, y in zip(wheels, chassis, strict=True):
            kf.predict(u=u[:, None])
            kf.update(y[:, None])
            total += kf.log_likelihood
        return total

    for _ in range(5):
        likelihood()
    return {"draws": np.zeros((0, 0, 3)), "evaluations": 5}


NAMES: dict[str, Callable[[Problem, int], Found]] = {
    "emcee + lsim": emcee_lsim, "PINTS": pints_lsim, "NumPyro NUTS": numpyro_nuts,
    "blackjax NUTS, Laplace metric": blackjax_nuts, "filterpy": filterpy_likelihood,
}  # fmt: skip


def main() -> None:
    """Run one peer."""
    name, where, out, seed = sys.argv[1:]
    with np.load(where) as file:
        problem = {key: file[key] for key in file.files}
    problem["share"] = int(problem["share"])
    begin = time.process_time()
    found = NAMES[name](problem, int(seed))
    found["cpu_seconds"] = time.process_time() - begin
    if "NUTS" in name:
        import jax

        log_posterior = jax.jit(jax.vmap(jax_log_posterior(problem)))
        found["largest_difference"] = float(
            np.max(np.abs(np.asarray(log_posterior(problem["points"])) - problem["values"]))
        )
    np.savez(out, **found)


if __name__ == "__main__":
    main()
