"""Tracking of a whole recording, and its result."""

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
from bayes_asv.models.half_car import HalfCar
from bayes_asv.tracking.consistency import ConsistencySummary
from bayes_asv.tracking.data_checks import unidentified_parameters
from bayes_asv.tracking.filter import parameter_covariance
from bayes_asv.tracking.frames import Frames, concatenate
from bayes_asv.tracking.parameters import Coordinates
from bayes_asv.tracking.tracker import Tracker, tracker_for

__all__ = ["TrackResult", "conclude", "track"]

Array = NDArray[np.float64]

_CHUNK = 16_384  # rows
_REFERENCE_CHUNK = 64  # rows, so that the progress of the slow engine is visible


@dataclass(frozen=True)
class TrackResult:
    """Result of tracking a recording.

    Parameters
    ----------
    verdict : str
        ``ok`` or ``refused``.
    reasons, warnings : tuple of str
        Why the recording was refused; faults that the filter coped with.
    vehicle : Vehicle
        The car as given.
    source, sha256 : str
        Name and hash of the recording; name of a port and an empty string.
    frames : Frames
        Results after each row; of a long drive from a port after some of them
        (:class:`bayes_asv.tracking.frames.DecimatedFrames`).
    rows : int
        Number of rows.
    begin, end : float
        First and last stamp, s.
    coordinates : Coordinates
        Coordinates of the parameters.
    mean, covariance : (p,) and (p, p) arrays
        Of the coordinates after the last row.
    consistency : ConsistencySummary
        Consistency of the filter.
    noise : (4,) array
        Given or estimated noise of each sensor, m/s².
    resets : tuple of float
        Times at which the motion was reset, s after the first row.
    rate : float
        Rows per second, Hz.
    forget : float or None
        Time constant of the parameters' random walk, s.
    engine : str
        Implementation of the filter.
    seconds : float
        Computing time, s.
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
    consistency: ConsistencySummary
    noise: Array
    resets: tuple[float, ...]
    rate: float
    forget: float | None
    engine: str
    seconds: float

    def log_moments(self, exponents: dict[str, float]) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of a product of powers.

        Parameters
        ----------
        exponents : dict of str to float
            Exponent of each quantity, such as ``{"i": 0.5, "m": -0.5}`` for the radius of gyration;
            ``1 - wdf`` is the rear weight share.  The logarithm of a share is linearized at the
            mean.

        Returns
        -------
        mean, sd : float
        """
        space = self.coordinates
        value = space.parameter_vectors(self.mean[None])[0]
        total, gradient = 0.0, np.zeros(len(space))
        for name, exponent in exponents.items():
            own, sign = ("wdf", -1.0) if name == "1 - wdf" else (name, 1.0)
            x = float(value[HalfCar._fields.index(own)])
            x = x if sign > 0.0 else 1.0 - x
            total += exponent * math.log(x)
            if own in space.names:
                k = space.names.index(own)
                gradient[k] += exponent * space.scale[k] * (1.0 if space.log[k] else sign / x)
        return total, float(np.sqrt(gradient @ self.covariance @ gradient))


def track(
    recording: Recording,
    vehicle: Vehicle,
    *,
    forget: float | None = None,
    engine: str = "compiled",
    progress: Callable[[float, str], None] | None = None,
) -> TrackResult:
    """Track a recording from its first row to its last.

    Parameters
    ----------
    recording : Recording
        As read.
    vehicle : Vehicle
        The car.
    forget, engine
        As for :class:`bayes_asv.tracking.tracker.Tracker`.
    progress : callable, optional
        Called with the share done and a short text.

    Returns
    -------
    TrackResult

    Raises
    ------
    InputError
        When a channel is in counts and the vehicle lacks its calibration.
    """
    began = time.perf_counter()
    acc = accelerations(recording, vehicle).T
    tracker = tracker_for(recording, vehicle, forget=forget, engine=engine)
    parts = []
    chunk = _CHUNK if engine == "compiled" else _REFERENCE_CHUNK
    for at in range(0, len(recording.time), chunk):
        if progress is not None:
            progress(at / len(recording.time), "tracking")
        parts.append(tracker.feed(recording.time[at : at + chunk], acc[at : at + chunk]))
    parts.append(tracker.finish())
    return conclude(
        tracker,
        concatenate(parts),
        recording.source,
        recording.sha256,
        recording.warnings,
        time.perf_counter() - began,
    )


def conclude(
    tracker: Tracker,
    frames: Frames,
    source: str,
    sha256: str = "",
    warnings: tuple[str, ...] = (),
    seconds: float = 0.0,
) -> TrackResult:
    """Assemble the result of a tracker that has finished.

    Parameters
    ----------
    tracker : Tracker
        After its ``finish``.
    frames : Frames
        All its frames, or those that were kept.
    source, sha256 : str
        Name and hash of the source.
    warnings : tuple of str
        Warnings of the reader.
    seconds : float
        Computing time, s.
    """
    name = source.rsplit("/", 1)[-1]
    space, checks = tracker.coordinates, tracker.data_checks
    consistency = tracker.consistency.summary()
    mean, covariance = np.zeros(len(space)), np.eye(len(space))
    resets: tuple[float, ...] = ()
    if tracker.started:
        state = tracker.filter.state
        mean, covariance = state.mu.copy(), parameter_covariance(state)
        resets = tuple(tracker.filter.resets)
    reasons = checks.reasons(tracker.vehicle, tracker.sensors, name)
    if not reasons:
        prior_sd = space.scale[:3]
        sd = prior_sd * np.sqrt(np.diag(covariance)[:3])
        inconsistent = consistency.verdict == "inconsistent"
        reasons = unidentified_parameters(sd, prior_sd, inconsistent=inconsistent)
    all_warnings = [*warnings, *checks.warnings(name)]
    unknown = [name for name in CHANNELS if tracker.vehicle.sensor(name).noise is None]
    if unknown:
        all_warnings.append(
            f"the vehicle file gives no noise for {', '.join(unknown)}; it was estimated from the "
            "first half second and corrected by the innovations"
        )
    return TrackResult(
        verdict="refused" if reasons else "ok",
        reasons=tuple(reasons),
        warnings=tuple(all_warnings),
        vehicle=tracker.vehicle,
        source=name,
        sha256=sha256,
        frames=frames,
        rows=checks.rows,
        begin=checks.first,
        end=checks.last,
        coordinates=space,
        mean=mean,
        covariance=covariance,
        consistency=consistency,
        noise=tracker.sensors.noise,
        resets=resets,
        rate=tracker.rate,
        forget=tracker.forget,
        engine=tracker.engine,
        seconds=seconds,
    )
