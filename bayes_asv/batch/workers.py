"""Tasks in processes that may be killed: on this machine (loky), or on a Dask cluster.

Both are used as executors of :mod:`concurrent.futures`.  Processes are started once.  A task whose
process was killed runs again; if several ran at the time, each of them runs alone, so that one that
kills its process is found and does not take the others with it.
"""

from __future__ import annotations

import importlib
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import contextmanager
from typing import Generic, TypeVar

from bayes_asv.domain.errors import BayesAsvError, InputError

__all__ = ["DaskCluster", "LocalProcesses", "TaskFailedError", "run_tasks"]

T = TypeVar("T")
R = TypeVar("R")

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_MOST_LOSSES = 5  # of processes before any task has ended, after which no task is at fault
_WATCH = 0.5  # s


class TaskFailedError(BayesAsvError):
    """A task could not be run; the message says why."""


class LocalProcesses:
    """Processes on this machine, each with one thread.

    Parameters
    ----------
    count : int or None
        Number of processes; by default that of the processors that may be used.
    modules : sequence of str
        Imported when a process starts.
    """

    def __init__(self, count: int | None, modules: Sequence[str] = ()):
        import loky

        self.capacity = count or int(loky.cpu_count())
        self._modules = tuple(modules)

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        """Start the processes, and end them."""
        import loky

        pool = loky.ProcessPoolExecutor(
            max_workers=self.capacity,
            timeout=None,
            initializer=_prepare_process,
            initargs=(os.getpid(), self._modules),
            env=dict.fromkeys(_ONE_THREAD, "1"),
        )
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=True, kill_workers=True)
            raise
        pool.shutdown(wait=True)


class DaskCluster:
    """Workers of a Dask cluster that see the same files under the same names.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://10.0.0.5:8786``.
    seconds : float
        Time after which it is given up.

    Raises
    ------
    InputError
        If nothing answers there, or the package ``distributed`` is not installed.
    """

    def __init__(self, address: str, seconds: float = 10.0):
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                "dask", "the package distributed is not installed",
                "run pip install 'bayes-asv[dask]'",
            ) from None  # fmt: skip
        try:
            self._client = Client(address, timeout=seconds)
        except (OSError, ValueError) as error:
            raise InputError(
                address, f"no Dask scheduler answers ({type(error).__name__})",
                "start one: dask scheduler",
            ) from None  # fmt: skip
        self._address = address

    @property
    def capacity(self) -> int:
        """Number of tasks that are handed out at a time, so that no worker waits."""
        return 1 + 2 * int(sum(self._client.nthreads().values()))

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        """Connect to the scheduler; it cancels what is left when the connection ends."""
        with self._client:
            try:
                yield self._client.get_executor(pure=False)
            except CancelledError:
                raise InputError(
                    self._address, "the Dask scheduler has ended",
                    "start it, and the same command again: it continues where it stopped",
                ) from None  # fmt: skip


def run_tasks(
    workers: LocalProcesses | DaskCluster,
    function: Callable[[T], R],
    tasks: Sequence[T],
    finished: Callable[[T, R | TaskFailedError], None],
) -> None:
    """Run a function for every task, whatever becomes of single processes.

    Parameters
    ----------
    workers : LocalProcesses or DaskCluster
        Where.
    function : callable
        Of a module; takes a task.
    tasks : sequence
        In the order in which they are begun.
    finished : callable
        Called in this process with a task and its result as soon as it ends.  A task that raised
        an exception, or whose process died while it ran alone, has a :class:`TaskFailedError`.

    Raises
    ------
    BayesAsvError
        If processes die before they have run anything.
    """
    _Run(workers, function, tasks, finished).run()


class _Run(Generic[T, R]):
    """State of :func:`run_tasks`; tasks are known by their numbers."""

    def __init__(
        self,
        workers: LocalProcesses | DaskCluster,
        function: Callable[[T], R],
        tasks: Sequence[T],
        finished: Callable[[T, R | TaskFailedError], None],
    ):
        self._workers, self._function = workers, function
        self._tasks, self._finished = tasks, finished
        self._waiting = deque(range(len(tasks)))
        self._suspects: set[int] = set()
        """Tasks that ran when a process died, and have not ended since."""
        self._losses_before_any_result: int | None = 0

    def run(self) -> None:
        while self._waiting:
            with self._workers.executor() as executor:
                self._until_broken(executor)

    def _until_broken(self, executor: Executor) -> None:
        """Run tasks until all are done or a process has died."""
        running: dict[Future[R], int] = {}
        while self._waiting or running:
            broken = not self._submit(executor, running)
            ended = wait(running, return_when=FIRST_COMPLETED).done
            results = [(running.pop(future), future) for future in ended]
            lost = [n for n, f in results if isinstance(f.exception(), BrokenExecutor)]
            good = [(n, f) for n, f in results if n not in lost]
            self._suspects.difference_update(n for n, _ in good)
            if not lost and not broken:
                self._submit(executor, running)  # before results are written, which takes time
            for number, future in good:
                self._losses_before_any_result = None
                fault = future.exception()
                result = future.result() if fault is None else TaskFailedError(_words(fault))
                self._finished(self._tasks[number], result)
            if lost or broken:
                self._lost([*lost, *running.values()])
                return

    def _submit(self, executor: Executor, running: dict[Future[R], int]) -> bool:
        """Hand out tasks, suspects one at a time; False if the processes have died."""
        while self._waiting:
            most = 1 if self._suspects else self._workers.capacity
            if len(running) >= most:
                break
            number = self._waiting[0]
            try:
                future = executor.submit(self._function, self._tasks[number])
            except BrokenExecutor:
                return False
            running[future] = self._waiting.popleft()
        return True

    def _lost(self, numbers: list[int]) -> None:
        """Try the tasks of dead processes again, first and alone; one that was alone has failed."""
        if self._losses_before_any_result is not None:
            self._losses_before_any_result += 1
            if self._losses_before_any_result > _MOST_LOSSES:
                raise TaskFailedError("the worker processes die as soon as they have started")
        for number in numbers:
            if number in self._suspects and len(numbers) == 1:
                self._suspects.discard(number)
                why = "its process was killed twice; perhaps it needs too much memory"
                self._finished(self._tasks[number], TaskFailedError(why))
            else:
                self._suspects.add(number)
                self._waiting.appendleft(number)


def _words(fault: BaseException) -> str:
    """Name an exception in one line."""
    if isinstance(fault, CancelledError):
        raise fault  # by the end of a Dask scheduler
    return " ".join(f"{type(fault).__name__}: {fault}".split())[:500]


def _prepare_process(parent: int, modules: Sequence[str]) -> None:
    """Import what every task needs, and end when the parent does, which may be killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its processes
    for module in modules:
        importlib.import_module(module)
