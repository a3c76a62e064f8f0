"""Threads for many small pieces of work, as many as there are processors to run them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

__all__ = ["Threads", "threads"]

_MOST = 2  # pieces of work take some tenths of a millisecond, too little to share among many
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Threads:
    """Threads that work while a context lasts; the caller's own where there is one processor.

    Parameters
    ----------
    count : int
        Number of threads.
    executor : ThreadPoolExecutor or None
        None where the caller's thread does the work.
    """

    count: int
    executor: ThreadPoolExecutor | None

    def map(self, function: Callable[..., T], *arguments: Iterable[Any]) -> Iterator[T]:
        """Apply a function to arguments, in their order."""
        return (
            self.executor.map(function, *arguments) if self.executor else map(function, *arguments)
        )


@contextmanager
def threads() -> Iterator[Threads]:
    """Provide as many threads as this process may use processors, at most two."""
    count = min(_MOST, _processors())
    if count == 1:
        yield Threads(1, None)
        return
    executor = ThreadPoolExecutor(count)
    try:
        yield Threads(count, executor)
    except BaseException:  # Ctrl-C does not wait for work whose result nobody takes
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()


def _processors() -> int:
    """Return the number of processors that this process may use.

    One process of several that share a machine is told so by ``OMP_NUM_THREADS=1``.
    """
    if os.environ.get("OMP_NUM_THREADS") == "1":
        return 1
    allowed = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1
