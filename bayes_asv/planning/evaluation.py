"""Evaluation of candidate drives: data checks, limits of car and sensors, Fisher information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS, channel
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.planning.drives import Drive
from bayes_asv.planning.information import IDENTIFIABLE, fisher_information
from bayes_asv.planning.measurement import (
    FilteredMotion,
    filter_motion,
    reading_extremes,
    simulate_recording,
)
from bayes_asv.planning.ride_simulation import Motion
from bayes_asv.posterior.map_fit import lay_out

__all__ = ["Evaluation", "evaluate"]

Array = NDArray[np.float64]

# The estimator needs no contact with the ground.  But in 0.15 s a car falls 11 cm: the suspension
# reaches its droop stops, and few drivers repeat such a jump.
_MAX_AIRBORNE = 0.15  # s
_NOTICEABLE_AIRBORNE = 0.02  # s
_MAX_RANGE_USE = 0.8  # fraction of a sensor's range, with a margin for errors of the prediction


@dataclass(frozen=True)
class Evaluation:
    """Feasibility and Fisher information of one candidate drive.

    Parameters
    ----------
    drive : Drive
        The drive.
    reasons : tuple of str
        Why the drive cannot be used; empty if it can.
    notes : tuple of str
        Remarks about a usable drive.
    gentle : bool
        Whether no wheel leaves the ground and no sensor comes near the end of its range.
    information : (6, 6) array
        Fisher information of one pass about the logarithms of
        :data:`~bayes_asv.planning.information.IDENTIFIABLE`; zero if the drive cannot be used.
    largest : (4,) array
        Largest absolute reading of each channel, m/s².
    travel : (4,) array
        Required front bump, front droop, rear bump and rear droop, m.
    airborne : (2,) array
        Longest uninterrupted time of the front and rear wheels off the ground, s.
    """

    drive: Drive
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    gentle: bool
    information: Array
    largest: Array
    travel: Array
    airborne: Array

    @property
    def usable(self) -> bool:
        """Whether the drive can be used."""
        return not self.reasons


def evaluate(
    vehicle: Vehicle, drives: Sequence[Drive], motions: Sequence[Motion], seed: int
) -> list[Evaluation]:
    """Evaluate drives over one road at one speed that differ in sampling rate.

    Parameters
    ----------
    vehicle : Vehicle
        With noise for every sensor; its values are taken as true.
    drives : sequence of Drive
        The drives.
    motions : sequence of Motion
        Response of the car, for several realisations of a rough road.
    seed : int
        Seed of the sensor noise.

    Returns
    -------
    list of Evaluation
        One per drive.
    """
    filtered = [filter_motion(vehicle, motion) for motion in motions]
    travel = np.max([_travel(motion) for motion in motions], axis=0)
    airborne = np.max([motion.airborne for motion in motions], axis=0)
    rate_independent = [*_travel_reasons(vehicle, travel), *_airborne_reasons(airborne)]
    jumps = _airborne_notes(airborne)
    evaluations = []
    for drive in drives:
        extremes = np.array([reading_extremes(one, drive.seconds) for one in filtered])
        range_use = _range_used(vehicle, extremes)
        # a drive that exceeds the limits of the car needs no Fisher information
        reasons, notes, information = _evaluate_recordings(
            vehicle, drive, () if rate_independent else filtered, seed
        )
        near_limit = [
            channel(n).words
            for n, used in zip(CHANNELS, range_use, strict=True)
            if used > _MAX_RANGE_USE
        ]
        if near_limit and not notes:
            notes = [
                f"the {_join(near_limit)} would come near the end of its range "
                f"({100.0 * float(range_use.max()):.0f} % of it)"
            ]
        reasons = rate_independent + reasons
        evaluations.append(
            Evaluation(
                drive=drive,
                reasons=tuple(reasons),
                notes=() if reasons else (*jumps, *notes),
                gentle=not (reasons or jumps or near_limit),
                information=np.zeros_like(information) if reasons else information,
                largest=np.max(np.abs(extremes), axis=(0, 2)),
                travel=travel,
                airborne=airborne,
            )
        )
    return evaluations


def _evaluate_recordings(
    vehicle: Vehicle, drive: Drive, filtered: Sequence[FilteredMotion], seed: int
) -> tuple[list[str], list[str], Array]:
    """Return reasons against a drive's recordings, notes on clipping, and mean information."""
    clipped = np.zeros(len(CHANNELS), np.int64)
    information = np.zeros((len(IDENTIFIABLE), len(IDENTIFIABLE)))
    for number, one in enumerate(filtered):
        recording = simulate_recording(vehicle, one, drive.rate, drive.seconds, seed + number)
        prepared, reasons, _ = lay_out([recording], vehicle)
        if reasons:
            return list(reasons), [], information
        information += fisher_information(prepared[0], vehicle) / len(filtered)
        clipped = np.maximum(clipped, prepared[0].clipped.sum(axis=1))
    notes = [
        f"the {channel(name).words} sensor would reach the end of its range in {count} of "
        f"{round(drive.seconds * drive.rate)} samples"
        for name, count in zip(CHANNELS, clipped, strict=True)
        if count
    ]
    return [], notes, information


