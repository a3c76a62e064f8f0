"""Sealed cases are diagnosed, one by one; whatever is finished is on disk."""

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
from benchmarks.battery.lines import append, pack, read, write
from benchmarks.battery.seal import Answer, Key, digest, now
from benchmarks.battery.share import shared
from benchmarks.calibration.store import About
from tests.battery.cases import make_case

__all__ = ["LOOSE", "PACKED", "Job", "Result", "diagnose_all", "drop", "load", "pack_results"]

Progress = Callable[[float, str], None]

LOOSE, PACKED = "runs.jsonl", "runs.jsonl.gz"
# What of a document is kept: the rest is curves and lists by run.
_KEPT = (
    "schema", "verdict", "reasons", "effects", "unexplained", "disagreement", "gap",
    "parameters_before", "parameters_after", "preflight", "p_value", "p_none",
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """What the diagnosis said about one case.

    Parameters
    ----------
    name : str
        Of the case.
    number : int
        Which one of that name.
    seal : str
        Hash of the file with the answer.
    begun : str
        When the diagnosis began, UTC.
    seconds : float
        How long it took.
    document : dict
        What it said; with the verdict ``error`` and the reason when it broke down.
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
    """One case to diagnose: its key, what was sealed, and who diagnoses."""

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
    """Diagnose every sealed case of some cells that has no result yet.

    Parameters
    ----------
    folder : Path
        Where results are kept.
    cells : sequence of Cell
        What is asked for.
    sealed : mapping
        Answers by name and number.
    about : About
        What is written beside the results.
    diagnoser, ablation : str
        As :func:`benchmarks.battery.diagnoser.resolve` takes them.
    runs : int, optional
        Cases a cell, in place of each cell's own number.
    processes : int
        How many share the work.
    progress : callable, optional
        Told the share done and a few words.

    Returns
    -------
    int
        Number of cases diagnosed.

    Raises
    ------
    InputError
        When there are results of another commit or seed, or the rig no longer gives what was
        sealed.
    """
    resolve(diagnoser, ablation)  # a wrong name is told before the work begins
    wanted = in_turn(cells, runs)
    there = load(folder)
    for key in wanted:
        if key in there and there[key].about != about:
            other = there[key].about
            raise InputError(
                str(folder),
                f"the results of {key[0]} are of commit {other.commit}, seed {other.seed}",
                "add --fresh to do them again, or name another --out",
            )
    jobs = [Job(key, sealed[key], diagnoser, ablation) for key in wanted if key not in there]

    def keep(result: Result, done: int) -> None:
        append(folder / LOOSE, [asdict(result)])
        if progress is not None:
            progress(done / len(jobs), f"{result.name}: {done} of {len(jobs)} cases")

    shared(partial(_diagnosed, about), jobs, processes, keep)
    return len(jobs)


def load(folder: Path) -> dict[Key, Result]:
    """Every result of a folder, by name and number, the last of each.

    Raises
    ------
    InputError
        When a file holds what is no result.
    """
    found: dict[Key, Result] = {}
    for name in (PACKED, LOOSE):
        for line in read(folder / name):
            try:
                result = Result(**{**line, "about": About(**line["about"])})
            except (KeyError, TypeError) as exc:
                raise InputError(
                    str(folder / name), "holds a line that is no result", "delete that line"
                ) from exc
            found[result.name, result.number] = result
    return found


def pack_results(folder: Path) -> None:
    """Put all results into the packed file."""
    pack(folder / LOOSE, folder / PACKED)


def drop(folder: Path, names: Sequence[str]) -> None:
    """Forget all results of some cells."""
    kept = [asdict(result) for key, result in load(folder).items() if key[0] not in names]
    (folder / LOOSE).unlink(missing_ok=True)
    if kept or (folder / PACKED).exists():
        write(folder / PACKED, kept)


def _diagnosed(about: About, job: Job) -> Result:
    name, number = job.key
    truth = job.answer.truth
    made = make_case(name, truth.seed, number, truth.fleet, truth.effects)
    if digest(made) != job.answer.digest:
        raise InputError(
            f"{name} {number}",
            "is no longer what was sealed: the rig or the cases have changed",
            "add --reseal to make the answers again",
        )
    begun = now()
    start = time.perf_counter()
    # The seed says nothing about the case, and the diagnosis is given nothing else.
    seed = zlib.crc32(job.answer.digest.encode("ascii"))
    document = _asked(resolve(job.diagnoser, job.ablation), made.recordings, made.holdout,
                      made.vehicle, seed)  # fmt: skip
    seconds = time.perf_counter() - start
    return Result(name, number, job.answer.seal, begun, round(seconds, 2), document, about)


def _asked(diagnoser: Diagnoser, *given: Any) -> dict[str, Any]:
    """Ask, and keep what is judged; a diagnosis that breaks down is a result as well."""
    try:
        document = diagnoser(*given)
        json.dumps(document, allow_nan=False)
    except Exception as exc:  # whatever it is, the battery has to count it
        return {"verdict": "error", "reasons": [f"{type(exc).__name__}: {exc}"[:300]]}
    return {key: document[key] for key in _KEPT if key in document}
