"""From judged cases to what is claimed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.battery.cells import CELLS, Group
from benchmarks.battery.intervals import Share, bootstrap, counted
from benchmarks.battery.judge import PARAMETERS, Judged
from tests.battery.effects import EFFECTS
from tests.battery.names import STRENGTHS

__all__ = [
    "ABOVE_THE_FLOOR",
    "Closed",
    "Naming",
    "by_group",
    "closed",
    "confusion",
    "coverage",
    "false_alarm",
    "naming",
    "probabilities",
    "single",
]

Array = NDArray[np.float64]

ABOVE_THE_FLOOR = 40.0
"""Noncentrality from which an effect is well above the floor, as ``docs/interfaces.md`` says."""

_NEAR = 0.5  # least share of the strength asked for that has to be reached
_GROUP_OF = {cell.name: cell.group for cell in CELLS}


@dataclass(frozen=True)
class Naming:
    """How cases with an effect of the list were named.

    Parameters
    ----------
    detected : Share
        Verdict other than agreement.
    name, first, of_class : Share
        First effect has the right name; name and place; it or its class is true.
    every : Share
        All true effects are named, themselves or by their class.
    exact : Share
        So they are, and nothing else is.
    confidently_wrong : Share
        A wrong effect with a probability of 0.9 or more, nothing said to be unexplained.
    """

    detected: Share
    name: Share
    first: Share
    of_class: Share
    every: Share
    exact: Share
    confidently_wrong: Share


@dataclass(frozen=True)
class Closed:
    """What became of the held-out gap.

    Parameters
    ----------
    cases : int
        Cases with a gap above the floor.
    median, tenth : float
        Median and 10th percentile of the share closed; nan of no case.
    median_interval, tenth_interval : pair of float
        95 % bootstrap intervals.
    worse : Share
        Cases whose gap grew.
    """

    cases: int
    median: float
    tenth: float
    median_interval: tuple[float, float]
    tenth_interval: tuple[float, float]
    worse: Share


def by_group(cases: Sequence[Judged]) -> dict[Group, list[Judged]]:
    """Sort cases by the groups of :mod:`benchmarks.battery.cells`; others are left out."""
    out: dict[Group, list[Judged]] = {}
    for cell in CELLS:
        out.setdefault(cell.group, [])
    for one in cases:
        group = _GROUP_OF.get(one.truth.name)
        if group is not None:
            out[group].append(one)
    return out


def answered(cases: Sequence[Judged]) -> list[Judged]:
    """Cases that were not refused; a diagnosis that broke down has answered, and wrongly."""
    return [one for one in cases if one.verdict != "refused"]


def false_alarm(cases: Sequence[Judged]) -> Share:
    """Verdict other than agreement where nothing is wrong, refused cases left out."""
    return counted([one.verdict != "agreement" for one in answered(cases)])


def reached(one: Judged) -> bool:
    """Whether every effect of a case came near the strength that was asked for."""
    return all(e.noncentrality >= _NEAR * one.truth.strength for e in one.truth.effects)


def single(cases: Sequence[Judged], strength: float) -> list[Judged]:
    """Cases of a strength, without those whose effect cannot be made so strong."""
    return [one for one in cases if one.truth.strength == strength and reached(one)]


def naming(cases: Sequence[Judged]) -> Naming:
    """Count how cases with effects of the list were named, refused ones left out."""
    asked = answered(cases)
    return Naming(
        detected=counted([one.verdict != "agreement" for one in asked]),
        name=counted([one.name_right for one in asked]),
        first=counted([one.first_right for one in asked]),
        of_class=counted([one.class_right for one in asked]),
        every=counted([all(one.found) and bool(one.found) for one in asked]),
        exact=counted([all(one.found) and bool(one.found) and not one.extra for one in asked]),
        confidently_wrong=counted([one.confidently_wrong for one in asked]),
    )


def confusion(
    cases: Mapping[Group, Sequence[Judged]], strength: float
) -> tuple[list[str], list[str], Array]:
    """Shares of what was said first (columns) by what is true (rows).

    Parameters
    ----------
    cases : mapping
        As :func:`by_group` gives it.
    strength : float
        Of the effects; nulls and clutter stand in every matrix.

    Returns
    -------
    rows, columns : list of str
        Names; rows carry their number of cases.
    shares : (rows, columns) array
        Each row adds up to one.
    """
    columns = [*EFFECTS, "unexplained", "agreement", "other"]
    truths: dict[str, list[Judged]] = {name: [] for name in EFFECTS}
    for group, there in cases.items():
        for one in there:
            if group.key == "single" and one.truth.strength == strength and reached(one):
                truths[one.truth.effects[0].name].append(one)
            elif group.key == "outside" and one.truth.strength == strength and reached(one):
                truths.setdefault("outside the list", []).append(one)
            elif group.key == "clutter":
                truths.setdefault("clutter", []).append(one)
            elif group.key == "null":
                truths.setdefault("nothing", []).append(one)
    rows, shares = [], []
    for name in [*EFFECTS, "outside the list", "clutter", "nothing"]:
        there = truths.get(name, [])
        if not there:
            continue
        said = [one.said if one.said in columns else "other" for one in there]
        rows.append(f"{name} ({len(there)})")
        shares.append([said.count(column) / len(there) for column in columns])
    return rows, columns, np.array(shares).reshape(-1, len(columns))


def closed(cases: Sequence[Judged]) -> Closed:
    """Judge the held-out gap of cases whose effects are well above the floor, held out as well."""
    use = [
        one
        for one in answered(cases)
        if one.gap is not None
        and one.truth.strength >= ABOVE_THE_FLOOR
        and reached(one)
        and sum(e.held_out for e in one.truth.effects) >= ABOVE_THE_FLOOR
        and np.isfinite(one.gap.closed)
    ]
    shares = np.array([one.gap.closed for one in use if one.gap is not None])
    worse = counted([one.gap.worse for one in use if one.gap is not None])
    if not len(shares):
        nothing = (float("nan"), float("nan"))
        return Closed(0, float("nan"), float("nan"), nothing, nothing, worse)

    def quantile(level: float) -> Callable[[Array], Array]:
        return lambda x: np.asarray(np.quantile(x, level, axis=-1))

    return Closed(
        cases=len(shares),
        median=float(quantile(0.5)(shares)),
        tenth=float(quantile(0.1)(shares)),
        median_interval=bootstrap(shares, quantile(0.5)),
        tenth_interval=bootstrap(shares, quantile(0.1)),
        worse=worse,
    )


def coverage(cases: Sequence[Judged]) -> dict[str, tuple[Share, Share, float]]:
    """Coverage of 95 % intervals before and after naming, and the median width after, by name."""
    out = {}
    for name in PARAMETERS:
        before = counted([c.covered_before[name] for c in cases if name in c.covered_before])
        after = counted([c.covered_after[name] for c in cases if name in c.covered_after])
        widths = [c.width_after[name] for c in cases if name in c.width_after]
        if after.of:
            out[name] = (before, after, float(np.median(widths)))
    return out


def probabilities(cases: Sequence[Judged], flagged: bool) -> list[tuple[float, bool]]:
    """Probabilities of all effects named, with whether they are true.

    Parameters
    ----------
    cases : sequence of Judged
        Of any kind.
    flagged : bool
        Take those also of documents that say that something is unexplained: those ask to be
        read with caution.
    """
    return [pair for one in cases if flagged or not one.flagged for pair in one.probabilities]


def strengths(cases: Sequence[Judged]) -> list[float]:
    """Strengths that there are, in order."""
    return [s for s in STRENGTHS if any(one.truth.strength == s for one in cases)]
