"""Run the blind cases, each once; results are on disk as soon as they are done."""

from __future__ import annotations

import argparse
import signal
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path

from bayes_asv.domain.errors import InputError
from bayes_asv.library.progress import progress_bar
from benchmarks.battery.json_lines import append
from benchmarks.battery.parallel import run_parallel
from benchmarks.battery.run import LOOSE, Result, drop, load
from benchmarks.blind.cases import in_turn
from benchmarks.blind.page import write_page
from benchmarks.blind.run import diagnosed
from benchmarks.blind.simulator.cases import CELLS, SEED
from benchmarks.calibration.bench import ROOT, about

__all__ = ["RESULTS", "main"]

RESULTS = ROOT / "benchmarks" / "results" / "blind"


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind",
        description="Diagnose cars, roads and faults of an author who knows the user pages alone.",
    )
    parser.add_argument("--cells", nargs="+", metavar="NAME", help="beginnings of names of cells")
    parser.add_argument("--runs", type=int, help="cases per cell at most")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument("--report", action="store_true", help="write the page from the results")
    given = parser.parse_args(arguments)
    if given.report:
        write_page(given.out, ROOT / "docs")
        return 0
    cells = {
        name: count
        for name, count in CELLS.items()
        if given.cells is None or any(name.startswith(x) for x in given.cells)
    }
    told = about(SEED)
    drop(given.out, [one.name for one in load(given.out).values() if one.about.seed != SEED])
    done_before = load(given.out)
    wanted = [key for key in in_turn(cells, given.runs) if key not in done_before]
    try:
        with progress_bar() as progress:

            def keep(result: Result, done: int) -> None:
                append(given.out / LOOSE, [asdict(result)])
                if progress is not None:
                    progress(done / len(wanted), f"{result.name}: {done} of {len(wanted)} cases")

            run_parallel(partial(diagnosed, told), wanted, given.processes, keep)
    except InputError as exc:
        print(exc, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; the same command resumes", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stop as on an interrupt
    sys.exit(main())
