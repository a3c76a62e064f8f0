"""Statistics of judged cases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.battery.cells import CELLS, Group
from benchmarks.battery.intervals import Share, bootstrap, count_true
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
"""Noncentrality from which an effect is well above the floor, as in ``docs/interfaces.md``."""

_MIN_REACHED = 0.5  # share of the intended strength that has to be reached
_GROUP_OF = {cell.name: cell.group for cell in CELLS}


@dataclass(frozen=True)
class Naming:
    """Naming of cases with listed effects.

    Parameters
    ----------
    detected : Share
        Verdict other than agreement.
    name, first, of_class : Share
        The first effect has the right name; name and place; it or its class is true.
    every : Share
        All true effects, or their classes, are named.
    exact : Share
        The same, and no other effect is named.
    confidently_wrong : Share
        A wrong effect has a probability of 0.9 or more, and nothing is reported as unexplained.
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
    """Held-out simulation error after naming.

    Parameters
    ----------
    cases : int
        Cases with an error above the floor.
    median, tenth : float
        Median and 10th percentile of the share removed; nan without a case.
    median_interval, tenth_interval : pair of float
        95 % bootstrap intervals.
    worse : Share
        Cases whose error increased.
    """

    cases: int
    median: float
    tenth: float
    median_interval: tuple[float, float]
    tenth_interval: tuple[float, float]
    worse: Share


def by_group(cases: Sequence[Judged]) -> dict[Group, list[Judged]]:
    """Group cases as :mod:`benchmarks.battery.cells` does; others are left out."""
    out: dict[Group, list[Judged]] = {}
    for cell in CELLS:
        out.setdefault(cell.group, [])
    for one in cases:
        group = _GROUP_OF.get(one.truth.name)
        if group is not None:
            out[group].append(one)
    return out


def answered(cases: Sequence[Judged]) -> list[Judged]:
    """Cases that were not refused; an exception counts as a wrong answer."""
    return [one for one in cases if one.verdict != "refused"]


def false_alarm(cases: Sequence[Judged]) -> Share:
    """Share of verdicts other than agreement, refused cases left out."""
    return count_true([one.verdict != "agreement" for one in answered(cases)])


def reached(one: Judged) -> bool:
    """Whether every effect of a case nearly reaches the intended strength."""
    return all(e.noncentrality >= _MIN_REACHED * one.truth.strength for e in one.truth.effects)


def single(cases: Sequence[Judged], strength: float) -> list[Judged]:
    """Cases of a strength, without those whose effect cannot reach it."""
    return [one for one in cases if one.truth.strength == strength and reached(one)]


def naming(cases: Sequence[Judged]) -> Naming:
    """Count the naming of cases with listed effects, refused ones left out."""
    asked = answered(cases)
    return Naming(
        detected=count_true([one.verdict != "agreement" for one in asked]),
        name=count_true([one.name_right for one in asked]),
        first=count_true([one.first_right for one in asked]),
        of_class=count_true([one.class_right for one in asked]),
        every=count_true([all(one.found) and bool(one.found) for one in asked]),
        exact=count_true([all(one.found) and bool(one.found) and not one.extra for one in asked]),
        confidently_wrong=count_true([one.confidently_wrong for one in asked]),
    )


def confusion(
    cases: Mapping[Group, Sequence[Judged]], strength: float
) -> tuple[list[str], list[str], Array]:
    """Shares of the first name (columns) by the true effect (rows).

    Parameters
    ----------
    cases : mapping
        From :func:`by_group`.
    strength : float
        Of the effects; cases without a fault and within tolerance are in every matrix.

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
    """Held-out error of cases whose effects are well above the floor in the held-out run too."""
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
    worse = count_true([one.gap.worse for one in use if one.gap is not None])
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
        before = count_true([c.covered_before[name] for c in cases if name in c.covered_before])
        after = count_true([c.covered_after[name] for c in cases if name in c.covered_after])
        widths = [c.width_after[name] for c in cases if name in c.width_after]
        if after.of:
            out[name] = (before, after, float(np.median(widths)))
    return out


def probabilities(cases: Sequence[Judged], flagged: bool) -> list[tuple[float, bool]]:
    """Probabilities of all named effects, with whether they are true.

    Parameters
    ----------
    cases : sequence of Judged
        Cases of any kind.
    flagged : bool
        Include documents that report something unexplained.
    """
    return [pair for one in cases if flagged or not one.flagged for pair in one.probabilities]


def strengths(cases: Sequence[Judged]) -> list[float]:
    """Strengths among the cases, in order."""
    return [s for s in STRENGTHS if any(one.truth.strength == s for one in cases)]
