"""Recordings prepared for the filter, and checked before anything is fitted."""

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
    """Prepare recordings for the filter and check them before anything is fitted.

    Parameters
    ----------
    recordings, vehicle : sequence of Recording, Vehicle
        As read.
    below : float, optional
        Keep the motion below this frequency (Hz) alone.
    car : str
        Name of the car, see :data:`bayes_asv.models.cars.CARS`.

    Returns
    -------
    recordings : tuple of PreparedRecording
        Empty when a channel has nothing to lay out, or readings that are not its own.
    reasons, warnings : tuple of str
        Any reason means that the data cannot answer.

    Raises
    ------
    InputError
        When a channel is in counts and the vehicle lacks its calibration, or the car's own
        motion is not in the band.
    """
    model = car_model(car, vehicle)
    if below is not None:
        check_band(below, model)
    reasons = [
        why
        for one in recordings
        for why in dead_channels(one, vehicle, model) or stuck_channels(one, vehicle, model)
    ]
    warnings = [w for recording in recordings for w in recording.warnings]
    if reasons:
        return (), tuple(reasons), tuple(warnings)
    prepared = tuple(prepare(recording, vehicle, model) for recording in recordings)
    for one in prepared:
        why, notes = preflight(vehicle, one)
        reasons += why
        warnings += notes
    if below is not None and not reasons:
        short = [too_short(one, below) for one in prepared]
        reasons += [why for why in short if why is not None]
        if not reasons:
            prepared = tuple(low_pass_recording(one, below) for one in prepared)
            warnings.append(f"only the motion below {below:g} Hz was used")
    return prepared, tuple(reasons), tuple(warnings)
