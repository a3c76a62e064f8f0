"""Processes that are killed: nothing is lost, and nothing else fails."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from bayes_asv.batch.workers import DaskCluster, LocalProcesses, TaskFailedError, run_tasks
from bayes_asv.domain.errors import InputError
from tests.batch.tasks import work

Task = tuple[str, str]


def _run(
    workers: LocalProcesses | DaskCluster, tasks: list[Task]
) -> list[tuple[Task, int | TaskFailedError]]:
    found: list[tuple[Task, int | TaskFailedError]] = []
    run_tasks(workers, work, tasks, lambda task, result: found.append((task, result)))
    return found


def test_a_killed_process_loses_no_task_and_one_that_kills_is_found(tmp_path: Path) -> None:
    tasks = [("sleep", str(n)) for n in range(6)]
    tasks[1:1] = [("die once", str(tmp_path / "once"))]
    tasks[4:4] = [("die", str(tmp_path / "always")), ("raise", "")]
    found = _run(LocalProcesses(2, ("json",)), tasks)
    assert sorted(task for task, _ in found) == sorted(tasks)
    failed = {task[0]: str(r) for task, r in found if isinstance(r, TaskFailedError)}
    assert set(failed) == {"die", "raise"}
    assert failed["die"].startswith("its process was killed twice")
    assert failed["raise"] == "ValueError: a fault in two lines"


def test_processes_are_started_once() -> None:
    found = _run(LocalProcesses(2), [("sleep", str(n)) for n in range(12)])
    assert 1 <= len({result for _, result in found}) <= 2


def test_processes_that_cannot_start_are_told() -> None:
    with pytest.raises(TaskFailedError, match="die as soon as they have started"):
        _run(LocalProcesses(1, ("there_is_no_such_module",)), [("sleep", str(n)) for n in range(9)])


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_one_of_two_dask_workers_is_killed(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    mark = tmp_path / "begun"
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
        silence_logs=50, local_directory=tmp_path,
    ) as cluster:  # fmt: skip
        with distributed.Client(cluster.scheduler_address) as client:
            pids = client.run(os.getpid)

        def kill_one() -> None:
            while not mark.exists():
                time.sleep(0.02)
            os.kill(min(pids.values()), signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        tasks = [("wait", str(mark)), *(("sleep", str(n)) for n in range(10)), ("wait", "0")]
        tasks[-1] = ("wait", str(tmp_path / "last"))
        found = _run(DaskCluster(cluster.scheduler_address), tasks)
        killer.join()
    assert sorted(task for task, _ in found) == sorted(tasks)
    assert not [result for _, result in found if isinstance(result, TaskFailedError)]


def test_a_dask_scheduler_that_is_not_there_is_told() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        DaskCluster("tcp://127.0.0.1:9", seconds=0.5)
