"""Evaluation of candidate drives: data checks, limits of car and sensors, Fisher information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.units import INCH
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel, Output
from bayes_asv.planning.drives import Drive
from bayes_asv.planning.measurement import (
    FilteredMotion,
    filter_motion,
    reading_extremes,
    simulate_recording,
)
from bayes_asv.planning.ride_simulation import Motion
from bayes_asv.posterior.information import ParameterPrior, fisher_information, make_parameter_prior
from bayes_asv.preprocessing.run_preparation import prepare_runs

__all__ = ["Evaluation", "MeasuredCar", "evaluate", "measured_car"]

Array = NDArray[np.float64]

# The estimator needs no contact with the ground.  But in 0.15 s a car falls 11 cm: the suspension
# reaches its droop stops, and few drivers repeat such a jump.
_MAX_AIRBORNE = 0.15  # longest time off the ground of a usable drive, s
_NOTICEABLE_AIRBORNE = 0.02  # time off the ground from which it is reported, s
# Largest usable fraction of a sensor's range, with a margin for errors of the prediction.
_MAX_RANGE_USE = 0.8


@dataclass(frozen=True)
class MeasuredCar:
    """A car and the sensors at hand.

    Parameters
    ----------
    vehicle : Vehicle
        Vehicle with noise for every sensor; its values are assumed to be true.
    car : CarModel
        Its model.
    channels : tuple of Channel
        The C measured channels.
    about : ParameterPrior
        Parameters of the car with their priors, and what these channels determine of them.
    """

    vehicle: Vehicle
    car: CarModel
    channels: tuple[Channel, ...]
    about: ParameterPrior


def measured_car(vehicle: Vehicle, car: CarModel, channels: Sequence[Channel]) -> MeasuredCar:
    """Put a car and its channels together."""
    outputs = [Output(channel) for channel in channels if not channel.is_input]
    return MeasuredCar(vehicle, car, tuple(channels), make_parameter_prior(car, outputs))


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
    information : (nT, nT) array
        Fisher information of one pass about the logarithms of the car's unknowns; zero if the
        drive cannot be used.
    largest : (C,) array
        Largest absolute reading of each channel, SI units.
    travel : dict of str to float
        Required ``front_bump``, ``front_droop`` and so on of each axle, m.
    airborne : dict of str to float
        Longest uninterrupted time of the wheels of each axle off the ground, s.
    """

    drive: Drive
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    gentle: bool
    information: Array
    largest: Array
    travel: dict[str, float]
    airborne: dict[str, float]

    @property
    def usable(self) -> bool:
        """Whether the drive can be used."""
        return not self.reasons


def evaluate(
    measured: MeasuredCar, drives: Sequence[Drive], motions: Sequence[Motion], seed: int
) -> list[Evaluation]:
    """Evaluate drives over one road at one speed that differ in sampling rate.

    Parameters
    ----------
    measured : MeasuredCar
        The car and its sensors.
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
    vehicle, car, channels = measured.vehicle, measured.car, measured.channels
    filtered = [filter_motion(vehicle, motion, channels) for motion in motions]
    travel = _travel(car, motions)
    airborne = {
        axle: max(float(motion.airborne[e]) for motion in motions for e in car.elements_at(axle))
        for axle in car.axles
    }
    rate_independent = [*_travel_reasons(vehicle, travel), *_airborne_reasons(airborne)]
    jumps = _airborne_notes(airborne)
    evaluations = []
    for drive in drives:
        extremes = np.array([reading_extremes(one, drive.seconds) for one in filtered])
        range_use = _range_used(vehicle, channels, extremes)
        # a drive that exceeds the limits of the car needs no Fisher information
        reasons, notes, information = _evaluate_recordings(
            measured, drive, () if rate_independent else filtered, seed
        )
        near_limit = [
            channel.words
            for channel, used in zip(channels, range_use, strict=True)
            if used > _MAX_RANGE_USE
        ]
        if near_limit and not notes:
            notes = [
                f"the {_sensor_list(near_limit)} would come near the end of its range "
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
    measured: MeasuredCar, drive: Drive, filtered: Sequence[FilteredMotion], seed: int
) -> tuple[list[str], list[str], Array]:
    """Return reasons against a drive's recordings, notes on clipping, and mean information."""
    vehicle, parameter_prior = measured.vehicle, measured.about
    clipped = np.zeros(len(measured.channels), np.int64)
    information = np.zeros((len(parameter_prior.names), len(parameter_prior.names)))
    for number, one in enumerate(filtered):
        recording = simulate_recording(vehicle, one, drive.rate, drive.seconds, seed + number)
        prepared, reasons, _ = prepare_runs([recording], vehicle, None, measured.car.name)
        if reasons:
            return list(reasons), [], information
        information += fisher_information(prepared[0], vehicle, parameter_prior) / len(filtered)
        clipped = np.maximum(clipped, prepared[0].clipped.sum(axis=1))
    notes = [
        f"the {channel.words} sensor would reach the end of its range in {count} of "
        f"{round(drive.seconds * drive.rate)} samples"
        for channel, count in zip(measured.channels, clipped, strict=True)
        if count
    ]
    return [], notes, information


