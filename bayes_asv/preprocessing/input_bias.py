"""Biases of the measured inputs, and the equilibrium position of the suspension.

To a linear car a bias of a wheel sensor is a bias of the body's sensors: both move together.  A
spring that stiffens or a stop that is met depends on where the suspension is.  A bias of 0.1 m/s²
moves the rest of a car that bounces at 1.4 Hz by 1.3 mm, in every run by another amount, and a stop
that is touched by half a millimetre is missed or met twice as hard.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.filters.kalman import ORDER
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["INPUT_BIAS_SD", "unit_input_moments", "without_mean_input"]

Array = NDArray[np.float64]

INPUT_BIAS_SD = 0.15
"""How well the mean reading gives a bias, m/s²: the wheel's speed at both ends over the time."""


def unit_input_moments(line: PreparedRecording) -> Array:
    """Moments (E, ORDER) of an input of 1 m/s²."""
    time = line.wheels[0].knots
    one = WheelSignal(CubicSpline(time, np.ones_like(time)), time, line.wheels[0].deviation)
    return moments(one, line.instants, ORDER)


def without_mean_input(line: PreparedRecording) -> PreparedRecording:
    """Return a recording whose inputs have mean zero; the body above them reads as much less.

    Beginning and end count little: what a wheel's speed is there does not average out.
    """
    rest = np.array([_mean(wheel) for wheel in line.wheels])
    wheels = tuple(
        wheel._replace(spline=CubicSpline(wheel.knots, wheel.spline(wheel.knots) - level))
        for wheel, level in zip(line.wheels, rest, strict=True)
    )
    return replace(
        line,
        moments=line.moments - rest[:, None] * unit_input_moments(line)[:, None],
        reading=line.reading - line.rigid_gain @ rest,
        wheels=wheels,
    )


def _mean(wheel: WheelSignal) -> float:
    weight = np.hanning(len(wheel.knots) + 2)[1:-1]
    return float(np.average(wheel.spline(wheel.knots), weights=weight))
