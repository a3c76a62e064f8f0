"""Sensors that are far off: a corner at a quarter of the declared one, and a lag of two samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.domain.recording import Recording
from tests.posterior.cases import DECLARED, as_recording, vehicle
from tests.rig import DEFAULT_SPEEDS, TERRAINS, SensorSpec, baja, draw, drive

SLOW: dict[str, Any] = {"bandwidth": (50.0, 12.5, 50.0, 50.0)}
LATE: dict[str, Any] = {"delay": (5e-3, 6.75e-4, 0.0, 6.75e-4)}


def _driven(terrain: str, spec: SensorSpec) -> Recording:
    car = draw(baja(), np.random.default_rng([1, 3]), DECLARED)
    run = drive(car, TERRAINS[terrain](1), DEFAULT_SPEEDS[terrain], 400.0, 2.5, spec, 1)
    return as_recording(run, f"{terrain}.csv")


@pytest.mark.parametrize(
    ("wrong", "name", "value"),
    [
        (SLOW, "sensor_bandwidth@front_chassis", ("bandwidth", 0.25)),
        (LATE, "sensor_lag@front_wheel", ("lag", 5e-3)),
    ],
)
def test_one_sensor_that_is_far_off_is_one_fault(
    wrong: dict[str, Any], name: str, value: tuple[str, float]
) -> None:
    """Patterns of a corner were taken to first order and the noise to pass the declared one: the
    sensor failed on what was held out, and innovations remembered."""
    spec = replace(SensorSpec(), **wrong)
    found = diagnose([_driven("bump", spec)], [_driven("rough", spec)], vehicle(DECLARED), 0)
    (named,) = found.named
    alike = [str(named.site), *(str(o.site) for o in named.others)]
    assert name in alike
    assert named.probability > 0.9
    assert found.left is not None
    assert not found.left.present
    gap = (found.gaps or {})["holdout"]
    assert gap.closed is not None
    assert gap.closed > 0.95
    if alike[0] == name:
        draws = (found.effects or {})[name][value[0]]
        low, high = np.quantile(draws, [0.001, 0.999])
        assert low < value[1] < high
