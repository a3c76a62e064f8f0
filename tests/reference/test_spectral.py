"""White-noise response, its spectrum, and modes from covariances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch

from bayes_asv.models.discretization import exact_step
from bayes_asv.models.modes import modes
from bayes_asv.reference.modal import poles_from_covariances, subspace_modes
from bayes_asv.reference.printed import car_of_table_41, car_of_table_71
from bayes_asv.reference.spectral import (
    simulate_white_noise,
    spectral_study,
    theoretical_spectrum,
    velocity_form,
    wilson_interval,
)


def test_the_velocity_form_has_the_cars_poles() -> None:
    car = car_of_table_71()
    poles = np.linalg.eigvals(velocity_form(car).A)
    found = sorted(np.abs(poles[poles.imag > 0.0]) / (2.0 * np.pi))
    assert found == pytest.approx([m.natural for m in modes(car)], rel=1e-9)


def test_at_zero_frequency_the_chassis_follows_the_wheels() -> None:
    """|T_ff + T_fr| is one at zero frequency; powers of independent wheels add to less than two."""
    car = car_of_table_71()
    A, B, C, _ = velocity_form(car)
    still = -C @ np.linalg.solve(A, B)
    np.testing.assert_allclose(still, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(theoretical_spectrum(car, np.array([1e-6])), [[1.0, 1.0]], atol=1e-6)


def test_drives_have_the_expected_spectrum() -> None:
    """Forty records of 100 s: mean density within five deviations of the transmissibility."""
    car = car_of_table_41(0.3)
    y = simulate_white_noise(car, 100.0, 100.0, 40, np.random.default_rng(4))
    frequency, density = welch(y, 100.0, nperseg=2000, axis=1)
    band = (frequency > 0.4) & (frequency < 4.0)
    ratio = density.mean(axis=0)[band] / theoretical_spectrum(car, frequency[band])
    # 40 records of some 9 segments, 72 frequencies of two channels, neighbours not independent
    assert np.abs(ratio.mean(axis=0) - 1.0).max() < 5.0 / np.sqrt(40 * 9 * 24)
    assert np.abs(ratio - 1.0).max() < 5.0 / np.sqrt(40 * 5)


def test_exact_covariances_give_the_exact_poles() -> None:
    """With R_k = C Φ^(k-1) G known, the subspace method has nothing to estimate."""
    car, rate = car_of_table_41(0.1), 20.0
    system = velocity_form(car)
    Phi = exact_step(system, 1.0 / rate).Phi
    G = np.random.default_rng(2).normal(size=(4, 2))
    R = [np.eye(2)]
    for k in range(1, 40):
        R.append(system.C @ np.linalg.matrix_power(Phi, k - 1) @ G)
    poles = poles_from_covariances(np.stack(R), rate, 4)
    expected = np.linalg.eigvals(system.A)
    for pole in expected:
        assert np.min(np.abs(poles - pole)) < 1e-6 * abs(pole)


def test_a_long_record_gives_the_modes() -> None:
    """One record of an hour (seed 9): 2 % of the frequencies, 0.03 of the ratios."""
    car = car_of_table_41(0.1)
    y = simulate_white_noise(car, 3600.0, 20.0, 1, np.random.default_rng(9))[0]
    found = subspace_modes(y, 20.0, 20)
    for mine, truth in zip(found, modes(car), strict=True):
        assert mine.natural == pytest.approx(truth.natural, rel=0.02)
        assert mine.ratio == pytest.approx(truth.ratio, abs=0.03)


def test_two_peaks_at_ten_per_cent_and_one_from_thirty_on() -> None:
    car = car_of_table_41()
    light, heavy = (spectral_study(car, damping, 12, 3) for damping in (0.1, 0.3))
    assert light.peaks_visible
    assert not heavy.peaks_visible
    assert [len(p) for p in light.peaks] == [2, 2]
    assert [len(p) for p in heavy.peaks] == [1, 1]
    short, long = light.readings
    assert long.subspace > short.subspace >= short.peaks
    assert long.peaks > short.peaks
    again = spectral_study(car, 0.1, 12, 3)
    assert again.readings == light.readings


def test_wilson_interval() -> None:
    low, high = wilson_interval(5, 10)
    assert (low, high) == pytest.approx((0.2366, 0.7634), abs=1e-4)  # Wilson 1927, by hand
    assert wilson_interval(0, 10)[0] == 0.0
    assert wilson_interval(10, 10)[1] == 1.0
