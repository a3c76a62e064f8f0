"""The curve of a spring is found from drives on springs of other formulae, and described."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.analysis.spring_curves import SpringCurve, spring_curves
from bayes_asv.models.effects import placed_effect
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import DECLARED, as_recording, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    CurveSpring,
    LinearDamper,
    SensorSpec,
    baja,
    draw,
    draw_biases,
    drive,
)

Array = NDArray[np.float64]

_DELTA = np.linspace(-0.25, 0.25, 2001)


def _relative_force(kind: str) -> Array:
    """Force over the stiffness at rest, m."""
    if kind == "tangent":  # a tangent that meets its asymptote at 94 mm, straight beyond 48 mm
        length, last = 0.06, 0.048
        inside = np.clip(_DELTA, -last, last)
        beyond = (_DELTA - inside) / math.cos(last / length) ** 2
        return np.asarray(length * np.tan(inside / length) + beyond)
    if kind == "coils":  # coils that close between 12 and 30 mm of compression: twice as stiff
        first, width = 0.012, 0.018
        closing = np.clip(-_DELTA - first, 0.0, width)
        closed = np.maximum(-_DELTA - first - width, 0.0)
        return np.asarray(_DELTA - closing**2 / (2.0 * width) - closed)
    return _DELTA


class _Found:
    """Posterior (normal at the mode) of a drive over parking stops with a law of the front spring.

    Parameters
    ----------
    kind : str
        The law, see :func:`_relative_force`.
    names : str
        Effects in the model.
    """

    def __init__(self, kind: str, *names: str) -> None:
        rng = np.random.default_rng([0, 77])
        car = draw(baja(), rng, DECLARED)
        self.car, self.force = car, car.k_f * _relative_force(kind)
        spring = CurveSpring(tuple(_DELTA), tuple(self.force))
        declared = draw_biases(SensorSpec(), rng)
        road, run = (int(v) for v in rng.integers(2**31, size=2))
        driven = drive(
            replace(car, front_law=(spring, LinearDamper(car.c_f))),
            TERRAINS["stops"](road), DEFAULT_SPEEDS["stops"], 400.0, 2.0, declared, run,
        )  # fmt: skip
        lines, _, _ = prepare_runs((as_recording(driven, "stops.csv"),), vehicle(DECLARED))
        found = best_fit(lines, vehicle(DECLARED), "innovations", tuple(map(placed_effect, names)))
        draws = np.random.default_rng(1)
        z = draws.multivariate_normal(found.mode.z, found.mode.covariance, 1000, method="eigh")
        self.draws = found.posterior.space.quantities(z, 0)
        self.curves = spring_curves(found.posterior, found.mode.z, z, self.draws)

    def interval(self, name: str) -> tuple[float, float]:
        low, high = np.quantile(self.draws[name], [0.025, 0.975])
        return float(low), float(high)


@pytest.mark.parametrize("kind", ["linear", "tangent", "coils"])
def test_the_band_holds_the_curve_and_the_intervals_hold(kind: str) -> None:
    found = _Found(kind, "spring_curve@front")
    (curve,) = found.curves
    true = np.interp(curve.deflection, _DELTA, found.force)
    low, high = np.quantile(curve.force, [0.025, 0.975], axis=0)
    held = (low <= true + 1e-9) & (true - 1e-9 <= high)
    assert held.mean() >= 0.9
    assert (high - low)[[0, -1]].max() < 0.1 * np.abs(true).max()
    for name in ("c_f", "c_r", "i"):
        lower, upper = found.interval(name)
        assert lower < getattr(found.car, name) < upper
    assert curve.at_rest.mean() == pytest.approx(found.car.k_f, rel=0.06)
    words = {(shape.name, shape.side) for shape in curve.shapes if shape.probability > 0.9}
    if kind == "tangent":
        assert words == {("stiffening", "both")}
    elif kind == "coils":
        assert ("stiffening", "compression") in words
        assert ("stiffening", "extension") not in words
    else:
        assert not words


def test_on_a_linear_spring_it_costs_little() -> None:
    plain, free = _Found("linear"), _Found("linear", "spring_curve@front")
    assert plain.curves == ()
    for name in ("c_f", "c_r", "i"):
        (low, high), (lower, upper) = plain.interval(name), free.interval(name)
        assert upper - lower < 1.15 * (high - low)


def test_both_springs_have_one_curve_over_their_own_travel() -> None:
    curve = _Found("coils", "spring_curve@both").curves
    assert [one.element for one in curve] == ["front", "rear"]
    front: SpringCurve = curve[0]
    assert front.travel[0] == pytest.approx(-front.deflection[0], rel=0.2)
    assert front.compression.mean() > 1.1 * front.extension.mean()
