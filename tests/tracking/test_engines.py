"""The compiled filter against the readable one, to nine digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.recording import accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters import ukf
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING
from bayes_asv.filters.ukf_state import COLUMNS, DRIFT, NOISE_FACTOR, Steps
from bayes_asv.tracking import reference_ukf
from bayes_asv.tracking.filter import DEFAULT_SETTINGS, filter_model, initial_state
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.relinearization import slice_steps
from bayes_asv.tracking.sensor_noise import sensor_model
from bayes_asv.tracking.streaming_timeline import StreamingTimeline
from tests.posterior.cases import DECLARED, EXACT, case, vehicle
from tests.tracking.drives import tracked

ROWS = 70
NO_EVENTS = DEFAULT_SETTINGS._replace(information_gain=1e9, review_interval=1e9, fault_duration=1e9)


def _steps(car: Vehicle, terrain: str = "bump", first: int = 150) -> Steps:
    _, _, recording = case(terrain, 3, DECLARED)
    timeline = StreamingTimeline(car, sensor_model(car), 400.0)
    chunk = timeline.push(recording.time, accelerations(recording, car).T)
    return slice_steps(chunk.steps, first, first + ROWS)


def _both(
    car: Vehicle,
    steps: Steps,
    forget: float | None = None,
    width: float = 1.0,
    **settings: float,
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Results of both engines: rows, event and final state."""
    space = coordinates(car)
    model = filter_model(space, sensor_model(car).noise_parameters(), forget)
    ends = []
    for run in (ukf.run, reference_ukf.run):
        state, out = initial_state(model), np.zeros((len(steps.step), COLUMNS))
        state.D[:] *= width
        event = run(0, False, state, model, NO_EVENTS._replace(**settings), steps, out)
        ends.append([out, np.asarray(event), *state[:7], state.statistics[:11]])
    return ends[0], ends[1]


def _differing(ends: tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]) -> list[int]:
    """Indices of the results that differ by more than 1e-9."""
    pairs = enumerate(zip(*ends, strict=True))
    return [k for k, (a, b) in pairs if not np.allclose(a, b, 1e-9, 1e-9, equal_nan=True)]


@pytest.mark.parametrize("sds", [EXACT, DECLARED], ids=["exact", "declared"])
def test_missing_readings(sds: dict[str, float]) -> None:
    car = vehicle(sds)
    steps = _steps(car)
    steps.kind[::7, 0] = MISSING
    steps.kind[3::11, 1] = MISSING
    assert _differing(_both(car, steps)) == []


def test_bounds_a_restart_and_process_noise() -> None:
    car = vehicle(DECLARED)
    steps = _steps(car)
    steps.kind[5::9, 0] = AT_LEAST
    steps.kind[6::13, 1] = AT_MOST
    steps.restart[40] = True
    assert _differing(_both(car, steps, forget=20.0)) == []


def test_raised_noise_factor_and_drift() -> None:
    car = vehicle(EXACT)
    steps = _steps(car, "rough", 220)
    steps.reading[30:, 1] += 2.0
    ends = _both(car, steps, width=0.02, drift_threshold=1.2)
    assert _differing(ends) == []
    out = ends[0][0]
    assert out[:, NOISE_FACTOR + 1].max() > 3.0
    assert out[:, DRIFT].max() == 1.0


def test_uncertain_scales_without_bandwidth() -> None:
    car = vehicle(EXACT)
    car = replace(
        car,
        sensors={
            n: replace(s, bandwidth=None, counts_scale=0.1, counts_scale_sd=0.002, resolution=0.0)
            for n, s in car.sensors.items()
        },
    )
    space = coordinates(car, (0.02, 0.02, 0.02, 0.02))
    assert len(space) == 7
    steps = _steps(vehicle(EXACT))
    model = filter_model(space, sensor_model(car).noise_parameters())
    outs = []
    for run in (ukf.run, reference_ukf.run):
        state, out = initial_state(model), np.zeros((ROWS, COLUMNS))
        run(0, False, state, model, NO_EVENTS, steps, out)
        outs.append(out)
    np.testing.assert_allclose(outs[0], outs[1], rtol=1e-9, atol=1e-9)


def test_trackers_with_relinearization() -> None:
    _, _, recording = case("stops", 5, DECLARED, seconds=0.62)
    car = vehicle(DECLARED)
    _, fast = tracked(recording, car)
    tracker, readable = tracked(recording, car, engine="filterpy")
    assert tracker.filter.relinearizing or tracker.filter.state.D[0, 0] < 0.1
    np.testing.assert_allclose(fast.median, readable.median, rtol=1e-9)
    np.testing.assert_allclose(fast.log_sd, readable.log_sd, rtol=1e-8)
    np.testing.assert_allclose(fast.predicted, readable.predicted, rtol=1e-9, atol=1e-9)


def test_reference_filter_has_no_fixed_reference() -> None:
    car = vehicle(EXACT)
    model = filter_model(coordinates(car), sensor_model(car).noise_parameters())
    with pytest.raises(ValueError, match="fixed reference"):
        reference_ukf.run(
            0,
            True,
            initial_state(model),
            model,
            DEFAULT_SETTINGS,
            _steps(car),
            np.zeros((ROWS, COLUMNS)),
        )
