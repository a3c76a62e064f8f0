"""Small recordings of any car, and the density of all their readings from dense algebra."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bayes_asv.domain.channels import channel
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.filters.kalman import MISSING, ORDER, VALUE, Measurements, SensorNoise, StateSpace
from bayes_asv.models.car_model import Output, bias_directions, state_space
from bayes_asv.models.cars import car_model

Array = NDArray[np.float64]

VEHICLE = read_vehicle(Path(__file__).parents[2] / "data" / "vehicles" / "baja2008_roll.toml")
LEAD = 0.003  # s, of a sensor without a filter behind a common pole
KINDS: dict[str, tuple[str, tuple[Output, ...]]] = {
    "half": ("half", (Output(channel("front_chassis")), Output(channel("rear_chassis")))),
    "quarter": ("quarter-rear", (Output(channel("rear_chassis")),)),
    "roll": (
        "roll",
        tuple(Output(channel(f"{name}_chassis")) for name in ("front_left", "front_right", "rear")),
    ),
    "travel": ("half", (Output(channel("front_travel"), LEAD), Output(channel("rear_travel")))),
    "body": (
        "half",
        (
            Output(replace(channel("body_vertical"), position=0.7)),
            Output(channel("body_pitch_rate"), LEAD),
        ),
    ),
}
"""Cars with the outputs that are measured of them."""


class Case(NamedTuple):
    """A recording of straight inputs: times (N,) and inputs (N, nu) beside what a filter takes."""

    system: StateSpace
    noise: SensorNoise
    data: Measurements
    time: Array
    inputs: Array


def straight_moments(step: Array, u: Array) -> Array:
    """Moments (N, nu, ORDER) of inputs (N, nu) that are straight between their samples."""
    moments = np.zeros((*u.shape, ORDER))
    for k in range(1, len(step)):
        h = step[k]
        for j in range(ORDER):
            # ∫ (h−s)ʲ/j! (u₀ + (u₁−u₀) s/h) ds
            whole = h ** (j + 1) / math.factorial(j + 1)
            ramp = h ** (j + 1) / math.factorial(j + 2)
            moments[k, :, j] = u[k - 1] * (whole - ramp) + u[k] * ramp
    return moments


def linear_case(name: str, seed: int, n: int = 25, missing: bool = True, sets: int = 1) -> Case:
    """A small recording: uneven steps, missing readings; parameter sets differ a little."""
    rng = np.random.default_rng(seed)
    car, outputs = KINDS[name]
    model = car_model(car, VEHICLE)
    values = {key: x * np.exp(0.1 * rng.normal(size=sets)) for key, x in model.nominal.items()}
    gains = tuple(
        np.exp(0.02 * rng.normal(size=(sets, size))) for size in (len(model.elements), len(outputs))
    )
    system = state_space(model, values, outputs, (gains[0], gains[1]))
    system = system._replace(N=bias_directions(state_space(model, model.nominal, outputs)))
    nu, ny, nd, nx = len(model.elements), len(outputs), system.N.shape[1], system.A.shape[1]
    step = np.append(0.0, rng.choice([0.0025, 0.0018, 0.004], size=n - 1))
    u = 5.0 * rng.normal(size=(n, nu))
    kind = np.full((n, ny), VALUE, np.int8)
    if missing:
        kind[rng.random((n, ny)) < 0.2] = MISSING
    size = np.array([0.01 if o.channel.quantity == "deflection" else 1.0 for o in outputs])
    variance = 0.02 * rng.uniform(0.5, 2.0, (2, sets, nu + ny))
    variance[:, :, nu:] *= size**2
    root = rng.normal(size=(nx + nd + ny,) * 2)
    scale = np.concatenate([np.tile([0.05, 0.5], (nx + 1) // 2)[:nx], np.full(nd, 0.7), size])
    start = scale[:, None] * (0.2 * root @ root.T + np.eye(len(root))) * scale
    spread = rng.uniform(0.5, 1.5, (n, 2 * nu)) * np.repeat([0.0025, 1e-4], nu)
    data = Measurements(
        step=step,
        moments=straight_moments(step, u),
        process_noise=spread,
        kind=kind,
        reading=3.0 * size * rng.normal(size=(n, ny)),
        extra_variance=0.01 * size**2 * rng.uniform(size=(n, ny)),
        initial_covariance=start,
    )
    noise = SensorNoise(variance[0], variance[1], rng.uniform(100.0, 400.0, (sets, nu + ny)))
    return Case(system, noise, data, np.cumsum(step), u)


def dense(case: Case) -> tuple[Array, Array]:
    """Mean (N, ny) and covariance (N ny, N ny) of all readings, from every source of chance.

    Built from the model's own words with matrix exponentials (Van Loan 1978), set 0.
    """
    A, B, C, N = (x[0] for x in (*case.system[:3], case.system.N[None]))
    white, filtered, poles = (x[0] for x in case.noise)
    step, _, spread, _, _, extra, start = case.data
    nx, nu = B.shape
    nd, ny = N.shape[1], len(C)
    size = nx + nd + nu + 2 * ny  # x, d, w, b, v
    d, w, b, v = nx, nx + nd, nx + nd + nu, nx + nd + nu + ny
    places = [*range(nx), *range(d, w), *range(b, v)]
    covariance = np.zeros((size, size))
    covariance[np.ix_(places, places)] = start
    covariance[range(w, b), range(w, b)] = filtered[:nu]
    covariance[range(v, size), range(v, size)] = filtered[nu:]
    sources = [np.linalg.cholesky(covariance + 1e-18 * np.eye(size))]
    reads = np.zeros((ny, size))
    reads[:, :nx] = C
    reads[range(ny), range(b, v)] = reads[range(ny), range(v, size)] = 1.0
    drive = np.zeros((size, size))  # biases and filtered noise held over a step
    drive[:nx, :nx] = A
    drive[:nx, d:w], drive[:nx, w:b] = -B @ N, -B
    mean = np.zeros(size)
    means, rows = [], []
    for k, h in enumerate(step):
        if h > 0.0:
            carry = expm(drive * h)
            carry[w:b, :] = 0.0
            carry[v:, :] = 0.0
            decay = np.exp(-poles * h)
            carry[range(w, b), range(w, b)] = decay[:nu]
            carry[range(v, size), range(v, size)] = decay[nu:]
            big = np.zeros((nx + 2, nx + 2))  # an input that is straight over the step
            big[:nx, :nx] = A
            big[:nx, nx] = B @ case.inputs[k - 1]
            big[:nx, nx + 1] = B @ (case.inputs[k] - case.inputs[k - 1]) / h
            big[nx, nx + 1] = 0.0
            flow = expm(big * h)
            ramp = np.zeros((nx + 2, nx + 2))
            ramp[:nx, :nx] = A
            ramp[:nx, nx] = big[:nx, nx + 1]
            ramp[nx, nx + 1] = 1.0
            mean = carry @ mean
            mean[:nx] += flow[:nx, nx] + expm(ramp * h)[:nx, nx + 1]
            sources = [carry @ s for s in sources]
            intensity = white[:nu] * spread[k, :nu] + spread[k, nu:]
            loan = np.zeros((2 * nx, 2 * nx))
            loan[:nx, :nx], loan[nx:, nx:] = -A, A.T
            loan[:nx, nx:] = (B * intensity) @ B.T
            flow = expm(loan * h)
            fresh = np.zeros((size, size))
            fresh[:nx, :nx] = flow[nx:, nx:].T @ flow[:nx, nx:]
            fresh[range(w, b), range(w, b)] = filtered[:nu] * (1.0 - decay[:nu] ** 2)
            fresh[range(v, size), range(v, size)] = filtered[nu:] * (1.0 - decay[nu:] ** 2)
            value, vectors = np.linalg.eigh(0.5 * (fresh + fresh.T))
            sources.append(vectors * np.sqrt(np.maximum(value, 0.0)))
        means.append(reads @ mean)
        rows.append(np.hstack([reads @ s for s in sources]))
    width = rows[-1].shape[1]
    stacked = np.vstack([np.pad(row, ((0, 0), (0, width - row.shape[1]))) for row in rows])
    return np.array(means), stacked @ stacked.T + np.diag((white[nu:] + extra).ravel())
