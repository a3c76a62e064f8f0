"""Force laws of effects, and corrections of readings for sensor effects.

Sensor effects are undone by corrections that are computed from a signal.

- For a wheel sensor, the signal is its reading with most of the noise removed.  Let slow be that
  signal after one more pole at the declared corner.  If the true corner is b times the declared
  one, a sensor as declared would have read slow + (signal − slow)/b.
- For a chassis sensor, the signal is a simulation that is driven by the wheels alone.  Let slow be
  the output of a sensor as declared after one more pole at b times the declared corner.  A sensor
  with that corner reads slow + b (signal − slow).

Both are exact for a filter with one pole.  A lag is a shift in time, computed by a Taylor series.
Corrections from the chassis readings themselves would share their noise: sharpening would amplify
noise that the model takes for signal.
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
from bayes_asv.filters.force_laws import excess_many, table_of_laws
from bayes_asv.filters.kalman import MISSING, ORDER
from bayes_asv.filters.one_pole import low_passed
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.models.outputs import relative_offset
from bayes_asv.preprocessing.measured_inputs import denoise_wheel, unit_input_moments
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = [
    "NO_FILTER",
    "SensorCorrections",
    "Values",
    "force_history",
    "law_table",
    "sensor_corrections",
]

Array = NDArray[np.float64]
Values = Mapping[PlacedEffect, Mapping[str, float]]

NO_FILTER = 0.4
"""Corner frequency that is assumed for an undeclared filter, as a share of the sampling rate."""
# Terms of the Taylor series in a lag: a lag of one sample, 0.9 rad at 60 Hz, is accurate to 0.5 %.
_TERMS = 4
_DEGREE = 7  # degree of the interpolating spline; the series needs its fourth derivative


def law_table(car: CarModel, values: Values, run: int) -> Array:
    """Table (K, P) of the force laws that act on a car's suspension elements in one run."""
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


def force_history(recording: PreparedRecording, values: Values, run: int) -> Array:
    """Return the forces (E, ne) on the body, N, of effects that motion does not change.

    Parameters
    ----------
    recording : PreparedRecording
        The recording, the ``run``-th.
    values : mapping
        Effects and their values.
    """
    table, time = law_table(recording.car, values, run), recording.elapsed
    rest = np.zeros(len(time))
    by_element = [
        excess_many(table, e, 0.0, 0.0, rest, rest, time, time[-1])[:, 0]
        for e in range(len(recording.car.elements))
    ]
    return np.stack(by_element, axis=1)


class NominalReadings(NamedTuple):
    """Readings that nominal sensors, those as declared, would have given.

    Parameters
    ----------
    moments : (E, nu, ORDER) array
        Moments of the measured inputs.
    reading : (E, ny) array
        Readings of the outputs.
    wheel : (E, nu) array
        Measured inputs at the instants, m/s².
    """

    moments: Array
    reading: Array
    wheel: Array


class NominalOutput(NamedTuple):
    """Signal that one chassis sensor would have read if it were as declared.

    Parameters
    ----------
    has_reading : (E,) array of bool
        Instants at which it was read; R of them.
    spline : CubicSpline
        Spline through that signal, m/s² over s.
    cutoff : float
        Declared corner frequency, rad/s.
    """

    has_reading: NDArray[np.bool_]
    spline: CubicSpline
    cutoff: float


@dataclass(frozen=True, eq=False)
class SensorCorrections:
    """Corrections of one recording's readings, channel by channel.

    Compared by identity: two objects are equal only if they are the same one.

    Parameters
    ----------
    pole : float
        Pole of the filter that all readings passed, rad/s.
    wheel : (E, nu) array
        Measured inputs at the instants, m/s².
    lag_series : tuple of (TERMS, E, ORDER) or (TERMS, E) arrays
        One a channel: the k-th derivative over k!, as moments of the reading of an input, or as
        values of the simulated signal of an output.
    exact_lag : tuple of callable
        One a channel: the correction for a lag, s, evaluated from the spline.
    max_series_lag : float
        Largest lag for which ``lag_series`` is used, s: one sample.
    high_pass : tuple of C (E, ORDER) arrays or None
        Moments of an input's signal less its slow part; None for an output.
    above : tuple of C NominalOutput or None
        Signal of an output as declared; None for an input.
    ramp : tuple of (E, ORDER) or (E,) arrays
        Drift with unit slope: time since the start of the recording, scaled by the relative offset
        of the channel's quantity.
    unit_moments : (E, ORDER) array
        Moments of the constant 1.
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
        """Return the readings that sensors as declared would have given.

        Parameters
        ----------
        recording : PreparedRecording
            The recording.
        values : mapping
            Effects and their values.
        biases : (nu,) array
            Biases of the inputs' sensors, m/s².

        Returns
        -------
        NominalReadings
            The bias of a wheel is subtracted from the wheel and from the body above it, so that it
            moves the suspension only.  The arrays are cached: do not write to them.
        """
        names = [channel.name for channel in recording.channels]
        known = tuple(
            (names.index(name), placed.effect.fault, next(iter(value.values())))
            for placed, value in values.items()
            if placed.effect.fault
            for name in placed.channels(names)
        )
        return _nominal_readings(self, recording, known, tuple(float(x) for x in biases))

    def undo_sensor_effects(self, c: int, fault: str, value: float) -> Array:
        """Return the correction that undoes one fault of one channel's sensor."""
        of_input = self.high_pass[c] is not None
        if fault == "lag":
            if abs(value) > self.max_series_lag:
                return self.exact_lag[c](value)
            return _series_lag_correction(self.lag_series[c], value, of_reading=of_input)
        return (
            self._bandwidth_correction(c, value) if fault == "bandwidth" else -value * self.ramp[c]
        )

    def _bandwidth_correction(self, c: int, share: float) -> Array:
        """Return the correction of a channel whose corner is a share of the declared one."""
        high_pass, nominal = self.high_pass[c], self.above[c]
        if high_pass is not None:
            return (1.0 / share - 1.0) * high_pass
        assert nominal is not None
        has_reading, spline, cutoff = nominal
        lost = spline(spline.x) - low_passed(spline.x, spline.c, share * cutoff)
        return _scatter(has_reading, (1.0 - share) * lost)


