"""The page of the blind test: figures beside what was asked, those that fall short first."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bayes_asv.domain.files import write_atomically
from benchmarks.battery.intervals import Share, count_true
from benchmarks.battery.judge import PARAMETERS, Judged, judge
from benchmarks.battery.reliability import calibration_error
from benchmarks.battery.run import Result, load, pack_results
from benchmarks.battery.tables import effects_coverage_table, percent
from benchmarks.blind.simulator.cases import CELLS
from benchmarks.calibration.tables import table
from tests.battery.truth import from_dict

__all__ = ["write_page"]

ABOVE = 1.1
"""A held-out error that exceeds its floor by this factor can be said to close."""
PROBABILITIES = (0.0, 0.3, 0.65, 0.9, 0.99, 1.0)
"""Bounds of the table of probabilities."""
INTRODUCTION = Path(__file__).parent / "page.md.in"


class Figure(NamedTuple):
    """One figure: what it is, what was asked, what was found, from how many cases, how short."""

    what: str
    asked: str
    found: str
    cases: int
    short: float


def write_page(folder: Path, docs: Path) -> None:
    """Write ``blind.md`` from the results of a folder."""
    results = load(folder)
    pack_results(folder)
    cases = [judge(result, from_dict(result.document["truth"])) for result in results.values()]
    introduction = INTRODUCTION.read_text("utf-8")
    parts = [introduction + "\n" + _origin(results), "## Summary\n\n" + _summary(cases)]
    parts += ["## By cell\n\nIn per cent.\n\n" + _by_cell(cases)]
    parts += ["## Intervals of effects' parameters\n\n95 % intervals that overlap the values that "
              "may rightly be reported, of effects that are named at their place.\n\n"
              + effects_coverage_table(cases)]  # fmt: skip
    parts += ["## Probabilities\n\nAll names, by the probability that is printed with them; true "
              "ones in per cent.\n\n" + _reliability(cases)]  # fmt: skip
    write_atomically(str(docs / "blind.md"), "\n".join(parts).encode("utf-8"))


def _origin(results: Mapping[tuple[str, int], Result]) -> str:
    about = dict.fromkeys(result.about for result in results.values())
    lines = [f"- commit {one.commit}, seed {one.seed}, {one.versions}" for one in about]
    begun = sorted(result.begun for result in results.values())
    lines.append(f"- diagnosed from {begun[0]} to {begun[-1]}")
    missing = sum(CELLS.values()) - len(results)
    lines.append(f"- {len(results)} cases" + (f"; {missing} were not run" if missing else ""))
    return "\n".join(lines) + "\n"


def _of(cases: Sequence[Judged], kind: str) -> list[Judged]:
    return [c for c in cases if c.truth.kind == kind and c.verdict != "refused"]


def _summary(cases: Sequence[Judged]) -> str:
    null, single, pair, outside = (_of(cases, k) for k in ("null", "single", "pair", "outside"))
    figures = [
        _between("false alarms: no fault", 0.03, 0.07, [c.verdict != "agreement" for c in null]),
        _least("one listed effect: class of the first name right", 0.95,
               [c.class_right for c in single]),
        _most("one listed effect: confidently wrong", 0.02, [c.confidently_wrong for c in single]),
        _least("two listed effects: both found", 0.85, [all(c.found) for c in pair]),
        _least("outside the list: said that something is unexplained", 0.95,
               [c.flagged for c in outside]),
        _most("outside the list: confidently misnamed", 0.02,
              [c.confidently_wrong for c in outside]),
        _closed(outside),
        _least("intervals of effects' parameters that contain the truth", 0.9,
               [held for c in cases for _, _, held in c.effects_covered]),
    ]  # fmt: skip
    for name in PARAMETERS:
        held = [c.covered_after[name] for c in cases if name in c.covered_after]
        figures.append(
            _least(f"95 % intervals of {name} that contain the truth, all cases", 0.93, held)
        )
    claims = [pair for one in cases for pair in one.probabilities]
    if claims:
        error, chance = calibration_error(claims)
        words = f"{error:.3f} (if calibrated: below {chance:.3f} with 95 %)"
        figures.append(
            Figure("expected calibration error of all probabilities", "at most 0.03", words,
                   len(claims), error - 0.03)
        )  # fmt: skip
    rows = [
        [f.what, f.asked, ("**short** " if f.short > 0.0 else "") + f.found, str(f.cases)]
        for f in sorted(figures, key=lambda f: -f.short)
        if f.cases
    ]
    seconds = [one.seconds for one in cases]
    rows.append(["seconds per diagnosis, median and 95th percentile", "",
                 f"{np.median(seconds):.1f}, {np.quantile(seconds, 0.95):.1f}",
                 str(len(cases))])  # fmt: skip
    for verdict in ("refused", "error"):
        there = [one for one in cases if one.verdict == verdict]
        if there:
            rows.append([f"verdict {verdict}", "", str(len(there)), str(len(cases))])
    return table(["figure", "asked", "found", "cases"], rows)


def _closed(outside: Sequence[Judged]) -> Figure:
    """Share of the squared held-out error above the floor that goes, where there is any."""
    shares = [
        one.gap.closed
        for one in outside
        if one.gap is not None and one.gap.before > ABOVE * one.gap.floor
    ]
    median = float(np.median(shares)) if shares else math.nan
    return Figure(
        "outside the list: share of the squared held-out error above the floor that goes, median",
        "at least 80 %", f"{100.0 * median:.0f} %", len(shares), 0.8 - median,
    )  # fmt: skip


def _figure(
    what: str, asked: str, truths: Sequence[bool], short: Callable[[float], float]
) -> Figure:
    share = count_true(truths)
    low, high = share.interval
    words = f"{100 * share.share:.1f} ({100 * low:.1f}–{100 * high:.1f}) %"
    return Figure(what, asked, words, share.of, short(share.share))


def _least(what: str, asked: float, truths: Sequence[bool]) -> Figure:
    return _figure(what, f"at least {100 * asked:.0f} %", truths, lambda share: asked - share)


def _most(what: str, asked: float, truths: Sequence[bool]) -> Figure:
    return _figure(what, f"at most {100 * asked:.0f} %", truths, lambda share: share - asked)


def _between(what: str, low: float, high: float, truths: Sequence[bool]) -> Figure:
    asked = f"{100 * low:.0f} to {100 * high:.0f} %"
    return _figure(what, asked, truths, lambda share: max(low - share, share - high))


def _by_cell(cases: Sequence[Judged]) -> str:
    rows: list[tuple[float, list[str]]] = []
    for cell in CELLS:
        own = [one for one in cases if one.truth.name == cell and one.verdict != "refused"]
        if not own:
            continue
        faults = any(one.truth.effects for one in own)
        right = _right(cell, own)
        said: dict[str, int] = {}
        for one in own:
            said[one.said] = said.get(one.said, 0) + 1
        words = ", ".join(f"{what} {n}" for what, n in sorted(said.items(), key=lambda x: -x[1]))
        flagged, wrong = (
            percent(count_true(own_values))
            for own_values in ([c.flagged for c in own], [c.confidently_wrong for c in own])
        )
        intervals = [
            percent(count_true([c.covered_after[p] for c in own if p in c.covered_after]))
            for p in PARAMETERS
        ]
        found = percent(count_true([bool(c.found) and all(c.found) for c in own])) if faults else ""
        rows.append((right.share, [cell, str(len(own)), percent(right), found, flagged, wrong,
                                   *intervals, words]))  # fmt: skip
    head = ["cell", "cases", "right", "all found", "unexplained", "confidently wrong",
            *PARAMETERS, "said first"]  # fmt: skip
    return table(head, [row for _, row in sorted(rows, key=lambda one: one[0])])


def _reliability(cases: Sequence[Judged]) -> str:
    """Tabulate how often names of a probability are true, with and without a remainder."""
    rows = []
    for low, high in itertools.pairwise(PROBABILITIES):
        row = [f"{low:g} to {high:g}"]
        for flagged in (False, True):
            claims = [
                (stated, true)
                for one in cases
                if one.flagged == flagged
                for stated, true in one.probabilities
                if low <= stated < high or stated == high == 1.0
            ]
            mean = f"{np.mean([stated for stated, _ in claims]):.3f}" if claims else ""
            row += [str(len(claims)), mean, percent(count_true([bool(true) for _, true in claims]))]
        rows.append(row)
    head = ["probability", "names, nothing unexplained", "mean", "true",
            "names beside something unexplained", "mean", "true"]  # fmt: skip
    return table(head, rows)


def _right(cell: str, own: Sequence[Judged]) -> Share:
    """Share of cases with the right answer: class, all effects, nothing, or "unexplained"."""
    kind = cell.partition(":")[0]
    if kind == "single":
        return count_true([one.class_right for one in own])
    if kind == "pair":
        return count_true([all(one.found) for one in own])
    if kind == "outside":
        return count_true([one.flagged for one in own])
    if kind == "crosstalk":
        return count_true([one.flagged or not one.named for one in own])
    if kind == "tolerance":
        return count_true([not one.confidently_wrong for one in own])
    return count_true([one.verdict == "agreement" for one in own])
