"""``asv.compare``: what changed between two sessions of one car."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

from bayes_asv.domain.errors import InputError
from bayes_asv.library.estimates import Estimate, car_of, estimate
from bayes_asv.library.extras import import_extra
from bayes_asv.library.inputs import check_inputs
from bayes_asv.library.progress import Progress, part_of, progress_bar
from bayes_asv.library.result import DocumentResult, html_table

if TYPE_CHECKING:
    import pandas as pd

    from bayes_asv.analysis.session_changes import Session
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.models.effects import PlacedEffect
    from bayes_asv.report.schema import CompareDocument

__all__ = ["Change", "Comparison", "compare"]

_SHARES = (0.0, 0.5, 1.0)  # of the time: each session
_CALL = "write asv.compare(before, after, vehicle), or asv.compare of two estimates"


@dataclass(frozen=True)
class Change:
    """Change of a parameter between two sessions.

    The ratio of the parameter after to that before is log-normal if all parameters may have
    changed; the probabilities allow for no change.

    Parameters
    ----------
    name, label : str
        Such as ``c_f`` and ``front damping rate``.
    ratio : float
        Median.
    log_sd : float
        Standard deviation of its logarithm.
    probability_lower, probability_higher : float
        Posterior probabilities that the parameter changed and is lower, or higher, after.
    p : float
        p-value of the test that the parameter is the same, with the others free to differ; nan
        where the recordings cannot show it.
    """

    name: str
    label: str
    ratio: float
    log_sd: float
    probability_lower: float
    probability_higher: float
    p: float

    def interval(self, probability: float = 0.95) -> tuple[float, float]:
        """Return the equal-tailed interval that holds the ratio with a probability."""
        if not 0.0 < probability < 1.0:
            raise InputError(
                f"interval({probability!r})", "is not a probability", "write interval(0.95)"
            )
        reach = math.exp(self.log_sd * NormalDist().inv_cdf(0.5 * (1.0 + probability)))
        return self.ratio / reach, self.ratio * reach

    @property
    def probability_changed(self) -> float:
        """Posterior probability that the parameter changed."""
        return min(self.probability_lower + self.probability_higher, 1.0)

    def __repr__(self) -> str:
        low, high = self.interval()
        return (
            f"<{self.name} after/before: {self.ratio:.4g}, 95 %: {low:.4g} to {high:.4g}, "
            f"changed with probability {self.probability_changed:.3g}>"
        )


class Comparison(DocumentResult):
    """Two sessions of one car compared, from :func:`bayes_asv.compare`.

    ``verdict`` is ``"changed"`` if a parameter changed with a probability of 95 % or more,
    ``"unclear"`` if one may or may not have changed, ``"consistent"`` otherwise, ``"doubtful"`` if
    the sessions differ in something else, such as the mass, or the model does not explain one of
    them, and ``"refused"`` where nothing can be compared.  ``result["c_f"]`` is a :class:`Change`.
    """

    document: CompareDocument

    def __init__(self, document: CompareDocument):
        super().__init__(document)
        self.changes = {
            name: Change(
                name, c.label, c.ratio, c.log_sd, c.p_lower, c.p_higher,
                math.nan if c.p_value is None else c.p_value,
            )
            for name, c in document.changes.items()
        }  # fmt: skip

    @property
    def p(self) -> float:
        """p-value of the test that all parameters are the same; nan where nothing is known."""
        value = self.document.p_value
        return math.nan if value is None else value

    @property
    def probability_unchanged(self) -> float:
        """Posterior probability that no parameter changed; nan where nothing is known."""
        value = self.document.p_unchanged
        return math.nan if value is None else value

    def __getitem__(self, name: str) -> Change:
        if name not in self.changes:
            why = "; ".join(self.reasons) or f"there are {', '.join(self.changes)}"
            raise KeyError(f"there is no change of {name}: {why}")
        return self.changes[name]

    def __contains__(self, name: object) -> bool:
        return name in self.changes

    def __iter__(self) -> Iterator[str]:
        return iter(self.changes)

    def summary(self) -> pd.DataFrame:
        """Return the changes as a table.

        Returns
        -------
        pandas.DataFrame
            One row a parameter: ``ratio`` (median), ``eti95_lb``, ``eti95_ub``, ``p_changed``,
            ``p_lower``, ``p_higher``, and ``p_value`` of the test that it is the same.
        """
        pandas = import_extra("pandas", "summary()")
        rows = [
            (
                c.ratio,
                *c.interval(),
                c.probability_changed,
                c.probability_lower,
                c.probability_higher,
                c.p,
            )
            for c in self.changes.values()
        ]
        columns = (
            "ratio", "eti95_lb", "eti95_ub", "p_changed", "p_lower", "p_higher", "p_value",
        )  # fmt: skip
        index = pandas.Index(list(self.changes), name="parameter")
        return pandas.DataFrame(rows, index=index, columns=columns)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, schema ``bayes_asv/compare/1``."""
        return self.document.to_dict()

    def lines(self) -> list[str]:
        """State the comparison in sentences."""
        from bayes_asv.report.sections.compare import compare_lines

        return compare_lines(self.document)

    def _repr_html_(self) -> str:
        from bayes_asv.report.sections.compare import change_rows

        head, rows = change_rows(self.document)
        first, *others = self.lines()
        notes = [line for line in others if line.startswith(("Why: ", "Note: ", "Next: "))]
        return html_table(first, head, rows, notes)

    def __repr__(self) -> str:
        from bayes_asv.report.words import plain

        about = ", ".join(f"{n} × {c.ratio:.3g}" for n, c in self.changes.items())
        about = about or "; ".join(self.reasons)[:160]
        car = plain(self.document.vehicle.name)[:60]
        return f"<Comparison {self.verdict!r} of {car}: {about}>"


