"""Diagnose sealed cases; each result is written to disk when it is done."""

from __future__ import annotations

import json
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from bayes_asv.domain.errors import InputError
from benchmarks.battery.cells import Cell, in_turn
from benchmarks.battery.diagnoser import Diagnoser, resolve
from benchmarks.battery.json_lines import append, pack, read, write
from benchmarks.battery.parallel import run_parallel
from benchmarks.battery.seal import Answer, Key, digest, now
from benchmarks.calibration.store import About
from tests.battery.cases import make_case

__all__ = [
    "LOOSE",
    "PACKED",
    "Job",
    "Result",
    "diagnose_all",
    "drop",
    "kept",
    "load",
    "pack_results",
]

Progress = Callable[[float, str], None]

LOOSE, PACKED = "runs.jsonl", "runs.jsonl.gz"
# Keys of a document that are kept: the others are curves and lists by run.
_KEPT = (
    "schema", "verdict", "reasons", "effects", "unexplained", "disagreement", "gap",
    "parameters_before", "parameters_after", "preflight", "p_value", "p_none",
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """Result of the diagnosis of one case.

    Parameters
    ----------
    name : str
        Name of the case.
    number : int
        Number of the case of that name.
    seal : str
        Hash of the file of the answer.
    begun : str
        When the diagnosis began, UTC.
    seconds : float
        Computing time.
    document : dict
        Its document; with the verdict ``error`` and the reason if it raised an exception.
    about : About
        Seed of the battery, commit and versions.
    """

    name: str
    number: int
    seal: str
    begun: str
    seconds: float
    document: dict[str, Any]
    about: About


@dataclass(frozen=True)
class Job:
    """One case to diagnose: its key, its sealed answer, and the diagnoser."""

    key: Key
    answer: Answer
    diagnoser: str
    ablation: str | None


def diagnose_all(
    folder: Path,
    cells: Sequence[Cell],
    sealed: Mapping[Key, Answer],
    about: About,
    *,
    diagnoser: str,
    ablation: str | None = None,
    runs: int | None = None,
    processes: int = 1,
    progress: Progress | None = None,
) -> int:
    """Diagnose every sealed case of some cells without a result.

    Parameters
    ----------
    folder : Path
        Of the results.
    cells : sequence of Cell
        Cells to diagnose.
    sealed : mapping
        Answers by name and number.
    about : About
        Provenance of the results.
    diagnoser, ablation : str
        As :func:`benchmarks.battery.diagnoser.resolve` takes them.
    runs : int, optional
        Cases per cell, in place of each cell's own number.
    processes : int
        Number of processes.
    progress : callable, optional
        Called with the share that is done and a description.

    Returns
    -------
    int
        Number of cases diagnosed.

    Raises
    ------
    InputError
        If there are results of another commit or seed, or the rig no longer makes the sealed cases.
    """
    resolve(diagnoser, ablation)  # reports a wrong name before the work begins
    wanted = in_turn(cells, runs)
    done_before = load(folder)
    for key in wanted:
        if key in done_before and done_before[key].about != about:
            other = done_before[key].about
            raise InputError(
                str(folder),
                f"the results of {key[0]} are of commit {other.commit}, seed {other.seed}",
                "add --fresh to do them again, or name another --out",
            )
    jobs = [Job(key, sealed[key], diagnoser, ablation) for key in wanted if key not in done_before]

    def keep(result: Result, done: int) -> None:
        append(folder / LOOSE, [asdict(result)])
        if progress is not None:
            progress(done / len(jobs), f"{result.name}: {done} of {len(jobs)} cases")

    run_parallel(partial(_diagnosed, about), jobs, processes, keep)
    return len(jobs)


def load(folder: Path) -> dict[Key, Result]:
    """Return the last result of each case in a folder, by name and number.

    Raises
    ------
    InputError
        If a line is not a result.
    """
    found: dict[Key, Result] = {}
    for name in (PACKED, LOOSE):
        for line in read(folder / name):
            try:
                result = Result(**{**line, "about": About(**line["about"])})
            except (KeyError, TypeError) as exc:
                raise InputError(
                    str(folder / name), "has a line that is not a result", "delete that line"
                ) from exc
            found[result.name, result.number] = result
    return found


def pack_results(folder: Path) -> None:
    """Move all results into the packed file."""
    pack(folder / LOOSE, folder / PACKED)


def drop(folder: Path, names: Sequence[str]) -> None:
    """Delete all results of some cells."""
    kept = [asdict(result) for key, result in load(folder).items() if key[0] not in names]
    (folder / LOOSE).unlink(missing_ok=True)
    if kept or (folder / PACKED).exists():
        write(folder / PACKED, kept)


def _diagnosed(about: About, job: Job) -> Result:
    name, number = job.key
    truth = job.answer.truth
    one = make_case(name, truth.seed, number, truth.fleet, truth.effects)
    if digest(one) != job.answer.digest:
        raise InputError(
            f"{name} {number}",
            "is no longer the sealed case: the rig or the cases have changed",
            "add --reseal to make the answers again",
        )
    begun = now()
    start = time.perf_counter()
    # The seed does not reveal the case.
    seed = zlib.crc32(job.answer.digest.encode("ascii"))
    document = _document(resolve(job.diagnoser, job.ablation), one.recordings, one.holdout,
                      one.vehicle, seed)  # fmt: skip
    seconds = time.perf_counter() - start
    return Result(name, number, job.answer.seal, begun, round(seconds, 2), document, about)


def _document(diagnoser: Diagnoser, *given: Any) -> dict[str, Any]:
    """Run a diagnoser and keep what is judged; an exception is a result as well."""
    try:
        document = diagnoser(*given)
        json.dumps(document, allow_nan=False)
    except Exception as exc:  # any exception counts as a result
        return {"verdict": "error", "reasons": [f"{type(exc).__name__}: {exc}"[:300]]}
    return kept(document)


def kept(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of a document that are judged."""
    return {key: document[key] for key in _KEPT if key in document}
