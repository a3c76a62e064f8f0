"""Road profiles against closed forms: heights, the spectrum of ISO 8608, tyre enveloping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_asv.planning.drives import (
    ISO_8608,
    KINDS,
    RoadProfile,
    enveloped_profile,
    road_profiles,
    speeds,
)

INCH = 0.0254


def test_shapes_have_their_dimensions() -> None:
    x = np.linspace(-1.0, 9.0, 100_001)
    bump = RoadProfile("bump", 0.08, 1.2, 1).profile(x)
    assert bump.max() == pytest.approx(0.08)
    assert x[bump > 0.0][[0, -1]] == pytest.approx([0.0, 1.2], abs=1e-3)
    stops = RoadProfile("stops", 0.1, 0.3, 2)
    up = stops.profile(x) > 0.05  # half way up the ramps
    edges = x[np.flatnonzero(np.diff(up))]
    assert np.diff(edges) == pytest.approx([0.125, 0.325, 0.125], abs=1e-3)
    rollers = RoadProfile("rollers", 0.05, 1.5, 4).profile(x)
    crests = (rollers[1:-1] > rollers[:-2]) & (rollers[1:-1] > rollers[2:])
    assert np.count_nonzero(crests) == 4
    assert np.all(rollers[x > 6.0] == 0.0)


@pytest.mark.parametrize("iso", ["C", "E"])
def test_a_rough_road_has_the_power_of_its_class(iso: str) -> None:
    """The variance is the integral of the density over its waves, 0.05 to 6.67 cycles/m."""
    rough = RoadProfile("rough", iso=iso)
    x = np.arange(1.0, 150.0, 0.5)
    found = [np.mean(rough.profile(x, seed) ** 2) for seed in range(40)]
    wanted = ISO_8608[iso] * 0.01 * (1.0 / 0.05 - 0.15)
    # the ~25 waves below 0.1 cycles/m carry half of it, each a chi-square of two: one road is
    # good to 25 %, forty to 4 %
    assert np.mean(found) == pytest.approx(wanted, rel=0.16)
    x = np.arange(1.0, 16.0, 0.01)
    slope = [np.var(np.diff(rough.profile(x, seed)) / 0.01) for seed in range(10)]
    wanted = ISO_8608[iso] * 0.01 * 4.0 * math.pi**2 * (1.0 / 0.15 - 0.05)
    assert np.mean(slope) == pytest.approx(wanted, rel=0.2)


def test_a_tyre_envelops_a_corner_along_an_arc() -> None:
    """A disc rolls over the corner of a step along a circle of the tyre's radius."""
    wide = RoadProfile("bump", 1e-9, 3.0, 1)
    level = enveloped_profile(wide, 4.0, 2.0, 0.015)
    assert np.max(np.abs(level(np.linspace(-1.0, 3.0, 50)))) < 1e-8
    stop = enveloped_profile(RoadProfile("stops", 0.1, 10.0, 1), 3.0, 2.0, 0.015)
    x = np.linspace(-1.0, 1.0, 2001)
    hub = stop(x)
    # the disc touches the upper corner √(R² − (R − h)²) before it, the patch half its length more
    reach = math.sqrt(0.27**2 - 0.17**2) + (4.0 / 3.0) * math.sqrt(2.0 * 0.27 * 0.015) - 0.025
    assert -reach - 0.01 < x[hub > 1e-4][0] < -reach + 0.06
    assert hub.max() == pytest.approx(0.1, abs=0.01)


@given(height=st.floats(0.01, 0.12), length=st.floats(0.6, 2.0), kind=st.sampled_from(KINDS[:3]))
@settings(max_examples=20, deadline=None)
def test_the_enveloped_profile_stays_between_the_lowest_and_the_highest_point(
    height: float, length: float, kind: str
) -> None:
    road = RoadProfile(kind, height, length, 1 if kind == "bump" else 2)
    hub = enveloped_profile(road, 5.0, 2.0, 0.015)(np.linspace(-1.0, 4.0, 1001))
    assert hub.min() > -1e-6
    assert hub.max() < height + 1e-6


@pytest.mark.parametrize("units", ["US", "SI"])
def test_candidate_dimensions_are_round_numbers(units: str) -> None:
    for road in road_profiles(units):
        unit = INCH if units == "US" else 0.005
        for dimension in (road.height, road.length):
            assert dimension / (0.5 * unit) == pytest.approx(round(dimension / (0.5 * unit)))
        pace = 0.44704 if units == "US" else 1.0 / 3.6
        found = [v / pace for v in speeds(road.kind, units)]
        assert found == pytest.approx(np.round(found))
        assert found == sorted(found)