def compare(
    before: Estimate | Recording | Iterable[Recording],
    after: Estimate | Recording | Iterable[Recording],
    vehicle: Vehicle | None = None,
    *,
    vehicle_after: Vehicle | None = None,
    effects: str | Sequence[str] = (),
    below: float | None = None,
    car: str | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Comparison:
    """Find out which parameters changed between two sessions of one car, and by how much.

    Errors of the given values (mass, springs, weight fraction) and of the scales of sensors are
    those of both sessions and do not enter the changes, which are therefore known better than the
    parameters.  ``docs/compare.md`` describes the probabilities.

    Parameters
    ----------
    before, after : Recording, iterable of Recording, or Estimate
        The runs of each session, or its estimate.  Where runs of one session differ from each
        other, their spread is part of it; several runs of each show that spread.
    vehicle : Vehicle, optional
        The car; to be left out where estimates are given, which have theirs.
    vehicle_after : Vehicle, optional
        The car after, where a mass, a spring or a sensor was changed on purpose; what it gives
        alike is the same in both sessions.
    effects, below, car, seed, progress
        As for :func:`bayes_asv.estimate`, for both sessions.

    Returns
    -------
    Comparison

    Raises
    ------
    TypeError
        If an argument is of another type.
    InputError
        If the estimates are of different models, or have effects that change given values.
    """
    if isinstance(before, Estimate) and isinstance(after, Estimate):
        given = (vehicle, vehicle_after, below, car, effects or None)
        if any(one is not None for one in given):
            raise InputError(
                "compare", "an estimate has its vehicle, its effects and its band already",
                "give two estimates and nothing else",
            )  # fmt: skip
        return _compared(before, after, before.engine.seed)
    if isinstance(before, Estimate) or isinstance(after, Estimate):
        raise TypeError(f"compare: one session is an estimate and the other is not; {_CALL}")
    if vehicle is None:
        raise TypeError(f"compare: the vehicle is missing; {_CALL}")
    names = (effects,) if isinstance(effects, str) else tuple(effects)
    if "auto" in names:
        raise InputError(
            "compare", "both sessions need the same effects, and 'auto' may find others in each",
            "name the effects that bayes-asv diagnose finds",
        )  # fmt: skip
    from bayes_asv.posterior.effect_fit import read_effect

    _check_effects(read_effect(name) for name in names)
    sessions = [_listed(before), _listed(after)]
    # both in the units of the first
    later = vehicle if vehicle_after is None else replace(vehicle_after, units=vehicle.units)
    cars = vehicle, later
    which = car or car_of(sessions[0])
    # Before the work: a recording in both sessions is a slip.
    check_inputs("compare", [*sessions[0], *sessions[1]], vehicle, car=which)
    with progress_bar(progress) as bar:
        first, second = (
            estimate(
                runs, one, effects=names, below=below, car=which, seed=seed,
                progress=part_of(bar, *span) or False,
            )
            for runs, one, span in zip(sessions, cars, pairwise(_SHARES), strict=True)
        )  # fmt: skip
    return _compared(first, second, seed)


def _listed(session: Recording | Iterable[Recording]) -> list[Recording]:
    """List the recordings of a session; the input checks reject objects of other types."""
    if isinstance(session, Iterable):
        return [session] if isinstance(session, str) else list(session)  # type: ignore[unreachable]
    return [session]


def _compared(before: Estimate, after: Estimate, seed: int) -> Comparison:
    """Compare two estimates."""
    from bayes_asv.analysis.session_changes import session_changes
    from bayes_asv.report.documents.compare import compare_document

    vehicles = before.vehicle, after.vehicle
    _check_alike(before, after)
    reasons = [
        f"the estimate {name} is {given.verdict.replace('_', ' ')}"
        + (f": {'; '.join(given.reasons)}" if given.reasons else "")
        for name, given in (("before", before), ("after", after))
        if given.engine.space is None or given.verdict in ("refused", "not_converged")
    ]
    changes = None
    if not reasons:
        changes = session_changes(_session(before), _session(after))
    doubts = [
        f"{name}: {doubt.sentence}"
        for name, doubt in (
            ("before", before.engine.input_check),
            ("after", after.engine.input_check),
        )
        # an error of a given value, which both share, is no obstacle
        if doubt is not None and (doubt.mistakes or not doubt.model_holds)
    ]
    return Comparison(
        compare_document(before.document, after.document, vehicles, changes, reasons, doubts, seed)
    )


def _check_alike(before: Estimate, after: Estimate) -> None:
    """Refuse estimates whose parameters do not mean the same."""
    if before.engine.car.name != after.engine.car.name:
        raise InputError("compare", "the estimates are of different models", "use one for both")
    if before.vehicle.units != after.vehicle.units:
        raise InputError(
            "compare", "the vehicles of the estimates have different units", "use one system"
        )
    both = [{str(placed) for placed in one.engine.effects} for one in (before, after)]
    if "refused" not in (before.verdict, after.verdict) and both[0] != both[1]:
        raise InputError(
            "compare", "the estimates have different effects", "estimate both with the same"
        )
    _check_effects(before.engine.effects)


def _check_effects(placed_effects: Iterable[PlacedEffect]) -> None:
    """Refuse effects on given values: draws of these are then no errors of what is given."""
    for placed in placed_effects:
        if placed.effect.acts == "car":
            raise InputError(
                str(placed), "changes a given value, whose errors a comparison takes out",
                "leave it out, and give the value a larger sd in the vehicle file",
            )  # fmt: skip


def _session(given: Estimate) -> Session:
    """Summarise an estimate: the moments of the draws of what both sessions may share."""
    from bayes_asv.analysis.session_changes import session

    engine = given.engine
    assert engine.space is not None
    z = engine.space.car_coordinates(engine.draws)
    gains = {
        name: draws.ravel() for name, draws in engine.nuisance.items() if name.startswith("gain ")
    }
    return session(engine.space, engine.vehicle, z.reshape(-1, z.shape[-1]), gains)
