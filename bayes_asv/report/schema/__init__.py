"""Typed schema of the documents that ``--json`` writes: the same classes write and read them.

``python -m bayes_asv.report.schema`` writes their JSON Schema to ``docs/schema``.  Keys and their
meaning are described in ``docs/interfaces.md``.
"""

from __future__ import annotations

import json
import os
from typing import Any, Final

from pydantic import ValidationError

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, decode, read_bytes
from bayes_asv.report.schema.compare import CompareDocument
from bayes_asv.report.schema.diagnose import DiagnoseDocument
from bayes_asv.report.schema.estimate import EstimateDocument
from bayes_asv.report.schema.fleet import FleetDocument
from bayes_asv.report.schema.parts import Model, half_car
from bayes_asv.report.schema.track import TrackDocument, WatchDocument

__all__ = [
    "DOCUMENTS",
    "CompareDocument",
    "DiagnoseDocument",
    "EstimateDocument",
    "FleetDocument",
    "PageDocument",
    "ReportDocument",
    "TrackDocument",
    "WatchDocument",
    "half_car",
    "read_saved",
]

ReportDocument = EstimateDocument | DiagnoseDocument | TrackDocument | CompareDocument
"""Documents that are saved and read again for a report."""

PageDocument = ReportDocument | FleetDocument
"""Documents that a page can be made of."""

DOCUMENTS: Final[dict[str, type[Model]]] = {
    "bayes_asv/estimate/1": EstimateDocument,
    "bayes_asv/diagnose/1": DiagnoseDocument,
    "bayes_asv/track/1": TrackDocument,
    "bayes_asv/watch/1": WatchDocument,
    "bayes_asv/fleet/1": FleetDocument,
    "bayes_asv/compare/1": CompareDocument,
}
"""Class of every schema by its name."""

_REPORTED: Final[dict[str, type[ReportDocument]]] = {
    "bayes_asv/estimate/1": EstimateDocument,
    "bayes_asv/diagnose/1": DiagnoseDocument,
    "bayes_asv/track/1": TrackDocument,
    "bayes_asv/compare/1": CompareDocument,
}
_FIX: Final = (
    "give a file that 'bayes-asv estimate --json', 'bayes-asv diagnose --json', "
    "'bayes-asv track --json' or 'bayes-asv compare --json' wrote"
)
_MAX_BYTES: Final = 200_000_000
_ROLL: Final = "bayes_asv/estimate_roll/1"


def read_saved(path: PathLike) -> ReportDocument:
    """Read a document that ``estimate``, ``diagnose``, ``track`` or ``compare`` wrote as JSON.

    Parameters
    ----------
    path : str or os.PathLike
        The file, which may come from anywhere: shape, size and consistency are checked.

    Returns
    -------
    EstimateDocument, DiagnoseDocument, TrackDocument or CompareDocument
        Keys of later versions are kept.  An estimate of the roll car of an earlier version, which
        had a schema of its own, ``bayes_asv/estimate_roll/1``, is converted.

    Raises
    ------
    InputError
        One line with the file, the key and the fix, if the file cannot be read, is cut off, is of
        another schema or holds an invalid value.
    """
    where = os.fspath(path)
    text = decode(read_bytes(path, _MAX_BYTES), where)
    try:
        data = json.loads(text, parse_constant=_reject_constant)
    except json.JSONDecodeError as fault:
        end = "" if text.rstrip().endswith("}") else " (it may be cut off)"
        raise InputError(f"{where}:{fault.lineno}", f"is not JSON{end}", _FIX) from None
    except (ValueError, RecursionError):
        raise InputError(where, "is not JSON", _FIX) from None
    name = data.get("schema") if isinstance(data, dict) else None
    if name == _ROLL:
        data, name = _converted(data), "bayes_asv/estimate/1"
    schema = _REPORTED.get(name) if isinstance(name, str) else None
    if schema is None:
        known = " or ".join(_REPORTED)
        what = f"is of schema {str(name)[:60]!r}, not {known}" if name else "is no estimate"
        raise InputError(where, what, _FIX)
    try:
        return schema.model_validate(data)
    except ValidationError as fault:
        first = fault.errors(include_url=False, include_input=False, include_context=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        what = first["msg"].removeprefix("Value error, ")
        what = what[:1].lower() + what[1:]
        raise InputError(f"{where}: {key}" if key else where, what, _FIX) from None


def _converted(data: dict[str, Any]) -> dict[str, Any]:
    """Write the data of ``bayes_asv/estimate_roll/1`` as those of ``bayes_asv/estimate/1``."""
    files = data.get("recordings")
    if isinstance(files, list):
        known = [file for file in files if isinstance(file, dict)]
        files = [{"file": f.get("source", ""), "sha256": f.get("sha256", "")} for f in known]
    elements = {
        f"{axle}_{side}": {
            "axle": axle, "side": side,
            "damping": f"c_{axle[0]}{side[0]}", "spring": f"k_{axle[0]}{side[0]}",
        }
        for axle in ("front", "rear")
        for side in ("left", "right")
    }  # fmt: skip
    kept = {key: value for key, value in data.items() if key != "recordings"}
    return {
        **kept, "schema": "bayes_asv/estimate/1", "car": "roll", "elements": elements,
        "fit": {}, "provenance": {"recordings": files or []},
    }  # fmt: skip


def _reject_constant(name: str) -> float:
    raise ValueError(name)  # NaN and Infinity are not JSON
