"""Lines of JSON on disk: appended while something runs, packed when it is done."""

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
    """Add lines to a file, after cutting off half a line that a killed run left behind."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        file.seek(0)
        text = file.read()
        if text and not text.endswith(b"\n"):
            file.truncate(text.rfind(b"\n") + 1)
        file.write("".join(_line(one) for one in lines).encode("utf-8"))


def read(path: Path) -> list[dict[str, Any]]:
    """Whole lines of a file, packed or not; none when it is not there.

    Raises
    ------
    InputError
        When it cannot be unpacked or holds what is no JSON object.
    """
    if not path.exists():
        return []
    data = path.read_bytes()
    try:
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")
    except (OSError, EOFError, UnicodeDecodeError) as exc:
        raise InputError(str(path), "cannot be unpacked", "delete it") from exc
    # a run that was killed may have left half a line
    try:
        found = [json.loads(line) for line in text.split("\n")[:-1] if line]
    except ValueError as exc:
        raise InputError(str(path), "holds a line that is no JSON", "delete that line") from exc
    if not all(isinstance(one, dict) for one in found):
        raise InputError(str(path), "holds a line that is no object", "delete that line")
    return found


def write(path: Path, lines: Iterable[Mapping[str, Any]]) -> bytes:
    """Write lines into a packed file, whole or not at all; return them unpacked."""
    data = "".join(_line(one) for one in lines).encode("utf-8")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(str(path), gzip.compress(data, 9, mtime=0))
    return data


def pack(loose: Path, packed: Path) -> None:
    """Move what was appended into the packed file beside it."""
    if loose.exists():
        write(packed, [*read(packed), *read(loose)])
        loose.unlink()


def _line(one: Mapping[str, Any]) -> str:
    return json.dumps(one, separators=(",", ":"), allow_nan=False) + "\n"
