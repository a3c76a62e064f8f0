"""The report as one HTML file that needs nothing else."""

from __future__ import annotations

from typing import Any

from bayes_asv.report.content import content
from bayes_asv.report.svg import themed

__all__ = ["html_report"]

Document = dict[str, Any]


def html_report(document: Document) -> str:
    """Write an estimate or a diagnosis as one self-contained page.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1`` or ``bayes_asv/diagnose/1``.

    Returns
    -------
    str
        HTML without scripts and without references to anything outside. The same document gives
        the same text.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    page, pictures = content(document)
    environment = Environment(
        loader=PackageLoader("bayes_asv.report", "templates"),
        autoescape=True,  # names of cars and files come from strangers
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # Pictures are our own markup; foreign text in them was escaped where they were drawn.
    drawn = {key: Markup(themed(p.svg)) for key, p in pictures.items()}
    return environment.get_template("report.html.j2").render(page=page, pictures=drawn)
