"""Both engines say the same, to nine digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.recording import accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters import ukf as unscented
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING
from bayes_asv.filters.ukf_state import COLUMNS, DOUBT, LEVEL, Steps
from bayes_asv.tracking import reference_ukf as reference
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.prior_state import RULES, beginning, model_of
from bayes_asv.tracking.relinearization import cut
from bayes_asv.tracking.sensor_noise import sensing
from bayes_asv.tracking.streaming_timeline import Layout
from tests.posterior.cases import DECLARED, EXACT, case, vehicle
from tests.tracking.drives import tracked

ROWS = 70
NEVER = RULES._replace(learned=1e9, look=1e9, patience=1e9)


def _steps(car: Vehicle, terrain: str = "bump", first: int = 150) -> Steps:
    _, _, recording = case(terrain, 3, DECLARED)
    layout = Layout(car, sensing(car), 400.0)
    laid = layout.push(recording.time, accelerations(recording, car).T)
    return cut(laid.steps, first, first + ROWS)


def _both(
    car: Vehicle,
    steps: Steps,
    forget: float | None = None,
    width: float = 1.0,
    **rules: float,
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """What either engine tells (the rows first) and ends with."""
    where = coordinates(car)
    model = model_of(where, sensing(car).kernel_noise(), forget)
    ends = []
    for run in (unscented.run, reference.run):
        state, out = beginning(model), np.zeros((len(steps.step), COLUMNS))
        state.D[:] *= width
        event = run(0, False, state, model, NEVER._replace(**rules), steps, out)
        ends.append([out, np.asarray(event), *state[:7], state.memory[:11]])
    return ends[0], ends[1]


def _far(ends: tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]) -> list[int]:
    """Places of what the engines do not agree on to 1e-9."""
    pairs = enumerate(zip(*ends, strict=True))
    return [k for k, (a, b) in pairs if not np.allclose(a, b, 1e-9, 1e-9, equal_nan=True)]


@pytest.mark.parametrize("sds", [EXACT, DECLARED], ids=["exact", "declared"])
def test_on_a_bump_with_readings_missing(sds: dict[str, float]) -> None:
    car = vehicle(sds)
    steps = _steps(car)
    steps.kind[::7, 0] = MISSING
    steps.kind[3::11, 1] = MISSING
    assert _far(_both(car, steps)) == []


def test_with_bounds_a_gap_and_parameters_that_walk() -> None:
    car = vehicle(DECLARED)
    steps = _steps(car)
    steps.kind[5::9, 0] = AT_LEAST
    steps.kind[6::13, 1] = AT_MOST
    steps.afresh[40] = True
    assert _far(_both(car, steps, forget=20.0)) == []


def test_with_noise_that_swells_and_parameters_that_are_doubted() -> None:
    car = vehicle(EXACT)
    steps = _steps(car, "rough", 220)
    steps.reading[30:, 1] += 2.0
    ends = _both(car, steps, width=0.02, coloured=1.2)
    assert _far(ends) == []
    out = ends[0][0]
    assert out[:, LEVEL + 1].max() > 3.0
    assert out[:, DOUBT].max() == 1.0


def test_with_uncertain_scales_and_no_bandwidth() -> None:
    car = vehicle(EXACT)
    car = replace(
        car,
        sensors=tuple(  # type: ignore[arg-type]
            replace(s, bandwidth=None, counts_scale=0.1, counts_scale_sd=0.002, resolution=0.0)
            for s in car.sensors
        ),
    )
    where = coordinates(car, (0.02, 0.02, 0.02, 0.02))
    assert len(where) == 7
    steps = _steps(vehicle(EXACT))
    model = model_of(where, sensing(car).kernel_noise())
    outs = []
    for run in (unscented.run, reference.run):
        state, out = beginning(model), np.zeros((ROWS, COLUMNS))
        run(0, False, state, model, NEVER, steps, out)
        outs.append(out)
    np.testing.assert_allclose(outs[0], outs[1], rtol=1e-9, atol=1e-9)


def test_with_second_thoughts_from_rows_to_frames() -> None:
    _, _, recording = case("stops", 5, DECLARED, seconds=0.62)
    car = vehicle(DECLARED)
    _, fast = tracked(recording, car)
    tracker, readable = tracked(recording, car, engine="filterpy")
    assert tracker.filter.looking_back or tracker.filter.state.D[0, 0] < 0.1
    np.testing.assert_allclose(fast.median, readable.median, rtol=1e-9)
    np.testing.assert_allclose(fast.log_sd, readable.log_sd, rtol=1e-8)
    np.testing.assert_allclose(fast.predicted, readable.predicted, rtol=1e-9, atol=1e-9)


def test_a_plain_filter_has_no_fixed_reference() -> None:
    car = vehicle(EXACT)
    model = model_of(coordinates(car), sensing(car).kernel_noise())
    with pytest.raises(ValueError, match="plain"):
        reference.run(
            0, True, beginning(model), model, RULES, _steps(car), np.zeros((ROWS, COLUMNS))
        )
