"""Preparation of recordings for the filter, and checks before any fit."""

from __future__ import annotations

from collections.abc import Sequence

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.band import check_band, low_pass_recording, too_short
from bayes_asv.preprocessing.data_checks import dead_channels, preflight
from bayes_asv.preprocessing.faulty_channels import stuck_channels
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = ["prepare_runs"]


def prepare_runs(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    below: float | None = None,
    car: str = "half",
) -> tuple[tuple[PreparedRecording, ...], tuple[str, ...], tuple[str, ...]]:
    """Prepare recordings for the filter, and check them before any fit.

    Parameters
    ----------
    recordings, vehicle : sequence of Recording, Vehicle
        Recordings and vehicle as read.
    below : float, optional
        Keep only the motion below this frequency (Hz).
    car : str
        Name of the car, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    recordings : tuple of PreparedRecording
        Prepared recordings; empty if a channel has too few readings, or is stuck or a copy.
    reasons, warnings : tuple of str
        Messages; any reason means that the recordings are refused.

    Raises
    ------
    InputError
        If a channel is in counts without a calibration, or if the band does not contain the modes
        of the car.
    """
    model = car_model(car, vehicle)
    if below is not None:
        check_band(below, model)
    reasons = [
        reason
        for one in recordings
        for reason in dead_channels(one, vehicle, model) or stuck_channels(one, vehicle, model)
    ]
    warnings = [w for recording in recordings for w in recording.warnings]
    if reasons:
        return (), tuple(reasons), tuple(warnings)
    prepared = tuple(prepare(recording, vehicle, model) for recording in recordings)
    for one in prepared:
        reason, notes = preflight(vehicle, one)
        reasons += reason
        warnings += notes
    if below is not None and not reasons:
        short = [too_short(one, below) for one in prepared]
        reasons += [reason for reason in short if reason is not None]
        if not reasons:
            prepared = tuple(low_pass_recording(one, below) for one in prepared)
            warnings.append(f"only the motion below {below:g} Hz was used")
    return prepared, tuple(reasons), tuple(warnings)
