"""``asv.simulate``: a recording of a car over a road."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.library.estimates import check_seed
from bayes_asv.library.inputs import check_car, check_vehicle, positive_quantity
from bayes_asv.library.recordings import Recording, as_recording

if TYPE_CHECKING:
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.models.car_model import CarModel

__all__ = ["SPEED_LIMITS", "Drive", "simulate", "simulate_drive"]

SPEED_LIMITS = (0.1, 60.0)  # m/s
_SKEW_LIMITS = (0.0, 100.0)  # m
_DEFAULT_SKEW = 0.5  # m, a quarter of a small car's wheelbase
_RATE_LIMITS = (10.0, 10_000.0)  # Hz
_MAX_SECONDS = 600.0


class Drive(NamedTuple):
    """A simulated drive.

    Attributes
    ----------
    recording : Recording
        What the sensors read.
    truth : dict of str to float
        Parameters of the simulated car, SI units.
    speed : float
        m/s.
    """

    recording: Recording
    truth: dict[str, float]
    speed: float


def simulate(
    vehicle: Vehicle,
    road: str = "stops",
    *,
    speed: str | None = None,
    rate: float = 400.0,
    seconds: float = 2.5,
    change: Mapping[str, float] | None = None,
    car: str = "half",
    channels: Sequence[str] | None = None,
    skew: str | None = None,
    seed: int = 0,
) -> Recording:
    """Simulate a recording of the car over a road, with the sensors of its vehicle file.

    Parameters
    ----------
    vehicle : Vehicle
        Nominal values and sensors.
    road : {'stops', 'bump', 'rough', 'rollers', 'noise'}
        What is driven over.
    speed : str, optional
        Such as ``"8 mph"``; each road has its own by default.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording.
    change : mapping, optional
        Factors on the car's parameters: ``{"c_r": 0.8}`` for a rear damper that has lost a fifth.
    car : str
        Model of the car, as ``--car`` takes it; ``'roll'`` drives a left and a right track
        (``docs/cars.md``).
    channels : sequence of str, optional
        What is measured, such as ``["front_wheel", "rear_wheel", "front_travel"]``; by default
        the accelerations of all wheel hubs and of the body above them.
    skew : str, optional
        For a car with left and right wheels: how much later the right ones meet the road, such as
        ``"20 in"``; by default half a metre, and a track of its own on a random road.
    seed : int
        The same seed gives the same recording.

    Returns
    -------
    Recording

    Raises
    ------
    TypeError, InputError
        If an argument is of another type or does not fit; the message says what to write.
    """
    return simulate_drive(
        vehicle, road, speed=speed, rate=rate, seconds=seconds, change=change, car=car,
        channels=channels, skew=skew, seed=seed,
    ).recording  # fmt: skip


def simulate_drive(
    vehicle: Vehicle,
    road: str = "stops",
    *,
    speed: str | None = None,
    rate: float = 400.0,
    seconds: float = 2.5,
    change: Mapping[str, float] | None = None,
    car: str = "half",
    channels: Sequence[str] | None = None,
    skew: str | None = None,
    seed: int = 0,
) -> Drive:
    """Simulate as :func:`simulate` does, and return the parameters of the car with it."""
    check_seed(seed)
    check_vehicle("simulate", vehicle)
    check_car(car)
    from bayes_asv.models.cars import car_model
    from bayes_asv.simulation import ROADS
    from bayes_asv.simulation import simulate as engine
    from bayes_asv.simulation.roads import road as profile

    if road not in ROADS:
        raise InputError(f"road {road!r}", "is unknown", f"give one of {', '.join(ROADS)}")
    if not _RATE_LIMITS[0] <= rate <= _RATE_LIMITS[1]:
        raise InputError(f"rate={rate!r}", "is not possible", "give 10 to 10000 Hz")
    if not 0.1 <= seconds <= _MAX_SECONDS:
        raise InputError(f"seconds={seconds!r}", "is not possible", "give 0.1 to 600 s")
    pace = positive_quantity("speed", speed, "velocity", "8 mph", SPEED_LIMITS)
    apart = positive_quantity("skew", skew, "length", "20 in", _SKEW_LIMITS)
    ground = profile(road, np.random.default_rng([seed, 0]), pace)
    model = car_model(car, vehicle)
    two_tracks = any(element.side == "right" for element in model.elements)
    if skew is not None and not two_tracks:
        raise InputError(
            "skew", f"the {car} car has no right wheels", "leave it out, or choose the roll car"
        )
    values = _changed(model, change or {})
    right = None
    if two_tracks and apart is None:
        right = profile(road, np.random.default_rng([seed, 2]), pace)
        apart = 0.0 if road in ("rough", "noise") else _DEFAULT_SKEW
    drive = engine.simulate(
        vehicle, ground, rate=rate, seconds=seconds, seed=seed, car=car, values=values,
        channels=channels, right=right, skew=apart or 0.0,
    )  # fmt: skip
    return Drive(as_recording(drive.recording), values, ground.speed)


def _changed(model: CarModel, change: Mapping[str, Any]) -> dict[str, float]:
    """Nominal parameters of a car, some of them multiplied by factors."""
    values = {p.name: p.nominal for p in model.parameters}
    for name, factor in change.items():
        if name not in values or not 0.01 <= factor <= 100.0:
            raise InputError(
                f"{name}={factor:g}" if isinstance(factor, int | float) else name,
                "is not a change",
                f"give one of {', '.join(values)} and a factor between 0.01 and 100",
            )
        values[name] *= factor
    if not 0.0 < values["wdf"] < 1.0 or not math.isfinite(values["wdf"]):
        raise InputError("change wdf", "leaves no weight on one of the axles", "give less")
    return values
