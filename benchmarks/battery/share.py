"""Work shared among processes; every piece is handed back as soon as it is done."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import TypeVar

__all__ = ["shared"]

T = TypeVar("T")
R = TypeVar("R")


def shared(
    work: Callable[[T], R], things: Sequence[T], processes: int, keep: Callable[[R, int], None]
) -> None:
    """Work on things, and keep every result with the number of those that are done.

    Parameters
    ----------
    work : callable
        Importable by name, since it runs in another process.
    things : sequence
        What to work on.
    processes : int
        One works here and starts none.
    keep : callable
        Gets a result and how many there are by now.
    """
    if processes == 1:
        for count, thing in enumerate(things, 1):
            keep(work(thing), count)
        return
    # Matrices here are small: more than one thread of a library only gets in the way.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    done = 0
    with ProcessPoolExecutor(processes, mp_context=context, initializer=_leave_to_parent) as pool:
        queue = iter(things)
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
            for future in waiting:  # what was under way is not lost
                if not future.cancelled() and future.exception() is None:
                    done += 1
                    keep(future.result(), done)
            raise


def _leave_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
