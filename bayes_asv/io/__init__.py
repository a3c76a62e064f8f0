"""Readers and writers of recordings, one module per file format."""

from __future__ import annotations

import hashlib
import os
from typing import TYPE_CHECKING

from bayes_asv.domain.channels import missing_inputs
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import decode, read_bytes
from bayes_asv.domain.recording import check_rate
from bayes_asv.io import csv
from bayes_asv.io import logger_text as logger
from bayes_asv.io.csv import write_csv
from bayes_asv.io.logger_text import write_logger
from bayes_asv.io.text import MAX_FILE_SIZE, TextFile

if TYPE_CHECKING:
    from bayes_asv.domain.channel_map import ChannelMap
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.log import Log
    from bayes_asv.domain.recording import Recording

__all__ = ["read_log", "read_recording", "write_csv", "write_logger", "write_recording"]

write_recording = write_csv
"""CSV is the format that stores all properties of a recording."""


def read_recording(
    path: PathLike, rate: float | None = None, channels: ChannelMap | None = None
) -> Recording:
    """Read a recording: a file of ours, or with a channel map a log of any known format.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    rate : float, optional
        Sampling rate, Hz, for formats without time stamps; it takes precedence over ``sample_rate``
        in the metadata.  For a file with stamps it is only a check.
    channels : ChannelMap, optional
        Which column of a foreign log is which channel.

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
    if channels is not None and not _is_own(data, channels):
        recording = channels.recording(read_log(path, channels.rate if rate is None else rate))
        missing = missing_inputs(recording.channels)
        if missing:
            raise InputError(
                channels.source,
                f"maps no {missing[0]}, without which no car can be estimated",
                f"add [channels.{missing[0]}]",
            )
        return recording
    _check_not_foreign(data, source)
    text = TextFile(decode(data, source), source, hashlib.sha256(data).hexdigest())
    reader = logger.read if logger.is_logger_text(text) else csv.read
    return reader(text, rate)


def read_log(path: PathLike, rate: float | None = None) -> Log:
    """Read the log of any known format, see :func:`bayes_asv.io.formats.read_log`."""
    from bayes_asv.io.formats import read_log as read  # seventeen modules that few files need

    return read(path, rate)


def _is_own(data: bytes, channels: ChannelMap) -> bool:
    """Whether a file has the channels by our names, and not by those of a channel map."""
    from bayes_asv.io.formats import bare, detect

    if detect(data) not in (bare.RECORDING, bare.LOGGER):
        return False
    head = data[:20_000]
    return not all(column.encode() in head for one in channels.channels for column in one.columns)


def _check_not_foreign(data: bytes, source: str) -> None:
    """Refuse a log whose channels have names of their own, and say what to do."""
    from bayes_asv.io.formats import bare, detect

    form = detect(data)
    if form is None or form in (bare.RECORDING, bare.LOGGER, bare.FORMAT):
        return  # one of ours, or with a fault that its reader names
    raise InputError(
        source,
        f"is a {form.name}, not a recording with channels of this package",
        f"make a channel map (bayes-asv inspect {source} -o channels.toml) and give it by "
        "--channels channels.toml, or export it as CSV with these channels",
    )
