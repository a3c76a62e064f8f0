"""``asv.estimate``: the posterior of damping rates and inertias."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.library.inputs import check_inputs
from bayes_asv.library.parameter import Parameter, from_draws
from bayes_asv.library.progress import Progress, part_of, progress_bar
from bayes_asv.library.result import Result

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.estimate_result import EstimationResult as EngineEstimate
    from bayes_asv.library.diagnoses import Diagnosis
    from bayes_asv.library.plots import EstimatePlots
    from bayes_asv.library.tracks import Track
    from bayes_asv.models.effects import PlacedEffect
    from bayes_asv.report.schema import EstimateDocument

__all__ = ["Estimate", "car_of", "check_seed", "estimate"]

Likelihood = Literal["innovations", "output-error"]

_AUTO = "auto"
_SHARE_OF_DIAGNOSIS = 0.6  # of the time, where effects are found before they are estimated


class Estimate(Result):
    """Posterior of one car's parameters, from :func:`bayes_asv.estimate`.

    ``verdict`` is ``"ok"``, ``"not_converged"`` or ``"refused"``.  Parameters of the half car are
    ``c_f``, ``c_r``, ``i``, ``k_g``, ``zeta_f`` and ``zeta_r``; ``docs/cars.md`` lists those of
    other cars.
    """

    document: EstimateDocument

    def __init__(
        self,
        engine: EngineEstimate,
        document: EstimateDocument,
        parameters: dict[str, Parameter],
        searched: bool = False,
    ):
        super().__init__(document, parameters, engine.vehicle)
        self._engine = engine
        self._searched = searched

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """The recordings, as given."""
        return self._engine.recordings

    @property
    def effects(self) -> list[Any]:
        """Effects in the model, each with ``name``, ``where`` and ``parameters``."""
        return list(self.document.effects)

    @cached_property
    def plot(self) -> EstimatePlots:
        """Figures: ``plot.posterior()``, ``plot.simulation()``, ``plot.damper_velocity()``."""
        from bayes_asv.library.plots import EstimatePlots

        return EstimatePlots(self.document)

    def report(
        self,
        path: PathLike,
        *,
        diagnosis: Diagnosis | None = None,
        track: Track | None = None,
        interactive: bool = False,
    ) -> None:
        """Write a report, HTML or PDF by the suffix of the file.

        Parameters
        ----------
        path : str or os.PathLike
            Ends in ``.html`` or ``.pdf``.
        diagnosis : Diagnosis, optional
            Of the same recordings, to be reported beside the estimate.
        track : Track, optional
            Of one of the recordings, likewise.
        interactive : bool
            Write a page to look at the recordings closely, in place of a report.

        Raises
        ------
        InputError
            If the suffix is another one or the file cannot be written.
        """
        from bayes_asv.report.render import write_report

        beside = {"diagnosis": diagnosis, "online": track}
        given = {key: result.document for key, result in beside.items() if result is not None}
        write_report(self.document.model_copy(update=given), path, interactive=interactive)

    def to_inference_data(self) -> Any:
        """Return the draws as ArviZ inference data, all in SI units.

        Returns
        -------
        arviz.InferenceData or xarray.DataTree
            As the installed ArviZ has it.  Groups are ``posterior`` (with noise levels and
            effects), ``sample_stats``, ``prior`` and ``observed_data``, and for runs of a linear
            car that are consistent with each other ``log_likelihood`` (by recording),
            ``log_prior`` and, unless residuals are modelled as autocorrelated,
            ``posterior_predictive``.

        Raises
        ------
        ImportError
            If ArviZ is not installed.
        InputError
            If there are no draws.
        """
        from bayes_asv.library.inference_data import inference_data

        return inference_data(self._drawn("to_inference_data"))

    def to_netcdf(self, path: PathLike) -> None:
        """Write :meth:`to_inference_data` as a netCDF file, which ArviZ opens.

        Parameters
        ----------
        path : str or os.PathLike
            The file.
        """
        from bayes_asv.library.inference_data import write_netcdf

        write_netcdf(self._drawn("to_netcdf"), path)

    def lines(self) -> list[str]:
        """State the result in sentences, as the command line prints them."""
        from bayes_asv.report.sections.effects import (
            clock_lines,
            damper_lines,
            effect_lines,
            spring_lines,
        )
        from bayes_asv.report.sections.verdict import verdict_lines

        lines = [*verdict_lines(self.document), *effect_lines(self.document.effects)]
        lines += damper_lines(self.document.dampers)
        lines += spring_lines(self.document.springs)
        lines += clock_lines(self.document.clocks)
        if self._searched and not self.effects and self.verdict != "refused":
            lines.append("No effect was named, so the model is linear.")
        return lines

    @property
    def engine(self) -> EngineEstimate:
        """The value that the engine returned, in SI units."""
        return self._engine

    def _drawn(self, purpose: str) -> EngineEstimate:
        if not self._engine.draws:
            raise InputError(purpose, "there are no draws", "see the result's reasons")
        return self._engine


def estimate(
    recordings: Recording | Iterable[Recording],
    vehicle: Vehicle,
    *,
    effects: str | Sequence[str] = (),
    likelihood: Likelihood = "innovations",
    below: float | None = None,
    car: str | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Estimate:
    """Estimate damping rates and inertias from one or several recordings of one car.

    Parameters
    ----------
    recordings : Recording or iterable of Recording
        Runs of the same car; each has its own biases, initial state and noise.
    vehicle : Vehicle
        The car: given and nominal values with their standard deviations, and sensors.
    effects : str or sequence of str, optional
        Effects that the car has, such as ``"bound_rebound@rear"`` (``docs/effects.md``);
        ``"auto"`` adds those that :func:`bayes_asv.diagnose` finds more likely than not.
    likelihood : {'innovations', 'output-error'}
        With the noise of the wheel sensors in the covariance, or with white residuals.
    below : float, optional
        Use only the motion below this frequency, Hz.
    car : {'half', 'quarter-front', 'quarter-rear', 'roll'}, optional
        Model of the car; by default that whose wheels the first recording has.
    seed : int
        The same seed gives the same answer.
    progress : bool or callable, optional
        None shows a bar on a terminal or in a notebook, False never; a callable is called with
        the share done and a description.

    Returns
    -------
    Estimate
        A refusal and a lack of convergence are verdicts, not exceptions.

    Raises
    ------
    TypeError
        If an argument is of another type.
    InputError
        If an option, a channel or a calibration does not fit; the message says what to do.
    """
    check_seed(seed)
    car = car or car_of(recordings)
    runs, vehicle = check_inputs("estimate", recordings, vehicle, car=car)
    names = (effects,) if isinstance(effects, str) else tuple(effects)
    bending = [name for name in names if not name.startswith("clock_offset")]
    if bending and (below is not None or likelihood != "innovations"):
        raise InputError(
            "estimate", "effects need the whole band and the innovations likelihood",
            "leave out below and likelihood, or effects",
        )  # fmt: skip
    from bayes_asv import estimation
    from bayes_asv.preprocessing.run_preparation import select_runs

    if likelihood not in estimation.LIKELIHOODS:
        raise InputError(
            f"likelihood={likelihood!r}", "is unknown",
            f"give one of {', '.join(estimation.LIKELIHOODS)}",
        )  # fmt: skip
    with progress_bar(progress) as report:
        short = select_runs(runs, vehicle, below, car)[0] if _AUTO in names else ()
        placed_effects, report = _placed_effects(names, short, vehicle, car, seed, report)
        result = estimation.estimate(
            runs, vehicle, likelihood=likelihood, below=below, seed=seed, progress=report,
            placed_effects=placed_effects, car=car,
        )  # fmt: skip
    from bayes_asv.report.documents.estimate import estimate_document

    nominal = result.nominal
    parameters = {
        name: from_draws(
            name,
            result.draws[name],
            nominal[name],
            vehicle.units,
            below=result.probability_below_nominal(name),
        )
        for name in result.estimands
    }
    return Estimate(result, estimate_document(result), parameters, searched=_AUTO in names)


def check_seed(seed: int) -> None:
    """Refuse a seed that random generators do not take."""
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**32:
        raise InputError(
            f"seed={seed!r}", "is not a seed", "give a whole number from 0 to 4294967295"
        )


def car_of(recordings: object) -> str:
    """Name of the first model of a car all of whose wheels the first recording has."""
    from bayes_asv.models.cars import cars_with

    first = recordings[0] if isinstance(recordings, Sequence) and recordings else recordings
    return next(iter(cars_with(getattr(first, "channels", ()))), "half")


def read_effects(effects: str | Sequence[str]) -> tuple[PlacedEffect, ...]:
    """Effects by their names, such as ``bound_rebound@front``.

    Raises
    ------
    InputError
        When there is no such effect or place.
    """
    from bayes_asv.posterior.effect_fit import read_effect

    names = (effects,) if isinstance(effects, str) else effects
    return tuple(dict.fromkeys(read_effect(name) for name in names))


def _placed_effects(
    names: tuple[str, ...],
    runs: tuple[Recording, ...],
    vehicle: Vehicle,
    car: str,
    seed: int,
    report: Any,
) -> tuple[tuple[PlacedEffect, ...], Any]:
    """Effects by their names, those that a diagnosis names among them, and what is left to do."""
    placed_effects = read_effects([name for name in names if name != _AUTO])
    if _AUTO not in names:
        return placed_effects, report
    from bayes_asv.diagnosis.workflow import missing_effects

    share = part_of(report, 0.0, _SHARE_OF_DIAGNOSIS)
    found = missing_effects(runs, vehicle, seed, share, car)
    placed_effects += tuple(placed for placed in found if placed not in placed_effects)
    return placed_effects, part_of(report, _SHARE_OF_DIAGNOSIS, 1.0)
