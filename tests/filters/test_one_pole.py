"""The filter with one pole, held against an integrator and against its own equation."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from bayes_asv.filters.one_pole import low_passed


@given(seed=st.integers(0, 50), corner=st.floats(1.0, 300.0))
def test_a_spline_is_filtered_as_an_integrator_does(seed: int, corner: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.001, 0.004, 40))
    through = CubicSpline(time, rng.normal(size=40))
    pole = 2.0 * np.pi * corner
    exact = solve_ivp(
        lambda t, y: pole * (through(t) - y), (time[0], time[-1]), [float(through(time[0]))],
        t_eval=time, rtol=1e-9, atol=1e-11, max_step=1e-3,
    )  # fmt: skip
    np.testing.assert_allclose(low_passed(time, through.c, pole), exact.y[0], atol=1e-6)


def test_what_stands_still_passes_and_two_filters_commute() -> None:
    time = np.linspace(0.0, 1.0, 400)
    still = CubicSpline(time, np.full(400, 3.0))
    np.testing.assert_allclose(low_passed(time, still.c, 70.0), 3.0)
    signal = CubicSpline(time, np.sin(2.0 * np.pi * 8.0 * time))
    one, two = (
        low_passed(time, CubicSpline(time, low_passed(time, signal.c, a)).c, b)
        for a, b in ((60.0, 300.0), (300.0, 60.0))
    )
    np.testing.assert_allclose(one, two, atol=2e-4)
