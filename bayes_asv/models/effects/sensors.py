"""Sensors that are not as declared: scale, lag, corner frequency and drift of a channel.

``factor``: on the reading.  ``lag``: sampling delay beyond the declared one.  ``bandwidth``: factor
on the corner frequency of the sensor's filter.  ``slope``: drift of the offset, m/s² per second;
for other quantities, in proportion to the offset
(:func:`bayes_asv.models.outputs.relative_offset`).
"""

from __future__ import annotations

from bayes_asv.domain.channels import KNOWN_CHANNELS
from bayes_asv.models.effects.base import Effect, Parameter

__all__ = ["BANDWIDTH", "DRIFT", "GAIN", "LAG"]

GAIN = Effect(
    name="sensor_gain",
    title="a wrong gain",
    acts="reading",
    allowed_places=KNOWN_CHANNELS,
    parameters=(Parameter("factor", "", "log", 1.0, 0.1, (1.0,)),),
    tolerance_values={"factor": 1.003},
    on_gain=lambda values: values["factor"],
    drive="turn the sensor over on a level table: it must read plus and minus one g",
)
# A board may be late by a sample or two at 400 Hz.  With a prior sd of 1 ms, a lag of 5 ms was
# attributed in halves to the wheel and to the chassis above it.
LAG = Effect(
    name="sensor_lag",
    title="an undeclared delay",
    acts="reading",
    allowed_places=KNOWN_CHANNELS,
    parameters=(Parameter("lag", "s", "linear", 0.0, 2.5e-3, (0.0,)),),
    tolerance_values={"lag": 1.5e-5},
    fault="lag",
    drive="shake all sensors on one plate",
)
BANDWIDTH = Effect(
    name="sensor_bandwidth",
    title="a bandwidth other than declared",
    acts="reading",
    allowed_places=KNOWN_CHANNELS,
    parameters=(Parameter("bandwidth", "share", "log", 1.0, 0.4, (1.0,)),),
    tolerance_values={"bandwidth": 1.02},
    on_pole=lambda values: values["bandwidth"],  # the sensor's noise passes the actual filter
    fault="bandwidth",
    drive="shake all sensors on one plate",
)
DRIFT = Effect(
    name="sensor_drift",
    title="a drifting offset",
    acts="reading",
    allowed_places=KNOWN_CHANNELS,
    parameters=(Parameter("slope", "m/s^3", "linear", 0.0, 0.5, (0.0,)),),
    tolerance_values={"slope": 0.005},
    fault="drift",
    drive="leave the car parked for a minute",
)
