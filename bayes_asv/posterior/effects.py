"""Effects among the parameters: their forces, and their corrections of readings.

Sensor effects are undone by corrections that follow from the signal.  A wheel's follow from its
reading without most of the noise: with slow that behind one more pole of the declared corner, a
sensor whose corner is b times the declared one would, were it as declared, have read
slow + (signal − slow)/b.  A chassis channel's follow from a simulation that knows the wheels alone:
with slow what a declared sensor would have read behind one more pole, b times the declared corner,
this one reads slow + b (signal − slow).  Both are exact for one pole.  A lag is a shift, a Taylor
series of it.  From a chassis reading itself corrections would share its noise, and a change that
sharpens a channel would be taken for news.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.force_laws import table_of_laws
from bayes_asv.filters.kalman import MISSING, ORDER
from bayes_asv.filters.one_pole import low_passed
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.models.outputs import relative_offset
from bayes_asv.preprocessing.measured_inputs import denoise_wheel, unit_input_moments
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["NO_FILTER", "SensorCorrections", "Values", "law_table", "sensor_corrections"]

Array = NDArray[np.float64]
Values = Mapping[PlacedEffect, Mapping[str, float]]

NO_FILTER = 0.4
"""Share of the sampling rate that is the pole of a filter which nobody declared."""
_TERMS = 4  # of a Taylor series: a lag of a sample moves 60 Hz by 0.9 rad, and is good to 0.5 %
_DEGREE = 7  # of the spline whose fourth derivative is asked for


def law_table(car: CarModel, values: Values, run: int) -> Array:
    """Table (K, P) of the laws that act on the suspension elements of a car in one run."""
    out: list[list[float]] = []
    for placed, value in values.items():
        if placed.effect.packed is None or placed.run not in (None, run):
            continue
        packed = placed.effect.packed(value)
        elements = placed.elements(car)
        if placed.effect.split_between_axles:
            packed = (packed[0] / len(elements), *packed[1:])
        out += [[e, placed.effect.code, *packed] for e in elements]
    return table_of_laws(out)


class NominalReadings(NamedTuple):
    """What sensors that are as declared would have read.

    Parameters
    ----------
    moments : (E, nu, ORDER) array
        Of the measured inputs.
    reading : (E, ny) array
        Of the outputs.
    wheel : (E, nu) array
        Measured inputs at the instants, m/s².
    """

    moments: Array
    reading: Array
    wheel: Array


class NominalOutput(NamedTuple):
    """What one chassis sensor would have read if it were as declared.

    Parameters
    ----------
    has_reading : (E,) array of bool
        Instants at which it was read; R of them.
    spline : CubicSpline
        Through what it would have read, m/s² over s.
    cutoff : float
        Declared, rad/s.
    """

    has_reading: NDArray[np.bool_]
    spline: CubicSpline
    cutoff: float


@dataclass(frozen=True, eq=False)
class SensorCorrections:
    """What sensors that are not as declared change in one recording; itself and no other.

    Parameters
    ----------
    pole : float
        Of the filter that all readings passed, rad/s.
    wheel : (E, nu) array
        Measured inputs at the instants, m/s².
    lag_series : tuple of (TERMS, E, ORDER) or (TERMS, E) arrays
        One a channel: moments of the k-th derivative of its reading over k!, or that derivative of
        what an output would have read.
    exact_lag : tuple of callable
        One a channel: from a lag, s, to what undoes it, by the spline itself.
    max_series_lag : float
        Lag up to which the series in ``lag_series`` holds, s: one sample.
    high_pass : tuple of C (E, ORDER) arrays or None
        An input's signal less its slow part, moments of it.
    above : tuple of C NominalOutput or None
        Each output, as declared.
    ramp : tuple of (E, ORDER) or (E,) arrays
        Drift of a unit slope: time since the recording's beginning, for another quantity than an
        acceleration times its relative offset.
    unit_moments : (E, ORDER) array
        Moments of one.
    """

    pole: float
    wheel: Array
    lag_series: tuple[Array, ...]
    exact_lag: tuple[Callable[[float], Array], ...]
    max_series_lag: float
    high_pass: tuple[Array | None, ...]
    above: tuple[NominalOutput | None, ...]
    ramp: tuple[Array, ...]
    unit_moments: Array

    def corrected(
        self, recording: PreparedRecording, values: Values, biases: Array
    ) -> NominalReadings:
        """Return what sensors that are as declared would have read.

        Parameters
        ----------
        recording : PreparedRecording
            The recording.
        values : mapping
            Effects and their values.
        biases : (nu,) array
            What the inputs' sensors read at rest, m/s².

        Returns
        -------
        NominalReadings
            Taken off a wheel and off the body above it, a level moves the suspension and nothing
            else.  The arrays are kept for the next call, and are not to be written to.
        """
        names = [channel.name for channel in recording.channels]
        known = tuple(
            (names.index(name), placed.effect.fault, next(iter(value.values())))
            for placed, value in values.items()
            if placed.effect.fault
            for name in placed.channels(names)
        )
        return _corrected(self, recording, known, tuple(float(x) for x in biases))

    def undo_sensor_effects(self, c: int, fault: str, value: float) -> Array:
        """Return what to add to one channel to undo one fault of its sensor."""
        of_input = self.high_pass[c] is not None
        if fault == "lag":
            if abs(value) > self.max_series_lag:
                return self.exact_lag[c](value)
            return _later(self.lag_series[c], value, of_reading=of_input)
        return self._sharper(c, value) if fault == "bandwidth" else -value * self.ramp[c]

    def _sharper(self, c: int, share: float) -> Array:
        """Return what a channel whose corner is a share of the declared one has lost."""
        sharper, above = self.high_pass[c], self.above[c]
        if sharper is not None:
            return (1.0 / share - 1.0) * sharper
        assert above is not None
        there, through, corner = above
        lost = through(through.x) - low_passed(through.x, through.c, share * corner)
        return _laid(there, (1.0 - share) * lost)


@lru_cache(maxsize=8)  # along all coordinates but a sensor's own and an input's bias it stays
def _corrected(
    known: SensorCorrections,
    recording: PreparedRecording,
    faults: tuple[tuple[int, str, float], ...],
    biases: tuple[float, ...],
) -> NominalReadings:
    """Return what sensors as declared would have read; faults by channel, kind and value."""
    level = np.array(biases)
    driven = recording.moments - level[:, None] * known.unit_moments[:, None]
    reading = recording.reading - recording.rigid_gain @ level
    for c, fault, value in faults:
        if c in recording.inputs:
            driven[:, recording.inputs.index(c)] += known.undo_sensor_effects(c, fault, value)
        else:
            reading[:, recording.outputs.index(c)] += known.undo_sensor_effects(c, fault, value)
    return NominalReadings(driven, reading, known.wheel - level)


def _later(derivatives: Array, lag: float, *, of_reading: bool) -> Array:
    """Return what a channel that samples later by ``lag`` has to be changed by.

    Of a reading r, r(t − lag) − r(t); of what it would have been, −(s(t + lag) − s(t)).
    """
    by = -lag if of_reading else lag
    change = sum(by ** (k + 1) * one for k, one in enumerate(derivatives))
    return np.asarray(change if of_reading else -change)


def sensor_corrections(
    recording: PreparedRecording, vehicle: Vehicle, declared: Array
) -> SensorCorrections:
    """Work out the corrections of a recording once.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    vehicle : Vehicle
        Gives declared bandwidths.
    declared : (E, ny) array
        Simulated outputs of sensors that are as declared.
    """
    begin = recording.instants[0] - recording.elapsed[0]
    moved, ramp, later = [], [], []
    sharper: list[Array | None] = []
    above: list[NominalOutput | None] = []
    for c, channel in enumerate(recording.channels):
        corner = vehicle.sensor(channel.name).bandwidth
        if c in recording.inputs:
            u = recording.inputs.index(c)
            time, signal = denoise_wheel(recording, u, corner)
            laid = partial(_moments, recording, time, recording.wheels[u].sd)
            through = CubicSpline(time, signal)
            slow = signal if corner is None else low_passed(time, through.c, 2.0 * math.pi * corner)
            sharper.append(laid(signal - slow))
            above.append(None)
        else:
            y = recording.outputs.index(c)
            there = recording.kind[:, y] != MISSING
            time, signal = recording.instants[there], declared[there, y]
            laid = partial(_laid, there)
            through = CubicSpline(time, signal)
            above.append(NominalOutput(there, through, 2.0 * math.pi * (corner or math.inf)))
            sharper.append(None)
        smooth = make_interp_spline(time, signal, k=_DEGREE)
        found = [smooth(time, k) / math.factorial(k) for k in range(1, _TERMS + 1)]
        moved.append(np.stack([laid(x) for x in found]))
        later.append(
            partial(_shift, smooth, time, signal, laid, -1.0 if c in recording.inputs else 1.0)
        )
        ramp.append(laid(relative_offset(channel.quantity) * (time - begin)))
    pole = float(np.max(recording.poles)) or 2.0 * math.pi * NO_FILTER / recording.reading_step
    wheel_at = np.stack([w.spline(recording.instants) for w in recording.wheels], axis=1)
    return SensorCorrections(
        pole, wheel_at, tuple(moved), tuple(later), recording.reading_step, tuple(sharper),
        tuple(above), tuple(ramp), unit_input_moments(recording),
    )  # fmt: skip


def _shift(
    smooth: BSpline,
    time: Array,
    signal: Array,
    laid: Callable[[Array], Array],
    sign: float,
    lag: float,
) -> Array:
    """Return what undoes a lag; beyond its ends a channel keeps its first and last value.

    Of a reading (sign −1) r(t − lag) − r(t), of what it would have been (sign 1)
    −(s(t + lag) − s(t)).
    """
    moved = smooth(np.clip(time + sign * lag, time[0], time[-1]))
    return -sign * laid(moved - signal)


def _moments(recording: PreparedRecording, time: Array, deviation: Array, samples: Array) -> Array:
    """Moments (E, ORDER) of what runs through an input's samples."""
    through = WheelSignal(CubicSpline(time, samples), time, deviation)
    return np.asarray(moments(through, recording.instants, ORDER))


def _laid(there: NDArray[np.bool_], samples: Array) -> Array:
    """Lay samples where an output was read, and nothing elsewhere (E,)."""
    out = np.zeros(len(there))
    out[there] = samples
    return out
