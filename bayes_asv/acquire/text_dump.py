"""Text dump of the logger: rows without a checksum, verified by comparing repeated dumps."""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from bayes_asv.acquire.blocks import MAX_ROWS
from bayes_asv.acquire.merge import MergedRun, format_ranges
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import COUNTS, Recording, parse_rate
from bayes_asv.io.logger_text import FULL_SCALE

__all__ = ["DUMP_END", "TextDump", "agreeing_rows", "find_dumps", "merge_dumps"]

_Value = TypeVar("_Value")

_ROW: Final = re.compile(r"(\d{1,4}) (\d{1,4}) (\d{1,4}) (\d{1,4}) (\d{1,4})")
_METADATA: Final = re.compile(
    r"# (?:(sample_rate) = (\d+(?:\.\d+)? Hz)"
    r"|(delay (?:front|rear)_(?:wheel|chassis)) = (0\.\d+ s)"
    r"|(clock rear) = (-?\d{1,4}\.\d ppm))"
)
DUMP_END: Final = "# end"
"""Last line of a dump."""
_BROKEN_OFF: Final = "# Slave 2: no answer"


@dataclass(frozen=True)
class TextDump:
    """A text dump.

    Parameters
    ----------
    metadata : tuple of (str, str)
        Keys and values.
    rows : tuple of (int, tuple of int)
        Index from 1, and four readings; indices ascend.
    complete : bool
        Whether its last line arrived.
    unreadable : int
        Lines that are neither row nor metadata, or out of order.
    """

    metadata: tuple[tuple[str, str], ...]
    rows: tuple[tuple[int, tuple[int, ...]], ...]
    complete: bool
    unreadable: int


def find_dumps(lines: list[str]) -> list[TextDump]:
    """Find the text dumps in lines: each from ``# sample_rate`` or row 1 to ``# end``."""
    parts: list[list[str]] = [[]]
    for line in lines:
        starts = line.startswith("# sample_rate") and any(_ROW.fullmatch(x) for x in parts[-1])
        if starts:
            parts.append([])
        parts[-1].append(line)
        if line == DUMP_END:
            parts.append([])
    return [dump for part in parts if (dump := _parse(part)).rows]


def _parse(lines: list[str]) -> TextDump:
    metadata: list[tuple[str, str]] = []
    rows: list[tuple[int, tuple[int, ...]]] = []
    unreadable = 0
    last = 0
    for line in lines:
        row, item = _ROW.fullmatch(line), _METADATA.fullmatch(line)
        if item is not None:
            key, value = (part for part in item.groups() if part is not None)
            metadata.append((key, value))
        elif row is not None:
            index, *readings = map(int, row.groups())
            if last < index <= MAX_ROWS and max(readings) <= FULL_SCALE:
                rows.append((index, tuple(readings)))
                last = index
            else:
                unreadable += 1
        elif line not in (DUMP_END, _BROKEN_OFF):
            unreadable += 1
    return TextDump(tuple(metadata), tuple(rows), DUMP_END in lines, unreadable)


def agreeing_rows(dumps: list[TextDump]) -> dict[int, tuple[int, ...]]:
    """Return the rows that at least two dumps have alike, and more than any other version."""
    votes: dict[int, Counter[tuple[int, ...]]] = {}
    for dump in dumps:
        for index, readings in dump.rows:
            votes.setdefault(index, Counter())[readings] += 1
    return {index: row for index, own in votes.items() if (row := _majority(own)) is not None}


def merge_dumps(dumps: list[TextDump], rate: float | None, source: str = "") -> MergedRun:
    """Make a recording of one dump, or of what several dumps of one run agree on.

    Parameters
    ----------
    dumps : list of TextDump
        At least one.
    rate : float or None
        Rows per second, Hz, if the dump does not state it.
    source : str
        For messages.
    """
    checked = len(dumps) > 1
    rows = agreeing_rows(dumps) if checked else dict(dumps[0].rows)
    values = {key: _majority(own) if checked else own.most_common(1)[0][0]
              for key, own in _metadata_votes(dumps).items()}  # fmt: skip
    faults, warnings = [], []
    lost = [k for k in range(1, MAX_ROWS + 1) if k not in rows]
    if lost:
        why = "were not received twice with the same values" if checked else "were not received"
        faults.append(f"{len(lost)} of {MAX_ROWS} rows {why}: {format_ranges(lost)}")
    if not checked:
        warnings.append("the text dump was received once: its readings are not checked")
    if values.get("clock rear") is None:
        faults.append("the drift of the rear board's clock was not received")
    text = values.pop("sample_rate", None)
    if text is not None:
        with contextlib.suppress(InputError):  # a single dump may have errors here as well
            rate = parse_rate(text, source)
    if rate is None:
        return MergedRun(None, (*faults, "the dump does not state its rate"), tuple(warnings))
    if len(rows) < 2:
        return MergedRun(None, (*faults, "fewer than two rows arrived"), tuple(warnings))
    index = np.array(sorted(rows))
    readings = np.array([rows[k] for k in index], dtype=np.float64).T
    metadata = [
        ("sample_rate", f"{rate:.12g} Hz"),
        *((key, value) for key, value in values.items() if value is not None),
        *(("note", note) for note in (*faults, *warnings)),
    ]
    assert len(readings) == len(CHANNELS)
    recording = Recording((index - 1) / rate, readings, (COUNTS,) * 4, tuple(metadata), source)
    return MergedRun(recording, tuple(faults), tuple(warnings), _ratio(values.get("clock rear")))


def _metadata_votes(dumps: list[TextDump]) -> dict[str, Counter[str]]:
    votes: dict[str, Counter[str]] = {}
    for dump in dumps:
        for key, value in dump.metadata:
            votes.setdefault(key, Counter())[value] += 1
    return votes


def _majority(votes: Counter[_Value]) -> _Value | None:
    """Return the value with at least two votes and more than any other."""
    first, *others = votes.most_common(2)
    return first[0] if first[1] > max([1, *(count for _, count in others)]) else None


def _ratio(text: str | None) -> float | None:
    number = re.fullmatch(r"(-?\d+(?:\.\d+)?) ppm", text or "")
    return None if number is None else 1e-6 * float(number[1])
