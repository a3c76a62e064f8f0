"""Files of JSON lines: appended during a run, packed at its end."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically

__all__ = ["append", "pack", "read", "write"]


def append(path: Path, lines: Iterable[Mapping[str, Any]]) -> None:
    """Append lines to a file, after removing an incomplete line of an interrupted run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        file.seek(0)
        text = file.read()
        if text and not text.endswith(b"\n"):
            file.truncate(text.rfind(b"\n") + 1)
        file.write("".join(_line(one) for one in lines).encode("utf-8"))


def read(path: Path) -> list[dict[str, Any]]:
    """Return the complete lines of a file, packed or not; none if it does not exist.

    Raises
    ------
    InputError
        If it cannot be unpacked or a line is not a JSON object.
    """
    if not path.exists():
        return []
    data = path.read_bytes()
    try:
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")
    except (OSError, EOFError, UnicodeDecodeError) as exc:
        raise InputError(str(path), "cannot be unpacked", "delete it") from exc
    # an interrupted run may have left an incomplete line
    try:
        found = [json.loads(line) for line in text.split("\n")[:-1] if line]
    except ValueError as exc:
        raise InputError(str(path), "has a line that is not JSON", "delete that line") from exc
    if not all(isinstance(one, dict) for one in found):
        raise InputError(str(path), "has a line that is not an object", "delete that line")
    return found


def write(path: Path, lines: Iterable[Mapping[str, Any]]) -> bytes:
    """Write lines to a packed file atomically; return them unpacked."""
    data = "".join(_line(one) for one in lines).encode("utf-8")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(str(path), gzip.compress(data, 9, mtime=0))
    return data


def pack(loose: Path, packed: Path) -> None:
    """Move appended lines into a packed file."""
    if loose.exists():
        write(packed, [*read(packed), *read(loose)])
        loose.unlink()


def _line(one: Mapping[str, Any]) -> str:
    return json.dumps(one, separators=(",", ":"), allow_nan=False) + "\n"
