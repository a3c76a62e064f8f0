"""The smoother against a dense Gaussian, and on a damper that fades."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm

from bayes_asv.filters.kalman import VALUE
from bayes_asv.filters.ukf_state import Model, Steps
from bayes_asv.models.half_car import deflection_form
from bayes_asv.tracking.smoother import smoothed, smoothed_states
from tests.filters.test_kalman import CAR, LaidOut, recursion_case
from tests.filters.test_ukf import NEVER
from tests.posterior.cases import DECLARED, vehicle
from tests.tracking.drives import faded, long_drive, tracked

Array = NDArray[np.float64]


def _dense(noise: Array, laid: LaidOut) -> tuple[Array, Array]:
    """Means and deviations (N, 10) of all states given all readings, by one big Gaussian."""
    h, moments, spread, kind, reading, _, start = laid
    n = len(h)
    system = deflection_form(CAR)
    flows, drives, fresh = [], [], []
    for k in range(1, n):
        F = np.eye(10)
        big = np.zeros((6, 6))
        big[:4, :4], big[:4, 4:] = system.A, np.eye(4)[:, [1, 3]]
        grown = expm(big * h[k])
        F[:4, :4], F[:4, 6:8] = grown[:4, :4], grown[:4, 4:]
        decay = np.exp(-noise[8:12] * h[k])
        F[range(6, 10), range(6, 10)] = decay
        x, B = np.zeros(10), system.B
        for j in range(moments.shape[2]):
            x[:4] += B @ moments[k, :, j]
            B = system.A @ B
        block = np.zeros((8, 8))
        block[:4, :4], block[4:, 4:] = -system.A, system.A.T
        block[1, 5], block[3, 7] = noise[:2] * spread[k, :2] + spread[k, 2:]
        flow = expm(block * h[k])
        Q = block_diag(
            flow[4:, 4:].T @ flow[:4, 4:], np.zeros((2, 2)), np.diag(noise[4:8] * (1 - decay**2))
        )
        flows.append(F)
        drives.append(x)
        fresh.append(Q)
    mean, P = np.zeros(10), np.diag(np.concatenate([start, noise[4:8]]))
    means, covariance = np.zeros((n, 10)), np.zeros((n, 10, n, 10))
    for k in range(n):
        if k:
            mean = flows[k - 1] @ mean + drives[k - 1]
            for j in range(k):
                covariance[k, :, j] = flows[k - 1] @ covariance[k - 1, :, j]
                covariance[j, :, k] = covariance[k, :, j].T
            P = flows[k - 1] @ P @ flows[k - 1].T + fresh[k - 1]
        means[k], covariance[k, :, k] = mean, P
    flat, whole = means.ravel(), covariance.reshape(10 * n, 10 * n)
    rows, values, white = [], [], []
    for k in range(n):
        for axle in range(2):
            if kind[k, axle] == VALUE:
                row = np.zeros((n, 10))
                row[k, :4] = system.C[axle]
                row[k, 4 + axle] = row[k, 8 + axle] = 1.0
                rows.append(row.ravel())
                values.append(reading[k, axle])
                white.append(noise[2 + axle])
    H = np.array(rows)
    gain = np.linalg.solve(H @ whole @ H.T + np.diag(white), H @ whole).T
    after = flat + gain @ (np.array(values) - H @ flat)
    left = whole - gain @ H @ whole
    return after.reshape(n, 10), np.sqrt(np.diag(left)).reshape(n, 10)


def test_with_known_parameters_it_is_the_gaussian_smoother() -> None:
    for seed in range(6):
        _, _, noise, laid = recursion_case(seed, n=15)
        h, moments, spread, kind, reading, _, _ = laid
        laid[6][:] = np.array([0.1, 1.0, 0.1, 1.0, 1.0, 1.0]) ** 2  # as the filter begins
        base = np.append(np.array(CAR, float), np.ones(4))
        model = Model(
            base, np.array([0, 1, 2]), np.ones(3, bool), np.log(base[:3]), np.full(3, 1e-12),
            noise, laid[6], np.zeros(3), np.zeros(3),
        )  # fmt: skip
        steps = Steps(h, moments, spread, kind, reading, np.zeros(15, bool))
        means, deviations = smoothed_states(model, steps, NEVER)
        wanted, sd = _dense(noise, laid)
        np.testing.assert_allclose(deviations[:, 3:], sd, atol=1e-5)
        np.testing.assert_allclose(means[:, 3:], wanted, atol=1e-5)


def test_it_is_the_filter_at_the_last_row_and_better_before() -> None:
    """30 % lost over 20 s on a rough road; seed 12."""
    car, recording = long_drive(24.0, 12, 0.3, 20.0)
    _, frames = tracked(recording, forget=60.0)
    found = smoothed(recording, vehicle(DECLARED), forget=60.0)
    np.testing.assert_allclose(found.median[-1], frames.median[-1], rtol=1e-9)
    np.testing.assert_allclose(found.log_sd[-1], frames.log_sd[-1], rtol=1e-6)
    assert np.mean(found.log_sd <= 1.001 * frames.log_sd) > 0.99
    late = found.time > 2.0
    seen = np.isfinite(frames.deflection_sd).all(axis=1) & late
    assert np.all(found.deflection_sd[seen] <= 1.05 * frames.deflection_sd[seen])
    true = faded(found.time, 0.3, 20.0)

    def error(median: Array) -> float:
        share = (median[:, 0] / car.c_f / true)[late]
        return float(np.std(share / np.median(share)))

    assert error(found.median) < 0.75 * error(frames.median)


def test_across_a_fault_the_parameters_hold_together() -> None:
    _, recording = long_drive(14.0, 11)
    values = recording.values.copy()
    values[3, recording.time > 5.0] += 3.0 / 0.0254
    broken = type(recording)(recording.time, values, recording.units, source="b.csv")
    found = smoothed(broken, vehicle(DECLARED))
    _, frames = tracked(broken)
    assert np.isfinite(found.median).all()
    assert np.isfinite(found.deflection).all()
    early, late = found.median[np.searchsorted(found.time, [4.0, 8.0])]
    np.testing.assert_allclose(np.log(early / late), 0.0, atol=3e-3)
    np.testing.assert_allclose(found.median[-1], frames.median[-1], rtol=1e-9)
