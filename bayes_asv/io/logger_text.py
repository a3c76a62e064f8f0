"""The logger's text format: columns of integers between white space, one row per sample.

The columns are index (from 1), front wheel, front chassis, rear wheel and rear chassis, in counts
of a 10-bit converter.  The format has no time stamps: the row ``index`` was sampled at
(index - 1) / rate, so a missing row is a gap in time.  The rate is an argument or the metadata line
``# sample_rate = 400 Hz``.

The format has no check sum: a digit that changed on the way to the file is a wrong reading.
``bayes-asv acquire --text`` therefore reads the dump until every row has come twice alike, and
notes in the recording if it came once; frames have a check sum of their own.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.recording import COUNTS, declared_rate, parse_rate
from bayes_asv.io.text import build_recording, check_table_size, metadata_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.recording import Recording
    from bayes_asv.io.text import TextFile

__all__ = ["FULL_SCALE", "is_logger_text", "read", "write_logger"]

_WIDTH: Final = 1 + len(CHANNELS)
FULL_SCALE: Final = 1023
_MAX_INTEGER: Final = 2**31 - 1
_ROW: Final = re.compile(r"\s*[+-]?\d{1,10}(?:\s+[+-]?\d{1,10}){4}\s*", re.ASCII)
_UNITS: Final = (COUNTS, COUNTS, COUNTS, COUNTS)


def is_logger_text(text: TextFile) -> bool:
    """Whether the first line of data is five integers between white space."""
    return _ROW.fullmatch(text.header) is not None


def read(text: TextFile, rate: float | None) -> Recording:
    """Read a recording from the lines of a logger file.

    Parameters
    ----------
    text : Text
        Lines with their line numbers.
    rate : float or None
        Sampling rate, Hz; it takes precedence over ``sample_rate`` in the metadata.

    Returns
    -------
    Recording
        In counts; its metadata give the rate used.

    Raises
    ------
    InputError
        With the line and the fix.
    """
    warnings: list[str] = []
    metadata = [(key.strip(), value.strip()) for key, value in text.metadata]
    _check_one_header(metadata, text.source)
    rate = _rate(text, rate, metadata, warnings)
    if len(text.lines) < 2:
        raise InputError(text.source, "has one row of data", "a recording needs at least two")
    check_table_size(len(text.lines), _WIDTH, text.source)
    table = _parse_table(text)
    index = table[:, 0]
    steps = np.diff(index, prepend=0)
    if (steps < 1).any():
        row = int(np.argmax(steps < 1))
        raise InputError(
            text.at(row),
            f"index {index[row]} does not come after {index[row - 1] if row else 0}",
            "sort the rows, delete repeated ones, and count from 1",
        )
    values = table[:, 1:].T.astype(np.float64)
    outside = (values < 0) | (values > FULL_SCALE)
    if outside.any():
        warnings.append(f"{int(outside.sum())} readings are outside 0 to {FULL_SCALE} counts")
    time = (index - 1) / rate
    return build_recording(text, time, values, _UNITS, metadata, None, warnings)


def write_logger(recording: Recording, path: PathLike) -> None:
    """Write a recording in counts in the logger's format; reading it back gives identical arrays.

    Raises
    ------
    InputError
        If the format cannot store the recording (other units, missing cells, fractions of a count,
        stamps off the grid of its ``sample_rate``) or the file cannot be written.
    """
    where, fix = recording.source or "recording", "write it as CSV"
    rate = declared_rate(recording)
    if rate is None:
        raise InputError(where, "has no sample_rate, which the format needs", fix)
    if recording.units != _UNITS:
        raise InputError(where, "is not in counts", fix)
    with np.errstate(invalid="ignore"):
        whole = np.abs(recording.values) <= _MAX_INTEGER
        whole &= recording.values == np.round(recording.values)
    if not whole.all():
        raise InputError(where, "has readings that are missing or not whole counts", fix)
    index = np.round(recording.time * rate) + 1
    on_grid = np.array_equal((index - 1) / rate, recording.time)
    if not on_grid or index[0] < 1 or index[-1] > _MAX_INTEGER:
        raise InputError(where, f"has time stamps off the grid of {rate:g} Hz", fix)
    table = np.vstack((index, recording.values)).astype(np.int64).T
    rows = [" ".join(map(str, row)) for row in table.tolist()]
    write_atomically(path, "\n".join([*metadata_lines(recording), *rows, ""]).encode("utf-8"))


def _check_one_header(metadata: list[tuple[str, str]], source: str) -> None:
    """Refuse metadata of two dumps in one file: whose rows are whose cannot be told."""
    known: dict[str, str] = {}
    for key, value in metadata:
        timed = key == "sample_rate" or key.startswith(("delay ", "clock "))
        if timed and known.setdefault(key, value) != value:
            raise InputError(
                f"{source}: # {key}", f"is {known[key][:40]} and {value[:40]}",
                "keep the rows and the header of one dump",
            )  # fmt: skip


def _rate(
    text: TextFile, rate: float | None, metadata: list[tuple[str, str]], warnings: list[str]
) -> float:
    """Return the rate to use and update `metadata` and `warnings` accordingly."""
    entries = [index for index, (key, _) in enumerate(metadata) if key == "sample_rate"]
    where = f"{text.source}: # sample_rate"
    declared = parse_rate(metadata[entries[-1]][1], where) if entries else None
    if rate is None:
        if declared is None:
            raise InputError(
                text.source,
                "has no time stamps and no rate",
                "give the rate (--rate 400) or add a line '# sample_rate = 400 Hz'",
            )
        return declared
    used = ("sample_rate", f"{rate!r} Hz")
    if declared is None:
        metadata.append(used)
    elif declared != rate:
        warnings.append(
            f"the file declares {declared:g} Hz, but the given rate of {rate:g} Hz is used"
        )
        metadata[entries[-1]] = used
    return rate


def _parse_table(text: TextFile) -> NDArray[np.int64]:
    """Return the integers, shape (N, 5)."""
    joined = " ".join(text.lines)
    if joined.isascii() and "_" not in joined:
        try:
            rows = [line.split() for line in text.lines]
            if all(len(row) == _WIDTH for row in rows):
                table = np.array([list(map(int, row)) for row in rows], dtype=np.int64)
                if np.abs(table).max() <= _MAX_INTEGER:
                    return table
        except (ValueError, OverflowError):
            pass
    for row, line in enumerate(text.lines):
        if _ROW.fullmatch(line) is None:
            raise InputError(
                text.at(row),
                "is not a row of five integers (index and four channels)",
                "correct or delete the line",
            )
    raise InputError(
        text.source, f"contains numbers beyond {_MAX_INTEGER}", "check the program that wrote it"
    )
