"""Checkpoints: a tracker saved to a file and restored, without any effect on its results.

The file is a NumPy archive without pickles: arrays by name, and one JSON text with numbers and with
the settings of the tracker.  Everything read is checked before it is used.
"""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, read_bytes, write_atomically
from bayes_asv.filters.ukf_state import ALL, State, Steps
from bayes_asv.filters.vector_code import LANES
from bayes_asv.tracking.filter import WHITE_SHARE_PRIOR
from bayes_asv.tracking.streaming_timeline import StreamingTimeline

__all__ = ["FORMAT", "read_checkpoint", "restore", "write_checkpoint"]

FORMAT: Final = "bayes_asv/tracker/1"

_MAX_FILE_SIZE: Final = 200_000_000
_FIX: Final = "give a file that a tracker's save() wrote"

Arrays = dict[str, NDArray[Any]]

# Attributes that change while a tracker runs, by class: name in the file -> name of the attribute.
# The names in the file are part of the format and stay when an attribute is renamed.
_FIELDS: Final[dict[str, dict[str, str]]] = {
    "Tracker": {
        "_layout": "_timeline",
        "_filter": "_filter",
        "watch": "consistency",
        "fitness": "data_checks",
        "_tail": "_recent",
        "_tail_end": "_step_count",
        "_last_fault": "_last_fault",
    },
    "StreamingTimeline": {
        "_equalisers": "_matchers",
        "_wheels": "_wheels",
        "_origin": "_origin",
        "_last_stamp": "_last_stamp",
        "_now": "_end",
        "_count": "_step_count",
        "_stamp": "_stamp",
        "_when": "_time",
        "_reading": "_reading",
        "_kind": "_kind",
        "_step": "_step",
        "_done": "_scheduled",
        "_still": "_still",
        "_use": "_use",
        "_stillness": "_stillness",
    },
    "_Stillness": {"_before": "_before"},
    "_BandwidthMatcher": {"time": "time", "signal": "signal", "slow": "filtered"},
    "StreamingSpline": {
        "_waiting": "_held",
        "_time": "_time",
        "_value": "_value",
        "_reach": "_excursion",
        "_opens": "_starts",
        "_upper": "_superdiagonal",
        "_right": "_rhs",
        "_missed": "_errors",
        "_curve": "_coefficients",
        "_deviation": "_sd",
        "_settled": "_final",
        "_newest": "_newest",
        "_complete": "_finished",
    },
    "OnlineFilter": {
        "state": "state",
        "looking_back": "relinearizing",
        "resets": "resets",
        "time": "time",
        "_patience": "_fault_duration",
        "_calm": "_settled_passes",
        "_looks": "_passes",
        "_known": "_window_start",
        "_held": "_window_steps",
    },
    "ConsistencyMonitor": {
        "nis": "nis",
        "readings": "readings",
        "rows": "rows",
        "rows_consistent": "rows_consistent",
        "rows_well": "rows_since_fault",
        "worst_colour": "max_box_pierce",
        "worst_level": "max_noise_factor",
        "products": "lagged_products",
        "_past": "_history",
        "_sums": "_sums",
        "_since": "_rows_since_recompute",
        "_doubt": "_flags",
    },
    "DataChecks": {
        "rows": "rows",
        "first": "first",
        "last": "last",
        "present": "present",
        "clipped": "clipped",
        "total": "total",
        "squares": "squares",
    },
}
# Names that files of earlier versions lack.
_ADDED: Final = ("_last_fault", "_still", "_use", "_stillness")
_RECORDS: Final[dict[str, Callable[..., Any]]] = {"State": State, "Steps": Steps}


