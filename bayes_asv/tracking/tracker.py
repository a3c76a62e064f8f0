"""Rows in, what is known of the car out: the online filter from end to end."""

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
    DEVIATION,
    EXPECTED,
    EXPECTED_SD,
    INNOVATION,
    LEVEL,
    MEAN,
    NIS,
    READINGS,
)
from bayes_asv.tracking.checkpoint import read_packed, taken_up, write_packed
from bayes_asv.tracking.consistency import Consistency
from bayes_asv.tracking.data_checks import Fitness
from bayes_asv.tracking.filter import ENGINES, Filter
from bayes_asv.tracking.frames import Frames, joined, nothing
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.prior_state import RULES, model_of
from bayes_asv.tracking.sensor_noise import Sensing, heard_level, sensing
from bayes_asv.tracking.streaming_timeline import Laid, Layout

__all__ = ["Tracker", "tracker_for"]

Array = NDArray[np.float64]

_LISTEN = 0.5  # s of record from which the noise of a sensor is guessed that has no figure
_WEAK_TRUST = 4.0  # readings that such a guess is worth
_TAIL = 1.2  # s of steps that are kept for rows whose readings were laid out at different times


class Tracker:
    """Tracks c_f, c_r and i, and the suspension's deflection, row after row.

    Parameters
    ----------
    vehicle : Vehicle
        What is known, nominal and mounted.
    rate : float
        Rows a second, Hz.
    forget : float, optional
        Seconds in which c_f, c_r and i may each wander by a tenth, one deviation; constants
        without it.
    engine : {'compiled', 'filterpy'}
        Which form of the filter; both say the same.
    timing : Timing, optional
        Delays and clocks of the recording.
    counts : tuple of 4 bool
        Channels whose readings came in counts: their step and the deviation of their scale count.

    Raises
    ------
    InputError
        For a rate, a time or an engine that there is not.
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
            raise InputError("rate", f"{rate:g} Hz is no rate", "give rows a second, such as 400")
        if forget is not None and not (math.isfinite(forget) and forget > 0.0):
            raise InputError("forget", f"{forget:g} s is no time", "give seconds, such as 60")
        if engine not in ENGINES:
            raise InputError("engine", f"there is no '{engine}'", f"name {' or '.join(ENGINES)}")
        self.vehicle = vehicle
        self.rate = rate
        self.forget = forget
        self.engine = engine
        self.timing = timing
        self.counts = tuple(counts)
        self.coordinates = coordinates(vehicle, _scale_sds(vehicle, self.counts))
        self._sensing = sensing(vehicle, self.counts)
        self._declared = bool(np.all(np.isfinite(self._sensing.noise)))
        self._heard: list[tuple[Array, Array]] = []
        self._layout: Layout | None = None
        self._filter: Filter | None = None
        self.watch = Consistency(rate, self._declared)
        self.fitness = Fitness(rate)
        if self._declared:
            self._begin(self._sensing)

    @property
    def sensing(self) -> Sensing:
        """The sensors, with the noise that was given or heard."""
        return self._sensing

    @property
    def begun(self) -> bool:
        """Whether the filter has begun, or noise is still being listened to."""
        return self._filter is not None

    @property
    def filter(self) -> Filter:
        """The filter below.

        Raises
        ------
        InputError
            While noise is still being listened to.
        """
        if self._filter is None:
            raise InputError(
                "tracker", "has not begun", "feed half a second of rows, or give the noise figures"
            )
        return self._filter

    def feed(self, times: Array, acc: Array) -> Frames:
        """Take rows.

        Parameters
        ----------
        times : (n,) array
            Stamps, s, increasing from call to call.
        acc : (n, 4) array
            Accelerations of the four channels, m/s², NaN where missing.

        Returns
        -------
        Frames
            Of the rows that are done; the last few wait for those that follow.

        Raises
        ------
        InputError
            When a stamp is not after the one before, or shapes do not match.
        """
        times, acc = np.asarray(times, np.float64), np.asarray(acc, np.float64)
        if self._layout is None:
            return self._listen(times, acc)
        laid = self._layout.push(times, acc)
        self.fitness.count(times, acc, self._sensing)
        return self._take(laid)

    def finish(self) -> Frames:
        """No row will follow: tell of those that were held back."""
        parts = []
        if self._layout is None and not self._heard:
            return nothing()
        if self._layout is None:
            parts.append(self._stop_listening())
        assert self._layout is not None
        parts.append(self._take(self._layout.finish()))
        return joined(parts)

    def resume(self, timing: Timing | None = None) -> None:
        """Begin another recording of the same car; call :meth:`finish` before.

        Parameters
        ----------
        timing : Timing, optional
            Its delays and clocks.
        """
        self.timing = timing
        if self._layout is None:
            return
        self._layout = Layout(self.vehicle, self._sensing, self.rate, timing)
        self.filter.begin_another()
        self._tail = np.empty((0, COLUMNS))
        self._tail_end = 0

    def save(self, path: PathLike) -> None:
        """Put the tracker away in a file; :meth:`restore` goes on as if nothing had been.

        Raises
        ------
        InputError
            If it has not begun, or the file cannot be written.
        """
        assert self.filter is not None  # says in words that it has not begun
        write_packed(path, self._made_with(), self)

    @classmethod
    def restore(cls, path: PathLike, vehicle: Vehicle) -> Tracker:
        """Take up a tracker that was put away.

        Parameters
        ----------
        path : str or os.PathLike
            What :meth:`save` wrote.
        vehicle : Vehicle
            The same car.

        Raises
        ------
        InputError
            If it is no such file, or the vehicle is another one.
        """
        made_with, plain, arrays = read_packed(path)
        where = os.fspath(path)
        try:
            clocks = made_with["timing"]
            tracker = cls(
                vehicle,
                made_with["rate"],
                forget=made_with["forget"],
                engine=made_with["engine"],
                timing=None if clocks is None else Timing(*(tuple(c) for c in clocks)),
                counts=made_with["counts"],
            )
            heard = np.array(made_with["noise"])
            if tracker._filter is None:
                tracker._begin(replace(tracker._sensing, noise=heard))
            if tracker._made_with() != made_with:
                raise InputError(where, "was saved for another vehicle", "give the same vehicle")
            taken_up(tracker, plain, arrays)
        except (KeyError, TypeError, ValueError, AttributeError):
            raise InputError(
                where, "is no saved tracker, or is broken", "give what save() wrote"
            ) from None
        return tracker

    def _made_with(self) -> dict[str, Any]:
        """Tell as plain data what has to be the same when it is taken up again."""
        where = self.coordinates
        return {
            "rate": self.rate,
            "forget": self.forget,
            "engine": self.engine,
            "timing": None
            if self.timing is None
            else [list(self.timing.delay), list(self.timing.clock)],
            "counts": list(self.counts),
            "noise": self._sensing.noise.tolist(),
            "steps": self._sensing.steps.tolist(),
            "bandwidths": list(self._sensing.bandwidths),
            "names": list(where.names),
            "car": where.base.tolist(),
            "centre": where.centre.tolist(),
            "scale": where.scale.tolist(),
        }

    def _listen(self, times: Array, acc: Array) -> Frames:
        """Hold rows back until the noise can be guessed."""
        if times.ndim != 1 or acc.shape != (len(times), 4):
            raise InputError(
                "rows", f"times {times.shape} and readings {acc.shape} do not match",
                "give times (n,) and readings (n, 4)",
            )  # fmt: skip
        if len(times):
            self._heard.append((times.copy(), acc.copy()))
        every = [t for part, _ in self._heard for t in (part[0], part[-1])]
        if not every or every[-1] - every[0] < _LISTEN:
            return nothing()
        return self._stop_listening()

    def _stop_listening(self) -> Frames:
        times = np.concatenate([t for t, _ in self._heard])
        acc = np.concatenate([a for _, a in self._heard])
        self._heard = []
        early = acc[times <= times[0] + _LISTEN]
        noise = self._sensing.noise.copy()
        for c in np.flatnonzero(~np.isfinite(noise)):
            noise[c] = heard_level(early[:, c], self._sensing.steps[c])
        self._begin(replace(self._sensing, noise=noise))
        return self.feed(times, acc)

    def _begin(self, heard: Sensing) -> None:
        self._sensing = heard
        self._layout = Layout(self.vehicle, heard, self.rate, self.timing)
        where = self.coordinates
        model = model_of(where, heard.kernel_noise(), self.forget)
        rules = RULES if self._declared else RULES._replace(trust=_WEAK_TRUST)
        self._filter = Filter(model, self.engine, rules)
        self._tail = np.empty((0, COLUMNS))
        self._tail_end = 0  # number of steps in all

    def _take(self, laid: Laid) -> Frames:
        """Run the filter over what was laid out, and tell of the rows that it completes."""
        out = self.filter.advance(laid.steps)
        self._tail_end += len(out)
        known = np.concatenate([self._tail, out])
        keep = max(int(_TAIL * self.rate), 64)
        self._tail = known[-keep:].copy()
        rows = laid.rows
        if not len(rows.stamp):
            return nothing()
        return self._frames(
            rows.stamp, rows.step - (self._tail_end - len(known)), rows.measured, known
        )

    def _frames(
        self, stamp: Array, step: NDArray[np.int64], measured: Array, known: Array
    ) -> Frames:
        """Arrange what was known after steps by rows."""
        if not len(known):
            known = np.zeros((1, COLUMNS))
            known[0, DEVIATION : DEVIATION + 3] = 1.0
            known[0, LEVEL : LEVEL + 2] = 1.0
        # numpy reduces rows of two one by one, and takes its time
        dark = np.logical_or(*(step < 0).T)
        step = np.clip(step, 0, len(known) - 1)
        last = np.maximum.accumulate(np.where(dark, 0, np.maximum(*step.T)))
        at = known[last]
        apart = step[:, 0] != step[:, 1]
        # as a rule both axles are read at once, and all is known then
        one = not (apart.any() or dark.any())
        own = [at, at] if one else [known[step[:, axle]] for axle in range(2)]
        nis = np.where(apart, own[0][:, NIS] + own[1][:, NIS], at[:, NIS])
        count = np.where(apart, own[0][:, READINGS] + own[1][:, READINGS], at[:, READINGS])
        nis, count = np.where(dark, 0.0, nis), np.where(dark, 0.0, count)

        def paired(column: int) -> Array:
            values = np.column_stack([own[axle][:, column + axle] for axle in range(2)])
            values[dark] = np.nan
            return values

        innovations = np.nan_to_num(paired(INNOVATION))
        level = at[:, LEVEL : LEVEL + 2]
        seen = self.watch.watch(nis, count, innovations, level)
        deflection = at[:, DEFLECTION : DEFLECTION + 2].copy()
        deflection_sd = at[:, DEFLECTION_SD : DEFLECTION_SD + 2].copy()
        deflection[dark] = deflection_sd[dark] = np.nan
        where = self.coordinates
        return Frames(
            time=stamp,
            median=np.exp(where.logs(at[:, MEAN : MEAN + 3])),
            log_sd=where.scale[:3] * at[:, DEVIATION : DEVIATION + 3],
            deflection=deflection,
            deflection_sd=deflection_sd,
            measured=measured,
            predicted=paired(EXPECTED),
            predicted_sd=paired(EXPECTED_SD),
            nis=nis,
            readings=count,
            nis_mean=seen.mean,
            nis_low=seen.low,
            nis_high=seen.high,
            consistent=seen.consistent,
            inflation=np.sqrt(np.maximum(np.maximum(*level.T), 1.0)),
        )


def _scale_sds(vehicle: Vehicle, counts: Sequence[bool]) -> list[float]:
    """Relative deviation of each sensor's scale, where its readings are in counts."""
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
    """Make a tracker for a recording that was read, or for its first rows.

    Parameters
    ----------
    recording : Recording
        Its units, delays and clocks hold.
    vehicle : Vehicle
        The car.
    rate : float, optional
        Rows a second, Hz; that of the recording's stamps without it.
    forget, engine
        As :class:`Tracker` takes them.
    """
    return Tracker(
        vehicle,
        nominal_rate(recording) if rate is None else rate,
        forget=forget,
        engine=engine,
        timing=timing(recording),
        counts=tuple(unit == COUNTS for unit in recording.units),
    )
