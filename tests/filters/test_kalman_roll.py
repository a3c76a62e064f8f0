"""The recursion of the car that rolls against one dense normal distribution."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal, norm

from bayes_asv.filters.discretization import ORDER
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING, VALUE
from bayes_asv.filters.kalman_roll import STATES, rolling_pass
from bayes_asv.models.roll_car import deflections, warp
from tests.models.test_cars import ROLLING

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def arguments(rng: np.random.Generator, n: int) -> dict[str, Array]:
    step = rng.choice([0.0025, 0.0018], size=n)
    step[0] = 0.0
    root = rng.normal(size=(12, 12)) * np.array([0.05] * 4 + [0.5] * 4 + [0.8] * 4)[:, None]
    noise = rng.uniform(0.5, 2.0, (2, 7)) * 0.01
    start = np.zeros((STATES, STATES))
    start[:12, :12] = 0.3 * root @ root.T + np.diag(np.diag(root @ root.T))
    start[range(12, 19), range(12, 19)] = noise[1]
    system = deflections(ROLLING)
    moments = np.zeros((n, 4, ORDER))  # of a wheel acceleration held over each step
    held = 5.0 * rng.normal(size=(n, 4))
    for j in range(ORDER):
        moments[:, :, j] = held * (step[:, None] ** (j + 1)) / np.prod(np.arange(1.0, j + 2.0))
    moments[0] = 0.0
    kind = np.full((n, 3), VALUE, np.int8)
    kind[rng.random((n, 3)) < 0.15] = MISSING
    return {
        "A": system.A, "C": np.ascontiguousarray(system.C), "n": warp(ROLLING), "noise": noise,
        "poles": rng.uniform(100.0, 400.0, 7), "step": step, "moments": moments,
        "spread": rng.uniform(0.5, 1.5, (n, 8)) * np.array([0.0025] * 4 + [1e-4] * 4),
        "kind": kind, "reading": 3.0 * rng.normal(size=(n, 3)), "start": start,
    }  # fmt: skip


def dense(a: dict[str, Array], held: Array | None = None) -> tuple[Array, Array]:
    """Mean (n, 3) and covariance (3n, 3n) of all readings, from every source of chance at once."""
    n = len(a["step"])
    mean = np.zeros(STATES)
    sources = [np.linalg.cholesky(a["start"] + 1e-18 * np.eye(STATES))]
    means, rows = np.zeros((n, 3)), []
    reads = np.zeros((3, STATES))
    reads[:, :8] = a["C"]
    reads[range(3), range(8, 11)] = reads[range(3), range(16, 19)] = 1.0
    drive = np.zeros((STATES, STATES))  # the whole as one linear system, noise held over a step
    drive[:8, :8] = a["A"]
    drive[4:8, 11] = a["n"]
    drive[4:8, 12:16] = np.eye(4)
    for k in range(n):
        h = float(a["step"][k])
        if h > 0.0:
            carry = expm(drive * h)
            decay = np.exp(-a["poles"] * h)
            carry[12:, :] = 0.0
            carry[range(12, 19), range(12, 19)] = decay
            u = a["moments"][k, :, 0] / h
            big = np.zeros((9, 9))
            big[:8, :8] = a["A"]
            big[4:8, 8] = -u
            mean = carry @ mean
            mean[:8] += expm(big * h)[:8, 8]
            sources = [carry @ s for s in sources]
            intensity = a["noise"][0, :4] * a["spread"][k, :4] + a["spread"][k, 4:]
            loan = np.zeros((16, 16))  # Van Loan 1978
            loan[:8, :8], loan[8:, 8:] = -a["A"], a["A"].T
            loan[4:8, 12:16] = np.diag(intensity)
            flow = expm(loan * h)
            fresh = np.zeros((STATES, STATES))
            fresh[:8, :8] = flow[8:, 8:].T @ flow[:8, 8:]
            fresh[range(12, 19), range(12, 19)] = a["noise"][1] * (1.0 - decay**2)
            value, vectors = np.linalg.eigh(0.5 * (fresh + fresh.T))
            sources.append(vectors * np.sqrt(np.maximum(value, 0.0)))
        means[k] = reads @ mean
        rows.append(np.hstack([reads @ s for s in sources]))
    width = rows[-1].shape[1]
    stacked = np.vstack([np.pad(row, ((0, 0), (0, width - row.shape[1]))) for row in rows])
    covariance = stacked @ stacked.T + np.diag(np.tile(a["noise"][0, 4:], n))
    return means, covariance


def run(a: dict[str, Array]) -> tuple[float, Array, Array]:
    nu, logs = np.zeros(a["kind"].shape), np.zeros(a["kind"].shape)
    return float(rolling_pass(*a.values(), nu, logs)), nu, logs


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_density_of_all_readings_at_once(seed: int) -> None:
    a = arguments(np.random.default_rng(seed), 14)
    means, covariance = dense(a)
    use = (a["kind"] == VALUE).ravel()
    expected = multivariate_normal(means.ravel()[use], covariance[np.ix_(use, use)]).logpdf(
        a["reading"].ravel()[use]
    )
    value, nu, logs = run(a)
    assert value == pytest.approx(expected, rel=1e-7)
    told = -0.5 * np.sum(np.log(2 * np.pi) + logs.ravel()[use] + nu.ravel()[use] ** 2)
    assert value == pytest.approx(told, rel=1e-12)
    assert not nu.ravel()[~use].any()


@pytest.mark.parametrize(("bound", "sign"), [(AT_LEAST, 1.0), (AT_MOST, -1.0)])
def test_a_rail_is_a_bound(bound: int, sign: float) -> None:
    """One bound as the last reading adds the probability of lying beyond it."""
    a = arguments(np.random.default_rng(9), 10)
    a["kind"][:] = VALUE
    before, _, _ = run(
        {
            **a,
            "kind": np.where(np.arange(30).reshape(10, 3) == 29, MISSING, a["kind"]).astype(
                np.int8
            ),
        }
    )
    means, covariance = dense(a)
    past, last = covariance[-1, :-1], covariance[-1, -1]
    gain = np.linalg.solve(covariance[:-1, :-1], past)
    middle = means[-1, -1] + gain @ (a["reading"].ravel()[:-1] - means.ravel()[:-1])
    sd = np.sqrt(last - past @ gain)
    a["kind"][-1, -1] = bound
    a["reading"][-1, -1] = middle + 0.4 * sd
    value, _, _ = run(a)
    assert value - before == pytest.approx(norm.logsf(sign * 0.4), abs=1e-6)
