"""A log: the channels of a file as its logger wrote them, each at its own rate.

A log comes before a recording.  Nothing is renamed, converted, resampled or aligned here; which
channel is which sensor of the car is decided later.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import MAX_MAGNITUDE, MAX_SAMPLES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

__all__ = [
    "MAX_CHANNELS", "MAX_DURATION", "Log", "LoggedChannel", "check_size", "utc",
]  # fmt: skip

MAX_CHANNELS: Final = 10_000
MAX_DURATION: Final = 366 * 86400.0
"""Longest log, s: beyond a year the unit of the stamps is wrong."""

_EPOCH_RANGE: Final = (1e9, 4.2e9)  # s since 1970: the years 2001 to 2103


@dataclass(frozen=True, slots=True, eq=False)
class LoggedChannel:
    """One channel of a log; its arrays are read-only.

    Parameters
    ----------
    name : str
        As in the file; names may repeat, then `source` tells them apart.
    unit : str
        As in the file, empty when the file states none.
    time : ndarray of float, shape (N,)
        Stamp of each reading, s since the start of the log, strictly increasing, N at least 1.
    values : ndarray of float, shape (N,)
        Readings in the unit of the file, all finite: a missing reading has no stamp.
    source : str
        Device, group or table of the channel in the file.
    note : str
        What the reader did to the channel, for example "time made from a rate of 2000 Hz".

    Raises
    ------
    InputError
        If the arrays violate the above or lie outside the bounds of this module.
    """

    name: str
    unit: str
    time: NDArray[np.float64]
    values: NDArray[np.float64]
    source: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        time, values = _read_only(self.time), _read_only(self.values)
        where = f"channel {self.name}"
        if time.ndim != 1 or time.shape != values.shape or not time.size:
            raise InputError(
                where, f"time {time.shape} and values {values.shape} do not match",
                "give two arrays of one length, at least 1",
            )  # fmt: skip
        if not (np.isfinite(time).all() and np.isfinite(values).all()):
            raise InputError(where, "has a stamp or a reading that is not finite", "leave it out")
        if (np.diff(time) <= 0).any():
            raise InputError(
                where, "has a time that does not increase", "sort or repair the stamps"
            )
        if time[-1] - time[0] > MAX_DURATION or np.abs(time[[0, -1]]).max() > MAX_MAGNITUDE:
            raise InputError(
                where, f"lasts from {time[0]:.6g} to {time[-1]:.6g} s",
                "check the unit of the stamps",
            )  # fmt: skip
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)

    @property
    def rate(self) -> float:
        """Sampling rate, Hz, from the median step; NaN for a single reading."""
        return float(1.0 / np.median(np.diff(self.time))) if self.time.size > 1 else np.nan


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """The content of one log file.

    Parameters
    ----------
    channels : tuple of LoggedChannel
        In the order of the file, at least one.
    format : str
        The file format in words, for example "RaceChrono CSV".
    source, sha256 : str
        Name and hash of the file.
    metadata : tuple of (str, str)
        Keys and values of the file's header.
    warnings : tuple of str
        Oddities that the reader accepted, and what it did about them.

    Raises
    ------
    InputError
        If there is no channel, or there are more readings than `MAX_SAMPLES`.
    """

    channels: tuple[LoggedChannel, ...]
    format: str
    source: str = ""
    sha256: str = ""
    metadata: tuple[tuple[str, str], ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        where = self.source or "log"
        if not self.channels:
            raise InputError(
                where, f"is a {self.format} without a channel", "record or export it again"
            )
        check_size(sum(one.time.size for one in self.channels), len(self.channels), where)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(one.name for one in self.channels)

    def channel(self, name: str, source: str | None = None) -> LoggedChannel:
        """Return the first channel of a name, or of a name and a source.

        Raises
        ------
        KeyError
            When there is none.
        """
        for one in self.channels:
            if one.name == name and source in (None, one.source):
                return one
        raise KeyError(name)


def check_size(samples: int, channels: int, source: str) -> None:
    """Check that a log fits into the memory of a laptop, before its arrays are made.

    Raises
    ------
    InputError
        If it has more than `MAX_SAMPLES` readings or `MAX_CHANNELS` channels.
    """
    if samples > MAX_SAMPLES:
        raise InputError(
            source, f"has {samples} readings", f"split it into files of less than {MAX_SAMPLES}"
        )
    if channels > MAX_CHANNELS:
        raise InputError(
            source, f"has {channels} channels", f"export less than {MAX_CHANNELS} of them"
        )


def utc(seconds: float) -> str | None:
    """Return the date and time of a stamp in seconds since 1970, or None if it is no such stamp."""
    if not _EPOCH_RANGE[0] <= seconds <= _EPOCH_RANGE[1]:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def collapse(pairs: Iterable[tuple[object, object]]) -> tuple[tuple[str, str], ...]:
    """Reduce keys and values to one line of printable text; pairs without a key are left out."""
    lines = ((_line(key), _line(value)) for key, value in pairs)
    return tuple((key, value) for key, value in lines if key)


def _line(value: object) -> str:
    text = "".join(ch if ch.isprintable() else " " for ch in str(value)[:_MAX_TEXT])
    return " ".join(text.split())


_MAX_TEXT: Final = 1000


def _read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a read-only array of floats; one that is already read-only is shared, not copied."""
    result = np.asarray(array, dtype=np.float64)
    if result.flags.writeable:
        if result is array:
            result = result.copy()
        result.flags.writeable = False
    return result
