"""A report as HTML or PDF, by the suffix of the file."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from importlib import resources
from pathlib import Path
from typing import Any, Final

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from bayes_asv.report.interactive import interactive_data
from bayes_asv.report.page import page_texts, report_page
from bayes_asv.report.schema import EstimateDocument, PageDocument
from bayes_asv.report.svg import themed

__all__ = ["check_suffix", "html_report", "interactive_report", "pdf_report", "write_report"]

_SUFFIXES: Final = (".html", ".htm", ".pdf")


def check_suffix(path: str | os.PathLike[str], *, interactive: bool = False) -> str:
    """Return the suffix of a report, or of an interactive page, in lower case.

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
    if interactive and suffix == ".pdf":
        raise InputError(os.fspath(path), "an interactive page is HTML", "end the name in .html")
    return suffix


def write_report(
    document: PageDocument, path: str | os.PathLike[str], *, interactive: bool = False
) -> None:
    """Write a report, HTML or PDF by the suffix of `path`, atomically.

    Parameters
    ----------
    document : EstimateDocument, DiagnoseDocument, TrackDocument, CompareDocument or FleetDocument
        An estimate may hold a diagnosis under ``diagnosis`` and a track under ``online``.
    path : str or os.PathLike
        Ends in ``.html`` or ``.pdf``. The same document gives the same bytes.
    interactive : bool
        Write the page on which the recordings of an estimate can be looked at closely.

    Raises
    ------
    InputError
        If the suffix is another one, the document is inconsistent or has no recordings to show, or
        the file cannot be written.
    """
    pdf = check_suffix(path, interactive=interactive) == ".pdf"
    if interactive and not (isinstance(document, EstimateDocument) and document.runs):
        raise InputError(
            os.fspath(path),
            "an interactive page shows the recordings of an estimate, and there is none",
            "make it from an estimate that was not refused",
        )
    try:
        if interactive:
            assert isinstance(document, EstimateDocument)
            data = interactive_report(document).encode("utf-8")
        else:
            data = pdf_report(document) if pdf else html_report(document).encode("utf-8")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as fault:
        raise InputError(
            os.fspath(path),
            f"the report cannot be made of this document ({type(fault).__name__}: {fault})",
            f"make it again with 'bayes-asv {document.schema_name.split('/')[1]} --json'",
        ) from fault
    write_atomically(path, data)


def _environment() -> Any:
    """Templates of HTML pages; text is escaped, as names of cars and files are foreign."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("bayes_asv.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def html_report(document: PageDocument) -> str:
    """Render a report as one HTML page without scripts and without external references."""
    from markupsafe import Markup

    page, pictures = report_page(document)
    # Pictures are our own markup; foreign text in them was escaped when they were drawn.
    drawn = {key: Markup(themed(picture.svg)) for key, picture in pictures.items()}
    text: str = _environment().get_template("report.html.j2").render(page=page, pictures=drawn)
    return text


def interactive_report(document: EstimateDocument) -> str:
    """Render the recordings of an estimate as one HTML page that needs nothing else.

    Its scripts are allowed by their hashes, so that foreign text cannot become one.
    """
    from markupsafe import Markup

    package = resources.files("bayes_asv")
    uplot = package.joinpath("live/static/uplot/uPlot.iife.min.js").read_text("utf-8").strip()
    script = package.joinpath("report/templates/interactive.js").read_text("utf-8").strip()
    style = package.joinpath("live/static/uplot/uPlot.min.css").read_text("utf-8")
    digests = [hashlib.sha256(one.encode("utf-8")).digest() for one in (uplot, script)]
    hashes = " ".join(f"'sha256-{base64.b64encode(one).decode()}'" for one in digests)
    data = json.dumps(interactive_data(document), separators=(",", ":"), allow_nan=False)
    text: str = (
        _environment()
        .get_template("interactive.html.j2")
        .render(
            page=page_texts(document),
            hashes=Markup(hashes),
            uplot=Markup(uplot),
            uplot_style=Markup(style),
            script=Markup(script),
            # No text in it ends the element that holds it.
            data=Markup(data.replace("<", "\\u003c")),
        )
    )
    return text


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
