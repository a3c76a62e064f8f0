"""Results on disk: finished runs are appended at once, and packed when the page is written.

``runs.jsonl`` grows by one line for a handful of finished runs, so that a bench that was stopped
goes on where it was; ``runs.jsonl.gz`` holds the same, one line a cell, small enough to keep.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from benchmarks.calibration.run import Row

__all__ = ["About", "Results", "append", "drop", "load", "pack"]

_LOOSE, _PACKED = "runs.jsonl", "runs.jsonl.gz"


@dataclass(frozen=True)
class About:
    """Where rows come from.

    Parameters
    ----------
    seed : int
        Of the bench.
    commit : str
        Of the code; a plus sign when files had been changed since.
    versions : str
        Of the package and of what it computes with.
    """

    seed: int
    commit: str
    versions: str


@dataclass(frozen=True)
class Results:
    """Rows of one cell, in the order of their runs, and where they come from."""

    rows: tuple[Row, ...]
    about: tuple[About, ...]


def append(folder: Path, cell: str, rows: Iterable[Row], about: About) -> None:
    """Add finished rows of a cell."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOOSE).open("a+b") as file:
        _drop_half_line(file)
        file.write(_line(cell, rows, about).encode("utf-8") + b"\n")


def _drop_half_line(file: BinaryIO) -> None:
    """Cut off what a killed bench left behind the last whole line."""
    file.seek(0)
    text = file.read()
    if text and not text.endswith(b"\n"):
        file.truncate(text.rfind(b"\n") + 1)


def load(folder: Path) -> dict[str, Results]:
    """Every cell's rows.

    Raises
    ------
    InputError
        When a file is not what :func:`append` and :func:`pack` write.
    """
    lines: list[tuple[str, str]] = []
    packed, loose = folder / _PACKED, folder / _LOOSE
    if packed.exists():
        try:
            text = gzip.decompress(packed.read_bytes()).decode("utf-8")
        except (OSError, EOFError, UnicodeDecodeError) as exc:
            raise InputError(str(packed), "cannot be unpacked", "delete it") from exc
        lines += [(str(packed), line) for line in text.splitlines()]
    if loose.exists():
        text = loose.read_text(encoding="utf-8")
        # a bench that was killed may have left half a line: those runs are done again
        lines += [(str(loose), line) for line in text.split("\n")[:-1] if line]
    rows: dict[str, dict[int, Row]] = {}
    about: dict[str, dict[About, None]] = {}
    for where, line in lines:
        try:
            cell, found, told = _parsed(line)
        except (ValueError, KeyError, TypeError) as exc:
            raise InputError(where, "holds a line that is no result", "delete that line") from exc
        rows.setdefault(cell, {}).update({row.run: row for row in found})
        about.setdefault(cell, {})[told] = None
    return {
        cell: Results(tuple(rows[cell][k] for k in sorted(rows[cell])), tuple(about[cell]))
        for cell in rows
    }


def pack(folder: Path) -> None:
    """Put all rows into the packed file, one line a cell and origin, and drop the loose one."""
    _write(folder, load(folder))


def drop(folder: Path, cells: Iterable[str]) -> None:
    """Forget all rows of some cells."""
    gone = set(cells)
    _write(folder, {cell: found for cell, found in load(folder).items() if cell not in gone})


def _write(folder: Path, results: dict[str, Results]) -> None:
    lines = [
        _line(cell, found.rows if k == 0 else (), about)
        for cell, found in results.items()
        for k, about in enumerate(found.about)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    data = gzip.compress("".join(line + "\n" for line in lines).encode("utf-8"), 9, mtime=0)
    write_atomically(str(folder / _PACKED), data)
    (folder / _LOOSE).unlink(missing_ok=True)


def _line(cell: str, rows: Iterable[Row], about: About) -> str:
    """One line of JSON: numbers column by column, which packs best, and seldom things by run."""
    kept = list(rows)
    document: dict[str, Any] = {"cell": cell, **asdict(about), "run": [row.run for row in kept]}
    for column, rounded in (("places", _place), ("widths", _three), ("bounds", _three)):
        names = list(dict.fromkeys(name for row in kept for name in getattr(row, column)))
        document[column] = {
            name: [_or_none(getattr(row, column).get(name), rounded) for row in kept]
            for name in names
        }
    document["effective"] = [round(row.effective) for row in kept]
    for column in ("how", "colour", "clipped"):
        document[column] = [getattr(row, column) for row in kept]
    document["reasons"] = {row.run: row.reasons for row in kept if row.reasons}
    document["checked"] = {
        row.run: {name: (_place(p), _three(w)) for name, (p, w) in row.checked.items()}
        for row in kept
        if row.checked
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False)


def _parsed(line: str) -> tuple[str, list[Row], About]:
    document = json.loads(line)
    about = About(document["seed"], document["commit"], document["versions"])
    rows = []
    for k, run in enumerate(document["run"]):
        columns = {
            column: {
                name: float(values[k])
                for name, values in document[column].items()
                if values[k] is not None
            }
            for column in ("places", "widths", "bounds")
        }
        rows.append(
            Row(
                run=int(run),
                reasons=tuple(document["reasons"].get(str(run), ())),
                effective=float(document["effective"][k]),
                how=str(document["how"][k]),
                colour=int(document["colour"][k]),
                clipped=int(document["clipped"][k]),
                checked={
                    name: (float(p), float(w))
                    for name, (p, w) in document["checked"].get(str(run), {}).items()
                },
                **columns,
            )
        )
    return str(document["cell"]), rows, about


def _place(value: float) -> float:
    return round(value, 4)


def _three(value: float) -> float:
    return float(f"{value:.3g}")


def _or_none(value: float | None, rounded: Any) -> float | None:
    return None if value is None else rounded(value)
