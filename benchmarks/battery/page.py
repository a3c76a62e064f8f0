"""The page: ``docs/battery.md`` with its pictures, from the results alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from benchmarks.battery import pictures
from benchmarks.battery.ablations import ABLATIONS
from benchmarks.battery.cells import CELLS, GROUPS
from benchmarks.battery.judge import Judged, judge
from benchmarks.battery.page_words import DEVELOPMENT, HOW, INTRODUCTION, LIMITS, SOURCES
from benchmarks.battery.run import Result, load, pack_results
from benchmarks.battery.seal import Answer, Key
from benchmarks.battery.summary import by_group, confusion, strengths
from benchmarks.battery.tables import (
    SUMMARY_HEAD,
    by_condition,
    by_effect,
    by_strength,
    coverage_table,
    effects_coverage_table,
    gap_table,
    outside_table,
    short_answer,
    sizes_table,
    summary_row,
)
from benchmarks.calibration.tables import table
from benchmarks.freshness import RESULTS

__all__ = ["LEFT_OUT", "judged", "write_page"]

LEFT_OUT = "ablations"
"""Folder beside the results with one of its own for every ablation."""


def judged(results: Mapping[Key, Result], sealed: Mapping[Key, Answer]) -> list[Judged]:
    """Judge every result against its sealed answer.

    Raises
    ------
    InputError
        If the answer of a result is not sealed, or was sealed after the diagnosis began.
    """
    out = []
    for key, result in results.items():
        answer = sealed.get(key)
        if answer is None or answer.seal != result.seal or result.begun < answer.sealed:
            raise InputError(
                f"{key[0]} {key[1]}", "has no answer that was sealed before it",
                "do the case again with --fresh",
            )  # fmt: skip
        out.append(judge(result, answer.truth))
    return out


def write_page(folder: Path, docs: Path, sealed: Mapping[Key, Answer]) -> None:
    """Write the page and its pictures.

    Parameters
    ----------
    folder : Path
        Results, which are packed.
    docs : Path
        Destination of ``battery.md`` and ``battery/``.
    sealed : mapping
        Answers by name and number.

    Raises
    ------
    InputError
        If there are no results, or an answer was not sealed before its result.
    """
    results = load(folder)
    if not results:
        raise InputError(str(folder), "has no runs", "run python -m benchmarks.battery first")
    cases = judged(results, sealed)
    pack_results(folder)
    beside = docs / "battery"
    beside.mkdir(parents=True, exist_ok=True)
    with pictures.look():
        shown = _pictures(cases, beside)
    parts = [INTRODUCTION + _fleet(cases), _summary_head(results) + short_answer(cases)]
    parts += [*shown, *_tables(cases)]
    parts += [HOW, _ablations(folder, sealed, cases), _sizes(cases), LIMITS + _missing(cases)]
    parts.append(_origin(results, sealed))
    write_atomically(str(docs / "battery.md"), "\n".join(p for p in parts if p).encode("utf-8"))


def _pictures(cases: Sequence[Judged], beside: Path) -> list[str]:
    groups = by_group(cases)
    one_effect = [one for group, there in groups.items() if group.key == "single" for one in there]
    parts = []
    if one_effect:
        pictures.save(pictures.naming_picture(one_effect), beside / "naming.png")
        parts.append("![Single effects by strength](battery/naming.png)\n")
        parts.append("## First name by true effect\n")
    for strength in strengths(one_effect):
        if len(confusion(groups, strength)[0]):
            name = f"confusion-{strength:g}.png"
            pictures.save(pictures.confusion_picture(groups, strength), beside / name)
            parts.append(f"![Confusion matrix, noncentrality {strength:g}](battery/{name})\n")
    if any(one.probabilities for one in cases):
        pictures.save(pictures.reliability_picture(cases), beside / "reliability.png")
        parts.append("## Reliability of the probabilities\n\n"
                     "![Reliability curve](battery/reliability.png)\n")  # fmt: skip
    return parts


def _tables(cases: Sequence[Judged]) -> list[str]:
    """Return every table that has rows, under its heading."""
    there = (
        ("By strength", "All in per cent.\n\n", by_strength),
        ("By effect", "Single effects of noncentrality 40 and more, in per cent.\n\n", by_effect),
        ("By condition", "The same cases, and false alarms for cars without a fault.\n\n",
         by_condition),
        ("Faults outside the list", "", outside_table),
        ("Held-out simulation error", "Fraction of the gap above the floor that is closed.\n\n",
         gap_table),
        ("Coverage before and after naming", "95 % intervals that contain the true value, in per "
         "cent; the width is the relative standard deviation of the widest of the three, "
         "median.\n\n",
         coverage_table),
        ("Intervals of effects' parameters", "95 % intervals that contain the true value, of "
         "effects that are named at their place; the lowest first.\n\n", effects_coverage_table),
    )  # fmt: skip
    parts = []
    for title, words, made in there:
        text = made(cases)
        if text.count("\n") > 2:
            parts.append(f"## {title}\n\n{words}{text}")
    return parts


def _sizes(cases: Sequence[Judged]) -> str:
    text = sizes_table(cases)
    return (
        "## Sizes of the effects\n\nMedian size by noncentrality; for factors the deviation from "
        f"one.\n\n{text}"
        if text.count("\n") > 2
        else ""
    )


def _ablations(folder: Path, sealed: Mapping[Key, Answer], whole: Sequence[Judged]) -> str:
    """Compare ablations with the whole diagnosis, on common cases."""
    places = sorted(path for path in (folder / LEFT_OUT).glob("*") if path.is_dir())
    rows = []
    for place in places:
        results = load(place)
        if not results:
            continue
        pack_results(place)
        own = judged(results, sealed)
        keys = {(one.truth.name, one.truth.number) for one in own}
        same = [one for one in whole if (one.truth.name, one.truth.number) in keys]
        rows += [summary_row("whole", same), summary_row(_left_out(place.name), own)]
    if not rows:
        return ""
    return (
        "## Ablations\n\nEach ablation follows the whole diagnosis on the same cases; proportions "
        "in per cent.\n\n" + table(SUMMARY_HEAD, rows)
    )


def _left_out(name: str) -> str:
    return ABLATIONS[name].title if name in ABLATIONS else name.replace("_", " ")


def _fleet(cases: Sequence[Judged]) -> str:
    """State the families of cars and whether they are those of development."""
    families = ", ".join(dict.fromkeys(sorted(one.truth.family for one in cases)))
    if any(one.truth.fleet == "dev" for one in cases):
        return f"\n**These are the cars of the development set ({families}).**\n"
    return f"\nFamilies of cars: {families}.\n{DEVELOPMENT}"


def _summary_head(results: Mapping[Key, Result]) -> str:
    """Return the heading of the summary, with a warning if it mixes several commits."""
    head = (
        "## Summary\n\nThe figures belong to the commits named on this page; [Evidence]"
        "(evidence.md) says whether the code has changed since. [Limitations](#limitations) says "
        "what was not run.\n\n"
    )
    commits: dict[str, list[str]] = {}
    for (name, _), result in results.items():
        commits.setdefault(result.about.commit, []).append(name)
    if len(commits) < 2:
        return head
    parts = [
        f"{len(names)} cases at commit {commit} ({_kinds(names)})"
        for commit, names in sorted(commits.items(), key=lambda item: -len(item[1]))
    ]
    return (
        head
        + f"**The table mixes {len(commits)} versions of the diagnosis.** Cases of one version "
        "were not repeated with the other:\n\n" + "".join(f"- {part}\n" for part in parts) + "\n"
    )


def _kinds(names: Sequence[str]) -> str:
    """Summarise the cells of some cases by group and strength."""
    groups = {cell.name: cell.group for cell in CELLS}
    counts: dict[str, int] = {}
    for name in names:
        group = groups.get(name)
        key = name if group is None else group.title[0].lower() + group.title[1:]
        strength = name.rpartition("-")[2]
        if strength.replace(".", "").isdigit():
            key += f", {strength}"
        counts[key] = counts.get(key, 0) + 1
    return "; ".join(f"{key}: {count}" for key, count in sorted(counts.items()))


def _missing(cases: Sequence[Judged]) -> str:
    """Name what the full battery has and these runs have not."""
    there: dict[str, int] = {}
    for one in cases:
        there[one.truth.name] = there.get(one.truth.name, 0) + 1
    short = [cell for cell in CELLS if there.get(cell.name, 0) < cell.runs]
    if not short:
        return ""
    missing = sum(cell.runs - there.get(cell.name, 0) for cell in short)
    whole = sum(cell.runs for cell in CELLS)
    text = f"- {missing} of the {whole} cases of the full battery were not run"
    some = sum(there.get(cell.name, 0) > 0 for cell in short)
    text += f"; {some} of its {len(CELLS)} cells have fewer cases than planned.\n"
    absent = [
        group.title[0].lower() + group.title[1:]
        for group in GROUPS
        if not any(there.get(cell.name) for cell in CELLS if cell.group == group)
    ]
    weak = [cell for cell in CELLS if cell.name.endswith("-10")]
    if weak and not any(there.get(cell.name) for cell in weak):
        absent.append("single effects of noncentrality 10")
    if absent:
        text += (
            "- **The hardest cells are among those that were not run:** " + "; ".join(absent)
            + ". No figure on this page covers them.\n"
        )  # fmt: skip
    return text


def _origin(results: Mapping[Key, Result], sealed: Mapping[Key, Answer]) -> str:
    about = dict.fromkeys(result.about for result in results.values())
    lines = [f"- seed {one.seed}, commit {one.commit}, {one.versions}" for one in about]
    seals = dict.fromkeys((a.seal, a.sealed) for k, a in sealed.items() if k in results)
    lines += [f"- answers `{seal}`, sealed {when}" for seal, when in seals]
    lines.append(f"- first diagnosis {min(result.begun for result in results.values())}")
    again = "".join(f"python -m {words}\n" for words in RESULTS["battery"].commands)
    return (
        "## Reproduce\n\n```sh\n" + again
        + "python -m benchmarks.battery.peek --set dev  # last results of the development set\n"
        + "```\n\nIt takes hours, and goes on where it was stopped. `--list` lists the cells, "
        "`--cells null bound_rebound --runs 2 --out FOLDER` runs some of them, `--ablation NAME` "
        "omits a part of the diagnosis.\n\n"
        + "\n".join(lines) + "\n" + SOURCES
    )  # fmt: skip
