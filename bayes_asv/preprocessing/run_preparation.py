"""From recordings to prepared runs: events of long logs, checks, preparation for the filter."""

from __future__ import annotations

from collections.abc import Sequence

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.band import check_band, low_pass_recording, too_short
from bayes_asv.preprocessing.data_checks import dead_channels, preflight
from bayes_asv.preprocessing.events import LogEvents, choose_events, find_events, is_long
from bayes_asv.preprocessing.faulty_channels import stuck_channels
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.resampling import at_own_rate

__all__ = ["nothing_in", "prepare_runs", "select_runs"]


def prepare_runs(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    below: float | None = None,
    car: str = "half",
) -> tuple[tuple[PreparedRecording, ...], tuple[str, ...], tuple[str, ...]]:
    """Prepare recordings for the filter, and check them before any fit.

    Parameters
    ----------
    recordings, vehicle : sequence of Recording, Vehicle
        Recordings and vehicle as read.
    below : float, optional
        Keep only the motion below this frequency (Hz).
    car : str
        Name of the car, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    recordings : tuple of PreparedRecording
        Prepared recordings; empty if a channel has too few readings, or is stuck or a copy.
    reasons, warnings : tuple of str
        Messages; any reason means that the recordings are refused.

    Raises
    ------
    InputError
        If a channel is in counts without a calibration, or if the band does not contain the modes
        of the car.
    """
    model = car_model(car, vehicle)
    if below is not None:
        check_band(below, model)
    reasons = [
        reason
        for one in recordings
        for reason in dead_channels(one, vehicle, model) or stuck_channels(one, vehicle, model)
    ]
    warnings = [w for recording in recordings for w in recording.warnings]
    if reasons:
        return (), tuple(reasons), tuple(warnings)
    prepared = tuple(prepare(recording, vehicle, model) for recording in recordings)
    for one in prepared:
        reason, notes = preflight(vehicle, one)
        reasons += reason
        warnings += notes
    if below is not None and not reasons:
        short = [too_short(one, below) for one in prepared]
        reasons += [reason for reason in short if reason is not None]
        if not reasons:
            prepared = tuple(low_pass_recording(one, below) for one in prepared)
            warnings.append(f"only the motion below {below:g} Hz was used")
    return prepared, tuple(reasons), tuple(warnings)


def select_runs(
    recordings: Sequence[Recording], vehicle: Vehicle, below: float | None = None, car: str = "half"
) -> tuple[tuple[Recording, ...], tuple[LogEvents, ...]]:
    """Undo resampling, and choose the best events of long recordings; others are used whole.

    Parameters
    ----------
    recordings, vehicle, below, car
        As for :func:`bayes_asv.estimation.estimate`.

    Returns
    -------
    runs : tuple of Recording
        Runs in order; a long recording is replaced by its events in order of time.
    logs : tuple of LogEvents
        Events of each long recording; empty if none is long.
    """
    model = car_model(car, vehicle)
    recordings = tuple(at_own_rate(recording) for recording in recordings)
    long = [is_long(recording, below) for recording in recordings]
    if not any(long):
        return recordings, ()
    events_of_logs = [
        find_events(recording, vehicle, model, below)
        for recording, is_cut in zip(recordings, long, strict=True)
        if is_cut
    ]
    rows = sum(len(one.time) for one, is_cut in zip(recordings, long, strict=True) if not is_cut)
    logs = choose_events(events_of_logs, rows, below)
    of_log = iter(logs)
    runs: list[Recording] = []
    for recording, is_cut in zip(recordings, long, strict=True):
        events = next(of_log).events if is_cut else ()
        runs += [event.recording for event in events if event.used] if is_cut else [recording]
    return tuple(runs), logs


def nothing_in(log: LogEvents) -> str:
    """Message that a log has no usable event, and why."""
    source = log.recording.source or "the recording"
    reasons = list(dict.fromkeys(event.reason for event in log.events))
    if not reasons:
        return (
            f"the wheels hardly move anywhere in {source}; drive over bumps, parking stops or a "
            "rough road"
        )
    return (
        f"none of the {len(log.events)} events of {source} can be used, as {' or '.join(reasons)}; "
        "drive slower over lower bumps"
    )
