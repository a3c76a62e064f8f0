"""When a recording was made: from its metadata, from its name, or from the time of its file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Final

__all__ = ["date_of_file", "date_of_metadata", "date_of_name"]

# Keys of date and time of day in the headers of loggers, in small letters without punctuation.
_DATES: Final = (
    "start", "date", "start time", "start date", "date time", "recorded", "recorded at",
    "recording date", "log date", "session date", "created", "timestamp",
)  # fmt: skip
_TIMES: Final = ("time", "start time", "log time", "session time")

_YEAR: Final = r"(?P<y>(?:19|20)\d\d)"
_MONTH: Final = r"(?P<m>0[1-9]|1[0-2])"
_DAY: Final = r"(?P<d>0[1-9]|[12]\d|3[01])"
_CLOCK: Final = (
    r"(?:[T_ \-]+(?P<H>[01]\d|2[0-3])(?P<sep>[:h.\-_]?)(?P<M>[0-5]\d)"
    r"(?:(?P=sep)(?P<S>[0-5]\d))?(?!\d))?"
)
_NAMES: Final = tuple(
    re.compile(rf"(?<!\d){date}{_CLOCK}", re.IGNORECASE)
    for date in (
        rf"{_YEAR}(?P<s>[-_./\\]?){_MONTH}(?P=s){_DAY}(?!\d)",
        rf"{_DAY}(?P<s>[-_.]){_MONTH}(?P=s){_YEAR}(?!\d)",
    )
)
_FORMATS: Final = (
    "%Y-%m-%d", "%d/%m/%Y", "%d.%m.%Y", "%d-%m-%Y", "%Y/%m/%d", "%A, %B %d, %Y", "%B %d, %Y",
    "%b %d, %Y",
    "%d %B %Y", "%d %b %Y", "%d-%b-%Y",
)  # fmt: skip
_CLOCKS: Final = ("", " %H:%M:%S", " %H:%M", " %I:%M %p", " %I:%M:%S %p")


def date_of_metadata(metadata: Iterable[tuple[str, str]]) -> datetime | None:
    """Find the date in the metadata of a recording.

    Parameters
    ----------
    metadata : iterable of (str, str)
        Keys and values, such as ``date = 2026-05-03`` or ``Date`` and ``Time`` of a logger's
        header.  Of a date in figures the day comes before the month.

    Returns
    -------
    datetime or None
        In UTC where a time zone is given, otherwise as it stands; None without a date.
    """
    known = {re.sub(r"[\W_]+", " ", key).strip().lower(): value for key, value in metadata}
    clocks = [known[key] for key in _TIMES if key in known]
    for key in _DATES:
        if key not in known:
            continue
        day = _parsed(known[key])
        if day is None:
            continue
        if (day.hour, day.minute, day.second) == (0, 0, 0):
            both = [_parsed(f"{day:%Y-%m-%d} {clock}") for clock in clocks if clock != known[key]]
            return next((one for one in both if one is not None), day)
        return day
    return None


def date_of_name(path: str | os.PathLike[str]) -> datetime | None:
    """Find the last date in a path: 2026-05-03, 20260503_1430 or 03.05.2026, also of a folder.

    Returns
    -------
    datetime or None
    """
    text = os.fspath(path)
    found = [
        (match.end(), date)
        for pattern in _NAMES
        for match in pattern.finditer(text)
        if (date := _date_of(match)) is not None
    ]
    return max(found)[1] if found else None


def date_of_file(path: str | os.PathLike[str]) -> datetime:
    """Return when a file was last modified, local time."""
    return datetime.fromtimestamp(int(os.stat(path).st_mtime))


def _parsed(text: str) -> datetime | None:
    text = " ".join(text.split())
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return next((d for f in _FORMATS for c in _CLOCKS if (d := _by_format(text, f + c))), None)
    if found.tzinfo is not None:
        found = found.astimezone(UTC).replace(tzinfo=None)
    return found if re.match(r"\d{4}-?\d\d-?\d\d", text) else None


def _by_format(text: str, form: str) -> datetime | None:
    try:
        return datetime.strptime(text, form)
    except ValueError:
        return None


def _date_of(match: re.Match[str]) -> datetime | None:
    parts = match.groupdict(default="0")
    year, month, day, hour, minute, second = (int(parts[key]) for key in "ymdHMS")
    try:
        return datetime(year, month, day, hour, minute, second)
    except ValueError:
        return None  # 31 June
