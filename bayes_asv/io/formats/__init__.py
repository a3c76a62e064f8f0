"""Readers of the files of foreign loggers, one module a format; `read_log` opens any of them."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import read_bytes
from bayes_asv.domain.recording import check_rate
from bayes_asv.io.formats import (
    aim_csv,
    aim_xrk,
    bare,
    gcdc,
    ide,
    matlab,
    mdf,
    messages,
    motec_csv,
    motec_ld,
    phyphox,
    picoquake,
    racecapture,
    racechrono,
    sufni,
    tdms,
    vbox,
)
from bayes_asv.io.formats.format import HEAD, Format, LogFile
from bayes_asv.io.formats.isolated import read_isolated
from bayes_asv.io.text import MAX_FILE_SIZE

if TYPE_CHECKING:
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.log import Log

__all__ = ["FORMATS", "Format", "LogFile", "detect", "read_file", "read_log"]

FORMATS: Final[tuple[Format, ...]] = (
    motec_ld.FORMAT,
    sufni.FORMAT,
    aim_xrk.FORMAT,
    mdf.FORMAT,
    tdms.FORMAT,
    ide.FORMAT,
    matlab.FORMAT,
    matlab.HDF5_FORMAT,
    messages.BAG,
    messages.BAG_2,
    messages.MCAP,
    phyphox.ZIP_FORMAT,
    motec_csv.FORMAT,
    aim_csv.FORMAT,
    racechrono.FORMAT,
    racecapture.FORMAT,
    gcdc.FORMAT,
    vbox.FORMAT,
    picoquake.FORMAT,
    phyphox.FORMAT,
    bare.RECORDING,
    bare.LOGGER,
    bare.FORMAT,  # any other text
)
"""All formats; the first that recognises a file reads it."""


def detect(head: bytes) -> Format | None:
    """Return the format of a file by its first bytes, or None."""
    head = head[:HEAD]
    return next((one for one in FORMATS if one.recognises(head)), None)


def read_log(path: PathLike, rate: float | None = None) -> Log:
    """Read the log of any known format, recognised by its content.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    rate : float, optional
        Sampling rate, Hz, for a file without time stamps; for one with stamps it is only a check.

    Returns
    -------
    Log
        All channels that are numbers, each with its own stamps, and warnings about oddities.

    Raises
    ------
    InputError
        If the file cannot be read, whatever its content; the message names file and fix.
    """
    source = os.fspath(path)
    if rate is not None:
        check_rate(rate, f"rate for {source}")
    data = read_bytes(path, MAX_FILE_SIZE)
    form = detect(data)
    if form is None:
        raise InputError(source, "is not in a known format", "export it as CSV")
    return read_file(form, LogFile(source, data, rate))


def read_file(form: Format, file: LogFile) -> Log:
    """Read a file of a known format; with another package, in a process of its own.

    Raises
    ------
    InputError
        As `read_log`.
    """
    return read_isolated(form, file) if form.needs else form.read(file)