@lru_cache(maxsize=8)  # changes of the car's coordinates leave the corrections as they are
def _nominal_readings(
    corrections: SensorCorrections,
    recording: PreparedRecording,
    faults: tuple[tuple[int, str, float], ...],
    biases: tuple[float, ...],
) -> NominalReadings:
    """Nominal readings of a recording; faults by channel, kind and value."""
    level = np.array(biases)
    input_moments = recording.moments - level[:, None] * corrections.unit_moments[:, None]
    reading = recording.reading - recording.rigid_gain @ level
    for c, fault, value in faults:
        if c in recording.inputs:
            input_moments[:, recording.inputs.index(c)] += corrections.undo_sensor_effects(
                c, fault, value
            )
        else:
            reading[:, recording.outputs.index(c)] += corrections.undo_sensor_effects(
                c, fault, value
            )
    return NominalReadings(input_moments, reading, corrections.wheel - level)


def _series_lag_correction(derivatives: Array, lag: float, *, of_reading: bool) -> Array:
    """Correction for a sampling delay, from the derivatives of the signal.

    For a reading r it is r(t − lag) − r(t); for a simulated signal s, −(s(t + lag) − s(t)).
    """
    by = -lag if of_reading else lag
    change = sum(by ** (k + 1) * one for k, one in enumerate(derivatives))
    return np.asarray(change if of_reading else -change)


def sensor_corrections(
    recording: PreparedRecording, vehicle: Vehicle, declared: Array
) -> SensorCorrections:
    """Compute the corrections of a recording.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    vehicle : Vehicle
        Gives declared bandwidths.
    declared : (E, ny) array
        Simulated outputs of sensors as declared.
    """
    lag_series, ramp, exact_lag = [], [], []
    high_pass: list[Array | None] = []
    above: list[NominalOutput | None] = []
    for c, channel in enumerate(recording.channels):
        corner = vehicle.sensor(channel.name).bandwidth
        if c in recording.inputs:
            u = recording.inputs.index(c)
            time, signal = denoise_wheel(recording, u, corner)
            to_instants = partial(_moments, recording, time, recording.wheels[u].sd)
            spline = CubicSpline(time, signal)
            slow = signal if corner is None else low_passed(time, spline.c, 2.0 * math.pi * corner)
            high_pass.append(to_instants(signal - slow))
            above.append(None)
        else:
            y = recording.outputs.index(c)
            has_reading = recording.kind[:, y] != MISSING
            time, signal = recording.instants[has_reading], declared[has_reading, y]
            to_instants = partial(_scatter, has_reading)
            spline = CubicSpline(time, signal)
            above.append(NominalOutput(has_reading, spline, 2.0 * math.pi * (corner or math.inf)))
            high_pass.append(None)
        smooth = make_interp_spline(time, signal, k=_DEGREE)
        terms = [smooth(time, k) / math.factorial(k) for k in range(1, _TERMS + 1)]
        lag_series.append(np.stack([to_instants(x) for x in terms]))
        exact_lag.append(
            partial(
                _exact_lag_correction,
                smooth,
                time,
                signal,
                to_instants,
                -1.0 if c in recording.inputs else 1.0,
            )
        )
        ramp.append(to_instants(relative_offset(channel.quantity) * (time - recording.start_time)))
    pole = float(np.max(recording.poles)) or 2.0 * math.pi * NO_FILTER / recording.reading_step
    wheel_at = np.stack([w.spline(recording.instants) for w in recording.wheels], axis=1)
    return SensorCorrections(
        pole, wheel_at, tuple(lag_series), tuple(exact_lag), recording.reading_step,
        tuple(high_pass), tuple(above), tuple(ramp), unit_input_moments(recording),
    )  # fmt: skip


def _exact_lag_correction(
    spline: BSpline,
    time: Array,
    signal: Array,
    to_instants: Callable[[Array], Array],
    sign: float,
    lag: float,
) -> Array:
    """Correction for a sampling delay, from the spline itself.

    For a reading r (sign −1) it is r(t − lag) − r(t); for a simulated signal s (sign 1),
    −(s(t + lag) − s(t)).  Beyond its ends a channel keeps its first and last value.
    """
    moved = spline(np.clip(time + sign * lag, time[0], time[-1]))
    return -sign * to_instants(moved - signal)


def _moments(recording: PreparedRecording, time: Array, deviation: Array, samples: Array) -> Array:
    """Moments (E, ORDER) of the cubic spline through samples of an input."""
    wheel = WheelSignal(CubicSpline(time, samples), time, deviation)
    return np.asarray(moments(wheel, recording.instants, ORDER))


def _scatter(has_reading: NDArray[np.bool_], samples: Array) -> Array:
    """Scatter samples to the instants with a reading (E,); zero elsewhere."""
    out = np.zeros(len(has_reading))
    out[has_reading] = samples
    return out
