"""Any other table of numbers in text, as Arduino, Teensy and ESP32 sketches write it.

With or without names or labels, separated by commas, semicolons, tabs or blanks, with a decimal
point or a decimal comma.  Time is in s, ms, µs, since 1970 or a time of day; without a column of
time the user gives the rate.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.channels import KNOWN_CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.files import decode
from bayes_asv.domain.recording import COUNTS
from bayes_asv.io import logger_text
from bayes_asv.io.formats.format import Format, LogBuilder
from bayes_asv.io.formats.table import decode_text, read_table
from bayes_asv.io.formats.table_log import log_of_table
from bayes_asv.io.text import TextFile

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT", "LOGGER", "RECORDING"]

_OWN_NAMES: Final = "|".join({*KNOWN_CHANNELS, *ROLL_CHANNELS}).encode()
_OWN_HEADER: Final = re.compile(
    rb"(?:^|\n)[^#\n\d][^\n]*?(?:"
    + _OWN_NAMES
    + rb")\s*[\[(][^\n]*(?:"
    + _OWN_NAMES
    + rb")\s*[\[(]"
)
_OWN_ROW: Final = re.compile(rb"[ \t]*[+-]?\d{1,10}(?:[ \t]+[+-]?\d{1,10}){4}[ \t]*")
_ARROW: Final = re.compile(r"\d\d:\d\d:\d\d\.\d{3} -> .*")
_LABEL: Final = re.compile(r"([A-Za-z_]\w{0,40})[ \t]?[:=][ \t]*([+-]?[\d.]+(?:[eE][+-]?\d+)?)")
_LABELLED: Final = re.compile(rf"(?:{_LABEL.pattern}(?:[,;\t ]+|$))+", re.ASCII)
_MAX_LINE: Final = 1000
_FULL_SCALE: Final = 1023


def _recognises(head: bytes) -> bool:
    """Whether it is text with a digit; every other format is asked first."""
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    return b"\0" not in head[:1000] and re.search(rb"\d", head) is not None


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    lines = decode_text(file.data, file.source).splitlines()
    lines = _without_labels(_without_arrows(lines, builder))
    return log_of_table(builder, read_table("\n".join(lines), file.source))


def _without_arrows(lines: list[str], builder: LogBuilder) -> list[str]:
    """Make the stamps of the Arduino monitor, ``12:34:56.789 -> ``, a cell of each line."""
    if not _most(_ARROW, lines):
        return lines
    builder.warnings.append(
        "the time is that of the computer, which reads the port later and in batches"
    )
    rests = [line.partition(" -> ")[2] for line in lines]
    separator = next((one for one in ";\t," if sum(one in rest for rest in rests) > 1), " ")
    return [line.replace(" -> ", separator, 1) for line in lines]


def _without_labels(lines: list[str]) -> list[str]:
    """Make names of the labels that the Arduino plotter wants, ``ax:0.01 ay:-0.02``."""
    if not _most(_LABELLED, lines):
        return lines
    rows = [dict(_LABEL.findall(line)) for line in lines if _LABELLED.fullmatch(line.strip())]
    names = list(dict.fromkeys(name for row in rows[:1000] for name in row))
    return [",".join(names), *(",".join(row.get(name, "") for name in names) for row in rows)]


def _most(form: re.Pattern[str], lines: list[str]) -> bool:
    sample = [line.strip() for line in lines[-100:] if line.strip() and len(line) < _MAX_LINE]
    return 2 * sum(form.fullmatch(line) is not None for line in sample) > len(sample)


def _recognises_recording(head: bytes) -> bool:
    return _OWN_HEADER.search(head[:20_000]) is not None


def _read_recording(file: LogFile) -> Log:
    table = read_table(decode_text(file.data, file.source), file.source)
    return log_of_table(LogBuilder(file, RECORDING.name), table)


def _recognises_logger(head: bytes) -> bool:
    """Whether rows are an increasing index and four counts of a 10-bit converter."""
    lines = [line for line in head.splitlines()[:-1] if line.strip() and line.lstrip()[:1] != b"#"]
    if not lines or any(_OWN_ROW.fullmatch(line) is None for line in lines):
        return False
    rows = [[int(cell) for cell in line.split()] for line in lines]
    index = [row[0] for row in rows]
    rising = index[0] > 0 and all(one < two for one, two in pairwise(index))
    return rising and all(0 <= cell <= _FULL_SCALE for row in rows for cell in row[1:])


def _read_logger(file: LogFile) -> Log:
    text = TextFile(decode(file.data, file.source), file.source, file.sha256)
    recording = logger_text.read(text, file.rate)
    builder = LogBuilder(file, LOGGER.name, list(recording.warnings), list(recording.metadata))
    for name, values in zip(recording.channels, recording.values, strict=True):
        note = f"time made from the index and # sample_rate = {recording.get('sample_rate')}"
        builder.add(name, COUNTS, recording.time, values, note=note)
    return builder.build()


FORMAT = Format("table in text", (".csv", ".txt", ".tsv", ".dat", ".log"), _recognises, _read)
RECORDING = Format("bayes_asv CSV", (".csv",), _recognises_recording, _read_recording)
LOGGER = Format("bayes_asv logger text", (".txt",), _recognises_logger, _read_logger)
