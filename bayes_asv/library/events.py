"""``asv.find_events``: what of a long log tells about a car."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_asv.library.estimates import car_of
from bayes_asv.library.inputs import check_inputs

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.preprocessing.events import Event

__all__ = ["find_events"]


def find_events(
    recording: Recording, vehicle: Vehicle, *, car: str | None = None, below: float | None = None
) -> list[Event]:
    """Find the stretches of a log that carry information about a car.

    Bumps, parking stops and rough stretches are found; standing, cruising, braking and cornering
    are not.  :func:`bayes_asv.estimate` takes the best events of a recording that is too long to be
    taken whole, the same as are marked here.

    Parameters
    ----------
    recording : Recording
        A log of any length.
    vehicle : Vehicle
        The car.
    car : {'half', 'quarter-front', 'quarter-rear', 'roll'}, optional
        Model of the car; by default that whose wheels the recording has.
    below : float, optional
        Upper edge of the band that will be used, Hz.

    Returns
    -------
    list of Event
        In order of time.  Each has its ``kind``, ``begin`` and ``end`` in seconds of the log, its
        rows as a ``recording``, and is ``used`` or left out for a ``reason``, such as wheels in
        the air.

    Raises
    ------
    TypeError, InputError
        As :func:`bayes_asv.estimate`.
    """
    car = car or car_of(recording)
    (run,), vehicle = check_inputs("find_events", recording, vehicle, car=car)
    from bayes_asv.models.cars import car_model
    from bayes_asv.preprocessing.events import choose_events
    from bayes_asv.preprocessing.events import find_events as find

    (log,) = choose_events([find(run, vehicle, car_model(car, vehicle), below)], below=below)
    return list(log.events)
