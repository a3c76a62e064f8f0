"""Thread pool for many small tasks, with at most one thread per processor."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

__all__ = ["Threads", "threads"]

_MAX_THREADS = 2  # a task takes some tenths of a millisecond, too little for more threads
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Threads:
    """Thread pool inside a context; with one processor, the calling thread does the work.

    Parameters
    ----------
    count : int
        Number of threads.
    executor : ThreadPoolExecutor or None
        None if the calling thread does the work.
    """

    count: int
    executor: ThreadPoolExecutor | None

    def map(self, function: Callable[..., T], *arguments: Iterable[Any]) -> Iterator[T]:
        """Apply a function to arguments, in order."""
        return (
            self.executor.map(function, *arguments) if self.executor else map(function, *arguments)
        )


@contextmanager
def threads() -> Iterator[Threads]:
    """Provide one thread for each processor that this process may use, at most two."""
    count = min(_MAX_THREADS, _processors())
    if count == 1:
        yield Threads(1, None)
        return
    executor = ThreadPoolExecutor(count)
    try:
        yield Threads(count, executor)
    except BaseException:  # on Ctrl-C, do not wait for pending tasks
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()


def _processors() -> int:
    """Return the number of processors that this process may use.

    ``OMP_NUM_THREADS=1`` limits a process that shares the machine with others.
    """
    if os.environ.get("OMP_NUM_THREADS") == "1":
        return 1
    allowed = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1
