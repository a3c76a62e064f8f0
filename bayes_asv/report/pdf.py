"""The report as PDF, set by typst without anything from the machine it runs on."""

from __future__ import annotations

import json
import os
from importlib import resources
from typing import Any

from bayes_asv.report.content import content

__all__ = ["pdf_report"]

Document = dict[str, Any]


def pdf_report(document: Document) -> bytes:
    """Write an estimate or a diagnosis as PDF: A4, or US letter for a car in US units.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1`` or ``bayes_asv/diagnose/1``.

    Returns
    -------
    bytes
        The file. The same document gives the same bytes.
    """
    import matplotlib as mpl
    import typst

    page, pictures = content(document)
    template = resources.files("bayes_asv.report").joinpath("templates/report.typ").read_bytes()
    # What strangers wrote travels as data beside the template, so it never is markup.
    data = {
        "page": json.dumps(page),
        "pictures": json.dumps({key: picture.svg for key, picture in pictures.items()}),
    }
    fonts = os.path.join(mpl.get_data_path(), "fonts", "ttf")
    # Its types want template and font folders to be of one type, which they are not.
    compile_template: Any = typst.compile
    made: bytes = compile_template(
        template,
        format="pdf",
        sys_inputs=data,
        font_paths=[fonts],
        ignore_system_fonts=True,
        timestamp=0,  # the day of printing is no part of an answer
    )
    return made
