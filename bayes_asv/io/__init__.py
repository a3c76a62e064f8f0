"""One reader and writer a file format, and the choice among them by looking at the file."""

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
from bayes_asv.io.text import LARGEST_FILE, Text

if TYPE_CHECKING:
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.recording import Recording

__all__ = ["read_recording", "write_csv", "write_logger", "write_recording"]

write_recording = write_csv
"""CSV is the format that holds everything a recording can hold."""


def read_recording(path: PathLike, rate: float | None = None) -> Recording:
    """Read a recording of any format known here, chosen by its first lines.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    rate : float, optional
        Rows a second, Hz, for formats without time stamps; it comes before the metadata's
        ``sample_rate``. Where there are stamps it is only a check.

    Returns
    -------
    Recording
        In the units of the file, with warnings for what was odd but readable.

    Raises
    ------
    InputError
        One line with the file, the line and the mend, whatever the bytes are.
    """
    source = os.fspath(path)
    if rate is not None:
        check_rate(rate, f"rate for {source}")
    data = read_bytes(path, LARGEST_FILE)
    text = Text(decode(data, source), source, hashlib.sha256(data).hexdigest())
    reader = logger.read if logger.recognises(text) else csv.read
    return reader(text, rate)
