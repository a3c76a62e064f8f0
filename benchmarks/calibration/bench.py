"""Runs shared among processes; whatever is finished is on disk."""

from __future__ import annotations

import multiprocessing
import os
import platform
import signal
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path

import numba
import numpy as np
import scipy

from bayes_asv import __version__
from bayes_asv.domain.errors import InputError
from benchmarks.calibration.cells import Cell
from benchmarks.calibration.run import Row, several
from benchmarks.calibration.store import About, append, drop, load

__all__ = ["about", "work"]

Progress = Callable[[float, str], None]

ROOT = Path(__file__).parents[2]
_TOGETHER = 10  # runs a line
# What an answer depends on; a change elsewhere in the tree does not make it another bench.
_JUDGED = ("bayes_asv", "benchmarks/calibration", "tests/rig")


def about(seed: int) -> About:
    """Seed, commit and versions."""
    commit = _git("rev-parse", "--short", "HEAD") or "unknown"
    if _git("status", "--porcelain", "--", *_JUDGED):
        commit += "+"
    versions = (
        f"bayes_asv {__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"scipy {scipy.__version__}, numba {numba.__version__}"
    )
    return About(seed, commit, versions)


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
    )  # a copy without git has no commit to name
    return done.stdout.strip() if done.returncode == 0 else ""


def work(
    cells: Sequence[Cell],
    folder: Path,
    told: About,
    processes: int,
    runs: int | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> int:
    """Do every run of some cells that is not there yet.

    Parameters
    ----------
    cells : sequence of Cell
        What to drive.
    folder : Path
        Where results are kept.
    told : About
        What is written beside them.
    processes : int
        How many share the work. Each climbs to its modes with two threads; the rest is single.
    runs : int, optional
        Runs a cell in place of each cell's own number.
    fresh : bool
        Forget what is there of these cells.
    progress : callable, optional
        Told the share done and a few words.

    Returns
    -------
    int
        Number of runs done.

    Raises
    ------
    InputError
        When a cell's results are of another commit or seed.
    """
    if fresh:
        drop(folder, [cell.name for cell in cells])
    there = load(folder)
    chunks: list[tuple[Cell, list[int]]] = []
    for cell in cells:
        found = there.get(cell.name)
        if found and found.about != (told,):
            other = next(one for one in found.about if one != told)
            raise InputError(
                str(folder),
                f"the runs of {cell.name} are of commit {other.commit}, seed {other.seed}",
                "add --fresh to do them again, or name another --out",
            )
        done = {row.run for row in found.rows} if found else set()
        left = [k for k in range(cell.runs if runs is None else runs) if k not in done]
        chunks += [(cell, left[k : k + _TOGETHER]) for k in range(0, len(left), _TOGETHER)]
    total = sum(len(chunk) for _, chunk in chunks)
    finished = 0

    def keep(cell: Cell, rows: list[Row]) -> None:
        nonlocal finished
        append(folder, cell.name, rows, told)
        finished += len(rows)
        if progress is not None:
            progress(finished / total, f"{cell.name}: {finished} of {total} runs")

    if processes == 1:
        for cell, chunk in chunks:
            keep(cell, several(cell, told.seed, chunk))
        return finished
    # Matrices here are small: more than one thread of a library only gets in the way.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        processes, mp_context=context, initializer=_leave_interrupts_to_the_parent
    ) as pool:
        waiting: dict[Future[list[Row]], Cell] = {}
        queue = iter(chunks)
        try:
            while True:
                while len(waiting) < 2 * processes:
                    following = next(queue, None)
                    if following is None:
                        break
                    cell, chunk = following
                    waiting[pool.submit(several, cell, told.seed, chunk)] = cell
                if not waiting:
                    return finished
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    keep(waiting.pop(future), future.result())
        except KeyboardInterrupt:
            pool.shutdown(wait=True, cancel_futures=True)
            for future, cell in waiting.items():  # what was under way is not lost
                if not future.cancelled() and future.exception() is None:
                    keep(cell, future.result())
            raise
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
