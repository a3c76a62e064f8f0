"""Work in parallel processes, with each result as soon as it is done."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import TypeVar

__all__ = ["run_parallel"]

T = TypeVar("T")
R = TypeVar("R")


def run_parallel(
    work: Callable[[T], R], items: Sequence[T], processes: int, keep: Callable[[R, int], None]
) -> None:
    """Work on items in parallel, and pass on each result with the number of those that are done.

    Parameters
    ----------
    work : callable
        Importable by name, for other processes.
    things : sequence
        Items of work.
    processes : int
        With 1, none is started.
    keep : callable
        Called with a result and the number of results so far.
    """
    if processes == 1:
        for count, item in enumerate(items, 1):
            keep(work(item), count)
        return
    # matrices are small: more threads of a library would only compete
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    done = 0
    with ProcessPoolExecutor(processes, mp_context=context, initializer=_leave_to_parent) as pool:
        queue = iter(items)
        waiting: set[Future[R]] = set()
        try:
            while True:
                while len(waiting) < 2 * processes:
                    following = next(queue, None)
                    if following is None:
                        break
                    waiting.add(pool.submit(work, following))
                if not waiting:
                    return
                finished = wait(waiting, return_when=FIRST_COMPLETED).done
                waiting -= finished
                for future in finished:
                    done += 1
                    keep(future.result(), done)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            for future in waiting:  # keep the results of work in progress
                if not future.cancelled() and future.exception() is None:
                    done += 1
                    keep(future.result(), done)
            raise


def _leave_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
