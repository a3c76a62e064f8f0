"""Print the last results, one line per group or case: ``python -m benchmarks.battery.peek``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bayes_asv.domain.errors import InputError
from benchmarks.battery.__main__ import RESULTS
from benchmarks.battery.judge import Judged
from benchmarks.battery.page import judged
from benchmarks.battery.run import load
from benchmarks.battery.seal import answers
from benchmarks.battery.summary import by_group, closed, coverage, naming, single, strengths
from benchmarks.battery.tables import flagged_outside, misnamed_outside, percent

__all__ = ["case_line", "group_lines", "main"]


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.battery.peek", description="Print the last results."
    )
    parser.add_argument("--set", choices=("dev", "test"), default="dev", dest="fleet")
    parser.add_argument("--out", type=Path, help="folder of the results")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", nargs="*", metavar="NAME",
                        help="one line per case; only those whose names begin so")  # fmt: skip
    parser.add_argument("--wrong", action="store_true", help="only cases with a wrong diagnosis")
    given = parser.parse_args(arguments)
    folder = given.out or RESULTS / given.fleet
    try:
        cases = judged(load(folder), answers(folder, given.fleet, given.seed))
    except InputError as exc:
        print(exc, file=sys.stderr)
        return 2
    if given.cases is None and not given.wrong:
        print("\n".join(group_lines(cases)) or f"{folder} has no runs")
        return 0
    chosen = tuple(given.cases or ("",))
    for one in cases:
        if one.truth.name.startswith(chosen) and not (given.wrong and _fine(one)):
            print(case_line(one))
    return 0


def group_lines(cases: Sequence[Judged]) -> list[str]:
    """Return one line per group and strength."""
    out = []
    for group, there in by_group(cases).items():
        for strength in strengths(there) or [0.0]:
            own = single(there, strength) if strength else list(there)
            if not own:
                continue
            n, gap = naming(own), closed(own)
            words = [f"{group.key + (f'-{strength:g}' if strength else ''):22} {len(own):4}"]
            words.append(f"alarm {percent(n.detected)}")
            if strength and group.key != "outside":
                words.append(f"name {percent(n.first)} class {percent(n.of_class)}")
                words.append(f"all {percent(n.every)}")
            if group.key == "outside":
                words.append(f"flagged {percent(flagged_outside(own))}")
                words.append(f"misnamed {percent(misnamed_outside(own))}")
            else:
                words.append(f"confidently wrong {percent(n.confidently_wrong)}")
            if gap.cases:
                words.append(f"gap {100 * gap.median:.1f} ({100 * gap.tenth:.0f})")
                words.append(f"worse {gap.worse.hits}/{gap.worse.of}")
            for name, (before, after, _) in coverage(own).items():
                words.append(f"{name} {100 * before.share:.0f}>{100 * after.share:.0f}")
            words.append(f"{sum(one.seconds for one in own) / len(own):.1f} s")
            broken = sum(one.verdict in ("refused", "error") for one in own)
            out.append("  ".join(words) + (f"  {broken} without answer" if broken else ""))
    return out


def case_line(one: Judged) -> str:
    """Return the truth and the diagnosis of a case in one line."""
    t = one.truth
    true = ", ".join(f"{e.name}@{e.where or '-'} {e.size:.3g}" for e in t.effects) or t.kind
    said = ", ".join(
        f"{name} {p:.2f}{'' if yes else '!'}"
        for name, (p, yes) in zip(one.named, one.probabilities, strict=True)
    )
    flag = " +unexplained" if one.flagged and one.verdict != "unexplained" else ""
    gap = "" if one.gap is None else f" gap {100 * one.gap.closed:.0f} %"
    return (
        f"{t.name} {t.number} [{t.family}, {t.terrain}>{t.held_out}, noise {t.noise:g}] {true} -> "
        f"{one.verdict}{flag} {said}{gap} {one.seconds:.1f} s"
    )


def _fine(one: Judged) -> bool:
    if one.truth.kind in ("null", "lifting", "coarse"):
        return one.verdict == "agreement"
    if one.truth.kind in ("clutter", "outside"):
        return not one.confidently_wrong and one.verdict != "error"
    return all(one.found) and not one.extra


if __name__ == "__main__":
    sys.exit(main())
