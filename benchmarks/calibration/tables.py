"""Tables of the page, and the whole of it as comma-separated values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchmarks.calibration.cells import GROUPS, NAMES, Cell, Group
from benchmarks.calibration.store import Results
from benchmarks.calibration.summary import (
    JUDGED_LEVELS,
    Summary,
    Verdict,
    adjusted,
    judged,
    places,
)
from benchmarks.calibration.uniformity import departure
from benchmarks.calibration.verdicts import LEVELS, Coverage, coverage

__all__ = [
    "conditions_table",
    "csv",
    "deviating",
    "full_table",
    "model_table",
    "table",
    "verdict_table",
]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a Markdown table; the first column is text, the others are numbers."""
    rule = ["---", *("---:" for _ in head[1:])]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *rows)) + "\n"


def percent(one: Coverage) -> str:
    """Format a coverage in per cent with Jeffreys' interval."""
    low, high = one.interval
    return f"{100 * one.share:.1f} ({100 * low:.1f}–{100 * high:.1f})"


def verdict_table(verdicts: Sequence[Verdict]) -> str:
    """Tabulate the criteria of each group and whether they are met."""
    rows = []
    for v in verdicts:
        met = ("yes" if v.met else "**no**") if v.settled else f"too few runs ({v.runs})"
        rows.append([v.group.title, v.asked, met, v.found])
    text = table(["drives", "criterion", "met", "worst result"], rows)
    return text.replace("---:", "---")


def full_table(found: Mapping[str, Summary], group: Group) -> str:
    """Every level of every quantity of a group, a row a terrain and quantity."""
    p = {level: adjusted(dict(found), group, level) for level in JUDGED_LEVELS}
    rows = []
    for summary in found.values():
        if summary.cell.group != group:
            continue
        for name in judged(summary.cell):
            key = (summary.cell.terrain, name)
            least = [p[level][key] for level in JUDGED_LEVELS if key in p[level]]
            rows.append(
                [
                    f"{summary.cell.terrain}, {name}",
                    str(summary.answered),
                    *(percent(summary.coverage[name, level]) for level in LEVELS),
                    f"{min(least):.2g}" if least else "",
                    f"{100 * summary.width[name]:.2g} %",
                    f"{summary.ratio[name]:.2f}",
                ]
            )
    levels = [f"{100 * level:.0f} %" for level in LEVELS]
    return table(["drive", "runs", *levels, "p", "width", "width / bound"], rows)


def conditions_table(found: Mapping[str, Summary], groups: Sequence[Group]) -> str:
    """Coverage at 95 % of the other conditions, a row a cell."""
    rows = []
    for group in groups:
        p = {level: adjusted(dict(found), group, level) for level in JUDGED_LEVELS}
        for summary in found.values():
            if summary.cell.group != group:
                continue
            terrain = summary.cell.terrain
            least = [v for level in p.values() for key, v in level.items() if key[0] == terrain]
            shares = [
                f"{100 * summary.coverage[n, 0.95].share:.1f}" if n in judged(summary.cell) else ""
                for n in NAMES
            ]
            rows.append(
                [
                    f"{group.title}: {terrain}",
                    _counts(summary),
                    *shares,
                    f"{min(least):.2g}" if least else "",
                    f"{max(summary.ratio[n] for n in judged(summary.cell)):.2f}",
                ]
            )
    head = ["drive", "answered", *(f"{n}, %" for n in NAMES), "p", "width / bound"]
    return table(head, rows)


def _counts(summary: Summary) -> str:
    text = f"{summary.answered} of {summary.runs}"
    if summary.not_converged:
        text += f" ({summary.not_converged} not converged)"
    return text


def deviating(found: Mapping[str, Summary]) -> list[str]:
    """Cells whose coverage a test rejects after adjusting, each in a sentence."""
    out = []
    for group in GROUPS:
        for level in JUDGED_LEVELS:
            for (terrain, name), p in adjusted(dict(found), group, level).items():
                if p >= 0.05:
                    continue
                one = found[f"{group.key}-{terrain}"].coverage[name, level]
                side = "too narrow" if one.share < level else "too wide"
                out.append(
                    f"{group.title}, {terrain}, {name}: {100 * level:.0f} % intervals contain the "
                    f"true value in {percent(one)} %, {side} (adjusted p {p:.2g})"
                )
    return out


def model_table(cell: Cell, results: Results) -> str:
    """Uniformity of every quantity of the draws from the model."""
    there = places(results.rows)
    rows = []
    for name, x in there.items():
        p = departure(x)
        rejected = "**yes**" if p < 0.05 / len(there) else "no"
        rows.append([name, percent(coverage(x, 0.95)), f"{p:.3f}", rejected])
    head = [cell.group.title.lower(), "coverage of 95 % intervals, %", "p of uniformity",
            f"rejected (5 %, Bonferroni over {len(there)})"]  # fmt: skip
    return table(head, rows)


def csv(found: Mapping[str, Summary]) -> str:
    """All counts, one line a cell, quantity and level."""
    lines = [
        "cell,rate,terrain,quantity,level,runs,answered,not_converged,hits,coverage,low,high,"
        "p,width,width_over_bound,effective,coloured,clipped_a_drive"
    ]
    for name, s in found.items():
        for (quantity, level), one in s.coverage.items():
            low, high = one.interval
            lines.append(
                f"{name},{s.cell.rate:g},{s.cell.terrain},{quantity},{level:g},{s.runs},"
                f"{s.answered},{s.not_converged},{one.hits},{one.share:.4f},{low:.4f},{high:.4f},"
                f"{one.p:.3g},{s.width[quantity]:.4g},{s.ratio[quantity]:.4f},{s.effective:.0f},"
                f"{s.coloured},{s.clipped:.1f}"
            )
    return "\n".join(lines) + "\n"
