"""Modes and Table 4.2 against independent computations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.models.half_car_equations import HalfCar, position_form
from bayes_asv.models.mode_shapes import second_order_modes
from bayes_asv.models.modes import modes
from bayes_asv.reference.modal import (
    axle_matrices,
    corrected_modes,
    printed_damped,
    printed_matrices,
    printed_modes,
)
from bayes_asv.reference.printed import TABLE_42, car_of_table_41, car_of_table_71

Array = NDArray[np.float64]


@st.composite
def cars(draw: st.DrawFn) -> HalfCar:
    base = car_of_table_71()
    factor = st.floats(0.4, 2.5)
    return base._replace(
        c_f=base.c_f * draw(factor),
        c_r=base.c_r * draw(factor),
        i=base.i * draw(factor),
        k_f=base.k_f * draw(factor),
        k_r=base.k_r * draw(factor),
        wdf=draw(st.floats(0.35, 0.65)),
    )


@settings(deadline=None, max_examples=40)
@given(car=cars())
def test_modes_are_the_roots_of_the_characteristic_polynomial(car: HalfCar) -> None:
    """det(Ms² + Cs + K) of two degrees of freedom vanishes at every pole."""
    M, C, K = axle_matrices(car)
    for mode in second_order_modes(M, C, K):
        size = 2.0 * np.pi * mode.natural
        s = size * complex(-mode.ratio, np.sqrt(max(1.0 - mode.ratio**2, 0.0)))
        if mode.damped == 0.0:
            s = complex(-size, 0.0)
        # relative to the largest terms, so that zero means zero to rounding
        Z = M * s**2 + C * s + K
        scale = np.abs(M * s**2).max() + np.abs(C * s).max() + np.abs(K).max()
        value = Z[0, 0] * Z[1, 1] - Z[0, 1] * Z[1, 0]
        assert abs(value) < 1e-9 * scale**2


@settings(deadline=None, max_examples=40)
@given(car=cars())
def test_three_coordinates_have_the_same_frequencies(car: HalfCar) -> None:
    """Deflections, displacements at the axles, and eq. 5.5's pitch and heave agree to 1e-9."""
    ours = modes(car)
    second = second_order_modes(*axle_matrices(car))
    direct = np.linalg.eigvals(position_form(car).A)
    direct = direct[direct.imag >= 0.0]
    natural = np.sort(np.abs(direct)) / (2.0 * np.pi)
    if min(np.diff(natural), default=1.0) < 1e-3 * natural[0]:
        return  # nearly equal poles are accurate to the square root of rounding only
    assert [m.natural for m in ours] == pytest.approx(list(natural), rel=1e-9)
    assert [m.natural for m in second] == pytest.approx(list(natural), rel=1e-9)
    for a, b in zip(ours, second, strict=True):
        assert a.ratio == pytest.approx(b.ratio, rel=1e-8)


def _closed_form(M: Array, K: Array) -> tuple[float, float]:
    """Return the two undamped frequencies, Hz, from the quadratic det(K − ω²M) = 0."""
    a = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    b = -(M[0, 0] * K[1, 1] + M[1, 1] * K[0, 0] - M[0, 1] * K[1, 0] - M[1, 0] * K[0, 1])
    c = K[0, 0] * K[1, 1] - K[0, 1] * K[1, 0]
    # computing the larger root first avoids cancellation in the smaller one
    large = (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    small = c / (a * large)
    return float(np.sqrt(small) / (2.0 * np.pi)), float(np.sqrt(large) / (2.0 * np.pi))


def test_undamped_frequencies_follow_from_the_quadratic() -> None:
    M, C, K = axle_matrices(car_of_table_41())
    slow, fast = second_order_modes(M, 0.0 * C, K)
    assert (slow.natural, fast.natural) == pytest.approx(_closed_form(M, K), rel=1e-9)
    assert slow.ratio == pytest.approx(0.0, abs=1e-9)


def test_the_printed_rule_reproduces_the_printed_table() -> None:
    printed = printed_modes(car_of_table_41())
    for k in (0, 1):
        assert round(printed[k].damped, 2) == TABLE_42["damped"][k]
        assert printed[k].ratio == pytest.approx(
            TABLE_42["ratio"][k], abs=6e-4
        )  # truncated in print
        assert round(printed[k].natural, 2) == TABLE_42["natural"][k]


def test_the_corrected_table() -> None:
    slow, fast = corrected_modes(car_of_table_41())
    assert (slow.natural, fast.natural) == pytest.approx((1.193, 1.911), abs=5e-4)
    assert (slow.damped, fast.damped) == pytest.approx((1.187, 1.891), abs=5e-4)
    assert (slow.ratio, fast.ratio) == pytest.approx((0.102, 0.145), abs=5e-4)


def test_both_mass_matrices_agree_for_a_car_balanced_at_mid_wheelbase() -> None:
    car = car_of_table_41()._replace(wdf=0.5)
    np.testing.assert_allclose(axle_matrices(car)[0], printed_matrices(car)[0], rtol=1e-12)


def test_at_seventy_per_cent_the_second_mode_is_overdamped() -> None:
    found = modes(car_of_table_41(0.7))
    real = [m for m in found if m.damped == 0.0]
    assert [m.natural for m in real] == pytest.approx([1.51, 2.35], abs=0.01)
    assert len(found) == 3


def test_the_misplaced_square_underestimates_the_damped_frequency() -> None:
    for mode in modes(car_of_table_41()):
        assert printed_damped(mode) < mode.damped
