"""What a recording would have looked like with a sensor that is not as declared.

Every fault changes a channel's readings by something small that follows from the readings
themselves; the innovations are linear in those, so one pass tells what the fault does to them.
Faults of all four channels at once change nothing but the common filter of a linear relation:
their effects add up to next to nothing, which a test checks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.units import INCH
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import MISSING, ORDER, VALUE
from bayes_asv.filters.one_pole import low_passed
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["Fault", "faults", "with_fault"]

Array = NDArray[np.float64]

# Sizes that a careful team may well overlook: a data sheet's tolerance of scale and corner
# frequency, a tenth of a millisecond of a converter's order, a mount an inch off its axle.
_GAIN, _DELAY, _BANDWIDTH, _PLACE = 0.01, 1e-4, 0.10, INCH


@dataclass(frozen=True)
class Fault:
    """A sensor that differs from what is declared.

    Parameters
    ----------
    kind : {'gain', 'delay', 'bandwidth', 'place'}
        It reads too much; samples later than declared; its corner is higher than declared; it
        sits ahead of its axle.
    channel : str
        Which sensor.
    size : float
        A share (gain, bandwidth), s (delay) or m (place).
    """

    kind: str
    channel: str
    size: float

    @property
    def name(self) -> str:
        """Kind and channel in one."""
        return f"{self.kind} {self.channel}"


def faults(line: PreparedRecording, vehicle: Vehicle) -> list[Fault]:
    """List the faults that the sensors of a recording may have."""
    names = [channel.name for channel in line.channels]
    found = [Fault("gain", name, _GAIN) for name in names]
    found += [Fault("delay", name, _DELAY) for name in names]
    found += [
        Fault("bandwidth", name, _BANDWIDTH)
        for name in names
        if vehicle.sensor(name).bandwidth is not None
    ]
    placed = [channel for channel in line.channels if channel.part == "body"]
    return found + [
        Fault("place", channel.name, _PLACE)
        for channel in placed
        if channel.quantity == "acceleration" and _to_pitch(line) is not None
    ]


def with_fault(line: PreparedRecording, fault: Fault, vehicle: Vehicle) -> PreparedRecording:
    """Return a recording as the faulty sensor would have taken it.

    Parameters
    ----------
    line : PreparedRecording
        As it was taken.
    fault : Fault
        What is wrong with one sensor.
    vehicle : Vehicle
        Gives declared bandwidths.

    Returns
    -------
    PreparedRecording
        With other readings of one channel, to first order in the size of the fault.
    """
    c = [channel.name for channel in line.channels].index(fault.channel)
    corner = vehicle.sensor(fault.channel).bandwidth
    if c in line.inputs:
        u = line.inputs.index(c)
        wheel = line.wheels[u]
        change = _change(fault, wheel.knots, wheel.spline(wheel.knots), corner)
        signal = WheelSignal(CubicSpline(wheel.knots, change), wheel.knots, wheel.deviation)
        driven = line.moments.copy()
        driven[:, u] += moments(signal, line.instants, ORDER)
        return replace(line, moments=driven)
    y = line.outputs.index(c)
    there = line.kind[:, y] != MISSING
    time, reading = line.instants[there], line.reading[there, y]
    if fault.kind == "place":
        change = fault.size * _pitch_acceleration(line, y, time)
    else:
        change = _change(fault, time, reading, corner)
    readings = line.reading.copy()
    readings[there, y] += change
    return replace(line, reading=readings)


def _to_pitch(line: PreparedRecording) -> Array | None:
    """Weights (ny,) that make a pitch acceleration of the outputs, or None where they cannot."""
    if "pitch" not in line.car.coordinates:
        return None
    nominal = line.car.nominal
    rows = np.zeros((len(line.outputs), len(line.car.coordinates)))
    for y, c in enumerate(line.outputs):
        if line.channels[c].quantity == "acceleration":
            rows[y] = line.car.point(nominal, line.channels[c])[0]
    axis = line.car.coordinates.index("pitch")
    weights = np.linalg.pinv(rows)[axis]
    return weights if abs(float(weights @ rows[:, axis]) - 1.0) < 1e-6 else None


def _pitch_acceleration(line: PreparedRecording, own: int, time: Array) -> Array:
    """Pitch acceleration (rad/s²) from all outputs at the times of one of them."""
    weights = _to_pitch(line)
    assert weights is not None
    out = np.zeros(len(time))
    for y, weight in enumerate(weights):
        if weight == 0.0:
            continue
        use = line.kind[:, y] != MISSING if y == own else line.kind[:, y] == VALUE
        at, reading = line.instants[use], line.reading[use, y]
        out += weight * (reading if y == own else CubicSpline(at, reading)(time))
    return out


def _change(fault: Fault, time: Array, signal: Array, corner: float | None) -> Array:
    """Return what the fault adds to a channel's samples (N,)."""
    if fault.kind == "gain":
        return fault.size * signal
    if fault.kind == "delay":
        return np.asarray(fault.size * CubicSpline(time, signal)(time, 1))
    # ∂/∂log ω of ω/(s + ω) is s/(s + ω) of what already passed the pole.
    assert corner is not None
    slow = low_passed(time, CubicSpline(time, signal).c, 2.0 * math.pi * corner)
    return np.asarray(fault.size * (signal - slow))
