"""The tracker: rows of accelerations in, parameters and states of the car out."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.domain.recording import COUNTS, Recording, Timing, nominal_rate, timing
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.ukf_state import (
    COLUMNS,
    DEFLECTION,
    DEFLECTION_SD,
    INNOVATION,
    MEAN,
    NIS,
    NOISE_FACTOR,
    PREDICTED,
    PREDICTED_SD,
    READINGS,
    SD,
)
from bayes_asv.tracking.checkpoint import read_checkpoint, restore, write_checkpoint
from bayes_asv.tracking.consistency import ConsistencyMonitor
from bayes_asv.tracking.data_checks import DataChecks
from bayes_asv.tracking.filter import DEFAULT_SETTINGS, ENGINES, OnlineFilter, filter_model
from bayes_asv.tracking.frames import Frames, concatenate, empty_frames
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.sensor_noise import SensorModel, estimate_noise, sensor_model
from bayes_asv.tracking.streaming_timeline import StreamingTimeline, TimelineChunk

__all__ = ["Tracker", "tracker_for"]

Array = NDArray[np.float64]

_NOISE_SECONDS = 0.5  # of the recording from which a noise level that is not given is estimated
_ESTIMATED_PRIOR_READINGS = 4.0  # readings that such an estimate is worth
# Steps are kept this long (s) for rows whose readings were scheduled at different times.
_RECENT_SECONDS = 1.2
_MIN_RECENT = 64  # steps


class Tracker:
    """Tracks c_f, c_r and i, and the suspension deflections, row by row.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal and known values, sensors.
    rate : float
        Rows per second, Hz.
    forget : float, optional
        Time constant of the parameters' random walk, s: in this time c_f, c_r and i change by 10 %,
        one standard deviation; constant parameters without it.
    engine : {'compiled', 'filterpy'}
        Implementation of the filter; the results are the same.
    timing : Timing, optional
        Delays and clocks of the recording.
    counts : tuple of 4 bool
        Channels whose readings came in counts: their quantization step and the standard deviation
        of their scale matter.

    Attributes
    ----------
    consistency : ConsistencyMonitor
        Tests of the innovations.
    data_checks : DataChecks
        Checks of the rows.

    Raises
    ------
    InputError
        For an impossible rate or time constant, or an unknown engine.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        rate: float,
        *,
        forget: float | None = None,
        engine: str = "compiled",
        timing: Timing | None = None,
        counts: Sequence[bool] = (False,) * 4,
    ) -> None:
        if not (math.isfinite(rate) and rate > 0.0):
            raise InputError(
                "rate", f"{rate:g} Hz is not a sampling rate", "give rows per second, such as 400"
            )
        if forget is not None and not (math.isfinite(forget) and forget > 0.0):
            raise InputError(
                "forget", f"{forget:g} s is not a time constant", "give seconds, such as 60"
            )
        if engine not in ENGINES:
            raise InputError("engine", f"'{engine}' is unknown", f"use {' or '.join(ENGINES)}")
        self.vehicle = vehicle
        self.rate = rate
        self.forget = forget
        self.engine = engine
        self.timing = timing
        self.counts = tuple(counts)
        self.coordinates = coordinates(vehicle, _scale_sds(vehicle, self.counts))
        self._sensors = sensor_model(vehicle, self.counts)
        self._noise_declared = bool(np.all(np.isfinite(self._sensors.noise)))
        self._pending: list[tuple[Array, Array]] = []  # rows from which noise is estimated
        self._timeline: StreamingTimeline | None = None
        self._filter: OnlineFilter | None = None
        self.consistency = ConsistencyMonitor(rate, self._noise_declared)
        self.data_checks = DataChecks(rate)
        if self._noise_declared:
            self._start_filter(self._sensors)

    @property
    def sensors(self) -> SensorModel:
        """The sensors, with the given or estimated noise."""
        return self._sensors

    @property
    def started(self) -> bool:
        """Whether the filter runs; it waits while noise levels are being estimated."""
        return self._filter is not None

    @property
    def filter(self) -> OnlineFilter:
        """The filter.

        Raises
        ------
        InputError
            While noise levels are being estimated.
        """
        if self._filter is None:
            raise InputError(
                "tracker", "has not started",
                "feed half a second of rows, or give the noise of all sensors",
            )  # fmt: skip
        return self._filter

    def feed(self, times: Array, acc: Array) -> Frames:
        """Process rows.

        Parameters
        ----------
        times : (n,) array
            Stamps, s, increasing from call to call.
        acc : (n, 4) array
            Accelerations of the four channels, m/s², NaN where missing.

        Returns
        -------
        Frames
            Of the rows that are complete; the last few wait for their successors.

        Raises
        ------
        InputError
            When a stamp is not after the one before, or shapes do not match.
        """
        times, acc = np.asarray(times, np.float64), np.asarray(acc, np.float64)
        if self._timeline is None:
            return self._collect(times, acc)
        chunk = self._timeline.push(times, acc)
        self.data_checks.update(times, acc, self._sensors)
        return self._advance(chunk)

    def finish(self) -> Frames:
        """Process the rows that were held back: no row will follow."""
        parts = []
        if self._timeline is None and not self._pending:
            return empty_frames()
        if self._timeline is None:
            parts.append(self._estimate_noise())
        assert self._timeline is not None
        parts.append(self._advance(self._timeline.finish()))
        return concatenate(parts)

    def resume(self, timing: Timing | None = None) -> None:
        """Begin another recording of the same car; call :meth:`finish` before.

        Parameters
        ----------
        timing : Timing, optional
            Delays and clocks of that recording.
        """
        self.timing = timing
        if self._timeline is None:
            return
        self._timeline = StreamingTimeline(self.vehicle, self._sensors, self.rate, timing)
        self.filter.start_recording()
        self._recent = np.empty((0, COLUMNS))
        self._step_count = 0

    def save(self, path: PathLike) -> None:
        """Save the tracker to a file, from which :meth:`restore` continues.

        Raises
        ------
        InputError
            If the filter has not started, or the file cannot be written.
        """
        assert self.filter is not None  # raises if it has not started
        write_checkpoint(path, self._settings(), self)

    @classmethod
    def restore(cls, path: PathLike, vehicle: Vehicle) -> Tracker:
        """Restore a saved tracker.

        Parameters
        ----------
        path : str or os.PathLike
            File that :meth:`save` wrote.
        vehicle : Vehicle
            The same car.

        Raises
        ------
        InputError
            If the file is not a checkpoint, or the vehicle is another one.
        """
        settings, plain, arrays = read_checkpoint(path)
        where = os.fspath(path)
        try:
            clocks = settings["timing"]
            tracker = cls(
                vehicle,
                settings["rate"],
                forget=settings["forget"],
                engine=settings["engine"],
                timing=None if clocks is None else Timing(*(tuple(c) for c in clocks)),
                counts=settings["counts"],
            )
            noise = np.array(settings["noise"])
            if tracker._filter is None:
                tracker._start_filter(replace(tracker._sensors, noise=noise))
            if tracker._settings() != settings:
                raise InputError(where, "was saved for another vehicle", "give the same vehicle")
            restore(tracker, plain, arrays)
        except (KeyError, TypeError, ValueError, AttributeError):
            raise InputError(
                where, "is no saved tracker, or is damaged",
                "give a file that a tracker's save() wrote",
            ) from None  # fmt: skip
        return tracker

    def _settings(self) -> dict[str, Any]:
        """Plain data that must agree when the tracker is restored."""
        space = self.coordinates
        return {
            "rate": self.rate,
            "forget": self.forget,
            "engine": self.engine,
            "timing": None
            if self.timing is None
            else [list(self.timing.delay), list(self.timing.clock)],
            "counts": list(self.counts),
            "noise": self._sensors.noise.tolist(),
            "steps": self._sensors.resolution.tolist(),
            "bandwidths": list(self._sensors.bandwidths),
            "names": list(space.names),
            "car": space.base.tolist(),
            "centre": space.centre.tolist(),
            "scale": space.scale.tolist(),
        }

    def _collect(self, times: Array, acc: Array) -> Frames:
        """Hold rows back until noise levels can be estimated."""
        if times.ndim != 1 or acc.shape != (len(times), 4):
            raise InputError(
                "rows", f"times {times.shape} and readings {acc.shape} do not match",
                "give times (n,) and readings (n, 4)",
            )  # fmt: skip
        if len(times):
            self._pending.append((times.copy(), acc.copy()))
        ends = [t for part, _ in self._pending for t in (part[0], part[-1])]
        if not ends or ends[-1] - ends[0] < _NOISE_SECONDS:
            return empty_frames()
        return self._estimate_noise()

    def _estimate_noise(self) -> Frames:
        """Estimate the missing noise levels, and process the rows held back."""
        times = np.concatenate([t for t, _ in self._pending])
        acc = np.concatenate([a for _, a in self._pending])
        self._pending = []
        early = acc[times <= times[0] + _NOISE_SECONDS]
        noise = self._sensors.noise.copy()
        for c in np.flatnonzero(~np.isfinite(noise)):
            noise[c] = estimate_noise(early[:, c], self._sensors.resolution[c])
        self._start_filter(replace(self._sensors, noise=noise))
        return self.feed(times, acc)

    def _start_filter(self, sensors: SensorModel) -> None:
        self._sensors = sensors
        self._timeline = StreamingTimeline(self.vehicle, sensors, self.rate, self.timing)
        model = filter_model(self.coordinates, sensors.noise_parameters(), self.forget)
        settings = DEFAULT_SETTINGS
        if not self._noise_declared:
            settings = settings._replace(prior_readings=_ESTIMATED_PRIOR_READINGS)
        self._filter = OnlineFilter(model, self.engine, settings)
        self._recent = np.empty((0, COLUMNS))  # results of the last steps
        self._step_count = 0

    def _advance(self, chunk: TimelineChunk) -> Frames:
        """Filter steps, and make frames of the rows that they complete."""
        out = self.filter.advance(chunk.steps)
        self._step_count += len(out)
        results = np.concatenate([self._recent, out])
        keep = max(int(_RECENT_SECONDS * self.rate), _MIN_RECENT)
        self._recent = results[-keep:].copy()
        rows = chunk.rows
        if not len(rows.stamp):
            return empty_frames()
        first = self._step_count - len(results)
        return self._frames(rows.stamp, rows.step - first, rows.measured, results)

    def _frames(
        self, stamp: Array, step: NDArray[np.int64], measured: Array, results: Array
    ) -> Frames:
        """Arrange the results after steps by rows.

        Parameters
        ----------
        stamp : (R,) array
            Stamps of the rows, s.
        step : (R, 2) int array
            Index into ``results`` of the step at either chassis reading; negative without one.
        measured : (R, 2) array
            Those readings, m/s².
        results : (N, COLUMNS) array
            Results after steps.
        """
        if not len(results):
            results = np.zeros((1, COLUMNS))
            results[0, SD : SD + 3] = 1.0
            results[0, NOISE_FACTOR : NOISE_FACTOR + 2] = 1.0
        # logical_or of two columns instead of any(axis=1), which is slow for rows of two
        missing = np.logical_or(*(step < 0).T)
        step = np.clip(step, 0, len(results) - 1)
        last = np.maximum.accumulate(np.where(missing, 0, np.maximum(*step.T)))
        at_last = results[last]
        apart = step[:, 0] != step[:, 1]
        # usually both axles are read at the same instant
        simultaneous = not (apart.any() or missing.any())
        own = [at_last, at_last] if simultaneous else [results[step[:, axle]] for axle in range(2)]
        nis = np.where(apart, own[0][:, NIS] + own[1][:, NIS], at_last[:, NIS])
        count = np.where(apart, own[0][:, READINGS] + own[1][:, READINGS], at_last[:, READINGS])
        nis, count = np.where(missing, 0.0, nis), np.where(missing, 0.0, count)

        def by_axle(column: int) -> Array:
            values = np.column_stack([own[axle][:, column + axle] for axle in range(2)])
            values[missing] = np.nan
            return values

        innovations = np.nan_to_num(by_axle(INNOVATION))
        noise_factor = at_last[:, NOISE_FACTOR : NOISE_FACTOR + 2]
        window = self.consistency.update(nis, count, innovations, noise_factor)
        deflection = at_last[:, DEFLECTION : DEFLECTION + 2].copy()
        deflection_sd = at_last[:, DEFLECTION_SD : DEFLECTION_SD + 2].copy()
        deflection[missing] = deflection_sd[missing] = np.nan
        return Frames(
            time=stamp,
            median=np.exp(self.coordinates.log_parameters(at_last[:, MEAN : MEAN + 3])),
            log_sd=self.coordinates.scale[:3] * at_last[:, SD : SD + 3],
            deflection=deflection,
            deflection_sd=deflection_sd,
            measured=measured,
            predicted=by_axle(PREDICTED),
            predicted_sd=by_axle(PREDICTED_SD),
            nis=nis,
            readings=count,
            nis_mean=window.mean,
            nis_low=window.low,
            nis_high=window.high,
            consistent=window.consistent,
            inflation=np.sqrt(np.maximum(np.maximum(*noise_factor.T), 1.0)),
        )


def _scale_sds(vehicle: Vehicle, counts: Sequence[bool]) -> list[float]:
    """Relative standard deviation of each sensor's scale, where its readings are in counts."""
    sensors = [vehicle.sensor(name) for name in CHANNELS]
    return [
        s.counts_scale_sd / abs(s.counts_scale) if raw and s.counts_scale else 0.0
        for s, raw in zip(sensors, counts, strict=True)
    ]


def tracker_for(
    recording: Recording,
    vehicle: Vehicle,
    *,
    rate: float | None = None,
    forget: float | None = None,
    engine: str = "compiled",
) -> Tracker:
    """Make a tracker for a recording, or for the stream that its first rows belong to.

    Parameters
    ----------
    recording : Recording
        Gives units, delays and clocks.
    vehicle : Vehicle
        The car.
    rate : float, optional
        Rows per second, Hz; that of the recording's stamps without it.
    forget, engine
        As for :class:`Tracker`.
    """
    return Tracker(
        vehicle,
        nominal_rate(recording) if rate is None else rate,
        forget=forget,
        engine=engine,
        timing=timing(recording),
        counts=tuple(unit == COUNTS for unit in recording.units),
    )
