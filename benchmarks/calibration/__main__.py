"""Command line of the calibration bench."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from bayes_asv.domain.errors import InputError
from bayes_asv.library.progress import progress_bar
from benchmarks.calibration.bench import ROOT, about, work
from benchmarks.calibration.cells import CELLS, Cell
from benchmarks.calibration.page import write_page

RESULTS = ROOT / "benchmarks" / "results" / "calibration"


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.calibration",
        description="Coverage on the rig, simulation-based calibration, and the Cramér–Rao bound.",
    )
    parser.add_argument("--cells", nargs="+", metavar="NAME",
                        help="cells, or beginnings of their names; all when left out")  # fmt: skip
    parser.add_argument("--runs", type=_positive, help="runs a cell, in place of its own number")
    parser.add_argument("--processes", type=_positive, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument("--fresh", action="store_true", help="do runs again that are there")
    parser.add_argument("--list", action="store_true", help="name the cells and their runs")
    tables = "write tables and pictures from the results, not while a bench runs into them"
    parser.add_argument("--report", action="store_true", help=tables)
    parser.add_argument("--docs", type=Path, default=ROOT / "docs", help="folder of the page")
    given = parser.parse_args(arguments)
    try:
        cells = chosen(given.cells)
        if given.list:
            for cell in cells:
                print(f"{cell.name:24} {cell.runs:5}  {cell.group.title}")
        elif given.report:
            write_page(given.out, given.docs)
        else:
            with progress_bar() as progress:
                told = about(given.seed)
                work(cells, given.out, told, given.processes, given.runs, given.fresh, progress)
    except InputError as exc:
        print(exc, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; the same command goes on where it was", file=sys.stderr)
        return 130
    return 0


def chosen(names: list[str] | None) -> tuple[Cell, ...]:
    """Cells whose names begin with one of the given words, each once, in their own order.

    Raises
    ------
    InputError
        When a word begins no cell's name.
    """
    if names is None:
        return CELLS
    for name in names:
        if not any(cell.name.startswith(name) for cell in CELLS):
            raise InputError("--cells", f"no cell begins with '{name}'", "see --list")
    return tuple(cell for cell in CELLS if cell.name.startswith(tuple(names)))


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a stop is a stop
    sys.exit(main())
