"""Document of a comparison of two sessions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bayes_asv import __version__
from bayes_asv.analysis.run_consistency import DISAGREE_BELOW
from bayes_asv.analysis.session_changes import CHANGE_SD, UNCHANGED, SessionChanges
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.report.schema.compare import ChangePrior, CompareDocument, ParameterChange
from bayes_asv.report.schema.estimate import EstimateDocument
from bayes_asv.report.schema.parts import SourceFile
from bayes_asv.report.sections.compare import sense
from bayes_asv.report.words import enumerated, p_value, two_digits

__all__ = ["compare_document"]

_UNEQUAL_SPEED = 1.25
"""Ratio of damper velocities from which a note is made: the rate of a damper with F ∝ v^¾, as
digressive as many, differs by 5 % between them."""


def compare_document(
    before: EstimateDocument,
    after: EstimateDocument,
    vehicles: tuple[Vehicle, Vehicle],
    changes: SessionChanges | None,
    reasons: Sequence[str],
    doubts: Sequence[str],
    seed: int,
) -> CompareDocument:
    """Document of the changes between two sessions, or of a refusal.

    Parameters
    ----------
    before, after : EstimateDocument
        Each session by itself.
    vehicles : pair of Vehicle
        Of both sessions.
    changes : SessionChanges or None
        None where the sessions cannot be compared,
    reasons : sequence of str
        and why.
    doubts : sequence of str
        Why one of the estimates is in doubt, beyond what both sessions share.
    seed : int
        Of both estimates.
    """
    first, second = (
        car_model(one.car, vehicle) for one, vehicle in zip((before, after), vehicles, strict=True)
    )
    if changes is not None and changes.rest.p < DISAGREE_BELOW:
        labels = enumerated([QUANTITIES[name][1] for name in changes.names])
        doubts = [
            *doubts, f"the sessions differ in more than {labels} ({p_value(changes.rest.p)})"
        ]  # fmt: skip
    own = {
        name: _change(name, k, changes) for k, name in enumerate(changes.names if changes else ())
    }
    files = [*before.provenance.recordings, *after.provenance.recordings]
    if vehicles[0] != vehicles[1]:
        files.append(SourceFile(file=after.vehicle.source, sha256=after.vehicle.sha256))
    return CompareDocument(
        schema="bayes_asv/compare/1",
        verdict=_verdict(own, doubts),
        reasons=list(reasons),
        warnings=[
            *(
                f"{name}: {warning}"
                for name, one in (("before", before), ("after", after))
                for warning in one.warnings
                if f"{name}: {warning}" not in doubts
            ),
            *([] if changes is None else _unequal_speeds(before, after)),
        ],
        doubts=list(doubts),
        p_value=changes.p_value if changes else math.nan,
        p_unchanged=changes.nothing if changes else math.nan,
        p_value_shared=changes.rest.p if changes else math.nan,
        differ_below=DISAGREE_BELOW,
        prior=ChangePrior(unchanged=UNCHANGED, log_sd=CHANGE_SD),
        shared=_given(first, second, shared=True),
        different=_given(first, second, shared=False),
        changes=own,
        # the draws are not shown again, and would be half of the document
        before=before.model_copy(update={"draws": {}}),
        after=after.model_copy(update={"draws": {}}),
        vehicle=before.vehicle,
        provenance=before.provenance.model_copy(update={"recordings": files}),
        version=__version__,
        seed=seed,
    )


def _change(name: str, k: int, changes: SessionChanges | None) -> ParameterChange:
    assert changes is not None
    mean, sd = float(changes.mean[k]), float(changes.sd[k])
    lower, higher = (min(float(p[k]), 1.0) for p in (changes.lower, changes.higher))
    return ParameterChange(
        label=QUANTITIES[name][1],
        ratio=math.exp(mean),
        eti95=[math.exp(mean - NORMAL_975 * sd), math.exp(mean + NORMAL_975 * sd)],
        log_sd=sd,
        p_changed=min(lower + higher, 1.0),
        p_lower=lower,
        p_higher=higher,
        p_value=float(changes.p_values[k]),
    )


def _verdict(changes: dict[str, ParameterChange], doubts: Sequence[str]) -> str:
    if not changes:
        return "refused"
    if doubts:
        return "doubtful"
    senses = {sense(change) for change in changes.values()}
    if "changed" in senses:
        return "changed"
    return "consistent" if senses == {"same"} else "unclear"


def _given(first: CarModel, second: CarModel, *, shared: bool) -> list[str]:
    """Given values that are alike in both vehicle files and uncertain, or that differ."""
    other = {p.name: p for p in second.parameters}
    return [
        QUANTITIES[p.name][1]
        for p in first.parameters
        if p.kind != "estimated"
        and (p == other.get(p.name)) == shared
        and (not shared or any(sd > 0.0 for _, _, sd in p.terms))
    ]


def _unequal_speeds(before: EstimateDocument, after: EstimateDocument) -> list[str]:
    """Say which dampers moved faster in one session; a known law of a damper takes it in."""
    found = []
    curved = {damper.element for damper in before.dampers}
    for name in before.elements:
        speeds = [_speed(one, name) for one in (before, after)]
        if name in curved or not all(speeds):
            continue
        ratio = speeds[1] / speeds[0]
        if max(ratio, 1.0 / ratio) > _UNEQUAL_SPEED:
            place = name.replace("_", " ")
            found.append(
                f"the {place} damper moved {two_digits(ratio)} times as fast after as before; the "
                "rate of a damper whose force is not proportional to speed differs between them: "
                "drive the same obstacle at the same speed, or estimate the law "
                f"(--with-effect digressive_damper@{name})"
            )
    return found


def _speed(document: EstimateDocument, element: str) -> float:
    """Root mean square of the velocity of an element over all runs."""
    curves = [
        [v for v in run.travel.entries[element].velocity if v is not None]
        for run in document.runs
        if element in run.travel.entries
    ]
    squares = [v**2 for curve in curves for v in curve]
    return math.sqrt(sum(squares) / len(squares)) if squares else 0.0
