"""Documents of the reference's own methods: modes of the car, and the grey-box point estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bayes_asv import __version__
from bayes_asv.library.inputs import check_inputs, check_vehicle
from bayes_asv.library.progress import Progress, progress_bar

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["greybox", "modes"]

Document = dict[str, Any]


def greybox(
    recording: Recording,
    vehicle: Vehicle,
    *,
    coordinates: str = "both",
    initial: str = "estimated",
    detrending: str = "trend",
    hold: str = "held",
    seed: int = 0,
) -> Document:
    """Estimate by prediction errors, as the reference does.

    Parameters
    ----------
    recording, vehicle : Recording, Vehicle
        One drive of the half car.
    coordinates : {'both', 'deflection', 'integrated'}
        Accelerations as they are, or integrated twice.
    initial : {'estimated', 'zero'}
        Initial state.
    detrending : {'trend', 'constant', 'rest', 'none'}
        What is removed before the integration.
    hold : {'held', 'straight'}
        Integrated inputs between samples.
    seed : int
        Recorded in the document; nothing is drawn.

    Returns
    -------
    dict
        Schema ``bayes_asv/greybox/1``.
    """
    from bayes_asv.reference.document import GREYBOX_SCHEMA, greybox_document, nan_to_none
    from bayes_asv.reference.greybox import COORDINATES, grey_box

    (run,), car = check_inputs("greybox", recording, vehicle)
    found = [
        grey_box(run, car, coordinates=way, initial=initial, detrending=detrending, hold=hold)
        for way in (COORDINATES if coordinates == "both" else (coordinates,))
    ]
    verdicts = [estimate.verdict for estimate in found]
    document: Document = nan_to_none(
        {
            "schema": GREYBOX_SCHEMA,
            "verdict": next((v for v in ("refused", "not_converged") if v in verdicts), "ok"),
            "reasons": list(found[0].reasons),
            "warnings": list(found[0].warnings),
            "estimates": [greybox_document(estimate, car.units) for estimate in found],
            "seed": seed,
            "version": __version__,
        }
    )
    return document


def modes(
    vehicle: Vehicle,
    recording: Recording | None = None,
    *,
    white_noise: bool = False,
    seed: int = 0,
    progress: Progress = None,
) -> Document:
    """Compute the eigenvalue modes of the nominal half car, and the spectrum of a recording.

    Parameters
    ----------
    vehicle : Vehicle
        The car.
    recording : Recording, optional
        Its spectrum goes into the document.
    white_noise : bool
        Also read the modes from simulated drives over white noise, with both axles damped to 10,
        30 and 70 %.
    seed : int
        The same seed gives the same answer.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`.

    Returns
    -------
    dict
        Schema ``bayes_asv/modes/1``.
    """
    from bayes_asv.models import modes as eigenvalues
    from bayes_asv.reference.document import (
        MODES_SCHEMA,
        mode_document,
        nan_to_none,
        study_document,
    )
    from bayes_asv.reference.greybox import nominal_car
    from bayes_asv.reference.modal import printed_modes
    from bayes_asv.reference.modes_document import spectrum_document
    from bayes_asv.reference.reproduce import RECORDS
    from bayes_asv.reference.spectral import DAMPINGS, spectral_study

    car = check_vehicle("modes", vehicle)
    if recording is not None:
        check_inputs("modes", recording, vehicle)
    nominal = nominal_car(car)
    studies = []
    with progress_bar(progress if white_noise else False) as report:
        for k, damping in enumerate(DAMPINGS if white_noise else ()):
            if report is not None:
                report(k / len(DAMPINGS), f"damped to {100 * damping:.0f} %")
            studies.append(study_document(spectral_study(nominal, damping, RECORDS, seed)))
    document: Document = nan_to_none(
        {
            "schema": MODES_SCHEMA,
            "verdict": "ok",
            "vehicle": car.name,
            "modes": [mode_document(mode) for mode in eigenvalues.modes(nominal)],
            "as_app_c1": [
                {"natural_hz": f.natural, "damped_hz": f.damped, "ratio": f.ratio}
                for f in printed_modes(nominal)
            ],
            "spectral": studies,
            "recording": None if recording is None else spectrum_document(recording, car),
            "seed": seed,
            "version": __version__,
        }
    )
    return document
