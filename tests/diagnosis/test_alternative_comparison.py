"""What was named is held against one thing without a name that may be there instead."""

from __future__ import annotations

import pytest

from bayes_asv.diagnosis.workflow import Diagnosis, diagnose
from tests.battery.cases import case


def _found(name: str, seed: int, number: int) -> Diagnosis:
    one = case(name, seed, number, "test")
    return diagnose(one.recordings, one.holdout, one.vehicle, 0)


@pytest.mark.parametrize(("seed", "axle"), [(69, "front"), (64, "rear")])
def test_a_sensor_that_sits_elsewhere_is_no_gain_alone(seed: int, axle: str) -> None:
    """Noise swells to cover what the gain leaves, and held there it hid the place."""
    found = _found("sensor_place-400", seed, 1)
    assert [str(n.site) for n in found.named] == [f"sensor_gain@{axle}_chassis"]
    assert found.left is not None
    assert found.left.like == f"a sensor that sits elsewhere ({axle} chassis)"
    assert found.left.rival > -3.0
    assert found.left.present
    assert not found.left.found


def test_a_gain_is_not_a_sensor_that_sits_elsewhere() -> None:
    found = _found("sensor_gain-400", 69, 2)
    assert len(found.named) == 1
    assert found.left is not None
    assert -100.0 < found.left.rival < -10.0
    assert not found.left.present