def _join(names: Sequence[str]) -> str:
    """Join channel names: ``front wheel and the rear wheel sensor``."""
    return f"{' and the '.join(names)} sensor"


def _travel(motion: Motion) -> Array:
    """Return front bump, front droop, rear bump and rear droop of one motion, m."""
    low, high = motion.deflection.min(axis=1), motion.deflection.max(axis=1)
    return np.asarray(np.maximum([-low[0], high[0], -low[1], high[1]], 0.0))


def _travel_reasons(vehicle: Vehicle, travel: Array) -> list[str]:
    """Return a reason for each declared stop that the suspension would reach."""
    given = (
        ("front", "bump", vehicle.travel.front_bump),
        ("front", "droop", vehicle.travel.front_droop),
        ("rear", "bump", vehicle.travel.rear_bump),
        ("rear", "droop", vehicle.travel.rear_droop),
    )
    return [
        f"the {axle} suspension would need {_length(needed, vehicle)} of {direction} and has "
        f"{_length(available, vehicle)}; drive slower or over something lower"
        for (axle, direction, available), needed in zip(given, travel, strict=True)
        if available is not None and needed > available
    ]


def _length(value: float, vehicle: Vehicle) -> str:
    return f"{value / 0.0254:.1f} in" if vehicle.units == "US" else f"{1e3 * value:.0f} mm"


def _airborne_reasons(airborne: Array) -> list[str]:
    return [
        f"the {axle} wheels would be off the ground for {time:.2f} s without a break; drive slower "
        "or over something lower"
        for axle, time in zip(("front", "rear"), airborne, strict=True)
        if time > _MAX_AIRBORNE
    ]


def _airborne_notes(airborne: Array) -> list[str]:
    return [
        f"the {axle} wheels would leave the ground for {time:.2f} s"
        for axle, time in zip(("front", "rear"), airborne, strict=True)
        if time > _NOTICEABLE_AIRBORNE
    ]


def _range_used(vehicle: Vehicle, extremes: Array) -> Array:
    """Return the fraction (4,) of each sensor's range used; 0 without a declared range."""
    low, high = extremes[:, :, 0].min(axis=0), extremes[:, :, 1].max(axis=0)
    used = np.zeros(len(CHANNELS))
    for c, sensor in enumerate(vehicle.sensors_of(CHANNELS)):
        if np.isfinite(sensor.high) and sensor.high > 0.0:
            used[c] = max(used[c], high[c] / sensor.high)
        if np.isfinite(sensor.low) and sensor.low < 0.0:
            used[c] = max(used[c], low[c] / sensor.low)
    return used
