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

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import MISSING, ORDER, VALUE
from bayes_asv.filters.one_pole import low_passed
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["Fault", "faults", "with_fault"]

Array = NDArray[np.float64]

# Sizes that a careful team may well overlook: a data sheet's tolerance of scale and corner
# frequency, a tenth of a millisecond of a converter's order, a mount an inch off its axle.
_GAIN, _DELAY, _BANDWIDTH, _PLACE = 0.01, 1e-4, 0.10, 0.0254


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


def faults(vehicle: Vehicle) -> list[Fault]:
    """List the faults that this vehicle's sensors may have."""
    found = [Fault("gain", channel, _GAIN) for channel in CHANNELS]
    found += [Fault("delay", channel, _DELAY) for channel in CHANNELS]
    found += [
        Fault("bandwidth", channel, _BANDWIDTH)
        for channel in CHANNELS
        if vehicle.sensor(channel).bandwidth is not None
    ]
    return found + [Fault("place", channel, _PLACE) for channel in CHANNELS[1::2]]


def with_fault(line: PreparedRecording, fault: Fault, vehicle: Vehicle) -> PreparedRecording:
    """Return a recording as the faulty sensor would have taken it.

    Parameters
    ----------
    line : PreparedRecording
        As it was taken.
    fault : Fault
        What is wrong with one sensor.
    vehicle : Vehicle
        Gives declared bandwidths and the wheelbase.

    Returns
    -------
    PreparedRecording
        With other readings of one channel, to first order in the size of the fault.
    """
    c = CHANNELS.index(fault.channel)
    axle = c // 2
    corner = vehicle.sensor(fault.channel).bandwidth
    if c % 2 == 0:
        wheel = line.wheels[axle]
        change = _change(fault, wheel.knots, wheel.spline(wheel.knots), corner)
        signal = WheelSignal(CubicSpline(wheel.knots, change), wheel.knots, wheel.deviation)
        driven = line.moments.copy()
        driven[:, axle] += moments(signal, line.instants, ORDER)
        return replace(line, moments=driven)
    there = line.kind[:, axle] != MISSING
    time, reading = line.instants[there], line.reading[there, axle]
    if fault.kind == "place":
        other = line.kind[:, 1 - axle] == VALUE
        beyond = CubicSpline(line.instants[other], line.reading[other, 1 - axle])(time)
        ahead = 1.0 if axle == 0 else -1.0
        change = ahead * fault.size / vehicle.l.value * (reading - beyond)
    else:
        change = _change(fault, time, reading, corner)
    readings = line.reading.copy()
    readings[there, axle] += change
    return replace(line, reading=readings)


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
