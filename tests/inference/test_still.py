"""Coarse converters while nothing moves, on the rig's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.diagnosis.memory import memory
from bayes_asv.diagnosis.model import asked
from bayes_asv.inference.bestfit import lay_out
from bayes_asv.inference.stage import base, setting
from bayes_asv.inference.still import offset, still_wheels_doubted
from bayes_asv.inference.timeline import Timeline
from tests.inference.cases import DECLARED, INCH, case, vehicle
from tests.rig import SensorSpec

# what the data sheets of the 2008 car's sensors say; its converter has ten bits
_REAL = replace(SensorSpec(), noise=(0.855 * INCH, 0.513 * INCH, 0.855 * INCH, 0.513 * INCH))


def _line(terrain: str, seed: int, sensors: SensorSpec) -> Timeline:
    _, _, recording = case(terrain, seed, DECLARED, seconds=2.5, sensors=sensors)
    lines, reasons, _ = lay_out([recording], vehicle(DECLARED, sensors))
    assert not reasons
    return lines[0]


@given(noise=st.floats(0.1, 0.8), seed=st.integers(0, 50))
def test_the_mean_error_of_a_standing_reading_stays_within_its_offset(
    noise: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    level = rng.uniform(-0.5, 0.5)
    read = np.round(level + noise * rng.standard_normal(20_000))
    assert abs(read.mean() - level) < offset(1.0, noise) + 0.06 * noise + 0.01


def test_a_car_that_waits_on_a_coarse_converter_has_nothing_missing() -> None:
    """On ten such drives p was below 0.05 in six while every reading was believed."""
    ps, memories = [], []
    for seed in range(1000, 1010):
        line = _line("stops" if seed % 2 == 0 else "bump", seed, _REAL)
        where = setting(vehicle(DECLARED, _REAL), (line,))
        model = asked(where, base(where), 0)
        ps.append(model.p)
        memories.append(memory(model.stage)[1])
    assert np.mean(np.array(ps) < 0.05) <= 0.2
    assert min(memories) > 1e-3


def test_a_wheel_that_moves_is_believed_and_one_that_waits_is_doubted() -> None:
    line = _line("stops", 1000, _REAL)
    doubted = still_wheels_doubted(line)
    assert doubted.doubt is not None
    front = np.abs(line.wheels[0].spline(line.instants))
    moving = np.convolve(front > 100.0 * INCH, np.ones(9), "same") > 8
    assert np.count_nonzero(moving) > 20
    assert np.all(doubted.doubt[moving, 0] == 0.0)
    assert np.mean(doubted.doubt[: len(front) // 20, 0] > 0.0) > 0.9
    assert doubted.noise_spread == pytest.approx(line.spread)


def test_noise_that_covers_the_steps_is_believed_as_it_is() -> None:
    loud = replace(SensorSpec(), noise=(4.0 * INCH, 2.0 * INCH, 4.0 * INCH, 2.0 * INCH))
    line = _line("stops", 1000, loud)
    same = still_wheels_doubted(line)
    assert np.array_equal(same.spread, line.spread)
