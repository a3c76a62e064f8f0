"""``asv.diagnose``: where simulation and measurement disagree, and what the model lacks."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING, Any

from bayes_asv.domain.errors import InputError
from bayes_asv.library.estimates import car_of, check_seed
from bayes_asv.library.inputs import check_inputs
from bayes_asv.library.parameter import Parameter, from_draws
from bayes_asv.library.progress import Progress, progress_bar
from bayes_asv.library.result import Result

if TYPE_CHECKING:
    from bayes_asv.diagnosis.results import DiagnosisResult as EngineDiagnosis
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.library.plots import DiagnosisPlots
    from bayes_asv.report.schema import DiagnoseDocument

__all__ = ["Diagnosis", "diagnose"]


class Diagnosis(Result):
    """What the linear car lacks, from :func:`bayes_asv.diagnose`.

    ``verdict`` is ``"agreement"``, ``"named"``, ``"unexplained"`` or ``"refused"``.
    ``result["c_f"]`` and the other parameters are those of the model with all that was added;
    ``result.before`` holds those of the linear car.
    """

    document: DiagnoseDocument

    def __init__(
        self,
        document: DiagnoseDocument,
        before: dict[str, Parameter],
        after: dict[str, Parameter],
        vehicle: Vehicle,
    ):
        super().__init__(document, after, vehicle)
        self.before = before

    @property
    def effects(self) -> list[Any]:
        """Named effects in the order in which they were added.

        Each has ``name``, ``where``, ``probability``, ``parameters`` (with ``mean``, ``eti95`` and
        ``unit``) and ``indistinguishable_from``.
        """
        return list(self.document.effects)

    @property
    def unexplained(self) -> bool:
        """Whether something remains that no listed effect explains."""
        return self.document.unexplained.present

    @property
    def unnamed(self) -> list[Any]:
        """What remains, as it was added to the model without a name; the largest first.

        Each has ``like`` (the unlisted fault that changes the recordings as it does, and where),
        ``share`` and the curves ``time``, ``change`` and ``along`` with their units.
        """
        return list(self.document.unnamed)

    @cached_property
    def plot(self) -> DiagnosisPlots:
        """Figures: ``plot.simulation_error()``, ``plot.parameters()``."""
        from bayes_asv.library.plots import DiagnosisPlots

        return DiagnosisPlots(self.document)

    def lines(self) -> list[str]:
        """State the result in sentences, as the command line prints them."""
        from bayes_asv.report.sections.diagnosis import diagnosis_lines

        return diagnosis_lines(self.document)

    def _notes(self, lines: list[str]) -> list[str]:
        return lines


def diagnose(
    recordings: Recording | Iterable[Recording],
    vehicle: Vehicle,
    *,
    holdout: Recording | Iterable[Recording] = (),
    car: str | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Diagnosis:
    """Find where the linear car and the recordings disagree, and which effects it lacks.

    Parameters
    ----------
    recordings : Recording or iterable of Recording
        Runs to fit.
    vehicle : Vehicle
        The car.
    holdout : Recording or iterable of Recording, optional
        Runs on which what was found is validated; by default the last of several recordings, or
        the second half of a single one.
    car : {'half', 'quarter-front', 'quarter-rear', 'roll'}, optional
        Model of the car; by default that whose wheels the first recording has.
    seed : int
        The same seed gives the same answer.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`.

    Returns
    -------
    Diagnosis

    Raises
    ------
    TypeError, InputError
        As :func:`bayes_asv.estimate`.
    """
    check_seed(seed)
    car = car or car_of(recordings)
    runs, vehicle = check_inputs("diagnose", recordings, vehicle, car=car)
    held: tuple[Recording, ...] = ()
    if not isinstance(holdout, tuple | list) or holdout:
        held = check_inputs("diagnose", holdout, vehicle, car=car)[0]
        check_inputs("diagnose", (*runs, *held), vehicle, car=car)  # none may be given twice
    from bayes_asv.diagnosis import workflow

    with progress_bar(progress) as report:
        runs, held = (_without_rest(some, vehicle, car) for some in (runs, held))
        found = workflow.diagnose(runs, held, vehicle, seed, report, car)
    return diagnosis_of(found, (*runs, *held))


def _without_rest(runs: tuple[Recording, ...], vehicle: Vehicle, car: str) -> tuple[Recording, ...]:
    """Replace recordings that are too long to be taken whole by their best events."""
    from bayes_asv.preprocessing.run_preparation import select_runs

    events, _ = select_runs(runs, vehicle, None, car)
    if runs and not events:
        raise InputError(
            runs[0].source, "has no event that tells about the car", "drive over bumps"
        )
    return events


def diagnosis_of(found: EngineDiagnosis, recordings: tuple[Recording, ...]) -> Diagnosis:
    """Wrap what the workflow found in these recordings."""
    from bayes_asv.report.documents.diagnose import diagnose_document, nominal_quantities

    document, vehicle = diagnose_document(found, recordings), found.vehicle
    nominal = nominal_quantities(found)

    def parameters(draws: Any, names: Iterable[str]) -> dict[str, Parameter]:
        return {name: from_draws(name, draws[name], nominal[name], vehicle.units) for name in names}

    return Diagnosis(
        document,
        parameters(found.quantities_before, document.parameters_before),
        parameters(found.quantities_after, document.parameters_after),
        vehicle,
    )
