"""The tracker: rows of accelerations in, parameters and states of the car out."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.input_mistakes import InputCheck, check_input
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.domain.recording import COUNTS, Recording, Timing, nominal_rate, timing
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import PlacedEffect, placed_effect
from bayes_asv.preprocessing.prepare import used_channels
from bayes_asv.preprocessing.quantization import smallest_step
from bayes_asv.preprocessing.resampling import at_own_rate
from bayes_asv.tracking.active_blocks import ActiveBlocks
from bayes_asv.tracking.checkpoint import read_checkpoint, restore, write_checkpoint
from bayes_asv.tracking.consistency import ConsistencyMonitor
from bayes_asv.tracking.data_checks import DataChecks, unidentified_parameters
from bayes_asv.tracking.filter import (
    DEFAULT_SETTINGS,
    ENGINES,
    OnlineFilter,
    parameter_covariance,
)
from bayes_asv.tracking.filter_model import (
    StandstillBias,
    filter_model,
    has_warp,
    standstill_bias,
)
from bayes_asv.tracking.frames import Frames, concatenate, empty_frames
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.sensor_noise import SensorModel, sensor_model
from bayes_asv.tracking.streaming_timeline import StreamingTimeline, TimelineChunk

__all__ = ["Tracker", "tracker_for"]

Array = NDArray[np.float64]

# Length of the beginning from which undeclared noise levels and biases are estimated, s.
_NOISE_SECONDS = 0.5
_LONGEST_FORGET = 1e6  # longest time constant of the random walk, s: eleven days of driving
# Bias along a twist of the wheels, m/s², that leads to a deflection of 0.1 m after two seconds.
_STANDSTILL_SD = 0.05
_ESTIMATED_PRIOR_READINGS = 4.0  # weight of an estimated noise level, in readings
# Time for which results of steps are kept, s, for rows with readings at different times.
_RECENT_SECONDS = 1.2
_MIN_RECENT = 64  # least number of steps that are kept
# Time after a fault in which results are suspect, s: the filter has then either learnt the change,
# or detects the fault again.
_SUSPECT_SECONDS = 2.0 * DEFAULT_SETTINGS.fault_duration


class Tracker:
    """Tracks the parameters of interest of a car, and its suspension deflections, by rows.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal and given values, and sensors.
    rate : float
        Rows per second, Hz.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.
    channels : sequence of str
        Names of the channels in a row; those that the car model does not use are ignored.
    effects : sequence of PlacedEffect
        Effects that the car or its sensors have.
    forget : float, optional
        Time constant of the parameters' random walk, s, in which the parameters of interest change
        by 10 % (one standard deviation); constant parameters without it.
    engine : {'compiled', 'filterpy'}
        Implementation of the filter; the results are the same.
    timing : Timing, optional
        Delays and clocks of the recording.
    counts : sequence of bool, optional
        Whether the readings of each channel were in counts, which defines their quantisation step
        and the standard deviation of their scale; none by default.
    metadata : tuple of (key, value)
        Metadata of the recording, for the input check.

    Attributes
    ----------
    consistency : ConsistencyMonitor
        Tests of the innovations.
    data_checks : DataChecks
        Checks of the rows.

    Raises
    ------
    InputError
        For an impossible rate or time constant, an unknown engine, channels that do not fit the
        car, or an effect that cannot be tracked.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        rate: float,
        *,
        car: str = "half",
        channels: Sequence[str] = CHANNELS,
        effects: Sequence[PlacedEffect] = (),
        forget: float | None = None,
        engine: str = "compiled",
        timing: Timing | None = None,
        counts: Sequence[bool] | None = None,
        metadata: tuple[tuple[str, str], ...] = (),
    ) -> None:
        if not (math.isfinite(rate) and rate > 0.0):
            raise InputError(
                "rate", f"{rate:g} Hz is not a sampling rate", "give rows per second, such as 400"
            )
        if forget is not None and not 0.0 < forget <= _LONGEST_FORGET:
            raise InputError(
                "forget", f"{forget:g} s is not a time constant", "give seconds, such as 60"
            )
        if engine not in ENGINES:
            raise InputError("engine", f"'{engine}' is unknown", f"use {' or '.join(ENGINES)}")
        self.vehicle = vehicle
        self.rate = rate
        self.forget = forget
        self.engine = engine
        model = car_model(car, vehicle)
        self.channels = tuple(channels)
        self._columns = [
            c for c, name in enumerate(channels) if model.has_channel(vehicle.channel(name))
        ]
        raw = (False,) * len(self.channels) if counts is None else tuple(counts)
        self.counts = tuple(raw[c] for c in self._columns)
        self.timing = self._own_timing(timing)
        names = [self.channels[c] for c in self._columns]
        self.effects = tuple(effects)
        self.coordinates = coordinates(
            model, names, _scale_sds(vehicle, names, self.counts), self.effects
        )
        if engine != "compiled" and self.coordinates.law_effects:
            raise InputError(
                "engine", f"'{engine}' has no force laws", "leave it out, or leave out the effects"
            )
        self._sensors = sensor_model(vehicle, model, names, self.counts)
        self._noise_declared = bool(np.all(np.isfinite(self._sensors.noise)))
        self._pending: list[tuple[Array, Array]] = []  # rows from which noise is estimated
        self._timeline: StreamingTimeline | None = None
        self._filter: OnlineFilter | None = None
        outputs = len(self._sensors.outputs)
        self.consistency = ConsistencyMonitor(rate, self._noise_declared, outputs)
        self.data_checks = DataChecks(rate, len(names))
        self._active_blocks = ActiveBlocks(self._sensors.channels, metadata)
        self._standstill: StandstillBias | None = None
        self._last_fault = -math.inf  # stamp of the last row with a fault
        if self._noise_declared and not has_warp(model):
            self._start_filter(self._sensors)

    def _own_timing(self, timing: Timing | None) -> Timing | None:
        """Clocks and delays of the used channels."""
        if timing is None:
            return None
        return Timing(
            tuple(timing.delay[c] for c in self._columns),
            tuple(timing.clock[c] for c in self._columns),
        )

    @property
    def estimands(self) -> tuple[str, ...]:
        """Names of the parameters that are tracked."""
        return self.coordinates.estimands

    @property
    def sensors(self) -> SensorModel:
        """The sensors, with declared or estimated noise."""
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
        acc : (n, C) array
            Readings of the channels, SI units, NaN where missing.

        Returns
        -------
        Frames
            Frames of the complete rows; the last few rows wait for their successors.

        Raises
        ------
        InputError
            If a stamp is not after the one before, or if shapes do not match.
        """
        times, acc = np.asarray(times, np.float64), np.asarray(acc, np.float64)
        if times.ndim != 1 or acc.shape != (len(times), len(self.channels)):
            raise InputError(
                "rows", f"times {times.shape} and readings {acc.shape} do not match",
                f"give times (n,) and readings (n, {len(self.channels)})",
            )  # fmt: skip
        if len(self._columns) < len(self.channels):
            acc = acc[:, self._columns]
        self._active_blocks.append(times, acc)
        if self._timeline is None:
            return self._collect(times, acc)
        return self._process(times, acc)

    def _process(self, times: Array, acc: Array) -> Frames:
        """Process rows of the used channels."""
        assert self._timeline is not None
        chunk = self._timeline.push(times, acc)
        self.data_checks.update(times, acc, self._sensors)
        return self._advance(chunk)

    def finish(self) -> Frames:
        """Process the rows that were held back: no row will follow."""
        parts = []
        if self._timeline is None and not self._pending:
            return self._no_frames()
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
        self.timing = self._own_timing(timing)
        if self._timeline is None:
            return
        self._timeline = StreamingTimeline(self.vehicle, self._sensors, self.rate, self.timing)
        self.filter.start_recording()
        self._recent = np.empty((0, self.filter.model.into.width))
        self._step_count = 0

    def unanswered(self, source: str) -> list[str]:
        """List the reasons to refuse the rows so far."""
        reasons = self.data_checks.reasons(self._sensors, source)
        if reasons or not self.started:
            return reasons
        space = self.coordinates
        sd = space.scale * np.sqrt(np.diag(parameter_covariance(self.filter.state)))
        standstill = self._standstill
        moving = standstill is not None and bool(np.any(standstill.sd > _STANDSTILL_SD))
        at_start = [
            f"{source} does not begin at standstill: from its first {_NOISE_SECONDS:g} s the "
            f"online filter of the {space.car.name} car learns how the biases of the wheel sensors "
            "differ; start the recording a second before the car moves"
        ]
        unidentified = unidentified_parameters(
            space.car,
            [self._sensors.channels[c] for c in self._sensors.outputs],
            dict(zip(space.estimands, space.scale, strict=False)),
            dict(zip(space.estimands, sd, strict=False)),
            inconsistent=self.consistency.summary().verdict == "inconsistent",
        )
        return at_start + unidentified if unidentified and moving else unidentified

    def input_doubt(self, source: str, refused: bool = False) -> InputCheck | None:
        """Check the input as ``estimate`` does, on the rows in which the wheels moved most.

        Parameters
        ----------
        source : str
            Name of the recording or port, for the messages.
        refused : bool
            Whether the rows are refused for another reason.

        Returns
        -------
        InputCheck or None
            None if nothing argues against the parameters, or if the model has effects: the check
            compares the recording with the linear car.
        """
        if self.effects:
            return None
        kept = [at_own_rate(one) for one in self._active_blocks.recordings(source)]
        if not kept:
            return None
        sensors = dict(self.vehicle.sensors)
        for channel, step in zip(self._sensors.channels, self._sensors.resolution, strict=True):
            sensors[channel.name] = replace(
                self.vehicle.sensor(channel.name), resolution=float(step) or None
            )
        as_read = replace(self.vehicle, sensors=sensors)
        return check_input(kept, as_read, self.coordinates.car.name, refused)

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
            # Settings that files of earlier versions lack are those of the half car.
            settings = {
                "model": "half", "channels": list(CHANNELS), "standstill": None, "effects": [],
                **settings,
            }  # fmt: skip
            clocks = settings["timing"]
            tracker = cls(
                vehicle,
                settings["rate"],
                car=settings["model"],
                channels=settings["channels"],
                forget=settings["forget"],
                engine=settings["engine"],
                timing=None if clocks is None else Timing(*(tuple(c) for c in clocks)),
                counts=settings["counts"],
                effects=[placed_effect(name) for name in settings["effects"]],
            )
            noise = np.array(settings["noise"])
            if settings["standstill"] is not None:
                tracker._standstill = StandstillBias(*map(np.array, settings["standstill"]))
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
            "effects": [str(effect) for effect in self.effects],
            "model": space.car.name,
            "channels": [channel.name for channel in self._sensors.channels],
            "standstill": None
            if self._standstill is None
            else [part.tolist() for part in self._standstill],
            "noise": self._sensors.noise.tolist(),
            "steps": self._sensors.resolution.tolist(),
            "bandwidths": list(self._sensors.bandwidths),
            "names": list(space.names),
            "car": space.base.tolist(),
            "centre": space.centre.tolist(),
            "scale": space.scale.tolist(),
        }

    def _collect(self, times: Array, acc: Array) -> Frames:
        """Collect rows until noise levels and biases can be estimated."""
        if len(times):
            self._pending.append((times.copy(), acc.copy()))
        ends = [t for part, _ in self._pending for t in (part[0], part[-1])]
        if not ends or ends[-1] - ends[0] < _NOISE_SECONDS:
            return self._no_frames()
        return self._estimate_noise()

    def _estimate_noise(self) -> Frames:
        """Estimate missing noise levels and biases, and process the collected rows."""
        times = np.concatenate([t for t, _ in self._pending])
        acc = np.concatenate([a for _, a in self._pending])
        self._pending = []
        first = times <= times[0] + _NOISE_SECONDS
        early = acc[first]
        resolution = self._sensors.resolution.copy()
        for c in np.flatnonzero(resolution == 0.0):
            resolution[c] = smallest_step(early[np.isfinite(early[:, c]), c])
        sensors = replace(self._sensors, resolution=resolution)
        noise = sensors.noise.copy()
        for c in np.flatnonzero(~np.isfinite(noise)):
            noise[c] = sensors.estimated(int(c), times[first], early[:, c])
        if has_warp(sensors.car):
            self._standstill = standstill_bias(sensors, early, self.rate)
        self._start_filter(replace(sensors, noise=noise))
        return self._process(times, acc)

    def _no_frames(self) -> Frames:
        car = self.coordinates.car
        return empty_frames(
            len(self.estimands), len(car.elements), len(self._sensors.outputs),
            len(self.coordinates.law_effects),
        )  # fmt: skip

    def _start_filter(self, sensors: SensorModel) -> None:
        self._sensors = sensors
        self._timeline = StreamingTimeline(self.vehicle, sensors, self.rate, self.timing)
        model = filter_model(self.coordinates, sensors, self.forget, self._standstill, self.rate)
        settings = DEFAULT_SETTINGS
        if not self._noise_declared:
            settings = settings._replace(prior_readings=_ESTIMATED_PRIOR_READINGS)
        self._filter = OnlineFilter(model, self.engine, settings)
        self._recent = np.empty((0, model.into.width))  # results of the last steps
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
            return self._no_frames()
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
        step : (R, ny) int array
            Index into ``results`` of the step at the reading of each output; negative without one.
        measured : (R, ny) array
            Those readings, SI units.
        results : (N, columns) array
            Results after steps.
        """
        into, sizes = self.filter.model.into, self.filter.model.sizes
        na, ne, ny = len(self.estimands), sizes.elements, sizes.outputs
        if not len(results):
            results = np.zeros((1, into.width))
            results[0, into.sd : into.sd + sizes.estimands] = 1.0
            results[0, into.noise_factor : into.noise_factor + ny] = 1.0
        # reductions over columns of the transpose: any(axis=1) is slow for short rows
        missing = np.logical_or.reduce((step < 0).T)
        step = np.clip(step, 0, len(results) - 1)
        last = np.maximum.accumulate(np.where(missing, 0, np.maximum.reduce(step.T)))
        at_last = results[last]
        # usually all outputs are read at the same instant
        simultaneous = not missing.any() and all(
            np.array_equal(step[:, 0], step[:, y]) for y in range(1, ny)
        )
        of_outputs = [at_last] * ny if simultaneous else [results[step[:, y]] for y in range(ny)]
        if simultaneous:
            nis, count = at_last[:, into.nis], at_last[:, into.readings]
        else:  # count each instant once, regardless of the number of its readings
            weights = [1.0 / np.add.reduce((step == step[:, y : y + 1]).T) for y in range(ny)]
            nis, count = (
                sum((of_outputs[y][:, column] * weights[y] for y in range(ny)), np.zeros(len(step)))
                for column in (into.nis, into.readings)
            )
            nis, count = np.where(missing, 0.0, nis), np.where(missing, 0.0, np.rint(count))

        def by_output(column: int) -> Array:
            values = np.column_stack([of_outputs[y][:, column + y] for y in range(ny)])
            values[missing] = np.nan
            return values

        innovations = np.nan_to_num(by_output(into.innovation))
        noise_factor = at_last[:, into.noise_factor : into.noise_factor + ny]
        window = self.consistency.update(nis, count, innovations, noise_factor)
        prior_sd = np.sqrt(
            self._suspect(stamp, np.maximum.reduce(noise_factor.T)).astype(np.float64)
        )
        sd = np.hypot(at_last[:, into.sd : into.sd + sizes.estimands], prior_sd[:, None])
        deflection = at_last[:, into.deflection : into.deflection + ne].copy()
        deflection_sd = at_last[:, into.deflection_sd : into.deflection_sd + ne].copy()
        deflection[missing] = deflection_sd[missing] = np.nan
        return Frames(
            time=stamp,
            median=np.exp(self.coordinates.log_parameters(at_last[:, into.mean : into.mean + na])),
            log_sd=self.coordinates.scale[:na] * sd[:, :na],
            effect=at_last[:, into.mean + na : into.mean + sizes.estimands],
            effect_sd=sd[:, na:],
            deflection=deflection,
            deflection_sd=deflection_sd,
            measured=measured,
            predicted=by_output(into.predicted),
            predicted_sd=by_output(into.predicted_sd),
            nis=nis,
            readings=count,
            nis_mean=window.mean,
            nis_low=window.low,
            nis_high=window.high,
            consistent=window.consistent,
            inflation=np.sqrt(np.maximum(np.maximum.reduce(noise_factor.T), 1.0)),
        )

    def _suspect(self, stamp: Array, noise_factor: Array) -> NDArray[np.bool_]:
        """Whether a sensor is faulty or the car has changed, at rows (R,).

        Until the filter can distinguish these, the uncertainty of the prior is added to its own.
        """
        fault = np.where(noise_factor > DEFAULT_SETTINGS.fault_threshold, stamp, self._last_fault)
        latest = np.maximum.accumulate(fault)
        self._last_fault = float(latest[-1])
        return np.asarray(stamp - latest < _SUSPECT_SECONDS)

    @property
    def belief(self) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p) of the coordinates after the last row."""
        state = self.filter.state
        covariance = parameter_covariance(state)
        if self.data_checks.last - self._last_fault < _SUSPECT_SECONDS:
            reported = range(self.filter.model.sizes.estimands)
            covariance[reported, reported] += 1.0
        return state.mu.copy(), covariance


def _scale_sds(vehicle: Vehicle, names: Sequence[str], counts: Sequence[bool]) -> list[float]:
    """Relative standard deviation of each sensor's scale; zero if it is not in counts."""
    sensors = [vehicle.sensor(name) for name in names]
    return [
        s.counts_scale_sd / abs(s.counts_scale) if raw and s.counts_scale else 0.0
        for s, raw in zip(sensors, counts, strict=True)
    ]


def tracker_for(
    recording: Recording,
    vehicle: Vehicle,
    *,
    car: str = "half",
    effects: Sequence[PlacedEffect] = (),
    rate: float | None = None,
    forget: float | None = None,
    engine: str = "compiled",
) -> Tracker:
    """Create a tracker for a recording, or for a stream with these first rows.

    Parameters
    ----------
    recording : Recording
        Gives channels, units, delays and clocks.
    vehicle : Vehicle
        The car.
    car : str
        Name of the car model, see :data:`bayes_asv.models.cars.CARS`.
    effects : sequence of PlacedEffect
        Effects that the car or its sensors have.
    rate : float, optional
        Rows per second, Hz; by default that of the recording's time stamps.
    forget, engine
        As for :class:`Tracker`.

    Raises
    ------
    InputError
        If the recording lacks channels that the car needs.
    """
    used_channels(recording, vehicle, car_model(car, vehicle))
    return Tracker(
        vehicle,
        nominal_rate(recording) if rate is None else rate,
        car=car,
        channels=recording.channels,
        effects=effects,
        forget=forget,
        engine=engine,
        timing=timing(recording),
        counts=tuple(unit == COUNTS for unit in recording.units),
        metadata=recording.metadata,
    )
