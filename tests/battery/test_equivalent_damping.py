"""Equivalent damping: exact for the forms of docs/interfaces.md, close for those of the rig."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import tests.rig as rig
from tests.battery.equivalent_damping import Path, equivalent, paths

Array = NDArray[np.float64]

C, K = 1300.0, 18e3
RNG = np.random.default_rng(5)
RATE = RNG.normal(0.0, 0.4, 200)
DELTA = 0.04 * np.sin(np.linspace(0.0, 40.0, 200)) + 0.01
SHARE = np.linspace(0.0, 1.0, 200)


def path(force: Array) -> Path:
    return Path(DELTA, RATE, SHARE, -K * DELTA - force)


@settings(max_examples=8)
@given(size=st.floats(0.05, 1.0), c=st.floats(300.0, 5000.0))
def test_the_rate_of_the_listed_forms_is_exact(size: float, c: float) -> None:
    v, ratio = RATE, 1.0 + size
    rebound = 2.0 * c * ratio / (1.0 + ratio)
    forms = {
        "bound_rebound": np.where(v > 0.0, rebound, rebound / ratio) * v,
        "digressive_damper": c * v / np.sqrt(1.0 + (v / (1.0 / size)) ** 2),
        "coulomb_friction": c * v + 100.0 * size * np.sign(v),
        "damper_fade": c * (1.0 - 0.5 * size * SHARE) * v,
        "progressive_spring": c * v + K * 300.0 * size * DELTA**3,
        "bump_stop": c * v - 5.0 * K * np.maximum(-DELTA - 0.02, 0.0),
        "droop_stop": c * v + 5.0 * K * np.maximum(DELTA - 0.02, 0.0),
    }
    for name, force in forms.items():
        assert equivalent([name], path(force), 1.2 * c, K) == pytest.approx(c, rel=1e-4), name
    both = forms["coulomb_friction"] + forms["damper_fade"] - c * v
    names = ["coulomb_friction", "damper_fade"]
    assert equivalent(names, path(both), 0.9 * c, K) == pytest.approx(c, rel=1e-4)


def test_a_force_without_a_form_goes_into_the_rate() -> None:
    softer = path(C * RATE - 200.0 * RATE)
    assert equivalent(["sensor_gain"], softer, C, K) == pytest.approx(C - 200.0)


def test_paths_cover_the_runs_without_their_margins() -> None:
    car = rig.baja()
    runs = [
        rig.drive(car, rig.bump(), speed, 400, 1.0, rig.SensorSpec.clean(), 0, keep_motion=True)
        for speed in (3.0, 4.0)
    ]
    front, rear = paths(runs, 1.0)
    assert len(front.rate) == len(rear.rate) == 2 * 401
    assert (front.share.min(), front.share.max()) == pytest.approx((0.0, 1.0), abs=1e-9)
    np.testing.assert_allclose(front.delta[:400], runs[0].deflection[0], atol=1e-9)
    for axle, own in ((front, car.c_f), (rear, car.c_r)):
        k = car.k_f if axle is front else car.k_r
        assert equivalent([], axle, own, k) == pytest.approx(own, rel=1e-9)
