"""Time stamps as loggers write them: their unit, and what is done where they do not increase.

The unit is the one that the file states, in a row of units, in brackets behind the name or in the
name itself (``time_ms``).  Without one, it is that unit among s, ms, µs and ns for which the
sampling rate is at least 8 Hz and below 8000 Hz.  The two bounds are a factor of 1000 apart, as the
units are, so exactly one unit fits any step; slower than 8 Hz shows no suspension, and few loggers
are faster than 8 kHz.  Stamps since 1970 need no rule: time counts from the first stamp.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import MAX_DURATION

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "Repaired", "clock_seconds", "is_clock", "past_midnight", "plausible_unit", "repair",
    "time_factor",
]  # fmt: skip

_FACTORS: Final = {
    1.0: "s sec secs second seconds sekunde sekunden unix epoch",
    1e-3: "ms msec msecs milli millis millisecond milliseconds",
    1e-6: "us µs usec usecs micro micros microsecond microseconds",
    1e-9: "ns nsec nanos nanosecond nanoseconds",
    60.0: "min minute minutes",
    3600.0: "h hour hours",
}
_FACTOR_OF: Final = {word: factor for factor, words in _FACTORS.items() for word in words.split()}
_SLOWEST: Final = 8.0  # Hz
_FEW: Final = 0.01
_MAX_STEP_BACK: Final = 1.0  # s
_COARSE: Final = 0.1
_LARGEST: Final = 1e19  # ns since 1970 are below it
_COUNTER: Final = 2.0**32
_CLOCK: Final = re.compile(
    r"(?:[\w./-]{1,12}[ T]){0,3}"
    r"(?:(\d{1,3}):)?(\d{1,2}):(\d{1,2}(?:[.,]\d{1,9})?)\s*(?:Z|UTC|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
_DAY: Final = 86400.0


class Repaired(NamedTuple):
    """Increasing stamps.

    Attributes
    ----------
    time : ndarray of float, shape (M,)
        Time since the first stamp, s.
    rows : ndarray of int, shape (M,)
        Rows of the stamps.
    warnings : tuple of str
        What was done.
    start : float
        First stamp, s since whatever the clock counts from.
    """

    time: NDArray[np.float64]
    rows: NDArray[np.intp]
    warnings: tuple[str, ...]
    start: float


def time_factor(text: str, in_name: bool = False) -> float | None:
    """Return the length of a unit of time in s, or None if the text names none.

    Parameters
    ----------
    text : str
        A unit, such as ``ms`` or ``unix time``; or with `in_name` the name of a column, such as
        ``time_us`` or ``TimeMillis``.
    in_name : bool
        Whether the unit is one word of a name.
    """
    folded = text.strip().replace("μ", "µ")
    if not in_name:
        words = folded.lower().replace(" time", "").strip(" .")
        return _FACTOR_OF.get(words)
    words_of_name = re.findall(r"[A-Z]?[a-zµ]+|[A-Zµ]+", folded)
    for word in [*folded.lower().replace("-", "_").split("_"), *words_of_name]:
        factor = _FACTOR_OF.get(word.lower())
        if factor is not None and factor < 60.0:  # "min" in a name is rather a minimum
            return factor
    return None


def plausible_unit(step: float) -> tuple[str, float]:
    """Return the unit of stamps, and its length in s, from their median step."""
    for word, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if _SLOWEST <= 1.0 / (step * factor) < 1000 * _SLOWEST:
            return word, factor
    return ("s", 1.0) if step < 1.0 else ("ns", 1e-9)


def repair(
    stamps: NDArray[np.float64],
    factor: float | None,
    where: str,
    same: NDArray[np.bool_] | None = None,
) -> Repaired:
    """Make stamps increase, or refuse them.

    - A row without a stamp is left out, up to 10 % of the rows.
    - A 32-bit counter that overflows goes on counting.
    - A single stamp that is too large, and rows up to 1 s behind their predecessors, are left out
      while they are not more than 1 % of the rows.  Otherwise the file holds several runs or is not
      a log, and is refused.
    - A row that repeats the whole row before is left out.
    - Of stamps that repeat otherwise the first is kept, if fewer than 10 % do: the logger wrote a
      row twice.  If more do, the clock is coarser than the sampling; the rows between two stamps
      are then spread evenly.

    Parameters
    ----------
    stamps : ndarray of float, shape (N,)
        In their own unit; NaN where a row has none.
    factor : float or None
        Length of this unit, s; None takes `plausible_unit`.
    where : str
        File, for messages.
    same : ndarray of bool, shape (N,), optional
        Whether a row repeats all cells of the row before.

    Returns
    -------
    Repaired
        M stamps and rows, M at most N.

    Raises
    ------
    InputError
        If the stamps do not advance, go back, or are too many without.
    """
    warnings: list[str] = []
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(np.abs(stamps) <= _LARGEST)
    missing = stamps.size - rows.size
    if missing:
        if missing > 0.1 * stamps.size:
            raise InputError(
                where, f"has no time in {missing} of {stamps.size} rows", "export it again"
            )
        warnings.append(f"{missing} rows without a time were left out")
    raw = _continued(stamps[rows], warnings)
    steps = np.diff(raw)
    advancing = steps[steps > 0]
    if not advancing.size:
        if raw.size == 1:
            return Repaired(np.zeros(1), rows, tuple(warnings), raw[0] * (factor or 1.0))
        raise _standing_still(where)
    if factor is None:
        step = float(np.median(advancing))
        word, factor = plausible_unit(step)
        warnings.append(
            f"no unit of time is stated; {word} is taken, as it gives {1 / (step * factor):.6g} Hz"
        )
    if (steps < 0).any():
        kept = _in_order(raw, factor, where)
        warnings.append(f"{raw.size - kept.size} rows out of order in time were left out")
        raw, rows = raw[kept], rows[kept]
        if raw[0] == raw[-1]:
            raise _standing_still(where)
    repeats = np.concatenate([[False], np.diff(raw) == 0])
    if repeats.any() and same is not None:
        whole = repeats & same[rows]
        if whole.any():
            warnings.append(f"{whole.sum()} rows that repeat the row before were left out")
            raw, rows, repeats = raw[~whole], rows[~whole], repeats[~whole]
    if repeats.any():
        if repeats.mean() > _COARSE:
            raw = _spread(raw)
            warnings.append(
                f"{repeats.sum()} stamps repeat, so the clock is coarser than the sampling; "
                "the rows between two stamps are spread evenly"
            )
        else:
            raw, rows = raw[~repeats], rows[~repeats]
            warnings.append(f"{repeats.sum()} rows that repeat a stamp were left out")
    with np.errstate(over="ignore"):
        time = (raw - raw[0]) * factor
        noise = float(np.spacing(np.abs(raw).max())) * factor
    if 1e-9 < noise < 1.0:  # stamps since 1970 have no more decimals than this
        time = np.round(time, int(-math.log10(noise)))
    if not time[-1] <= MAX_DURATION:
        raise InputError(where, f"lasts {time[-1]:.3g} s", "check the unit of the time column")
    if (np.diff(time) <= 0).any():
        raise InputError(where, "has stamps closer than they can be told apart", "export it again")
    return Repaired(time, rows, tuple(warnings), raw[0] * factor)


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date, or minutes and seconds."""
    return ":" in cell and len(cell) < 40 and _CLOCK.fullmatch(cell.strip()) is not None


