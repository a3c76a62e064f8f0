"""What a model foretells from wheels that carry next to no noise.

A wheel's noise drives the simulation and the innovations alike.  A pattern or a derivative that
follows from the simulation must not have it: a lag of 2.3 ms of a chassis sensor came out 15 %
short, and a narrower filter fitted better than the lag that was there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.channels import CHANNELS
from bayes_asv.inference.denoised import clear_wheel
from bayes_asv.inference.freerun import free_run, simulated
from bayes_asv.inference.likelihood import Target
from bayes_asv.inference.timeline import Timeline
from bayes_asv.inference.wheel_noise import without_noise
from bayes_asv.inference.wheels import WheelSignal, moments
from bayes_asv.kernels.innovations import ORDER
from bayes_asv.vehicle import Vehicle

__all__ = ["Calm", "above", "calm"]

Array = NDArray[np.float64]


class Calm(NamedTuple):
    """A recording on quiet wheels.

    Parameters
    ----------
    line : Timeline
        With moments of quiet wheels, and wheels that have lost what the chassis show to be noise.
    before, after : (E, 2) arrays
        What sensors as declared would have read of the chassis above the wheels as they are, and
        above quiet ones, m/s².
    """

    line: Timeline
    before: Array
    after: Array


def calm(target: Target, z: Array, run: int, vehicle: Vehicle) -> Calm:
    """Quieten the wheels of a recording, and simulate the chassis above them.

    Parameters
    ----------
    target : Target
        With patterns.
    z : (D,) array
        Coordinates.
    run : int
        Which recording.
    vehicle : Vehicle
        Gives declared bandwidths.
    """
    line = without_noise(target, z, run)
    driven = line.moments.copy()
    for axle, wheel in enumerate(line.wheels):
        knots, signal = clear_wheel(line, axle, vehicle.sensor(CHANNELS[2 * axle]).bandwidth)
        quiet = WheelSignal(CubicSpline(knots, signal), knots, wheel.deviation)
        driven[:, axle] = moments(quiet, line.instants, ORDER)
    still = replace(line, moments=driven)
    begin = free_run(target, z, run)[2]
    before, after = (
        simulated(target, z, run, target.as_declared(z, run, one), begin)[0]
        for one in (line, still)
    )
    return Calm(still, before, after)


def above(target: Target, z: Array, run: int) -> Array:
    """Simulate what chassis sensors as declared would have read (E, 2) of a run, m/s²."""
    begin = free_run(target, z, run)[2]
    return simulated(target, z, run, target.as_declared(z, run), begin)[0]
