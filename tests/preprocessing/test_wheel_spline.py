"""Wheel signals: moments against quadrature, filters against scipy, edges against truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.signal import lsim

from bayes_asv.preprocessing.wheel_spline import (
    Array,
    WheelSignal,
    interpolation_sd,
    match_bandwidths,
    moments,
    wheel_signal,
)


def _signal(seed: int = 0, n: int = 60) -> tuple[Array, WheelSignal]:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.001, 0.004, n))
    none = np.zeros(n, bool)
    return time, wheel_signal(time, rng.normal(size=n), none, none)


@given(seed=st.integers(0, 50))
def test_moments_are_the_integrals_they_claim(seed: int) -> None:
    time, signal = _signal(seed)
    rng = np.random.default_rng(seed + 1)
    instants = np.sort(rng.uniform(time[2], time[-3], 12))
    got = moments(signal, instants, 6)
    factorial = 1.0
    for j in range(6):
        factorial *= max(j, 1)
        for k in range(1, len(instants)):
            a, b = instants[k - 1], instants[k]
            inside = signal.knots[(signal.knots > a) & (signal.knots < b)]
            exact, _ = quad(
                lambda s, b=b, j=j, f=factorial: (b - s) ** j / f * signal.spline(s),
                a, b, points=inside if len(inside) else None, epsabs=1e-14, limit=200,
            )  # fmt: skip
            assert got[k, j] == pytest.approx(exact, rel=1e-8, abs=1e-13)
    assert np.all(got[0] == 0.0)


def test_equalising_a_fast_sensor_gives_what_the_slow_one_reads() -> None:
    time = np.arange(4000) / 4000.0
    truth = np.sin(2 * np.pi * 12.0 * time) + 0.3 * np.sin(2 * np.pi * 35.0 * time)
    filtered = {
        pole: lsim(([2 * np.pi * pole], [1.0, 2 * np.pi * pole]), truth, time)[1]
        for pole in (50.0, 120.0)
    }
    got = match_bandwidths(time, filtered[120.0], 120.0, 50.0)
    np.testing.assert_allclose(got[400:], filtered[50.0][400:], atol=2e-4)


def test_equalising_leaves_the_slowest_sensor_alone() -> None:
    x = np.arange(5.0)
    assert match_bandwidths(x, x, 50.0, 50.0) is x


def test_what_happens_between_samples_is_seen_at_edges_only() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(800) / 400.0
    smooth = 20.0 * np.sin(2 * np.pi * 3.0 * time)
    edge = np.where(time >= 1.0, 40.0 * (1.0 - np.exp(-314.0 * (time - 1.0))), 0.0)
    quiet = interpolation_sd(time, smooth + 0.02 * rng.normal(size=800))
    sharp = interpolation_sd(time, smooth + edge + 0.02 * rng.normal(size=800))
    assert np.max(quiet) < 0.02
    near = np.abs(0.5 * (time[1:] + time[:-1]) - 1.0) < 0.012
    assert np.max(sharp[near]) > 0.3
    assert np.max(sharp[~near]) < 0.02


def test_deviation_between_samples_covers_the_errors_of_jumps() -> None:
    """Over random places of a filtered jump, the spline's error has the claimed size."""
    rng = np.random.default_rng(3)
    time = np.arange(41) / 400.0
    error, claimed = [], []
    for _ in range(200):
        t0 = (20.0 + rng.uniform()) / 400.0

        def truth(t: np.ndarray, t0: float = t0) -> np.ndarray:
            return np.where(t > t0, 1.0 - np.exp(-314.16 * (t - t0)), 0.0)

        none = np.zeros(41, bool)
        signal = wheel_signal(time, truth(time), none, none)
        fine = np.linspace(time[0], time[-1], 200_001)
        error.append(np.trapezoid(signal.spline(fine) - truth(fine), fine))
        claimed.append(np.sum((signal.sd / 400.0) ** 2))
    ratio = np.sqrt(np.mean(np.square(error)) / np.mean(claimed))
    assert 0.7 < ratio < 1.2


def test_a_clipped_sample_is_put_outside_the_rail_and_trusted_less() -> None:
    time = np.arange(60) / 400.0
    truth = 30.0 * np.exp(-(((time - 0.075) / 0.008) ** 2))
    high = truth > 25.0
    signal = wheel_signal(time, np.minimum(truth, 25.0), np.zeros(60, bool), high)
    assert np.all(signal.spline(time[high]) >= 25.0)
    inside = high[:-1] & high[1:]
    assert np.min(signal.sd[inside]) > 0.5
    far = np.abs(time[:-1] - 0.075) > 0.03
    assert np.max(signal.sd[far]) < 0.2
