"""Sealed answers: truths that are written before their cases are diagnosed.

``answers.jsonl`` grows while cases are made.  When all are made it is packed into
``answers-<hash>.jsonl.gz`` with the time in its first line.  The hash is that of its content: a
changed file no longer has the right name.  Only sealed cases are diagnosed, and every result has
the hash of its answer's file and the time of the diagnosis.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import to_toml
from benchmarks.battery.cells import Cell, in_turn
from benchmarks.battery.json_lines import append, read, write
from benchmarks.battery.parallel import run_parallel
from tests.battery.cases import Case, make_case
from tests.battery.truth import Truth, from_dict, to_dict
from tests.battery.vehicles import Fleet

__all__ = ["Answer", "Key", "answers", "digest", "now", "seal"]

Key = tuple[str, int]
Progress = Callable[[float, str], None]

_LOOSE = "answers.jsonl"
_SEALED = "answers-*.jsonl.gz"
_LETTERS = 16  # of the hash in the file's name


@dataclass(frozen=True)
class Answer:
    """A sealed answer.

    Parameters
    ----------
    truth : Truth
        Truth of the case.
    digest : str
        Hash of everything that the diagnosis is given.
    seal : str
        Hash of the file of the answer.
    sealed : str
        Time of sealing, UTC.
    """

    truth: Truth
    digest: str
    seal: str
    sealed: str


def now() -> str:
    """Return the time, UTC, to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def digest(made: Case) -> str:
    """Hash recordings and vehicle; readings are rounded to a millionth of a m/s^2."""
    found = hashlib.sha256(to_toml(made.vehicle).encode("utf-8"))
    for recording in (*made.recordings, *made.holdout):
        found.update(recording.source.encode("utf-8"))
        for values in (recording.time, recording.values):
            # adding zero turns -0.0 into 0.0
            found.update((values.round(6) + 0.0).tobytes())
    return found.hexdigest()


def answers(folder: Path, fleet: Fleet, seed: int) -> dict[Key, Answer]:
    """Return the sealed answers of a fleet and seed, by name and number.

    Raises
    ------
    InputError
        If the content of a file does not match its name.
    """
    found: dict[Key, Answer] = {}
    for path in sorted(folder.glob(_SEALED)):
        head, *lines = _checked(path)
        if (head.get("fleet"), head.get("seed")) != (fleet, seed):
            continue
        name = path.name.split("-")[1].split(".")[0]
        for line in lines:
            truth, told = _parsed(path, line)
            found[truth.name, truth.number] = Answer(truth, told, name, str(head["sealed"]))
    return found


def seal(
    folder: Path,
    cells: Sequence[Cell],
    fleet: Fleet,
    seed: int,
    runs: int | None = None,
    processes: int = 1,
    progress: Progress | None = None,
) -> dict[Key, Answer]:
    """Make and seal the missing answers of some cells; return all sealed answers.

    Parameters
    ----------
    folder : Path
        Of the answers.
    cells : sequence of Cell
        Cells to seal.
    fleet : {'dev', 'test'}
        Set of vehicle families.
    seed : int
        Seed of the battery.
    runs : int, optional
        Cases per cell, in place of each cell's own number.
    processes : int
        Number of processes.
    progress : callable, optional
        Called with the share that is done and a description.
    """
    there = answers(folder, fleet, seed)
    loose = folder / _LOOSE
    begun = {
        (str(line["truth"]["name"]), int(line["truth"]["number"]))
        for line in read(loose)
        if (line["truth"]["fleet"], line["truth"]["seed"]) == (fleet, seed)
    }
    wanted = [key for key in in_turn(cells, runs) if key not in there]
    left = [key for key in wanted if key not in begun]

    def keep(line: dict[str, Any], done: int) -> None:
        append(loose, [line])
        if progress is not None:
            progress(done / len(left), f"answers: {done} of {len(left)}")

    run_parallel(partial(_made, seed, fleet), left, processes, keep)
    if wanted:
        lines = read(loose)
        own = [x for x in lines if (x["truth"]["fleet"], x["truth"]["seed"]) == (fleet, seed)]
        _close(folder, own, fleet, seed)
        loose.unlink()
        others = [x for x in lines if x not in own]
        if others:
            append(loose, others)
    return answers(folder, fleet, seed)


def forget(folder: Path, names: Sequence[str]) -> None:
    """Delete the answers of some cells, sealed or not."""
    for path in [*folder.glob(_SEALED), folder / _LOOSE]:
        lines = read(path)
        kept = [x for x in lines if "truth" not in x or x["truth"]["name"] not in names]
        if len(kept) == len(lines):
            continue
        path.unlink()
        if path.name == _LOOSE:
            append(path, kept)
        elif len(kept) > 1:
            _close(folder, kept[1:], kept[0]["fleet"], kept[0]["seed"], kept[0]["sealed"])


def _made(seed: int, fleet: Fleet, key: Key) -> dict[str, Any]:
    made = make_case(key[0], seed, key[1], fleet)
    return {"truth": to_dict(made.truth), "digest": digest(made)}


def _close(
    folder: Path, lines: list[dict[str, Any]], fleet: Fleet, seed: int, when: str | None = None
) -> None:
    """Pack lines into a file named by the hash of its content."""
    head = {"fleet": fleet, "seed": seed, "sealed": when or now(), "cases": len(lines)}
    passing = folder / "answers-.jsonl.gz"
    data = write(passing, [head, *lines])
    passing.rename(folder / f"answers-{_hash(data)}.jsonl.gz")


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_LETTERS]


def _checked(path: Path) -> list[dict[str, Any]]:
    import gzip

    lines = read(path)
    if not lines or path.name != f"answers-{_hash(gzip.decompress(path.read_bytes()))}.jsonl.gz":
        raise InputError(str(path), "does not match its seal", "delete it and its results")
    return lines


def _parsed(path: Path, line: dict[str, Any]) -> tuple[Truth, str]:
    try:
        return from_dict(line["truth"]), str(line["digest"])
    except (KeyError, TypeError, ValueError) as exc:
        raise InputError(str(path), "has a line that is not an answer", "delete it") from exc
