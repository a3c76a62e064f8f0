"""Modes and Table 4.2 against other ways to compute them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_asv.models.half_car import HalfCar, position_form
from bayes_asv.models.modes import modes
from bayes_asv.models.second_order import second_order_modes
from bayes_asv.reference.modal import (
    axle_matrices,
    closed_form,
    printed_damped,
    printed_matrices,
    printed_way,
    right_way,
)
from bayes_asv.reference.printed import TABLE_42, car_of_table_41, car_of_table_71


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
    """det(Ms² + Cs + K), written out for two degrees of freedom, vanishes at every pole."""
    M, C, K = axle_matrices(car)
    for mode in second_order_modes(M, C, K):
        size = 2.0 * np.pi * mode.natural
        s = size * complex(-mode.ratio, np.sqrt(max(1.0 - mode.ratio**2, 0.0)))
        if mode.damped == 0.0:
            s = complex(-size, 0.0)
        # each row in units of its largest term, so that zero means zero to rounding
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
        return  # poles that nearly meet are known to the root of the rounding only
    assert [m.natural for m in ours] == pytest.approx(list(natural), rel=1e-9)
    assert [m.natural for m in second] == pytest.approx(list(natural), rel=1e-9)
    for a, b in zip(ours, second, strict=True):
        assert a.ratio == pytest.approx(b.ratio, rel=1e-8)


def test_undamped_frequencies_follow_from_the_quadratic() -> None:
    M, C, K = axle_matrices(car_of_table_41())
    slow, fast = second_order_modes(M, 0.0 * C, K)
    assert (slow.natural, fast.natural) == pytest.approx(closed_form(M, K), rel=1e-9)
    assert slow.ratio == pytest.approx(0.0, abs=1e-9)


def test_the_printed_rule_gives_the_printed_table() -> None:
    theirs = printed_way(car_of_table_41())
    for k in (0, 1):
        assert round(theirs[k].damped, 2) == TABLE_42["damped"][k]
        assert theirs[k].ratio == pytest.approx(TABLE_42["ratio"][k], abs=6e-4)  # it truncates
        assert round(theirs[k].natural, 2) == TABLE_42["natural"][k]


def test_the_right_table() -> None:
    slow, fast = right_way(car_of_table_41())
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


def test_the_misplaced_square_always_falls_short() -> None:
    for mode in modes(car_of_table_41()):
        assert printed_damped(mode) < mode.damped
