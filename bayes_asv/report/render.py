"""Writing a report to a file, HTML or PDF by its suffix."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically

__all__ = ["check_suffix", "write_report"]

Document = dict[str, Any]

_KINDS: Final = {"bayes_asv/diagnose/1": "diagnose", "bayes_asv/track/1": "track"}
_SUFFIXES: Final = (".html", ".htm", ".pdf")
_NEEDED: Final = {
    "estimate": ("verdict", "reasons", "warnings", "parameters"),
    "diagnose": ("verdict", "reasons", "warnings", "effects", "gap", "unexplained"),
    "track": ("verdict", "reasons", "warnings", "parameters", "consistency"),
}


def check_suffix(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a report in small letters.

    Raises
    ------
    InputError
        If it is not one that a report can be written with.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(
            os.fspath(path), "a report is HTML or PDF", "end the name in .html or .pdf"
        )
    return suffix


def write_report(document: Document, path: str | os.PathLike[str]) -> None:
    """Write a report, HTML or PDF by the suffix of `path`, whole or not at all.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``, ``bayes_asv/diagnose/1`` or ``bayes_asv/track/1``, as
        made by :mod:`bayes_asv.report.document`, :mod:`bayes_asv.report.diagnose_document` or
        :mod:`bayes_asv.report.track_document`, or read from its JSON; an estimate may hold a
        diagnosis under ``diagnosis`` and a track under ``online``.
    path : str or os.PathLike
        Ends in ``.html`` or ``.pdf``. The same document gives the same bytes.

    Raises
    ------
    InputError
        If the suffix is another one, the document is none of them, or the file cannot be
        written.
    """
    suffix = check_suffix(path)
    kind = _KINDS.get(document.get("schema", ""), "estimate")
    missing = [key for key in _NEEDED[kind] if key not in document]
    if missing:
        raise InputError(
            os.fspath(path),
            f"the document to be told has no '{missing[0]}'",
            f"give what 'bayes-asv {kind} --json' wrote",
        )
    try:
        if suffix == ".pdf":
            from bayes_asv.report.pdf import pdf_report

            data = pdf_report(document)
        else:
            from bayes_asv.report.html import html_report

            data = html_report(document).encode("utf-8")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as fault:
        raise InputError(
            os.fspath(path),
            f"the document to be told is broken ({type(fault).__name__}: {fault})",
            f"make it again with 'bayes-asv {kind} --json'",
        ) from fault
    write_atomically(path, data)
