"""The document that ``bayes-asv watch`` writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv import __version__
from bayes_asv.tracking.alarm import AXLES, Alarm, AlarmMonitor
from bayes_asv.tracking.data_checks import unlearned
from bayes_asv.tracking.tracker import Tracker

__all__ = ["watch_document"]

Document = dict[str, Any]


def watch_document(
    tracker: Tracker, dog: AlarmMonitor, alarm: Alarm | None, source: str, seed: int = 0
) -> Document:
    """Tell a watch as plain data.

    Parameters
    ----------
    tracker : Tracker
        As far as it came.
    dog : AlarmMonitor
        What was asked of it, and what it saw last.
    alarm : Alarm or None
        Its alarm.
    source : str
        Recording or port.
    seed : int
        As given; nothing is drawn.

    Returns
    -------
    dict
        Schema ``bayes_asv/watch/1``; verdict ``alarm``, ``ok`` or ``refused``.
    """
    name = Path(source).name
    reasons = [] if alarm else tracker.fitness.reasons(tracker.vehicle, tracker.sensing, name)
    if alarm is None and not reasons and tracker.begun:
        before = tracker.coordinates.scale[:3]
        D = tracker.filter.state.D[:, :3]
        lost = tracker.watch.summary().verdict == "inconsistent"
        reasons = unlearned(before * np.sqrt(np.sum(D**2, axis=0)), before, lost=lost)
    return {
        "schema": "bayes_asv/watch/1",
        "verdict": "alarm" if alarm else "refused" if reasons else "ok",
        "reasons": reasons,
        "warnings": [],
        "asked": {"share": dog.share, "probability": dog.level, "hold_seconds": dog.hold},
        "alarm": None
        if alarm is None
        else {
            "axle": alarm.axle,
            "time": alarm.time,
            "since": alarm.since,
            "probability": alarm.probability,
            "share_of_nominal": alarm.median,
            "eti95": [alarm.low, alarm.high],
        },
        "probability": {
            axle: float(p) if np.isfinite(p) else None
            for axle, p in zip(AXLES, dog.probability, strict=True)
        },
        "seconds_watched": dog.rows / tracker.rate,
        "share_of_time": dog.rows_told / max(dog.rows, 1),
        "recording": name,
        "version": __version__,
        "seed": seed,
    }
