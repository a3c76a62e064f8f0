"""What tracking a recording gave, from the first row to the last."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.parameters import CAR
from bayes_asv.tracking.consistency import Summary
from bayes_asv.tracking.data_checks import unlearned
from bayes_asv.tracking.frames import Frames, joined
from bayes_asv.tracking.parameters import Coordinates
from bayes_asv.tracking.prior_state import car_covariance
from bayes_asv.tracking.tracker import Tracker, tracker_for

__all__ = ["Track", "concluded", "track"]

Array = NDArray[np.float64]

_CHUNK = 16_384  # rows


@dataclass(frozen=True)
class Track:
    """A recording tracked to its end.

    Parameters
    ----------
    verdict : str
        ``ok`` or ``refused``.
    reasons, warnings : tuple of str
        Why it was refused; what to know otherwise.
    vehicle : Vehicle
        The car as given.
    source, sha256 : str
        The recording's name and hash; a port's name and nothing.
    frames : Frames
        What was known after each row; of a long drive from a port after some of them
        (:class:`bayes_asv.tracking.decimation.DecimatedFrames`).
    rows : int
        How many rows there were.
    begin, end : float
        Stamps of the first and of the last, s.
    coordinates : Coordinates
        What was learnt, in which coordinates.
    mean, covariance : (p,) and (p, p) arrays
        Of the coordinates after the last row.
    consistency : Summary
        Whether the filter's noise explains what its predictions missed.
    noise : (4,) array
        Noise of each sensor as given or heard, m/s².
    resets : tuple of float
        Seconds after the first row at which motion and biases were doubted and begun anew.
    rate : float
        Rows a second.
    forget : float or None
        Seconds, see :class:`bayes_asv.tracking.tracker.Tracker`.
    engine : str
        Which form of the filter.
    seconds : float
        Time it took.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    vehicle: Vehicle
    source: str
    sha256: str
    frames: Frames
    rows: int
    begin: float
    end: float
    coordinates: Coordinates
    mean: Array
    covariance: Array
    consistency: Summary
    noise: Array
    resets: tuple[float, ...]
    rate: float
    forget: float | None
    engine: str
    seconds: float

    def log_of(self, weights: dict[str, float]) -> tuple[float, float]:
        """Mean and deviation of a sum of logarithms of the car's quantities.

        Parameters
        ----------
        weights : dict of str to float
            Weight of the logarithm of each, such as ``{"i": 0.5, "m": -0.5}`` for the radius of
            gyration; ``1 - wdf`` is the rear's share.  Shares enter by the slope of their
            logarithm at the mean.

        Returns
        -------
        mean, deviation : float
        """
        where = self.coordinates
        value = where.cars(self.mean[None])[0]
        total, slope = 0.0, np.zeros(len(where))
        for name, weight in weights.items():
            own, sign = ("wdf", -1.0) if name == "1 - wdf" else (name, 1.0)
            x = float(value[CAR.index(own)])
            x = x if sign > 0.0 else 1.0 - x
            total += weight * math.log(x)
            if own in where.names:
                k = where.names.index(own)
                slope[k] += weight * where.scale[k] * (1.0 if where.log[k] else sign / x)
        return total, float(np.sqrt(slope @ self.covariance @ slope))


def track(
    recording: Recording,
    vehicle: Vehicle,
    *,
    forget: float | None = None,
    engine: str = "compiled",
    progress: Callable[[float, str], None] | None = None,
) -> Track:
    """Track a recording from its first row to its last.

    Parameters
    ----------
    recording : Recording
        As read.
    vehicle : Vehicle
        The car.
    forget, engine
        As :class:`bayes_asv.tracking.tracker.Tracker` takes them.
    progress : callable, optional
        Told the share done and a few words.

    Returns
    -------
    Track

    Raises
    ------
    InputError
        When a channel is in counts and the vehicle lacks its calibration.
    """
    began = time.perf_counter()
    acc = accelerations(recording, vehicle).T
    tracker = tracker_for(recording, vehicle, forget=forget, engine=engine)
    parts = []
    chunk = _CHUNK if engine == "compiled" else 64
    for at in range(0, len(recording.time), chunk):
        if progress is not None:
            progress(at / len(recording.time), "tracking")
        parts.append(tracker.feed(recording.time[at : at + chunk], acc[at : at + chunk]))
    parts.append(tracker.finish())
    return concluded(
        tracker,
        joined(parts),
        recording.source,
        recording.sha256,
        recording.warnings,
        time.perf_counter() - began,
    )


def concluded(
    tracker: Tracker,
    frames: Frames,
    source: str,
    sha256: str = "",
    warnings: tuple[str, ...] = (),
    seconds: float = 0.0,
) -> Track:
    """Put together what a tracker that is finished has to say.

    Parameters
    ----------
    tracker : Tracker
        After its ``finish``.
    frames : Frames
        All that it gave, or as much of it as was kept.
    source, sha256 : str
        Where the rows came from.
    warnings : tuple of str
        What the reader noticed.
    seconds : float
        Time it took.
    """
    name = source.rsplit("/", 1)[-1]
    where = tracker.coordinates
    begun = tracker.begun
    reasons = tracker.fitness.reasons(tracker.vehicle, tracker.sensing, name)
    mean, covariance = np.zeros(len(where)), np.eye(len(where))
    resets: tuple[float, ...] = ()
    if begun:
        state = tracker.filter.state
        mean, covariance = state.mu.copy(), car_covariance(state)
        resets = tuple(tracker.filter.resets)
    if not reasons:
        sd = where.scale[:3] * np.sqrt(np.diag(covariance)[:3])
        lost = tracker.watch.summary().verdict == "inconsistent"
        reasons = unlearned(sd, where.scale[:3], lost=lost)
    said = [*warnings, *tracker.fitness.warnings(name)]
    unheard = [c for c, s in zip(CHANNELS, tracker.vehicle.sensors, strict=True) if s.noise is None]
    if unheard:
        said.append(
            f"the vehicle file gives no noise for {', '.join(unheard)}; it was taken from the "
            "first half second, and the innovations corrected it"
        )
    return Track(
        verdict="refused" if reasons else "ok",
        reasons=tuple(reasons),
        warnings=tuple(said),
        vehicle=tracker.vehicle,
        source=name,
        sha256=sha256,
        frames=frames,
        rows=tracker.fitness.rows,
        begin=tracker.fitness.first,
        end=tracker.fitness.last,
        coordinates=where,
        mean=mean,
        covariance=covariance,
        consistency=tracker.watch.summary(),
        noise=tracker.sensing.noise,
        resets=resets,
        rate=tracker.rate,
        forget=tracker.forget,
        engine=tracker.engine,
        seconds=seconds,
    )
