"""Tracking of a whole recording, and its result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.input_mistakes import InputCheck
from bayes_asv.analysis.nominal_values import NominalDamping, nominal_damping
from bayes_asv.domain.channels import Channel
from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.tracking.consistency import ConsistencySummary
from bayes_asv.tracking.frames import Frames, concatenate
from bayes_asv.tracking.parameters import Coordinates
from bayes_asv.tracking.tracker import Tracker, tracker_for

__all__ = ["TrackResult", "conclude", "track"]

Array = NDArray[np.float64]

_STEP = 1e-4  # step of finite differences of a coordinate
_CHUNK = 16_384  # rows that are processed at a time
# Rows that the slow reference engine processes at a time, few enough to show its progress.
_REFERENCE_CHUNK = 64


@dataclass(frozen=True)
class TrackResult:
    """Result of tracking a recording.

    Parameters
    ----------
    verdict : str
        ``ok`` or ``refused``.
    reasons, warnings : tuple of str
        Reasons for a refusal; faults that the filter tolerated.
    vehicle : Vehicle
        Declared vehicle and sensors.
    source, sha256 : str
        Name and hash of the recording, or name of a port and an empty string.
    frames : Frames
        Results after each row; for a long drive from a port, decimated
        (:class:`bayes_asv.tracking.frames.DecimatedFrames`).
    rows : int
        Number of rows.
    begin, end : float
        First and last stamp, s.
    coordinates : Coordinates
        Coordinates of the parameters.
    mean, covariance : (p,) and (p, p) arrays
        Mean and covariance of the coordinates after the last row.
    consistency : ConsistencySummary
        Consistency of the filter.
    noise : (C,) array
        Declared or estimated noise of each sensor, SI units.
    resets : tuple of float
        Times at which the motion was reset, s after the first row.
    channels : tuple of Channel
        Channels that were used, in the order of ``noise``.
    rate : float
        Rows per second, Hz.
    forget : float or None
        Time constant of the parameters' random walk, s.
    engine : str
        Implementation of the filter.
    seconds : float
        Computing time, s.
    doubt : InputCheck or None
        Result of the input check, if it argues against a verdict on a damper; ``reasons`` or
        ``warnings`` then begin with its message.
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
    channels: tuple[Channel, ...]
    rate: float
    forget: float | None
    engine: str
    seconds: float
    doubt: InputCheck | None = None

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal value of every parameter and derived quantity, SI units."""
        return {name: float(x[0]) for name, x in self._values(None).items()}

    @property
    def derived(self) -> tuple[str, ...]:
        """Names of the derived quantities."""
        derived = self.coordinates.car.derived
        return () if derived is None else tuple(derived(self.coordinates.car.nominal))

    def _values(self, z: Array | None) -> dict[str, Array]:
        """Parameters and derived quantities (W,) at coordinates (W, p), or nominal ones."""
        car = self.coordinates.car
        values = car.nominal
        if z is not None:
            vectors = self.coordinates.parameter_vectors(z)
            values = {name: vectors[:, k] for k, name in enumerate(car.names)}
        return values if car.derived is None else {**values, **car.derived(values)}

    @property
    def effects(self) -> dict[PlacedEffect, dict[str, Array]]:
        """Values, in place of draws, of the reported parameters of each effect, SI units."""
        values: dict[PlacedEffect, dict[str, Array]] = {
            placed: {} for placed in self.coordinates.placed_effects
        }
        moments = self.coordinates.effect_moments(self.mean, self.covariance)
        for effect, mean, sd in zip(self.coordinates.effects, *moments, strict=True):
            if not effect.parameter.shape:
                values[effect.placed][effect.parameter.name] = effect.draws(float(mean), float(sd))
        return values

    def log_moments(self, name: str) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of a parameter or a derived quantity.

        The logarithm, which is linear in most coordinates, is linearised at the mean.
        """
        p = len(self.coordinates)
        points = self.mean + _STEP * np.vstack([np.zeros(p), np.eye(p), -np.eye(p)])
        logs = np.log(self._values(points)[name])
        gradient = (logs[1 : p + 1] - logs[p + 1 :]) / (2.0 * _STEP)
        return float(logs[0]), float(np.sqrt(gradient @ self.covariance @ gradient))

    @cached_property
    def nominal_damping(self) -> NominalDamping | None:
        """Possible mistakes in nominal damping; None if there is no verdict on the dampers."""
        car = self.coordinates.car
        rates = {element.damping for element in car.elements}
        if self.verdict != "ok" or self.doubt is not None:
            return None
        return nominal_damping(car, {name: math.exp(self.log_moments(name)[0]) for name in rates})

    def probability_below_nominal(self, name: str) -> float:
        """Return the probability that a quantity is below nominal, allowing for a mistake."""
        mean, sd = self.log_moments(name)
        log_ratio = mean - math.log(self.nominal[name])
        p = 0.5 * math.erfc(log_ratio / max(sd, 1e-300) / math.sqrt(2.0))
        return (
            p if self.nominal_damping is None else self.nominal_damping.probability_below(name, p)
        )


def track(
    recording: Recording,
    vehicle: Vehicle,
    *,
    car: str = "half",
    effects: Sequence[PlacedEffect] = (),
    forget: float | None = None,
    engine: str = "compiled",
    progress: Callable[[float, str], None] | None = None,
) -> TrackResult:
    """Track a recording from its first row to its last.

    Parameters
    ----------
    recording : Recording
        Recording as read.
    vehicle : Vehicle
        The car.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.
    effects : sequence of PlacedEffect
        Effects that the car or its sensors have.
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
        If a channel is in counts without a calibration, or if the recording lacks channels that the
        car needs.
    """
    start_time = time.perf_counter()
    acc = accelerations(recording, vehicle).T
    tracker = tracker_for(
        recording, vehicle, car=car, effects=effects, forget=forget, engine=engine
    )
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
        time.perf_counter() - start_time,
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
        Tracker after its ``finish``.
    frames : Frames
        All its frames, or decimated ones.
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
        mean, covariance = tracker.belief
        resets = tuple(tracker.filter.resets)
    reasons = tracker.unanswered(name)
    input_check = tracker.input_doubt(name, refused=bool(reasons))
    if input_check is not None and reasons:
        reasons = [input_check.sentence, *reasons]
    elif input_check is not None:
        warnings = (input_check.sentence, *warnings)
    all_warnings = [*warnings, *checks.warnings(tracker.sensors, name)]
    channels = tracker.sensors.channels
    unknown = [c.name for c in channels if tracker.vehicle.sensor(c.name).noise is None]
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
        channels=channels,
        rate=tracker.rate,
        forget=tracker.forget,
        engine=tracker.engine,
        seconds=seconds,
        doubt=input_check,
    )
