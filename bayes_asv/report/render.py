"""A report as HTML or PDF, by the suffix of the file."""

from __future__ import annotations

import json
import os
from importlib import resources
from pathlib import Path
from typing import Any, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from bayes_asv.report.page import report_page
from bayes_asv.report.schema import PageDocument
from bayes_asv.report.svg import themed

__all__ = ["check_suffix", "html_report", "pdf_report", "write_report"]

_SUFFIXES: Final = (".html", ".htm", ".pdf")


def check_suffix(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a report in lower case.

    Raises
    ------
    InputError
        If a report cannot be written with it.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(
            os.fspath(path), "a report is HTML or PDF", "end the name in .html or .pdf"
        )
    return suffix


def write_report(document: PageDocument, path: str | os.PathLike[str]) -> None:
    """Write a report, HTML or PDF by the suffix of `path`, atomically.

    Parameters
    ----------
    document : EstimateDocument, DiagnoseDocument, TrackDocument or FleetDocument
        An estimate may hold a diagnosis under ``diagnosis`` and a track under ``online``.
    path : str or os.PathLike
        Ends in ``.html`` or ``.pdf``. The same document gives the same bytes.

    Raises
    ------
    InputError
        If the suffix is another one, the document is inconsistent, or the file cannot be written.
    """
    suffix = check_suffix(path)
    try:
        pdf = suffix == ".pdf"
        data = pdf_report(document) if pdf else html_report(document).encode("utf-8")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as fault:
        raise InputError(
            os.fspath(path),
            f"the report cannot be made of this document ({type(fault).__name__}: {fault})",
            f"make it again with 'bayes-asv {document.schema_name.split('/')[1]} --json'",
        ) from fault
    write_atomically(path, data)


def html_report(document: PageDocument) -> str:
    """Render a report as one HTML page without scripts and without external references."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    page, pictures = report_page(document)
    environment = Environment(
        loader=PackageLoader("bayes_asv.report", "templates"),
        autoescape=True,  # names of cars and files are foreign text
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # Pictures are our own markup; foreign text in them was escaped when they were drawn.
    drawn = {key: Markup(themed(picture.svg)) for key, picture in pictures.items()}
    return environment.get_template("report.html.j2").render(page=page, pictures=drawn)


def pdf_report(document: PageDocument) -> bytes:
    """Render a report as PDF with typst: A4, or US letter for a vehicle in US units."""
    import matplotlib as mpl
    import typst

    page, pictures = report_page(document)
    template = resources.files("bayes_asv.report").joinpath("templates/report.typ").read_bytes()
    # Foreign text is data beside the template and never markup.
    data = {
        "page": json.dumps(page),
        "pictures": json.dumps({key: picture.svg for key, picture in pictures.items()}),
    }
    fonts = os.path.join(mpl.get_data_path(), "fonts", "ttf")
    # typst's type stubs want template and font folders to be of one type.
    compile_template: Any = typst.compile
    pdf: bytes = compile_template(
        template,
        format="pdf",
        sys_inputs=data,
        font_paths=[fonts],
        ignore_system_fonts=True,
        timestamp=0,  # the same document gives the same bytes on any day
    )
    return pdf
