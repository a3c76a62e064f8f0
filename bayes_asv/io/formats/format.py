"""What a file format is, and the parts that all readers share."""

from __future__ import annotations

import hashlib
import warnings
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log, LoggedChannel, check_size, collapse
from bayes_asv.domain.recording import MAX_MAGNITUDE
from bayes_asv.io.formats.stamps import repair

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import NDArray

__all__ = ["HEAD", "Format", "LogBuilder", "LogFile", "library"]

HEAD: Final = 65536
"""Bytes at the start of a file that are enough to recognise its format."""

_MAX_LISTED: Final = 8


@dataclass(frozen=True)
class LogFile:
    """A file to be read.

    Parameters
    ----------
    source : str
        Its name, for messages.
    data : bytes
        All of it.
    rate : float or None
        Sampling rate that the user gives for a file without stamps, Hz.
    """

    source: str
    data: bytes
    rate: float | None = None

    @cached_property
    def sha256(self) -> str:
        """Hash of the content."""
        return hashlib.sha256(self.data).hexdigest()


@dataclass(frozen=True, slots=True)
class Format:
    """A file format.

    Parameters
    ----------
    name : str
        In words, for example "RaceChrono CSV".
    extensions : tuple of str
        Usual ends of the file name, for messages; a format is recognised by content.
    recognises : callable
        Whether the first `HEAD` bytes are of this format.
    read : callable
        Makes the log; an `InputError` on anything unreadable.
    needs : str
        Package that reads it, empty for none; it works in a process of its own.
    extra : str
        Extra of this package that installs it.
    """

    name: str
    extensions: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[LogFile], Log]
    needs: str = ""
    extra: str = "formats"


@contextmanager
def library(file: LogFile, format: Format) -> Iterator[None]:
    """Turn whatever another package raises on a damaged file into an `InputError`."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as exc:  # packages raise many types; each means that the file is not usable
        reason = str(exc) or type(exc).__name__
        raise InputError(
            file.source, f"cannot be read as {format.name} ({reason[:120]})",
            "copy it from the logger again, or export it as CSV",
        ) from None  # fmt: skip


@dataclass
class LogBuilder:
    """Collects the channels of a log, repairs their stamps and keeps the bounds."""

    file: LogFile
    format: str
    warnings: list[str] = field(default_factory=list)
    metadata: list[tuple[object, object]] = field(default_factory=list)
    _channels: list[LoggedChannel] = field(default_factory=list)
    _samples: int = 0
    _empty: list[str] = field(default_factory=list)
    _repaired: dict[str, int] = field(default_factory=dict)

    @property
    def has_channels(self) -> bool:
        """Whether any channel was added."""
        return bool(self._channels)

    def reserve(self, samples: int) -> None:
        """Check that so many more readings fit, before they are made.

        Raises
        ------
        InputError
            If they do not.
        """
        check_size(self._samples + samples, len(self._channels), self.file.source)

    def add(
        self,
        name: str,
        unit: str,
        time: NDArray[np.float64],
        values: NDArray[Any],
        source: str = "",
        note: str = "",
    ) -> None:
        """Add a channel with stamps in s; readings that are not finite are left out.

        Stamps that do not increase are repaired as `repair` says, with one warning for all channels
        that need the same.
        """
        self.reserve(values.size)
        if values.dtype != np.float64:
            values = values.astype(np.float64)
        with np.errstate(invalid="ignore"):
            good = np.isfinite(values) & (np.abs(values) <= MAX_MAGNITUDE)
        if not good.all():
            time, values = time[good], values[good]
        if not values.size:
            self._empty.append(name)
            return
        if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
            repaired = repair(time, 1.0, f"{self.file.source}: {name}")
            time, values = repaired.time, values[repaired.rows]
            for text in repaired.warnings:
                self._repaired[text] = self._repaired.get(text, 0) + 1
        self._samples += values.size
        self._channels.append(
            LoggedChannel(_text(name), _text(unit), time, values, _text(source), note)
        )

    def add_uniform(
        self, name: str, unit: str, rate: float, values: NDArray[Any], source: str = "",
        start: float = 0.0, note: str = "",
    ) -> None:  # fmt: skip
        """Add a channel without stamps, sampled at a rate, Hz."""
        self.reserve(values.size)
        if not 1e-6 < rate < 1e9:
            raise InputError(
                f"{self.file.source}: {name}", f"has a rate of {rate:g} Hz", "copy the file again"
            )
        time = start + np.arange(values.size) / rate
        time.flags.writeable = False
        self.add(name, unit, time, values, source, note or f"time made from a rate of {rate:g} Hz")

    def build(self) -> Log:
        """Make the log; its time is zero at the first stamp of any channel.

        Raises
        ------
        InputError
            If no channel has a reading.
        """
        notes = list(self.warnings)
        if self._empty:
            notes.append(f"channels without a reading were left out: {listed(self._empty)}")
        for text, count in self._repaired.items():
            notes.append(text if count == 1 else f"{count} channels: {text}")
        return Log(
            _from_start(_with_distinct_sources(self._channels)),
            self.format,
            self.file.source,
            self.file.sha256,
            collapse(self.metadata),
            tuple(notes),
        )


def listed(names: Iterable[str]) -> str:
    """Return names separated by commas, the first few of them."""
    all_names = list(names)
    more = f" and {len(all_names) - _MAX_LISTED} more" if len(all_names) > _MAX_LISTED else ""
    return ", ".join(name[:40] for name in all_names[:_MAX_LISTED]) + more


def _from_start(channels: list[LoggedChannel]) -> tuple[LoggedChannel, ...]:
    start = min((float(one.time[0]) for one in channels), default=0.0)
    if start == 0.0:
        return tuple(channels)
    moved: dict[int, NDArray[np.float64]] = {}  # channels may share their stamps
    for one in channels:
        if id(one.time) not in moved:
            time = one.time - start
            time.flags.writeable = False
            moved[id(one.time)] = time
    return tuple(replace(one, time=moved[id(one.time)]) for one in channels)


def _with_distinct_sources(channels: list[LoggedChannel]) -> list[LoggedChannel]:
    """Make the pair of name and source name one channel: number those that share both."""
    seen: dict[tuple[str, str], int] = {}
    result = []
    for one in channels:
        key = (one.name, one.source)
        seen[key] = seen.get(key, 0) + 1
        if seen[key] > 1:
            one = replace(one, source=f"{one.source} no. {seen[key]}".strip())
        result.append(one)
    return result


def _text(text: str) -> str:
    return " ".join("".join(ch if ch.isprintable() else " " for ch in text[:200]).split())
