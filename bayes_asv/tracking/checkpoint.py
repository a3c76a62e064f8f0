"""A tracker put away in a file and taken up again, as if nothing had been between.

The file is a NumPy archive without pickles: arrays by name, and one text of JSON for numbers and
what the tracker was made with.  What is read is checked before anything is taken from it.
"""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, read_bytes, write_atomically
from bayes_asv.filters.ukf_state import State, Steps

__all__ = ["FORMAT", "packed", "read_packed", "taken_up", "write_packed"]

FORMAT: Final = "bayes_asv/tracker/1"

_LARGEST_FILE: Final = 200_000_000
_MEND: Final = "give what a tracker's save() wrote"

Arrays = dict[str, NDArray[Any]]

# What changes while a tracker runs, by the name of its class.
_KEPT: Final[dict[str, tuple[str, ...]]] = {
    "Tracker": ("_layout", "_filter", "watch", "fitness", "_tail", "_tail_end"),
    "Layout": (
        "_equalisers", "_wheels", "_origin", "_last_stamp", "_now", "_count", "_stamp", "_when",
        "_reading", "_kind", "_step", "_done",
    ),
    "_Equaliser": ("time", "signal", "slow"),
    "WheelCurve": (
        "_waiting", "_time", "_value", "_reach", "_opens", "_upper", "_right", "_missed",
        "_curve", "_deviation", "_settled", "_newest", "_complete",
    ),
    "Filter": (
        "state", "looking_back", "resets", "time", "_patience", "_calm", "_looks", "_known",
        "_held",
    ),
    "Consistency": (
        "nis", "readings", "rows", "rows_consistent", "rows_well", "worst_colour", "worst_level",
        "products", "_past", "_sums", "_since", "_doubt",
    ),
    "Fitness": ("rows", "first", "last", "present", "clipped", "total", "squares"),
}  # fmt: skip
_RECORDS: Final[dict[str, Callable[..., Any]]] = {"State": State, "Steps": Steps}


def packed(thing: object, name: str, arrays: Arrays) -> Any:
    """Take a thing apart: arrays go into ``arrays``, the rest is returned as plain data.

    Parameters
    ----------
    thing : object
        One of the classes above, a record of arrays, an array, a list, or a plain value.
    name : str
        Where it stands.
    arrays : dict
        Filled.
    """
    kind = type(thing).__name__
    if kind in _KEPT:
        return {key: packed(getattr(thing, key), f"{name}.{key}", arrays) for key in _KEPT[kind]}
    if isinstance(thing, np.ndarray):
        arrays[name] = thing
        return {"array": name}
    if isinstance(thing, tuple) and kind in _RECORDS:
        return {
            "record": kind,
            "parts": [packed(x, f"{name}.{k}", arrays) for k, x in enumerate(thing)],
        }
    if isinstance(thing, (list, tuple)):
        return [packed(x, f"{name}.{k}", arrays) for k, x in enumerate(thing)]
    if isinstance(thing, float) and not math.isfinite(thing):
        return {"number": repr(thing)}
    if thing is None or isinstance(thing, (bool, int, float, str)):
        return thing
    raise TypeError(f"{name} is a {kind}, which cannot be put away")


def taken_up(into: Any, plain: Any, arrays: Arrays) -> None:
    """Put what :func:`packed` took apart into a thing made alike.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it does not fit.
    """
    for key in _KEPT[type(into).__name__]:
        old, new = getattr(into, key), plain[key]
        if type(old).__name__ in _KEPT:
            taken_up(old, new, arrays)
        elif isinstance(old, list) and any(type(x).__name__ in _KEPT for x in old):
            if len(old) != len(new):
                raise ValueError(f"{key} has another length")
            for one, other in zip(old, new, strict=True):
                if one is not None:
                    taken_up(one, other, arrays)
        else:
            setattr(into, key, _value(new, old, arrays))


def _value(plain: Any, like: Any, arrays: Arrays) -> Any:
    """Rebuild a value; it has to be of the kind of the one it replaces."""
    if isinstance(plain, dict) and "array" in plain:
        found = arrays[plain["array"]]
        if isinstance(like, np.ndarray) and (
            found.dtype != like.dtype
            or found.ndim != like.ndim
            or found.shape[1:] != like.shape[1:]
        ):
            raise ValueError(f"{plain['array']} has another shape")
        return found.copy()
    if isinstance(plain, dict) and "record" in plain:
        made = _RECORDS[plain["record"]](*(_value(x, None, arrays) for x in plain["parts"]))
        if isinstance(like, tuple):
            for one, other in zip(made, like, strict=True):
                if one.shape != other.shape or one.dtype != other.dtype:
                    raise ValueError("a record has another shape")
        return made
    if isinstance(plain, dict) and "number" in plain:
        return float(plain["number"])
    if isinstance(plain, list):
        rows = [_value(x, None, arrays) for x in plain]
        return [tuple(row) if isinstance(row, list) else row for row in rows]
    return plain


def write_packed(path: PathLike, made_with: dict[str, Any], tracker: object) -> None:
    """Write a tracker, whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    arrays: Arrays = {}
    plain = packed(tracker, "tracker", arrays)
    text = json.dumps({"format": FORMAT, "made_with": made_with, "plain": plain})
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, json=np.frombuffer(text.encode(), np.uint8), **arrays)
    write_atomically(path, buffer.getvalue())


def read_packed(path: PathLike) -> tuple[dict[str, Any], Any, Arrays]:
    """Read what a tracker was made with, its plain data and its arrays.

    Raises
    ------
    InputError
        If it is no such file.
    """
    where = os.fspath(path)
    data = read_bytes(path, _LARGEST_FILE)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        document = json.loads(arrays.pop("json").tobytes().decode())
        if document["format"] != FORMAT:
            raise ValueError
        return document["made_with"], document["plain"], arrays
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile):
        raise InputError(where, "is no saved tracker, or is cut off", _MEND) from None
