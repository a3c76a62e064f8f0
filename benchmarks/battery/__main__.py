"""Command line of the battery."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from bayes_asv.domain.errors import InputError
from bayes_asv.library.progress import progress_bar
from benchmarks.battery.ablations import ABLATIONS
from benchmarks.battery.cells import CELLS, Cell
from benchmarks.battery.diagnoser import DEFAULT
from benchmarks.battery.page import LEFT_OUT, write_page
from benchmarks.battery.run import diagnose_all, drop
from benchmarks.battery.seal import answers, forget, seal
from benchmarks.calibration.bench import ROOT, about

__all__ = ["RESULTS", "chosen", "main"]

RESULTS = ROOT / "benchmarks" / "results" / "battery"


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.battery",
        description="Diagnose cars with sealed faults and judge the diagnoses.",
    )
    which = "cells, groups, or beginnings of their names (default: all)"
    parser.add_argument("--cells", nargs="+", metavar="NAME", help=which)
    parser.add_argument("--runs", type=_positive, help="cases per cell, in place of its own number")
    parser.add_argument("--processes", type=_positive, default=2)
    parser.add_argument("--seed", type=int, default=1)
    whose = "vehicle families: those of development, or those of the test (default)"
    parser.add_argument("--set", choices=("dev", "test"), default="test", dest="fleet", help=whose)
    parser.add_argument("--out", type=Path, help="folder of the results")
    judged = "diagnoser to judge (default: the diagnosis, called in process)"
    parser.add_argument("--diagnoser", default=DEFAULT, metavar="MODULE:FUNCTION", help=judged)
    left_out = f"leave a part of the diagnosis out: {', '.join(ABLATIONS)}"
    parser.add_argument("--ablation", metavar="NAME", help=left_out)
    parser.add_argument("--fresh", action="store_true", help="repeat cases that have a result")
    parser.add_argument("--reseal", action="store_true", help="repeat the answers as well")
    parser.add_argument("--seal-only", action="store_true", help="seal answers without diagnosing")
    parser.add_argument(
        "--list", action="store_true", help="list the cells and their numbers of cases"
    )
    parser.add_argument("--report", action="store_true", help="write the page from the results")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs", help="folder of the page")
    given = parser.parse_args(arguments)
    folder = given.out or RESULTS / given.fleet
    place = folder / LEFT_OUT / given.ablation if given.ablation else folder
    try:
        cells = chosen(given.cells)
        if given.list:
            for cell in cells:
                print(f"{cell.name:28} {cell.runs:4}  {cell.group.title}")
        elif given.report:
            write_page(folder, given.docs, answers(folder, given.fleet, given.seed))
        else:
            names = [cell.name for cell in cells]
            if given.fresh or given.reseal:
                drop(place, names)
            if given.reseal:
                forget(folder, names)
            with progress_bar() as progress:
                sealed = seal(folder, cells, given.fleet, given.seed, given.runs, given.processes,
                              progress)  # fmt: skip
                if not given.seal_only:
                    diagnose_all(
                        place, cells, sealed, about(given.seed), diagnoser=given.diagnoser,
                        ablation=given.ablation, runs=given.runs, processes=given.processes,
                        progress=progress,
                    )  # fmt: skip
    except InputError as exc:
        print(exc, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; the same command resumes", file=sys.stderr)
        return 130
    return 0


def chosen(names: list[str] | None) -> tuple[Cell, ...]:
    """Return the cells of the given names or groups, or whose names begin so.

    Raises
    ------
    InputError
        If there is no such cell.
    """
    if names is None:
        return CELLS
    found: set[str] = set()
    for name in names:
        own = {cell.name for cell in CELLS if name in (cell.name, cell.group.key)}
        own = own or {cell.name for cell in CELLS if cell.name.startswith(name)}
        if not own:
            raise InputError("--cells", f"no cell begins with '{name}'", "see --list")
        found |= own
    return tuple(cell for cell in CELLS if cell.name in found)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stop as on an interrupt
    sys.exit(main())
