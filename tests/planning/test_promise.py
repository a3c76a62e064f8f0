"""The promise itself, in short: widths of a plan against the estimator on rig drives.

The long form, with other cars, tyres, rates and the true errors, is ``benchmarks/plan.py``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.planning.grid import Planned
from bayes_asv.planning.grounds import Ground
from benchmarks.plan import KNOWLEDGE, posterior, promise, vehicle_of
from benchmarks.plan_cars import CARS

INCH = 0.0254

DRIVES = {
    "bump": Planned(Ground("bump", 3 * INCH, 0.9144, 1), 2.68, 400.0, 2.5),
    "stops": Planned(Ground("stops", 3 * INCH, 12 * INCH, 2), 1.79, 200.0, 2.9),
    "rollers": Planned(Ground("rollers", 2 * INCH, 1.524, 3), 3.58, 100.0, 3.2),
    "rough": Planned(Ground("rough", iso="D"), 5.36, 400.0, 3.0),
}


@pytest.mark.parametrize("road", DRIVES)
@pytest.mark.parametrize("car", ["baja", "hatchback"])
def test_the_rig_gives_what_was_promised(road: str, car: str) -> None:
    """Nominal cars with exact given values, where nothing but the drive sets the width."""
    nominal = CARS[car]()
    vehicle = vehicle_of(nominal, KNOWLEDGE["exact"])
    promised = promise(vehicle, DRIVES[road], 1, 1)
    assert promised is not None
    got = posterior(nominal, vehicle, DRIVES[road], [5])
    assert got is not None
    ratio = got / promised
    assert np.all((ratio > 1.0 / 1.5) & (ratio < 1.5)), ratio


def test_two_passes_are_worth_two() -> None:
    nominal = replace(CARS["baja"](), c_f=1.2 * CARS["baja"]().c_f)
    vehicle = vehicle_of(CARS["baja"](), KNOWLEDGE["declared"])
    drive = DRIVES["bump"]._replace(rate=200.0)
    one, two = promise(vehicle, drive, 1, 1), promise(vehicle, drive, 2, 1)
    assert one is not None
    assert two is not None
    assert two[3] == pytest.approx(one[3] / np.sqrt(2.0), rel=0.02)
    got = posterior(nominal, vehicle, drive, [3, 4])
    assert got is not None
    ratio = got / two
    assert np.all((ratio > 1.0 / 1.5) & (ratio < 1.5)), ratio
