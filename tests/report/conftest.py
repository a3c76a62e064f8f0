"""Small documents, and the reports made of them once for all tests."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import pytest

from bayes_asv.report.page import Page, report_page
from bayes_asv.report.render import html_report, pdf_report
from bayes_asv.report.schema import (
    DiagnoseDocument,
    EstimateDocument,
    ReportDocument,
    TrackDocument,
)
from bayes_asv.report.sections import DIAGNOSIS, ESTIMATE, TRACK
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table
from bayes_asv.report.svg import Panel, style
from tests.browser import browsing

Data = dict[str, Any]
Made = TypeVar("Made")
D = TypeVar("D")

DATA = Path(__file__).parent / "data"
KINDS = ("us", "si", "two_runs", "budget", "refused", "not_converged", "hostile")
HOSTILE = "<script>alert(1)</script> {{7*7}} #[7*7] $x$ & \"q\" 's' \x00\x1b[31m\u202eevil"


def data(kind: str) -> Data:
    """Read the data of an estimate, or make one from another."""
    if kind == "not_converged":
        document = data("us")
        document["verdict"] = kind
        document["diagnostics"].update(rhat_max=1.034, ess_bulk_min=212.0, ess_tail_min=140.0)
        document["warnings"] = ["the ensembles had not agreed after 7680 draws each"]
        return document
    if kind == "budget":
        document = data("us")
        document["width"] = json.loads((DATA / "width.json").read_text(encoding="utf-8"))
        return document
    if kind == "hostile":
        document = data("us")
        document["vehicle"]["name"] = HOSTILE
        document["vehicle"]["source"] = HOSTILE
        document["warnings"] = [HOSTILE, "<img src=x onerror=alert(1)>"]
        document["runs"].append(copy.deepcopy(document["runs"][0]))
        for n, run in enumerate(document["runs"]):
            run["source"] = f"{n}{HOSTILE}.csv"
            run["unit"] = f"$\\frac{{{n}}}</text><script>"
        document["fit_by_run"][0]["source"] = HOSTILE
        document["noise"][0]["source"] = HOSTILE
        for file in document["provenance"]["recordings"]:
            file.update(file=HOSTILE, sha256=HOSTILE)
        document["provenance"]["vehicle"]["file"] = HOSTILE
        document["provenance"]["packages"] = {"numpy": HOSTILE}
        document["parameters"]["c_f"]["label"] = HOSTILE
        document["known"]["m"]["label"] = HOSTILE
        return document
    read: Data = json.loads((DATA / f"{kind}.json").read_text(encoding="utf-8"))
    return read


def load(kind: str) -> EstimateDocument:
    """Return an estimate."""
    return EstimateDocument.model_validate(data(kind))


@contextmanager
def without_pictures() -> Iterator[None]:
    """Plot every figure and render none, which takes most of the time of a report."""
    from matplotlib.figure import Figure as Canvas

    def empty(_: Canvas, file: Any, **__: Any) -> None:
        file.write('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"></svg>')

    with patch.object(Canvas, "savefig", empty):
        yield


def blocks(document: ReportDocument) -> list[Block]:
    """Return texts, tables and figures of all sections."""
    with style():
        if isinstance(document, EstimateDocument):
            return _content(ESTIMATE, document)
        if isinstance(document, DiagnoseDocument):
            return _content(DIAGNOSIS, document)
        assert isinstance(document, TrackDocument)
        return _content(TRACK, document)


def _content(sections: tuple[Section[D], ...], document: D) -> list[Block]:
    return [block for section in sections for block in section.content(document)]


def figures(document: ReportDocument) -> dict[str, Figure]:
    """Return the figures that have panels, by key; see :func:`without_pictures`."""
    found = [block for block in blocks(document) if isinstance(block, Figure) and block.panels]
    return {figure.key: figure for figure in found}


def figures_of(section: Section[D], document: D) -> dict[str, Figure]:
    """Return the figures of one section that have panels, by key."""
    with style():
        found = [block for block in section.content(document) if isinstance(block, Figure)]
    return {figure.key: figure for figure in found if figure.panels}


def sections_of(page: Data) -> list[Data]:
    """Return the texts, tables and figures of a page: of the main report, then of the appendix."""
    found: list[Data] = list(page["sections"])
    for part in page["appendix"]:
        # what has the title of its part does not repeat it
        found += [one | {"title": one["title"] or part["title"]} for one in part["sections"]]
    return found


def panel_keys(page: Data) -> set[str]:
    """Return the keys of all pictures that a page asks for."""
    shown = [*sections_of(page), *([page["overview"]] if page["overview"] else [])]
    panels = {p["key"] for s in shown if s["kind"] == "figure" for p in s["panels"]}
    return panels | {card["gauge"] for card in page["cards"]}


def table(document: ReportDocument, title: str) -> Table | None:
    """Return the table of that title."""
    with without_pictures():
        found = [b for b in blocks(document) if isinstance(b, Table) and b.title == title]
    return found[0] if found else None


class _Once(dict[str, Made]):
    def __init__(self, make: Callable[[EstimateDocument], Made]) -> None:
        super().__init__()
        self.make = make

    def __missing__(self, kind: str) -> Made:
        self[kind] = self.make(load(kind))
        return self[kind]


class _Rendered(dict[str, Made]):
    def __init__(
        self,
        render: Callable[[EstimateDocument], Made],
        composed: dict[str, tuple[Page, dict[str, Panel]]],
    ) -> None:
        super().__init__()
        self.render, self.composed = render, composed

    def __missing__(self, kind: str) -> Made:
        with patch("bayes_asv.report.render.report_page", lambda _: self.composed[kind]):
            self[kind] = self.render(load(kind))
        return self[kind]


@pytest.fixture(scope="session")
def composed() -> dict[str, tuple[Page, dict[str, Panel]]]:
    """Page and pictures by kind of document; HTML and PDF are made of the same."""
    return _Once(report_page)


@pytest.fixture(scope="session")
def pages(composed: dict[str, tuple[Page, dict[str, Panel]]]) -> dict[str, str]:
    """HTML by kind of document."""
    return _Rendered(html_report, composed)


@pytest.fixture(scope="session")
def papers(composed: dict[str, tuple[Page, dict[str, Panel]]]) -> dict[str, bytes]:
    """PDF by kind of document."""
    return _Rendered(pdf_report, composed)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A browser without a window."""
    yield from browsing(tmp_path_factory.mktemp("browser"))
