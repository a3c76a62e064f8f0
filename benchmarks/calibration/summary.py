"""From rows to what is claimed: coverage by cell, widths against the bound, what deviates."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration.cells import CELLS, GROUPS, MODEL, NAMES, Cell, Group
from benchmarks.calibration.run import NOT_CONVERGED, Row
from benchmarks.calibration.store import Results
from benchmarks.calibration.verdicts import LEVELS, Coverage, coverage, holm

__all__ = [
    "FEWEST",
    "JUDGED_LEVELS",
    "LEAST_ON_STOPS",
    "LEAST_UNDER_STRAIN",
    "WIDEST",
    "RunConsistency",
    "Summary",
    "Verdict",
    "adjusted",
    "agreement",
    "judged",
    "places",
    "summaries",
    "verdicts",
]

Array = NDArray[np.float64]

JUDGED_LEVELS = (0.5, 0.95)
LEAST_ON_STOPS = 0.92
LEAST_UNDER_STRAIN = 0.90
WIDEST = 1.3  # times the bound, median
FEWEST = 200  # answers; with them a coverage of 95 % is known to 3 %
_ALPHA = 0.05


@dataclass(frozen=True)
class Summary:
    """One cell of the rig, counted.

    Parameters
    ----------
    cell : Cell
        Which.
    runs, answered, not_converged : int
        Drives, drives with an answer, and drives whose ensembles did not agree; the rest was
        refused.
    coverage : dict of (str, float) to Coverage
        By quantity and level.
    ratio, width : dict of str to float
        Medians of width over bound, and of the relative deviation the 95 % interval stands for.
    effective : float
        Median effective number of draws.
    how : dict of str to int
        Number of runs by how their posterior was drawn.
    coloured : int
        Answers whose innovations had a colour.
    clipped : float
        Readings at a rail, mean a drive.
    """

    cell: Cell
    runs: int
    answered: int
    not_converged: int
    coverage: dict[tuple[str, float], Coverage]
    ratio: dict[str, float]
    width: dict[str, float]
    effective: float
    how: dict[str, int]
    coloured: int
    clipped: float


@dataclass(frozen=True)
class Verdict:
    """Whether a group of cells meets what is asked of it.

    Parameters
    ----------
    group : Group
        Which.
    asked : str
        What, in words.
    met : bool
        Whether, by what was found.
    found : str
        The worst that was found, in words.
    runs : int
        Answers in the cell that has the fewest.
    """

    group: Group
    asked: str
    met: bool
    found: str
    runs: int

    @property
    def settled(self) -> bool:
        """Whether there are runs enough to say so."""
        return self.runs >= FEWEST


@dataclass(frozen=True)
class RunConsistency:
    """Weighted draws against the product's own ensembles on the same recordings.

    Parameters
    ----------
    runs : int
        Recordings.
    place : float
        Root-mean-square difference of the posterior probability below the truth.
    largest : float
        Largest such difference.
    width : float
        Median relative difference of the widths.
    """

    runs: int
    place: float
    largest: float
    width: float


def judged(cell: Cell) -> tuple[str, ...]:
    """Quantities that say something of their own: with an exact mass k_g is but the root of i."""
    return tuple(name for name in NAMES if not (cell.exact and name == "k_g"))


def places(rows: tuple[Row, ...], only: tuple[str, ...] | None = None) -> dict[str, Array]:
    """Places of the truth by quantity, of every run that has one."""
    names = dict.fromkeys(name for row in rows for name in row.places)
    return {
        name: np.array([row.places[name] for row in rows if name in row.places])
        for name in names
        if only is None or name in only
    }


def summaries(results: dict[str, Results]) -> dict[str, Summary]:
    """Count every cell of the rig that has answers, by name, in the order of the cells."""
    out = {}
    for cell in CELLS:
        found = results.get(cell.name)
        if found is not None and cell.terrain != MODEL:
            summary = _summary(cell, found.rows)
            if summary.answered:
                out[cell.name] = summary
    return out


def _summary(cell: Cell, rows: tuple[Row, ...]) -> Summary:
    answers = [row for row in rows if row.places]
    there = places(rows, NAMES)
    return Summary(
        cell=cell,
        runs=len(rows),
        answered=len(answers),
        not_converged=sum(NOT_CONVERGED in row.reasons for row in rows),
        coverage={(n, level): coverage(there[n], level) for n in there for level in LEVELS},
        ratio={
            n: float(np.median([row.widths[n] / row.bounds[n] for row in answers])) for n in there
        },
        width={n: float(np.median([row.widths[n] for row in answers])) for n in there},
        effective=float(np.median([row.effective for row in answers])) if answers else 0.0,
        how=dict(Counter(row.how for row in answers)),
        coloured=sum(row.colour > 0 for row in answers),
        clipped=float(np.mean([row.clipped for row in rows])) if rows else 0.0,
    )


def adjusted(found: dict[str, Summary], group: Group, level: float) -> dict[tuple[str, str], float]:
    """Holm-adjusted p-values of a group's coverages by terrain and quantity, one level a family.

    Stops are left out where nominal coverage is asked, since less is asked of them.
    """
    keys, p = [], []
    for cell in CELLS:
        if cell.group != group or cell.name not in found:
            continue
        if group.rule == "nominal" and cell.terrain == "stops":
            continue
        for name in judged(cell):
            keys.append((cell.terrain, name))
            p.append(found[cell.name].coverage[name, level].p)
    return dict(zip(keys, holm(p), strict=True))


def verdicts(found: dict[str, Summary]) -> list[Verdict]:
    """Hold every group against what is asked of it; groups without results are left out."""
    out: list[Verdict] = []
    for group in GROUPS:
        cells = [s for s in found.values() if s.cell.group == group]
        if not cells:
            continue
        if group.rule == "nominal":
            held = [s for s in cells if s.cell.terrain != "stops"]
            if held:
                out += [_nominal(found, group, level, _fewest(held)) for level in JUDGED_LEVELS]
            stops = [s for s in cells if s.cell.terrain == "stops"]
            out += [_least(group, stops, LEAST_ON_STOPS, "on stops")] if stops else []
            out.append(_narrow(group, cells))
        elif group.rule == "at least 90 %":
            out.append(_least(group, cells, LEAST_UNDER_STRAIN, "on every terrain"))
    return out


def _fewest(cells: list[Summary]) -> int:
    return min(s.answered for s in cells)


def _nominal(found: dict[str, Summary], group: Group, level: float, runs: int) -> Verdict:
    p = adjusted(found, group, level)
    asked = f"coverage {100 * level:.0f} % on bump, rough and rollers, no test rejects (Holm, 5 %)"
    terrain, name = min(
        p, key=lambda key: (p[key], found[f"{group.key}-{key[0]}"].coverage[key[1], level].p)
    )
    worst = found[f"{group.key}-{terrain}"].coverage[name, level]
    words = f"lowest adjusted p {p[terrain, name]:.2g}: {_share(worst)}, {name}, {terrain}"
    return Verdict(group, asked, p[terrain, name] >= _ALPHA, words, runs)


def _least(group: Group, cells: list[Summary], least: float, where: str) -> Verdict:
    every = [(s.coverage[n, 0.95], n, s.cell.terrain) for s in cells for n in judged(s.cell)]
    worst, name, terrain = min(every, key=lambda one: one[0].share)
    asked = f"coverage of 95 % intervals at least {100 * least:.0f} % {where}"
    words = f"{_share(worst)}, {name}, {terrain}"
    return Verdict(group, asked, worst.share >= least, words, _fewest(cells))


def _narrow(group: Group, cells: list[Summary]) -> Verdict:
    every = [(s.ratio[n], n, s.cell.terrain) for s in cells for n in judged(s.cell)]
    worst, name, terrain = max(every)
    asked = f"median width at most {WIDEST:g} times the bound"
    words = f"{worst:.2f}, {name}, {terrain}"
    return Verdict(group, asked, worst <= WIDEST, words, _fewest(cells))


def _share(one: Coverage) -> str:
    low, high = one.interval
    return f"{100 * one.share:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def agreement(results: dict[str, Results]) -> RunConsistency | None:
    """Compare what was sampled both ways; None when nothing was."""
    place, width = [], []
    runs = 0
    for found in results.values():
        for row in found.rows:
            runs += bool(row.checked)
            for name, (p, w) in row.checked.items():
                place.append(row.places[name] - p)
                if name in row.widths and w > 0.0:
                    width.append(abs(row.widths[name] / w - 1.0))
    if not place:
        return None
    apart = np.abs(place)
    return RunConsistency(
        runs=runs,
        place=float(np.sqrt(np.mean(apart**2))),
        largest=float(apart.max()),
        width=float(np.median(width)),
    )
