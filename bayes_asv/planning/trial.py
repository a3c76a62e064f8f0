"""One planned drive: driven on paper, judged as a recording would be, and asked what it says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.planning.grid import Planned
from bayes_asv.planning.information import SEEN, information
from bayes_asv.planning.motion import Motion
from bayes_asv.planning.sensing import Felt, extremes, feel, record
from bayes_asv.posterior.map_fit import lay_out
from bayes_asv.preprocessing.data_checks import PLAIN

__all__ = ["Trial", "attempt"]

Array = NDArray[np.float64]

# A wheel off the ground is measured like any other, and estimates of the rig stay honest; but in
# a flight of 0.15 s a car falls 11 cm, which is where droop stops are and drivers stop repeating.
_LONGEST_FLIGHT = 0.15  # s
_NOTICED_FLIGHT = 0.02  # s
_FULL_SCALE = 0.8  # share of a sensor's range that leaves room for what a plan cannot know


@dataclass(frozen=True)
class Trial:
    """What one drive of the grid would be worth.

    Parameters
    ----------
    drive : Planned
        The drive.
    reasons : tuple of str
        Why it cannot be used; empty when it can.
    notes : tuple of str
        What to expect otherwise.
    gentle : bool
        No wheel leaves the ground, and no sensor comes near the end of its range.
    information : (6, 6) array
        Of one pass, about the logarithms of :data:`~bayes_asv.planning.information.SEEN`; zero
        when the drive cannot be used.
    largest : (4,) array
        Largest reading of each channel, m/s².
    travel : (4,) array
        Front bump, front droop, rear bump, rear droop that it takes, m.
    flight : (2,) array
        Longest time that front and rear wheels are off the ground, s.
    """

    drive: Planned
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    gentle: bool
    information: Array
    largest: Array
    travel: Array
    flight: Array

    @property
    def usable(self) -> bool:
        """Whether the drive can answer at all."""
        return not self.reasons


def attempt(
    vehicle: Vehicle, drives: Sequence[Planned], motions: Sequence[Motion], seed: int
) -> list[Trial]:
    """Judge the drives that go over one ground at one speed and differ in rate.

    Parameters
    ----------
    vehicle : Vehicle
        With a noise for every sensor; its values are the truth.
    drives : sequence of Planned
        The drives.
    motions : sequence of Motion
        What they do to the car: several for a rough road, no two of which are alike.
    seed : int
        Of the sensors' noise.

    Returns
    -------
    list of Trial
        One a drive.
    """
    felt = [feel(vehicle, motion) for motion in motions]
    travel = np.max([_travel(motion) for motion in motions], axis=0)
    flight = np.max([motion.flight for motion in motions], axis=0)
    shape = [*_beyond_travel(vehicle, travel), *_too_long_in_the_air(flight)]
    air = _in_the_air(flight)
    found = []
    for drive in drives:
        low_high = np.array([extremes(one, drive.seconds) for one in felt])
        share = _range_used(vehicle, low_high)
        # what the car cannot do at any rate need not be asked what it says
        reasons, notes, gathered = _ask(vehicle, drive, () if shape else felt, seed)
        full = [PLAIN[n] for n, used in zip(CHANNELS, share, strict=True) if used > _FULL_SCALE]
        if full and not notes:
            notes = [
                f"the {_listed(full)} would come near the end of its range "
                f"({100.0 * float(share.max()):.0f} % of it)"
            ]
        reasons = shape + reasons
        found.append(
            Trial(
                drive=drive,
                reasons=tuple(reasons),
                notes=() if reasons else (*air, *notes),
                gentle=not (reasons or air or full),
                information=np.zeros_like(gathered) if reasons else gathered,
                largest=np.max(np.abs(low_high), axis=(0, 2)),
                travel=travel,
                flight=flight,
            )
        )
    return found


def _ask(
    vehicle: Vehicle, drive: Planned, felt: Sequence[Felt], seed: int
) -> tuple[list[str], list[str], Array]:
    """Reasons against a drive's recordings, clipped readings in words, and what they say."""
    clipped = np.zeros(len(CHANNELS), np.int64)
    gathered = np.zeros((len(SEEN), len(SEEN)))
    for number, one in enumerate(felt):
        recording = record(vehicle, one, drive.rate, drive.seconds, seed + number)
        lines, why, _ = lay_out([recording], vehicle)
        if why:
            return list(why), [], gathered
        gathered += information(lines[0], vehicle) / len(felt)
        clipped = np.maximum(clipped, lines[0].clipped.sum(axis=1))
    notes = [
        f"the {PLAIN[name]} sensor would reach the end of its range in {count} of "
        f"{round(drive.seconds * drive.rate)} samples"
        for name, count in zip(CHANNELS, clipped, strict=True)
        if count
    ]
    return [], notes, gathered


def _listed(names: Sequence[str]) -> str:
    """``front chassis sensor``, or several of them with an and."""
    return f"{' and the '.join(names)} sensor"


def _travel(motion: Motion) -> Array:
    """Front bump, front droop, rear bump, rear droop of one motion, m, never negative."""
    low, high = motion.deflection.min(axis=1), motion.deflection.max(axis=1)
    return np.asarray(np.maximum([-low[0], high[0], -low[1], high[1]], 0.0))


def _beyond_travel(vehicle: Vehicle, travel: Array) -> list[str]:
    """Reasons where the suspension would reach a stop that the vehicle file gives."""
    given = (
        ("front", "bump", vehicle.travel.front_bump),
        ("front", "droop", vehicle.travel.front_droop),
        ("rear", "bump", vehicle.travel.rear_bump),
        ("rear", "droop", vehicle.travel.rear_droop),
    )
    return [
        f"the {axle} suspension would need {_length(needed, vehicle)} of {which} and has "
        f"{_length(there, vehicle)}; drive slower or over something lower"
        for (axle, which, there), needed in zip(given, travel, strict=True)
        if there is not None and needed > there
    ]


def _length(value: float, vehicle: Vehicle) -> str:
    return f"{value / 0.0254:.1f} in" if vehicle.units == "US" else f"{1e3 * value:.0f} mm"


def _too_long_in_the_air(flight: Array) -> list[str]:
    return [
        f"the {axle} wheels would be off the ground for {time:.2f} s at a stretch; drive slower "
        "or over something lower"
        for axle, time in zip(("front", "rear"), flight, strict=True)
        if time > _LONGEST_FLIGHT
    ]


def _in_the_air(flight: Array) -> list[str]:
    return [
        f"the {axle} wheels would leave the ground for {time:.2f} s"
        for axle, time in zip(("front", "rear"), flight, strict=True)
        if time > _NOTICED_FLIGHT
    ]


def _range_used(vehicle: Vehicle, low_high: Array) -> Array:
    """Share (4,) of each sensor's range that the largest reading takes; 0 without a range."""
    low, high = low_high[:, :, 0].min(axis=0), low_high[:, :, 1].max(axis=0)
    used = np.zeros(len(CHANNELS))
    for c, sensor in enumerate(vehicle.sensors):
        if np.isfinite(sensor.high) and sensor.high > 0.0:
            used[c] = max(used[c], high[c] / sensor.high)
        if np.isfinite(sensor.low) and sensor.low < 0.0:
            used[c] = max(used[c], low[c] / sensor.low)
    return used