def clock_seconds(cell: str) -> float:
    """Return the time of day of a cell, s, without its date; NaN if it is none."""
    match = _CLOCK.fullmatch(cell.strip()) if len(cell) < 40 else None
    if match is None:
        return math.nan
    return 3600 * int(match[1] or 0) + 60 * int(match[2]) + float(match[3].replace(",", "."))


def past_midnight(seconds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times of day, s, that go on counting after midnight."""
    days = np.cumsum(np.concatenate([[0], np.diff(seconds) < -_DAY / 2]))
    return seconds + _DAY * days


def _standing_still(where: str) -> InputError:
    return InputError(where, "has a time that does not advance", "export it with another clock")


def _continued(raw: NDArray[np.float64], warnings: list[str]) -> NDArray[np.float64]:
    """Let a 32-bit counter go on counting where it overflows."""
    over = (raw[:-1] > 0.9 * _COUNTER) & (raw[:-1] < _COUNTER) & (np.abs(raw[1:]) < 0.1 * _COUNTER)
    if not over.any():
        return raw
    warnings.append("the 32-bit counter of the time overflows; it goes on counting")
    return raw + _COUNTER * np.cumsum(np.concatenate([[False], over]))


def _in_order(raw: NDArray[np.float64], factor: float, where: str) -> NDArray[np.intp]:
    """Rows whose stamps do not decrease; an error when the others are many or far behind."""
    kept = np.arange(raw.size)
    before = np.concatenate([[-np.inf], raw[:-2]])
    spikes = np.concatenate([(raw[:-1] > raw[1:]) & (before <= raw[1:]), [False]])
    kept = kept[~spikes]
    highest = np.maximum.accumulate(raw[kept])
    late = raw[kept] < highest
    behind = float((highest - raw[kept]).max() * factor)
    if spikes.sum() + late.sum() > max(1, _FEW * raw.size) or behind > _MAX_STEP_BACK:
        row = int(np.argmax(np.diff(raw) < 0)) + 1
        raise InputError(
            where,
            f"time goes back from {(raw[row - 1] - raw[0]) * factor:.6g} s "
            f"to {(raw[row] - raw[0]) * factor:.6g} s after {row} rows",
            "split it into its runs, one file each",
        )
    result: NDArray[np.intp] = kept[~late]
    return result


def _spread(raw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spread the rows of one stamp evenly up to the next, or up to the usual step in a gap."""
    stamps, first, count = np.unique(raw, return_index=True, return_counts=True)
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    steps = np.minimum(np.append(steps, usual), usual)
    within = np.arange(raw.size) - np.repeat(first, count)
    result: NDArray[np.float64] = np.repeat(stamps, count) + within * np.repeat(
        steps / count, count
    )
    return result
