"""Writing a report to a file, HTML or PDF by its suffix."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

from bayes_asv.errors import InputError
from bayes_asv.files import write_whole

__all__ = ["check_suffix", "write_report"]

Document = dict[str, Any]

_SUFFIXES: Final = (".html", ".htm", ".pdf")
_NEEDED: Final = ("verdict", "reasons", "warnings", "parameters")


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
        Schema ``bayes_asv/estimate/1``, as made by
        :func:`bayes_asv.report.document.estimate_document` or read from its JSON.
    path : str or os.PathLike
        Ends in ``.html`` or ``.pdf``. The same document gives the same bytes.

    Raises
    ------
    InputError
        If the suffix is another one, the document is not an estimate, or the file cannot be
        written.
    """
    suffix = check_suffix(path)
    missing = [key for key in _NEEDED if key not in document]
    if missing:
        raise InputError(
            os.fspath(path),
            f"the document to be told has no '{missing[0]}'",
            "give what 'bayes-asv estimate --json' wrote",
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
            "make it again with 'bayes-asv estimate --json'",
        ) from fault
    write_whole(path, data)
