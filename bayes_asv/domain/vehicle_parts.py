"""Parts of a vehicle's description, all in SI: values, travel, sensors, wheels and tyres, roll."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Given", "Nominal", "Roll", "Sensor", "Travel", "Unsprung"]


@dataclass(frozen=True, slots=True)
class Given:
    """A value that is known, in SI, with its standard deviation (zero: exact)."""

    value: float
    sd: float = 0.0


@dataclass(frozen=True, slots=True)
class Nominal:
    """A value to start from, in SI; `sd` is the prior's deviation, None for the usual prior."""

    value: float
    sd: float | None = None


@dataclass(frozen=True, slots=True)
class Travel:
    """Suspension travel from rest to the stop, m, positive; bump is compression.

    None where it is not known.
    """

    front_bump: float | None = None
    front_droop: float | None = None
    rear_bump: float | None = None
    rear_droop: float | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """One accelerometer as mounted; None where a figure is not known.

    Parameters
    ----------
    zero_counts : float or None
        Reading at rest, counts.
    counts_scale : float or None
        Acceleration per count, m/s^2; negative when mounted upside down.
    low, high : float
        Ends of the range, m/s^2.
    noise : float or None
        Root-mean-square noise of one sample, quantising left out, m/s^2.
    resolution : float or None
        One step of the reading, m/s^2.
    bandwidth : float or None
        Corner of the output filter (one pole), Hz.
    delay : float
        Sampled this much later than the row's time, s.
    counts_scale_sd : float
        Standard deviation of `counts_scale`, m/s^2 (zero: exact).
    """

    zero_counts: float | None = None
    counts_scale: float | None = None
    low: float = -math.inf
    high: float = math.inf
    noise: float | None = None
    resolution: float | None = None
    bandwidth: float | None = None
    delay: float = 0.0
    counts_scale_sd: float = 0.0


@dataclass(frozen=True, slots=True)
class Unsprung:
    """Wheels and tyres, both sides of an axle together.

    Parameters
    ----------
    front_mass, rear_mass : float
        Wheels, hubs and the half of the links, kg.
    front_tyre_rate, rear_tyre_rate : float
        N/m.
    front_tyre_damping, rear_tyre_damping : float
        N·s/m.
    """

    front_mass: float
    rear_mass: float
    front_tyre_rate: float
    rear_tyre_rate: float
    front_tyre_damping: float = 0.0
    rear_tyre_damping: float = 0.0


@dataclass(frozen=True, slots=True)
class Roll:
    """What a car needs to roll.

    Parameters
    ----------
    front_track, rear_track : Given
        Between the middles of the tyres, m.
    inertia : Nominal
        Roll inertia of the sprung mass about its centre of gravity, kg·m².
    front_bar, rear_bar : float
        Anti-roll bars: force at either wheel per difference of the two deflections, N/m.
    front_sensors : float or None
        Distance between the two front chassis sensors, m; None for the front track.
    """

    front_track: Given
    rear_track: Given
    inertia: Nominal
    front_bar: float = 0.0
    rear_bar: float = 0.0
    front_sensors: float | None = None
