"""Readers and writers of recordings, one module per file format."""

from __future__ import annotations

import hashlib
import os
from typing import TYPE_CHECKING

from bayes_asv.domain.files import decode, read_bytes
from bayes_asv.domain.recording import check_rate
from bayes_asv.io import csv
from bayes_asv.io import logger_text as logger
from bayes_asv.io.csv import write_csv
from bayes_asv.io.logger_text import write_logger
from bayes_asv.io.text import MAX_FILE_SIZE, TextFile

if TYPE_CHECKING:
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.recording import Recording

__all__ = ["read_recording", "write_csv", "write_logger", "write_recording"]

write_recording = write_csv
"""CSV is the format that stores all properties of a recording."""


def read_recording(path: PathLike, rate: float | None = None) -> Recording:
    """Read a recording in any supported format, detected from its first lines.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    rate : float, optional
        Sampling rate, Hz, for formats without time stamps; it takes precedence over ``sample_rate``
        in the metadata.  For a file with stamps it is only a check.

    Returns
    -------
    Recording
        In the units of the file, with warnings about accepted oddities.

    Raises
    ------
    InputError
        If the file cannot be read, whatever its content; the message names file, line and fix.
    """
    source = os.fspath(path)
    if rate is not None:
        check_rate(rate, f"rate for {source}")
    data = read_bytes(path, MAX_FILE_SIZE)
    text = TextFile(decode(data, source), source, hashlib.sha256(data).hexdigest())
    reader = logger.read if logger.is_logger_text(text) else csv.read
    return reader(text, rate)
