"""Recordings: read, checked, shown in a notebook, and exchanged with pandas."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from bayes_asv.domain import recording as domain
from bayes_asv.domain.channel_map import ChannelMap, read_channel_map
from bayes_asv.domain.channels import KNOWN_CHANNELS, channel, missing_inputs
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.domain.units import si_factor
from bayes_asv.library.extras import import_extra

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Recording", "as_channel_map", "as_recording", "check_different", "expanded", "read_recording",
    "read_recordings",
]  # fmt: skip

_COLUMN: Final = re.compile(r"\s*(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*")
_TIME: Final = "time"


class Recording(domain.Recording):
    """Channels over time, in the units of the file.

    Made by :func:`read_recording`, by :meth:`from_dataframe` or from arrays.  ``time`` (N,) is in
    seconds, ``values`` (C, N) in ``units``, one a channel; a missing reading is NaN.
    """

    __slots__ = ()

    @classmethod
    def from_dataframe(
        cls,
        frame: pd.DataFrame,
        units: str | Mapping[str, str] | None = None,
        *,
        channels: Mapping[str, str] | None = None,
        rate: float | None = None,
        metadata: Mapping[str, str] | None = None,
        name: str = "DataFrame",
    ) -> Self:
        """Make a recording from a table with one column a channel.

        Parameters
        ----------
        frame : pandas.DataFrame
            Columns are named as the channels (``front_wheel``, ``front_chassis``, ``rear_wheel``,
            ``rear_chassis`` and others, see ``docs/recording.md``), with or without a unit in
            brackets as in a CSV file: ``front_wheel [m/s^2]``.  Other columns are left out.  Times
            are in a column ``time`` (seconds, or the unit in its brackets) or in the index; a
            missing reading is NaN.
        units : str or mapping, optional
            Unit of all columns, or of each by channel, where the names give none: ``"g"`` or
            ``{"front_wheel": "g", …}``; ``"counts"`` for raw readings.
        channels : mapping, optional
            Column of each channel whose column has another name: ``{"front_wheel": "acc_1"}``.
        rate : float, optional
            Sampling rate, Hz, of a table without times.
        metadata : mapping, optional
            As the ``# key = value`` lines of a file; those of :meth:`to_dataframe` by default.
        name : str
            What messages and reports call the recording.

        Returns
        -------
        Recording

        Raises
        ------
        InputError
            If a channel, a unit or the time is missing.
        """
        if not (hasattr(frame, "columns") and hasattr(frame, "index")):
            raise TypeError(
                f"from_dataframe takes a pandas DataFrame, not a {type(frame).__name__}"
            )
        columns = _columns(frame, channels or {}, name)
        measured = tuple(name for name in KNOWN_CHANNELS if name in columns)
        missing = missing_inputs(measured)
        if missing:
            raise InputError(
                name,
                f"has no column {', '.join(missing)}",
                f'name the columns by channels={{"{missing[0]}": "…"}}',
            )
        about = frame.attrs.get("metadata", {}) if metadata is None else metadata
        return cls(
            time=_times(frame, columns.get(_TIME), rate, name),
            values=np.stack([np.asarray(frame[columns[c][0]], dtype=float) for c in measured]),
            units=tuple(_unit_of(c, columns[c][1], units, name) for c in measured),
            metadata=tuple((str(key), str(value)) for key, value in about.items()),
            source=name,
            channels=measured,
        )

    def to_dataframe(self, units: str | None = None) -> pd.DataFrame:
        """Return the readings as a table with the times as its index.

        Parameters
        ----------
        units : str, optional
            A unit of acceleration for all accelerometers, such as ``"m/s^2"``; by default each
            keeps its own.  Readings in counts stay in counts.

        Returns
        -------
        pandas.DataFrame
            Columns are named as in a CSV file, ``front_wheel [in/s^2]``, so that
            :meth:`from_dataframe` makes the same recording of it.
        """
        pandas = import_extra("pandas", "to_dataframe()")
        table = {}
        for name, own, values in zip(self.channels, self.units, self.values, strict=True):
            other = own == domain.COUNTS or channel(name).dimension != "acceleration"
            shown = own if units is None or other else units
            factor = 1.0
            if shown != own:
                factor = si_factor(own, "acceleration") / si_factor(shown, "acceleration")
            table[f"{name} [{shown}]"] = values * factor if shown != own else values
        frame = pandas.DataFrame(table, index=pandas.Index(self.time, name="time [s]"))
        frame.attrs["metadata"] = dict(self.metadata)
        return frame

    def to_csv(self, path: PathLike) -> None:
        """Write the recording as CSV, which :func:`read_recording` reads back unchanged."""
        from bayes_asv.io import write_recording

        write_recording(self, path)

    @property
    def rate(self) -> float:
        """Sampling rate, Hz, from the median time step."""
        return domain.nominal_rate(self)

    @property
    def duration(self) -> float:
        """Time from the first row to the last, s."""
        return float(self.time[-1] - self.time[0])

    def __repr__(self) -> str:
        units = ", ".join(dict.fromkeys(self.units))
        return (
            f"<Recording {Path(self.source).name[:60] or 'in memory'}: {len(self.time)} rows at "
            f"{self.rate:.4g} Hz, {self.duration:.4g} s, {len(self.channels)} channels in {units}>"
        )

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{channel}</th><td>{np.nanmin(x):.4g} to {np.nanmax(x):.4g} "
            f"{escape(unit)}</td><td>{int(np.sum(~np.isfinite(x))) or 'none'}</td></tr>"
            for channel, unit, x in zip(self.channels, self.units, self.values, strict=True)
            if np.isfinite(x).any()
        )
        notes = "".join(f"<li>{escape(text)}</li>" for text in self.warnings)
        return (
            f"<div><b>{escape(repr(self)[1:-1])}</b><table><thead><tr><th>channel</th>"
            f"<th>readings</th><th>missing</th></tr></thead><tbody>{rows}</tbody></table>"
            f"<ul>{notes}</ul></div>"
        )


def read_recording(
    path: PathLike,
    *,
    rate: float | None = None,
    channels: PathLike | ChannelMap | Mapping[str, str] | None = None,
) -> Recording:
    """Read one recording, in any format that the command line reads.

    Parameters
    ----------
    path : str or os.PathLike
        The file, described in ``docs/recording.md``.
    rate : float, optional
        Sampling rate, Hz, of a file without time stamps.
    channels : str, os.PathLike, ChannelMap or mapping, optional
        Which column of a foreign log is which channel: a channel map (``docs/channel-map.md``), its
        file, or names alone, ``{"front_wheel": "Acc FL", …}``.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        If the file cannot be read; the message names file, line and fix.
    """
    from bayes_asv.io import read_recording as read

    return as_recording(read(path, rate, as_channel_map(channels)))


def as_channel_map(
    channels: PathLike | ChannelMap | Mapping[str, str] | None,
) -> ChannelMap | None:
    """Return a channel map that is given as such, as a file or as names of columns."""
    if channels is None or isinstance(channels, ChannelMap):
        return channels
    if isinstance(channels, Mapping):
        return ChannelMap.from_names(channels)
    return read_channel_map(channels)


def read_recordings(
    paths: PathLike | Iterable[PathLike],
    *,
    rate: float | None = None,
    channels: PathLike | ChannelMap | Mapping[str, str] | None = None,
) -> list[Recording]:
    """Read several recordings of one car.

    Parameters
    ----------
    paths : str, os.PathLike or iterable of them
        Files; one that does not exist may be a pattern such as ``"run*.csv"``, whose files are
        read in the order of their names.
    rate, channels : optional
        As for :func:`read_recording`.

    Returns
    -------
    list of Recording

    Raises
    ------
    InputError
        If a file cannot be read, a pattern fits none, or two files are the same.
    """
    patterns = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    runs: list[Recording] = []
    mapped = as_channel_map(channels)
    for path in [path for pattern in patterns for path in expanded(pattern)]:
        runs.append(read_recording(path, rate=rate, channels=mapped))
        check_different(runs[:-1], runs[-1])
    return runs


def as_recording(recording: domain.Recording) -> Recording:
    """Return a recording of the domain as the class that the library shows."""
    return Recording(**{f.name: getattr(recording, f.name) for f in fields(recording)})


def check_different(runs: Iterable[domain.Recording], run: domain.Recording) -> None:
    """Refuse a recording that is already there: it would count as twice the evidence."""
    for other in runs:
        # Pieces of one log have its hash, and begin at times of their own.
        same = (
            other.sha256 == run.sha256 and other.time[0] == run.time[0]
            if run.sha256
            else np.array_equal(other.values, run.values)
        )
        if same:
            raise InputError(
                run.source or "recording",
                f"holds the same as {other.source or 'another'}",
                "give each recording once",
            )


def expanded(path: PathLike) -> list[PathLike]:
    """Return the files of a pattern in the order of their names, or the path itself if it is none.

    Raises
    ------
    InputError
        If a pattern fits no file.
    """
    text = os.fspath(path)
    if os.path.exists(text) or not glob.has_magic(text):
        return [path]
    found = sorted(glob.glob(text, recursive=True))
    if not found:
        raise InputError(text, "no such file, and the pattern fits none", "check folder and name")
    return list(found)


def _columns(
    frame: pd.DataFrame, channels: Mapping[str, str], name: str
) -> dict[str, tuple[Any, str | None]]:
    """Column and bracketed unit of the time and of every channel that there is."""
    known = {_TIME, *KNOWN_CHANNELS}
    unknown = [one for one in channels if one not in known]
    if unknown:
        raise InputError(
            name, f"there is no channel '{unknown[0]}'", f"name one of {', '.join(KNOWN_CHANNELS)}"
        )
    found: dict[str, tuple[Any, str | None]] = {}
    for column in frame.columns:
        match = _COLUMN.fullmatch(str(column))
        plain, unit = (match["name"], match["unit"]) if match else (str(column), None)
        plain = re.sub(r"[\s-]+", "_", plain.lower())
        if plain in known and plain not in channels:
            found[plain] = column, unit
        for own, wanted in channels.items():
            if column == wanted:
                found[own] = column, unit
    absent = [wanted for own, wanted in channels.items() if own not in found]
    if absent:
        raise InputError(
            name, f"has no column '{absent[0]}'", f"it has {', '.join(map(str, frame.columns))}"
        )
    return found


def _unit_of(
    channel: str, bracketed: str | None, units: str | Mapping[str, str] | None, name: str
) -> str:
    unit = units if isinstance(units, str) else (units or {}).get(channel, bracketed)
    if not unit:
        raise InputError(
            f"{name}: {channel}", "has no unit", f'give units={{"{channel}": "m/s^2"}} or units="g"'
        )
    return unit


def _times(
    frame: pd.DataFrame, column: tuple[Any, str | None] | None, rate: float | None, name: str
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Seconds of every row: of the column, else of the index, else of the rate."""
    index = frame.index
    if column is not None:
        stamps, unit = frame[column[0]].to_numpy(), column[1]
    elif rate is not None:
        domain.check_rate(rate, f"{name}: rate")
        return np.arange(len(frame)) / rate
    elif type(index).__name__ != "RangeIndex":
        stamps = index.to_numpy()
        match = _COLUMN.fullmatch(str(index.name or ""))
        unit = match["unit"] if match else None
    else:
        raise InputError(name, "has no times", "add a column 'time [s]' or give rate=400")
    if stamps.dtype.kind in "mM":
        return np.asarray((stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9, dtype=float)
    return np.asarray(stamps, dtype=float) * si_factor(unit or "s", "time")
