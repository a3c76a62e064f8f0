"""Predicted standard deviations against the estimator on drives of the rig.

The long form, with other cars, tyres, rates and the true errors, is ``benchmarks/plan.py``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.planning.drives import Drive, RoadProfile
from benchmarks.plan import KNOWLEDGE, posterior, predict, vehicle_of
from benchmarks.plan_cars import CARS

INCH = 0.0254

DRIVES = {
    "bump": Drive(RoadProfile("bump", 3 * INCH, 0.9144, 1), 2.68, 400.0, 2.5),
    "stops": Drive(RoadProfile("stops", 3 * INCH, 12 * INCH, 2), 1.79, 200.0, 2.9),
    "rollers": Drive(RoadProfile("rollers", 2 * INCH, 1.524, 3), 3.58, 100.0, 3.2),
    "rough": Drive(RoadProfile("rough", iso="D"), 5.36, 400.0, 3.0),
}


@pytest.mark.parametrize("road", DRIVES)
@pytest.mark.parametrize("car", ["baja", "hatchback"])
def test_the_posterior_on_the_rig_has_the_predicted_deviation(road: str, car: str) -> None:
    """Nominal cars with exact given values, so that the drive alone sets the deviation."""
    nominal = CARS[car]()
    vehicle = vehicle_of(nominal, KNOWLEDGE["exact"])
    sd_after = predict(vehicle, DRIVES[road], 1, 1)
    assert sd_after is not None
    got = posterior(nominal, vehicle, DRIVES[road], [5])
    assert got is not None
    ratio = got / sd_after
    assert np.all((ratio > 1.0 / 1.5) & (ratio < 1.5)), ratio


def test_two_passes_double_the_information() -> None:
    nominal = replace(CARS["baja"](), c_f=1.2 * CARS["baja"]().c_f)
    vehicle = vehicle_of(CARS["baja"](), KNOWLEDGE["declared"])
    drive = DRIVES["bump"]._replace(rate=200.0)
    one, two = predict(vehicle, drive, 1, 1), predict(vehicle, drive, 2, 1)
    assert one is not None
    assert two is not None
    assert two[3] == pytest.approx(one[3] / np.sqrt(2.0), rel=0.02)
    got = posterior(nominal, vehicle, drive, [3, 4])
    assert got is not None
    ratio = got / two
    assert np.all((ratio > 1.0 / 1.5) & (ratio < 1.5)), ratio