def _sensor_list(names: Sequence[str]) -> str:
    """Join channel names: ``front wheel and the rear wheel sensor``."""
    return f"{' and the '.join(names)} sensor"


def _travel(car: CarModel, motions: Sequence[Motion]) -> dict[str, float]:
    """Return bump and droop of each axle, the largest of all motions, m."""
    out: dict[str, float] = {}
    for axle in car.axles:
        elements = list(car.elements_at(axle))
        low = min(float(motion.deflection[elements].min()) for motion in motions)
        high = max(float(motion.deflection[elements].max()) for motion in motions)
        out |= {f"{axle}_bump": max(-low, 0.0), f"{axle}_droop": max(high, 0.0)}
    return out


def _travel_reasons(vehicle: Vehicle, travel: dict[str, float]) -> list[str]:
    """Return a reason for each declared stop that the suspension would reach."""
    reasons = []
    for name, needed in travel.items():
        axle, direction = name.split("_")
        available = getattr(vehicle.travel, name)
        if available is not None and needed > available:
            reasons.append(
                f"the {axle} suspension would need {_length(needed, vehicle)} of {direction} and "
                f"has {_length(available, vehicle)}; drive slower or over something lower"
            )
    return reasons


def _length(value: float, vehicle: Vehicle) -> str:
    return f"{value / INCH:.1f} in" if vehicle.units == "US" else f"{1e3 * value:.0f} mm"


def _airborne_reasons(airborne: dict[str, float]) -> list[str]:
    return [
        f"the {axle} wheels would be off the ground for {time:.2f} s without a break; drive slower "
        "or over something lower"
        for axle, time in airborne.items()
        if time > _MAX_AIRBORNE
    ]


def _airborne_notes(airborne: dict[str, float]) -> list[str]:
    return [
        f"the {axle} wheels would leave the ground for {time:.2f} s"
        for axle, time in airborne.items()
        if time > _NOTICEABLE_AIRBORNE
    ]


def _range_used(vehicle: Vehicle, channels: Sequence[Channel], extremes: Array) -> Array:
    """Return the fraction (C,) of each sensor's range used; 0 without a declared range."""
    low, high = extremes[:, :, 0].min(axis=0), extremes[:, :, 1].max(axis=0)
    used = np.zeros(len(channels))
    for c, channel in enumerate(channels):
        sensor = vehicle.sensor(channel.name)
        if np.isfinite(sensor.high) and sensor.high > 0.0:
            used[c] = max(used[c], high[c] / sensor.high)
        if np.isfinite(sensor.low) and sensor.low < 0.0:
            used[c] = max(used[c], low[c] / sensor.low)
    return used
