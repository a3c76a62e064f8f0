"""Events of a long log: a drive of ten minutes on the rig, of which everything is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.domain.recording import Recording, sample_times
from bayes_asv.domain.vehicle import Given, Vehicle, read_vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.events import (
    AT_RAIL,
    IN_THE_AIR,
    LOST,
    MOST_ROWS,
    NO_TIME,
    NOT_NEEDED,
    PUSHED,
    Event,
    LogEvents,
    choose_events,
    find_events,
)
from bayes_asv.preprocessing.faulty_channels import clipping_limit
from bayes_asv.preprocessing.run_preparation import prepare_runs, select_runs
from tests.rig import RigCar, SensorSpec, baja, draw, draw_biases, vehicle_toml
from tests.rig.long_log import Kind, LongLog, hour, long_log

RATE = 200.0
UNITS = ("m/s^2",) * 4


@pytest.fixture(scope="module")
def car() -> RigCar:
    return draw(baja(), np.random.default_rng(1))


@pytest.fixture(scope="module")
def drive(car: RigCar) -> LongLog:
    sensors = draw_biases(SensorSpec(), np.random.default_rng(2))
    return long_log(car, hour(10.0, 8, 1), RATE, sensors, 1)


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Vehicle:
    path = tmp_path_factory.mktemp("car") / "car.toml"
    path.write_text(vehicle_toml(baja(), SensorSpec()), encoding="utf-8")
    return read_vehicle(path)


@pytest.fixture(scope="module")
def recording(drive: LongLog) -> Recording:
    return Recording(drive.time, drive.channels, UNITS, (("driver", "A"),), "run.csv", "0123")


@pytest.fixture(scope="module")
def found(recording: Recording, vehicle: Vehicle) -> LogEvents:
    return find_events(recording, vehicle, car_model("half", vehicle))


def within(events: Sequence[Event], begin: float, end: float) -> list[Event]:
    return [event for event in events if event.begin < end and event.end > begin]


def of(found: LogEvents, drive: LongLog, kind: Kind) -> list[Event]:
    """Events whose middle lies in a part of one kind."""
    return [
        event
        for event in found.events
        if any(a < 0.5 * (event.begin + event.end) < b for a, b in drive.of(kind))
    ]


def changed(recording: Recording, begin: float, end: float, values: object) -> Recording:
    rows = (recording.time >= begin) & (recording.time < end)
    out = recording.values.copy()
    out[:, rows] = values  # type: ignore[call-overload]
    return replace(recording, values=out)


def test_bumps_are_found_and_all_else_is_left_out(found: LogEvents, drive: LongLog) -> None:
    for begin, end in drive.of("bump"):
        (event,) = within(found.events, begin, end)
        assert event.kind == "bump"
        assert not event.reason
    for kind in ("standing", "braking", "cornering", "cruising"):
        assert of(found, drive, kind) == [], kind
    assert [event.reason for event in of(found, drive, "jump")] == [IN_THE_AIR]
    rough = of(found, drive, "rough")
    assert len(rough) > 1
    assert {(event.kind, event.reason) for event in rough} == {("rough stretch", "")}
    assert len(found.events) == 8 + 1 + len(rough)


def test_the_rest_of_the_time_is_accounted_for(found: LogEvents, drive: LongLog) -> None:
    covered = sum(event.end - event.begin for event in found.events)
    assert covered + sum(found.states.values()) == pytest.approx(drive.time[-1], abs=1.0)
    standing = sum(end - begin for begin, end in drive.of("standing"))
    assert found.states["standing"] > standing - 4.0
    assert found.states["little motion"] > 10.0 * covered


def test_an_event_begins_and_ends_in_calm(found: LogEvents, drive: LongLog) -> None:
    """What the chassis does at either end is a few percent of what it does between."""
    for event in of(found, drive, "bump"):
        body = event.recording.values[[1, 3]] - np.median(drive.channels[[1, 3]], 1)[:, None]
        largest = np.abs(body).max()
        assert np.abs(body[:, : int(0.2 * RATE)]).max() < 0.06 * largest
        assert np.abs(body[:, -int(0.2 * RATE) :]).max() < 0.06 * largest
        assert 1.5 < event.end - event.begin < 4.0


def test_an_event_is_a_recording_with_its_origin(found: LogEvents, recording: Recording) -> None:
    event = found.events[0].recording
    first = int(np.searchsorted(recording.time, event.time[0]))
    rows = slice(first, first + len(event.time))
    assert np.array_equal(event.time, recording.time[rows])
    assert np.array_equal(event.values, recording.values[:, rows])
    assert event.metadata == recording.metadata
    assert event.sha256 == recording.sha256
    assert event.source == f"run.csv, {event.time[0]:.1f} – {event.time[-1]:.1f} s"


def test_readings_at_a_rail_are_left_out_where_there_is_a_choice(
    recording: Recording, drive: LongLog, vehicle: Vehicle
) -> None:
    model = car_model("half", vehicle)
    high = vehicle.sensor("front_chassis").high
    cut = {**vehicle.sensors, "front_chassis": replace(vehicle.sensor("front_chassis"), high=14.0)}
    railed = replace(
        recording, values=np.minimum(recording.values, np.array([[99.0], [14.0], [99.0], [99.0]]))
    )
    assert high > 14.0
    found = find_events(railed, replace(vehicle, sensors=cut), model)
    reasons = [event.reason for event in of(found, drive, "bump")]
    assert AT_RAIL in reasons
    assert "" in reasons
    # Without a range in the vehicle file, readings that stay at the extreme of the log tell.
    assert [event.reason for event in of(find_events(railed, vehicle, model), drive, "bump")] == (
        reasons
    )
    # Where there is nothing else, a few of them are bounds, as in a recording taken whole.
    (begin, end), *_ = drive.of("bump")
    part = (recording.time >= begin) & (recording.time < end)
    alone = replace(railed, time=recording.time[part], values=railed.values[:, part])
    top = float(alone.values[1].max())
    cut["front_chassis"] = replace(vehicle.sensor("front_chassis"), high=top)
    clipped = int(np.count_nonzero(alone.values[1] >= top))
    (event,) = find_events(alone, replace(vehicle, sensors=cut), model).events
    assert 0 < clipped <= clipping_limit(len(event.recording.time))
    assert not event.reason


def test_what_else_moves_the_body_spoils_an_event(
    recording: Recording, drive: LongLog, vehicle: Vehicle
) -> None:
    """A corner that is taken over a bump: the leaning body reads some of its acceleration."""
    begin, end = drive.of("bump")[2]
    inside = (recording.time >= begin) & (recording.time < end)
    lean = 4.0 * np.sin(np.pi * (recording.time[inside] - begin) / (end - begin)) ** 2
    values = recording.values[:, inside] - np.outer([0.0, 1.0, 0.0, 1.0], lean)
    found = find_events(changed(recording, begin, end, values), vehicle, car_model("half", vehicle))
    assert [event.reason for event in of(found, drive, "bump")].count(PUSHED) == 1
    assert within(found.events, begin, end)[0].reason == PUSHED


def test_lost_rows_spoil_an_event(recording: Recording, drive: LongLog, vehicle: Vehicle) -> None:
    begin, _ = drive.of("bump")[3]
    kept = (recording.time < begin + 1.0) | (recording.time > begin + 1.2)
    lost = replace(recording, time=recording.time[kept], values=recording.values[:, kept])
    found = find_events(lost, vehicle, car_model("half", vehicle))
    reasons = [event.reason for event in of(found, drive, "bump")]
    assert reasons == ["", "", "", LOST, "", "", "", ""]


def test_clocks_have_drifted_by_the_time_of_an_event(
    recording: Recording, vehicle: Vehicle
) -> None:
    drifting = replace(recording, metadata=(("clock rear", "300 ppm"),))
    whole = sample_times(drifting, vehicle)
    events = find_events(drifting, vehicle, car_model("half", vehicle)).events
    assert len(events) > 8
    for event in events:
        first = int(np.searchsorted(recording.time, event.begin))
        rows = slice(first, first + len(event.recording.time))
        own = sample_times(event.recording, vehicle)
        assert own == pytest.approx(whole[:, rows], abs=1e-7)


def test_the_most_informative_events_are_chosen(found: LogEvents, vehicle: Vehicle) -> None:
    (chosen,) = choose_events([found])
    used = [event for event in chosen.events if event.used]
    assert len(used) == 6
    left = [event for event in chosen.events if not event.used]
    assert {event.reason for event in left} == {IN_THE_AIR, NOT_NEEDED}
    density = [np.trace(e.information) / len(e.recording.time) for e in used]
    assert min(density) > np.median(
        [np.trace(e.information) / len(e.recording.time) for e in left if e.reason == NOT_NEEDED]
    )


def test_more_events_are_used_where_they_tell_more_and_time_allows(
    recording: Recording, vehicle: Vehicle
) -> None:
    exact = replace(
        vehicle,
        m=Given(vehicle.m.value),
        wdf=Given(vehicle.wdf.value),
        k_f=Given(vehicle.k_f.value),
        k_r=Given(vehicle.k_r.value),
    )
    found = find_events(recording, exact, car_model("half", exact))
    (chosen,) = choose_events([found])
    assert sum(event.used for event in chosen.events) == len(chosen.events) - 1  # not the jump
    (chosen,) = choose_events([found], rows=MOST_ROWS - 1500)
    used = [event for event in chosen.events if event.used]
    assert 1 <= len(used) <= 3
    assert sum(len(event.recording.time) for event in used) <= 1500
    assert NO_TIME in {event.reason for event in chosen.events}


def test_information_is_that_of_the_posterior(
    found: LogEvents, drive: LongLog, vehicle: Vehicle
) -> None:
    """Deviations predicted from the binned log against the curvature of the posterior."""
    exact = replace(vehicle, m=Given(vehicle.m.value), wdf=Given(vehicle.wdf.value))
    model = car_model("half", exact)
    log = find_events(found.recording, exact, model)
    for event in of(log, drive, "bump")[:3]:
        lines, reasons, _ = prepare_runs([event.recording], exact)
        fit = best_fit(lines, exact)
        assert not reasons
        assert not fit.reasons
        covariance = np.linalg.inv(np.eye(len(event.information)) + event.information)
        for row, name in zip(log.estimands, model.estimated, strict=True):
            predicted = float(np.sqrt(row @ covariance @ row))
            actual = fit.space.log_deviation(fit.mode.covariance, name)
            assert predicted == pytest.approx(actual, rel=0.3), name


def test_other_cars_and_channels(vehicle: Vehicle, recording: Recording, drive: LongLog) -> None:
    """A quarter car takes the two channels of its axle."""
    rear = replace(
        recording,
        values=recording.values[2:],
        units=UNITS[:2],
        channels=("rear_wheel", "rear_chassis"),
    )
    found = find_events(rear, vehicle, car_model("quarter-rear", vehicle))
    for begin, end in drive.of("bump"):
        assert [event.reason for event in within(found.events, begin, end)] == [""]
    assert all(event.reason for event in of(found, drive, "jump"))


def test_a_log_without_motion_has_no_events(vehicle: Vehicle, recording: Recording) -> None:
    rng = np.random.default_rng(0)
    still = replace(
        recording, values=0.04 * rng.standard_normal(recording.values.shape) + [[1], [2], [3], [4]]
    )
    found = find_events(still, vehicle, car_model("half", vehicle))
    assert found.events == ()
    assert found.states["standing"] > 0.99 * recording.time[-1]


def test_a_short_recording_is_taken_whole(vehicle: Vehicle, recording: Recording) -> None:
    short = replace(
        recording, time=recording.time[:MOST_ROWS], values=recording.values[:, :MOST_ROWS]
    )
    runs, logs = select_runs([short], vehicle)
    assert runs == (short,)
    assert runs[0] is short
    assert logs == ()
    runs, logs = select_runs([short, recording], vehicle)
    assert runs[0] is short
    assert len(logs) == 1
    assert len(runs) == 1 + sum(event.used for event in logs[0].events)
