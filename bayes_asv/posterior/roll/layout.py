"""A recording of seven channels laid out as the steps and readings that the recursion takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import ROLL_CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations, require_roll_car, sample_times
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.discretization import ORDER
from bayes_asv.filters.kalman import AT_LEAST, AT_MOST, MISSING, VALUE
from bayes_asv.filters.kalman_roll import STATES
from bayes_asv.models.from_vehicle import roll_car
from bayes_asv.models.roll_car import RollCar, deflections, sensor_places
from bayes_asv.preprocessing.timeline import FEWEST_READINGS, common_bandwidth, rails
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments, wheel_signal

__all__ = ["RollLayout", "lay_out"]

Array = NDArray[np.float64]

_LONGEST_STEP = 0.005  # s; the same bounds as for the half car, see preprocessing/timeline.py
_LONGEST_PHASE = 0.25
_SAME_INSTANT = 1e-8  # s
_DEFLECTION, _RATE = 0.1, 1.0  # m and m/s, one deviation of the state when a record begins
_BIAS = 0.5**0.5  # m/s², of one sensor: 1 m/s² of one against another, as for the half car


@dataclass(frozen=True)
class RollLayout:
    """One recording, ready for :mod:`bayes_asv.filters.kalman_roll`.

    Parameters
    ----------
    step, moments, spread, kind, reading, start
        As the kernel takes them; see there for shapes and units.
    instants : (N,) array
        Times of the steps' ends, s.
    acceleration, times : (7, R) arrays
        All channels in m/s², NaN where missing, bandwidths made equal, and when each reading was
        taken, s.
    clipped : (7, R) bool array
        Readings at a rail.
    noise : 7-tuple of float or None
        Given deviation of one sample of each channel, m/s².
    steps, poles : (7,) arrays
        One step of each channel's reading, m/s², and the pole of the filter that all readings
        passed, rad/s; 0 where not given.
    source : str
        File name without its folder.
    """

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    reading: Array
    start: Array
    instants: Array
    acceleration: Array
    times: Array
    clipped: NDArray[np.bool_]
    noise: tuple[float | None, ...]
    steps: Array
    poles: Array
    source: str


def lay_out(recording: Recording, vehicle: Vehicle) -> RollLayout:
    """Lay a recording out in time.

    Parameters
    ----------
    recording : Recording
        Of the channels `ROLL_CHANNELS`.
    vehicle : Vehicle
        With a ``[roll]``; gives calibration, delays, ranges and bandwidths.

    Returns
    -------
    RollLayout

    Raises
    ------
    InputError
        When the channels are others, the vehicle does not roll, or a channel has fewer than
        :data:`~bayes_asv.preprocessing.timeline.FEWEST_READINGS` readings inside its range.
    """
    require_roll_car(recording)
    car = roll_car(vehicle)
    acc, times = accelerations(recording, vehicle), sample_times(recording, vehicle)
    low, high = rails(acc, vehicle, ROLL_CHANNELS)
    for c, name in enumerate(ROLL_CHANNELS):
        if np.count_nonzero(np.isfinite(acc[c]) & ~(low[c] | high[c])) < FEWEST_READINGS:
            raise InputError(
                recording.source,
                f"channel {name} has fewer than {FEWEST_READINGS} readings inside its range",
                "check the wiring, the column and the vehicle's range for that sensor",
            )
    sensors = [vehicle.sensor(name) for name in ROLL_CHANNELS]
    acc, poles = common_bandwidth(acc, times, [s.bandwidth for s in sensors])
    steps = np.array(
        [
            s.resolution or (abs(s.counts_scale or 0.0) if unit == "counts" else 0.0)
            for s, unit in zip(sensors, recording.units, strict=True)
        ]
    )
    wheels = [wheel_signal(times[c], acc[c], low[c], high[c]) for c in range(4)]
    fastest = float(np.max(np.abs(np.linalg.eigvals(deflections(car).A))))
    longest = min(_LONGEST_STEP, _LONGEST_PHASE / fastest)
    instants, kind, reading = _instants(acc, times, (low, high), wheels, longest)
    return RollLayout(
        step=np.diff(instants, prepend=instants[0]),
        moments=np.ascontiguousarray(
            np.stack([moments(w, instants, ORDER) for w in wheels], axis=1)
        ),
        spread=_spread(wheels, instants),
        kind=kind,
        reading=reading,
        start=_start(car),
        instants=instants,
        acceleration=acc,
        times=times,
        clipped=low | high,
        noise=tuple(s.noise for s in sensors),
        steps=steps,
        poles=poles,
        source=Path(recording.source).name,
    )


def _start(car: RollCar) -> Array:
    """Prior covariance of deflections and biases; filtered noise is added by the posterior.

    Seven biases of one size are four that matter: with G the pseudo-inverse of the corners, the
    wheels' biases u are a motion g = G u of the whole chassis and a part along the warp.  The first
    counts against the chassis' own biases, b = y − P g.
    """
    covariance = np.zeros((STATES, STATES))
    covariance[:4, :4] = _DEFLECTION**2 * np.eye(4)
    covariance[4:8, 4:8] = _RATE**2 * np.eye(4)
    carried = sensor_places(car) @ np.linalg.pinv(car.corners)
    covariance[8:11, 8:11] = _BIAS**2 * (np.eye(3) + carried @ carried.T)
    covariance[11, 11] = _BIAS**2
    return covariance


def _instants(
    acc: Array,
    times: Array,
    at_rail: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    wheels: list[WheelSignal],
    longest: float,
) -> tuple[Array, NDArray[np.int8], Array]:
    """Instants of observation in order, with fillers where the step would be too long."""
    low, high = at_rail
    first = max(w.knots[0] for w in wheels)
    last = min(w.knots[-1] for w in wheels)
    uses = [np.isfinite(acc[c]) & (times[c] >= first) & (times[c] <= last) for c in (4, 5, 6)]
    t = np.concatenate([times[4 + y, use] for y, use in enumerate(uses)])
    if len(t) < 2:
        raise InputError(
            "recording", "wheels and chassis were not measured at one time", "check delays"
        )
    which = np.repeat(np.arange(3), [np.count_nonzero(use) for use in uses])
    row = np.concatenate([np.flatnonzero(use) for use in uses])
    order = np.argsort(t, kind="stable")
    t, which, row = t[order], which[order], row[order]
    new = np.append(True, np.diff(t) > _SAME_INSTANT)
    place, seen = np.cumsum(new) - 1, t[new]
    pieces = np.maximum(np.ceil(np.diff(seen) / longest - 1e-9).astype(int), 1)
    position = np.concatenate([[0], np.cumsum(pieces)])
    total = int(position[-1]) + 1
    instants = np.interp(np.arange(total), position, seen)
    instants[position] = seen
    kind = np.full((total, 3), MISSING, np.int8)
    reading = np.zeros((total, 3))
    at, c = position[place], 4 + which
    kind[at, which] = np.where(high[c, row], AT_LEAST, np.where(low[c, row], AT_MOST, VALUE))
    reading[at, which] = acc[c, row]
    return instants, kind, reading


def _spread(wheels: list[WheelSignal], instants: Array) -> Array:
    """How a sample's noise and its surroundings drive the states over each step."""
    middle = 0.5 * (instants + np.append(instants[0], instants[:-1]))
    out = np.zeros((len(instants), 8))
    for u, wheel in enumerate(wheels):
        at = np.clip(np.searchsorted(wheel.knots, middle) - 1, 0, len(wheel.knots) - 2)
        spacing = np.diff(wheel.knots)[at]
        out[:, u] = spacing
        out[:, 4 + u] = wheel.deviation[at] ** 2 * spacing
    return out