def _pack(value: object, name: str, arrays: Arrays) -> Any:
    """Convert a value to plain data; arrays are added to ``arrays``.

    Parameters
    ----------
    value : object
        An instance of a class of ``_FIELDS``, a record of arrays, an array, a list, or plain data.
    name : str
        Path to the value, for the names of arrays.
    arrays : dict
        Added to in place.
    """
    kind = type(value).__name__
    if kind in _FIELDS:
        return {
            stored: _pack(getattr(value, attribute), f"{name}.{stored}", arrays)
            for stored, attribute in _FIELDS[kind].items()
        }
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple) and kind in _RECORDS:
        return {
            "record": kind,
            "parts": [_pack(x, f"{name}.{k}", arrays) for k, x in enumerate(value)],
        }
    if isinstance(value, (list, tuple)):
        return [_pack(x, f"{name}.{k}", arrays) for k, x in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        return {"number": repr(value)}
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{name} is a {kind}, which cannot be saved")


def restore(target: Any, plain: Any, arrays: Arrays) -> None:
    """Restore a saved object into a new one that was made with the same settings.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the data do not match the object.
    """
    for stored, attribute in _FIELDS[type(target).__name__].items():
        if stored in _ADDED and stored not in plain:
            continue
        current, saved = getattr(target, attribute), plain[stored]
        if type(current).__name__ in _FIELDS:
            restore(current, saved, arrays)
        elif isinstance(current, list) and any(type(x).__name__ in _FIELDS for x in current):
            if len(current) != len(saved):
                raise ValueError(f"{stored} has another length")
            for part, saved_part in zip(current, saved, strict=True):
                if part is not None:
                    restore(part, saved_part, arrays)
        else:
            setattr(target, attribute, _unpack(saved, current, arrays))
    if isinstance(target, StreamingTimeline):
        target.complete()


def _unpack(plain: Any, current: Any, arrays: Arrays) -> Any:
    """Rebuild a value; types and shapes have to match the value that it replaces."""
    if isinstance(plain, dict) and "array" in plain:
        array = arrays[plain["array"]]
        if isinstance(current, np.ndarray) and (
            array.dtype != current.dtype
            or array.ndim != current.ndim
            or array.shape[1:] != current.shape[1:]
        ):
            raise ValueError(f"{plain['array']} has another shape")
        return array.copy()
    if isinstance(plain, dict) and "record" in plain:
        parts = [_unpack(x, None, arrays) for x in plain["parts"]]
        record = _RECORDS[plain["record"]](*_completed(plain["record"], parts))
        if isinstance(current, tuple):
            for new, old in zip(record, current, strict=True):
                if new.shape != old.shape or new.dtype != old.dtype:
                    raise ValueError("a record has another shape")
        return record
    if isinstance(plain, dict) and "number" in plain:
        return float(plain["number"])
    if isinstance(plain, list):
        values = [_unpack(x, None, arrays) for x in plain]
        return [tuple(value) if isinstance(value, list) else value for value in values]
    return plain


def _completed(record: str, parts: list[Any]) -> list[Any]:
    """Add the parts that a record of an earlier version, without force laws, lacks."""
    if record == "Steps" and len(parts) == 6:
        steps, elements = parts[1].shape[:2]
        parts += [np.zeros((steps, 2, elements)), np.full(steps, ALL, np.int8)]
    elif record == "State" and len(parts) == 10:
        parts[7] = np.concatenate([parts[7], [0.0, *WHITE_SHARE_PRIOR]])
        parts.append(_NO_FORCES)
    elif record == "State" and parts[10].size == 0:
        parts[10] = _NO_FORCES
    return parts


_NO_FORCES = np.zeros((0, 2, 0, LANES))


def write_checkpoint(path: PathLike, settings: dict[str, Any], tracker: object) -> None:
    """Write a tracker atomically.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    settings : dict
        Plain data that must agree when the tracker is restored.
    tracker : Tracker
        The tracker.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    arrays: Arrays = {}
    plain = _pack(tracker, "tracker", arrays)
    text = json.dumps({"format": FORMAT, "made_with": settings, "plain": plain})
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, json=np.frombuffer(text.encode(), np.uint8), **arrays)
    write_atomically(path, buffer.getvalue())


def read_checkpoint(path: PathLike) -> tuple[dict[str, Any], Any, Arrays]:
    """Read settings, plain data and arrays of a saved tracker.

    Raises
    ------
    InputError
        If the file is not a checkpoint.
    """
    where = os.fspath(path)
    data = read_bytes(path, _MAX_FILE_SIZE)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        document = json.loads(arrays.pop("json").tobytes().decode())
        if document["format"] != FORMAT:
            raise ValueError
        return document["made_with"], document["plain"], arrays
    except Exception:  # NumPy, zipfile and the tokenizer raise a dozen kinds for damaged bytes
        raise InputError(where, "is no saved tracker, or is truncated", _FIX) from None
