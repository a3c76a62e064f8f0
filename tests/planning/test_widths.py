"""Widths against the estimator's own formula, limits in closed form, and what must hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Given, Vehicle, read_vehicle
from bayes_asv.planning.information import SEEN
from bayes_asv.planning.limits import limit
from bayes_asv.planning.pairs import pairs
from bayes_asv.planning.widths import ANSWERS, GIVEN, Known, floors, known, passes_needed, widths
from bayes_asv.posterior.parameters import space
from bayes_asv.shipped import shipped

Array = NDArray[np.float64]

BAJA = read_vehicle(shipped("vehicles", "baja2008.toml"))
DRAWN = settings(max_examples=40, deadline=None)


def _information(seed: int, strength: float = 1e4) -> Array:
    """Draw a positive definite information matrix."""
    root = np.random.default_rng(seed).normal(size=(6, 9))
    return np.asarray(strength * root @ root.T)


def _car(m: float, l: float, wdf: float, k: float) -> Vehicle:
    return replace(
        BAJA,
        m=Given(BAJA.m.value, m * BAJA.m.value),
        l=Given(BAJA.l.value, l * BAJA.l.value),
        wdf=Given(BAJA.wdf.value, wdf * BAJA.wdf.value),
        k_f=Given(BAJA.k_f.value, k * BAJA.k_f.value),
        k_r=Given(BAJA.k_r.value, 2.0 * k * BAJA.k_r.value),
    )


@pytest.mark.parametrize("car", [BAJA, _car(0.0, 0.0, 0.01, 0.05), _car(0.02, 0.01, 0.0, 0.0)])
def test_the_width_is_that_of_the_estimators_coordinates(car: Vehicle) -> None:
    """The same precision in the coordinates that are sampled, and the estimator's way back."""
    J, passes = _information(3), 4
    where = space(car, ())
    d = where.car_dimension
    # ∂ ln θ / ∂z of what the information is about, by differences of the estimator's own map
    step = 1e-5
    slope = np.zeros((len(SEEN), d))
    order = ("c_f", "c_r", "i", "m", "l", "wdf", "k_f", "k_r")
    for k in range(d):
        by = np.zeros((1, where.dimension))
        by[0, k] = step
        up, down = np.log(where.cars(by)[0]), np.log(where.cars(-by)[0])
        change = dict(zip(order, (up - down) / (2.0 * step), strict=True))
        for row, name in enumerate(SEEN):
            slope[row, k] = change[name]
            if name != "wdf":
                slope[row, k] -= change["m"] + (2.0 * change["l"] if name == "i" else 0.0)
    precision: Array = np.eye(d) + passes * slope.T @ J @ slope
    covariance: Array = np.linalg.inv(precision).astype(np.float64)
    found = widths(J, passes, known(car))
    for k, name in enumerate(ANSWERS[:3]):
        sd = where.log_deviation(covariance, name)
        assert found[k] == pytest.approx(math.sqrt(math.expm1(sd**2)), rel=1e-5)


def test_without_data_the_widths_are_the_priors() -> None:
    found = widths(np.zeros((6, 6)), 1, known(BAJA))
    assert found[0] == pytest.approx(math.sqrt(math.expm1(math.log(3.0) ** 2)))
    assert found[2] == pytest.approx(math.sqrt(math.expm1(math.log(2.0) ** 2)))
    own, m = math.log(2.0), known(BAJA).log_sd["m"]
    assert found[3] == pytest.approx(math.sqrt(math.expm1(0.25 * (own**2 + m**2))))


def test_a_drive_that_says_everything_leaves_mass_and_wheelbase() -> None:
    """Closed form where springs are wide: c as m, i as m l², k_g as l."""
    wide = {"c_f": 1.1, "c_r": 1.1, "i": 0.7, "k_f": 9.0, "k_r": 9.0, "wdf": 0.01}
    before = Known({**wide, "m": 0.02, "l": 0.01})
    found = floors(before)
    wanted = [0.02, 0.02, math.hypot(0.02, 0.02), 0.01]
    assert found == pytest.approx(wanted, rel=2e-3)
    assert widths(_information(1), 1e7, before) == pytest.approx(found, rel=1e-3)
    assert floors(before.exactly()) == pytest.approx(np.zeros(4), abs=1e-12)


