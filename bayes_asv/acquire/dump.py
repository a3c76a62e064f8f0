"""The logger's text dump: the reference's rows, which nothing checks unless they come twice."""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from bayes_asv.acquire.blocks import MOST_ROWS
from bayes_asv.acquire.merge import Merged, ranges
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import COUNTS, Recording, parse_rate

__all__ = ["DUMP_END", "Dump", "agreed", "dumps_in", "merged_dumps"]

_Said = TypeVar("_Said")

_ROW: Final = re.compile(r"(\d{1,4}) (\d{1,4}) (\d{1,4}) (\d{1,4}) (\d{1,4})")
_REMARK: Final = re.compile(
    r"# (?:(sample_rate) = (\d+(?:\.\d+)? Hz)"
    r"|(delay (?:front|rear)_(?:wheel|chassis)) = (0\.\d+ s)"
    r"|(clock rear) = (-?\d{1,4}\.\d ppm))"
)
_FULL_SCALE: Final = 1023
DUMP_END: Final = "# end"
"""Last line of a dump."""
_BROKEN_OFF: Final = "# Slave 2: no answer"


@dataclass(frozen=True)
class Dump:
    """One text dump.

    Parameters
    ----------
    remarks : tuple of (str, str)
        Metadata.
    rows : tuple of (int, tuple of int)
        Index from 1, and four readings; indices ascend.
    ended : bool
        Whether its last line came.
    unreadable : int
        Lines that are neither row nor remark, or out of order.
    """

    remarks: tuple[tuple[str, str], ...]
    rows: tuple[tuple[int, tuple[int, ...]], ...]
    ended: bool
    unreadable: int


def dumps_in(lines: list[str]) -> list[Dump]:
    """Find the text dumps in lines: each from ``# sample_rate`` or row 1 to ``# end``."""
    parts: list[list[str]] = [[]]
    for line in lines:
        opens = line.startswith("# sample_rate") and any(_ROW.fullmatch(x) for x in parts[-1])
        if opens:
            parts.append([])
        parts[-1].append(line)
        if line == DUMP_END:
            parts.append([])
    return [dump for part in parts if (dump := _dump(part)).rows]


def _dump(lines: list[str]) -> Dump:
    remarks: list[tuple[str, str]] = []
    rows: list[tuple[int, tuple[int, ...]]] = []
    unreadable = 0
    last = 0
    for line in lines:
        row, remark = _ROW.fullmatch(line), _REMARK.fullmatch(line)
        if remark is not None:
            key, value = (part for part in remark.groups() if part is not None)
            remarks.append((key, value))
        elif row is not None:
            index, *readings = map(int, row.groups())
            if last < index <= MOST_ROWS and max(readings) <= _FULL_SCALE:
                rows.append((index, tuple(readings)))
                last = index
            else:
                unreadable += 1
        elif line not in (DUMP_END, _BROKEN_OFF):
            unreadable += 1
    return Dump(tuple(remarks), tuple(rows), DUMP_END in lines, unreadable)


def agreed(dumps: list[Dump]) -> dict[int, tuple[int, ...]]:
    """Return the rows that two dumps gave alike and nothing contradicts as often."""
    votes: dict[int, Counter[tuple[int, ...]]] = {}
    for dump in dumps:
        for index, readings in dump.rows:
            votes.setdefault(index, Counter())[readings] += 1
    return {index: row for index, own in votes.items() if (row := _elected(own)) is not None}


def merged_dumps(dumps: list[Dump], rate: float | None, source: str = "") -> Merged:
    """Make a recording of one dump, or of what several dumps of one run agree on.

    Parameters
    ----------
    dumps : list of Dump
        At least one.
    rate : float or None
        Rows a second, Hz, where the dump does not say it.
    source : str
        For messages.
    """
    checked = len(dumps) > 1
    good = agreed(dumps) if checked else dict(dumps[0].rows)
    said = {key: _elected(own) if checked else own.most_common(1)[0][0]
            for key, own in _remarks(dumps).items()}  # fmt: skip
    faults, warnings = [], []
    lost = [k for k in range(1, MOST_ROWS + 1) if k not in good]
    if lost:
        why = "did not come twice alike" if checked else "did not come"
        faults.append(f"{len(lost)} of {MOST_ROWS} rows {why}: {ranges(lost)}")
    if not checked:
        warnings.append("the text dump came once: nothing checks its readings")
    if said.get("clock rear") is None:
        faults.append("the drift of the rear's clock did not come")
    text = said.pop("sample_rate", None)
    if text is not None:
        with contextlib.suppress(InputError):  # one dump alone may be spoilt here as well
            rate = parse_rate(text, source)
    if rate is None:
        return Merged(None, (*faults, "the dump does not say its rate"), tuple(warnings))
    if len(good) < 2:
        return Merged(None, (*faults, "not two rows came"), tuple(warnings))
    index = np.array(sorted(good))
    values = np.array([good[k] for k in index], dtype=np.float64).T
    metadata = [
        ("sample_rate", f"{rate:.12g} Hz"),
        *((key, value) for key, value in said.items() if value is not None),
        *(("note", note) for note in (*faults, *warnings)),
    ]
    assert len(values) == len(CHANNELS)
    recording = Recording((index - 1) / rate, values, (COUNTS,) * 4, tuple(metadata), source)
    return Merged(recording, tuple(faults), tuple(warnings), _ppm(said.get("clock rear")))


def _remarks(dumps: list[Dump]) -> dict[str, Counter[str]]:
    votes: dict[str, Counter[str]] = {}
    for dump in dumps:
        for key, value in dump.remarks:
            votes.setdefault(key, Counter())[value] += 1
    return votes


def _elected(votes: Counter[_Said]) -> _Said | None:
    """Return what was said twice at least, and more often than anything else."""
    first, *others = votes.most_common(2)
    return first[0] if first[1] > max([1, *(count for _, count in others)]) else None


def _ppm(text: str | None) -> float | None:
    number = re.fullmatch(r"(-?\d+(?:\.\d+)?) ppm", text or "")
    return None if number is None else 1e-6 * float(number[1])
