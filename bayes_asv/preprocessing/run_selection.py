"""Recordings as they are fitted: at their own rates, and long ones by their best events."""

from __future__ import annotations

from collections.abc import Sequence

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.events import LogEvents, choose_events, find_events, is_long
from bayes_asv.preprocessing.resampling import at_own_rate

__all__ = ["nothing_in", "select_runs"]


def select_runs(
    recordings: Sequence[Recording], vehicle: Vehicle, below: float | None = None, car: str = "half"
) -> tuple[tuple[Recording, ...], tuple[LogEvents, ...]]:
    """Undo resampling, and take the best events of long recordings and all others whole.

    Parameters
    ----------
    recordings, vehicle, below, car
        As for :func:`bayes_asv.estimation.estimate`.

    Returns
    -------
    runs : tuple of Recording
        In order; a long recording is replaced by its events in order of time.
    logs : tuple of LogEvents
        What was found in each long recording; empty where none is long.
    """
    model = car_model(car, vehicle)
    recordings = tuple(at_own_rate(recording) for recording in recordings)
    long = [is_long(recording, below) for recording in recordings]
    if not any(long):
        return recordings, ()
    found = [
        find_events(recording, vehicle, model, below)
        for recording, cut in zip(recordings, long, strict=True)
        if cut
    ]
    rows = sum(len(one.time) for one, cut in zip(recordings, long, strict=True) if not cut)
    logs = choose_events(found, rows, below)
    of_log = iter(logs)
    runs: list[Recording] = []
    for recording, cut in zip(recordings, long, strict=True):
        events = next(of_log).events if cut else ()
        runs += [event.recording for event in events if event.used] if cut else [recording]
    return tuple(runs), logs


def nothing_in(log: LogEvents) -> str:
    """Say that a log has no event to use, and why."""
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