@given(
    seed=st.integers(0, 10_000), strength=st.floats(1.0, 1e6),
    sds=st.lists(st.sampled_from([0.0, 0.003, 0.02, 0.1]), min_size=4, max_size=4),
)  # fmt: skip
@DRAWN
def test_more_passes_and_better_given_values_never_hurt(
    seed: int, strength: float, sds: list[float]
) -> None:
    J, before = _information(seed, strength), known(_car(*sds))
    one, many = widths(J, 1, before), widths(J, 7, before)
    assert np.all(many <= one * (1.0 + 1e-9))
    assert np.all(floors(before) <= many * (1.0 + 1e-6) + 1e-12)
    for name in GIVEN:
        better = widths(J, 7, before.but(**{name: 0.5 * before.log_sd[name]}))
        assert np.all(better <= many * (1.0 + 1e-9))


@given(seed=st.integers(0, 10_000), want=st.floats(0.002, 0.5))
@DRAWN
def test_the_passes_needed_are_the_fewest(seed: int, want: float) -> None:
    J, before = _information(seed, 100.0), known(BAJA)
    for k, n in enumerate(passes_needed(J, before, np.full(4, want))):
        if n is None:
            assert widths(J, 1000, before)[k] > want
        else:
            assert widths(J, n, before)[k] <= want
            assert n == 1 or widths(J, n - 1, before)[k] > want


@given(
    seed=st.integers(0, 10_000), answer=st.sampled_from(ANSWERS), want=st.floats(0.001, 0.05),
    sds=st.lists(st.sampled_from([0.0, 0.01, 0.05]), min_size=4, max_size=4),
)  # fmt: skip
@DRAWN
def test_what_is_asked_of_the_given_values_suffices_and_is_no_more_than_needed(
    seed: int, answer: str, want: float, sds: list[float]
) -> None:
    J, before, place = _information(seed, 3e4), known(_car(*sds)), ANSWERS.index(answer)
    what = limit(J, 5, before, answer, want)
    if what is None:
        assert widths(J, 5, before)[place] <= want
        return
    if not what.needed:
        assert widths(J, 5, before.exactly())[place] > want
        return
    # all other given values keep theirs, or improve by the same factor where one is not enough
    factor = max(sd / before.log_sd[name] for name, sd in what.needed.items())
    assert factor < 1.0
    if len(what.needed) == 1:
        done = before.but(**what.needed)
        slack = before.but(**{name: 1.01 * sd for name, sd in what.needed.items()})
        if widths(J, 5, done)[place] <= want * (1.0 + 1e-6):
            assert widths(J, 5, slack)[place] > want * (1.0 - 1e-3)
            return
    done = before.but(**{name: factor * before.log_sd[name] for name in GIVEN})
    assert widths(J, 5, done)[place] <= want * (1.0 + 1e-6)


def test_a_mass_known_to_a_per_cent_is_named() -> None:
    what = limit(_information(2, 1e7), 10, known(BAJA), "c_f", 0.005)
    assert what is not None
    assert list(what.needed) == ["m"]
    assert what.needed["m"] == pytest.approx(0.005, rel=0.02)
    assert limit(_information(2, 1e7), 10, known(BAJA), "c_f", 0.02) is None
    weak = limit(_information(2, 1.0), 1, known(BAJA), "c_f", 0.005)
    assert weak is not None
    assert weak.needed == {}


def test_parameters_that_move_alike_are_found() -> None:
    """Two columns of sensitivities at a known angle: the estimates' correlation is −cos."""
    for angle, alike in ((0.3, True), (1.2, False)):
        slope = np.eye(6) * 100.0
        slope[SEEN.index("k_f")] = 0.0
        slope[SEEN.index("k_f"), :4] = 0.0
        slope[SEEN.index("k_f"), SEEN.index("c_f")] = 100.0 * math.cos(angle)
        slope[SEEN.index("k_f"), SEEN.index("k_f")] = 100.0 * math.sin(angle)
        found = pairs(slope @ slope.T)
        assert bool(found) == alike
        if alike:
            assert found[0].names == ("c_f", "k_f")
            assert found[0].correlation == pytest.approx(-math.cos(angle), abs=1e-3)
            assert found[0].blindness == pytest.approx(1.0 / math.sin(angle), rel=0.01)


def test_a_drive_that_says_nothing_names_no_pair() -> None:
    assert pairs(np.zeros((6, 6))) == []
