"""Reading a saved document: what comes from a file is checked before anything is told from it.

A document may be cut off, come from another program or be made to do harm. What the report
counts on is checked by shape, size and sense in :mod:`bayes_asv.report.saved_document`,
:mod:`bayes_asv.report.saved_diagnosis` and :mod:`bayes_asv.report.saved_track`.
"""

from __future__ import annotations

import json
import os
from typing import Any, Final

from pydantic import BaseModel, ValidationError

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, decode, read_bytes
from bayes_asv.report.saved_diagnosis import SavedDiagnosis
from bayes_asv.report.saved_document import SavedDocument
from bayes_asv.report.saved_track import SavedTrack

__all__ = ["read_saved"]

_SCHEMAS: Final[dict[str, type[BaseModel]]] = {
    "bayes_asv/estimate/1": SavedDocument,
    "bayes_asv/diagnose/1": SavedDiagnosis,
    "bayes_asv/track/1": SavedTrack,
}
_MEND: Final = (
    "give a file that 'bayes-asv estimate --json', 'bayes-asv diagnose --json' or "
    "'bayes-asv track --json' wrote"
)
_LARGEST_FILE: Final = 200_000_000


def read_saved(path: PathLike) -> dict[str, Any]:
    """Read a document that ``estimate``, ``diagnose`` or ``track`` wrote with ``--json``.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    dict
        Schema ``bayes_asv/estimate/1``, ``diagnose/1`` or ``track/1``, as plain data.

    Raises
    ------
    InputError
        One line with the file, the key and the mend: unreadable, cut off, of another schema, or
        holding what it cannot hold.
    """
    where = os.fspath(path)
    text = decode(read_bytes(path, _LARGEST_FILE), where)
    try:
        document = json.loads(text, parse_constant=_no_constant)
    except json.JSONDecodeError as fault:
        end = "" if text.rstrip().endswith("}") else " (it may be cut off)"
        raise InputError(f"{where}:{fault.lineno}", f"is not JSON{end}", _MEND) from None
    except (ValueError, RecursionError):
        raise InputError(where, "is not JSON", _MEND) from None
    said = document.get("schema") if isinstance(document, dict) else None
    checked = _SCHEMAS.get(said) if isinstance(said, str) else None
    if checked is None:
        known = " or ".join(_SCHEMAS)
        what = f"is of schema {str(said)[:60]!r}, not {known}" if said else "is no estimate"
        raise InputError(where, what, _MEND)
    try:
        checked.model_validate(document)
    except ValidationError as fault:
        first = fault.errors(include_url=False, include_input=False, include_context=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        what = first["msg"].removeprefix("Value error, ")
        what = what[:1].lower() + what[1:]
        raise InputError(f"{where}: {key}" if key else where, what, _MEND) from None
    assert isinstance(document, dict)
    return document


def _no_constant(name: str) -> float:
    raise ValueError(name)  # NaN and Infinity are not JSON
