import re
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.report.page import Page
from bayes_asv.report.render import pdf_report, write_report
from bayes_asv.report.sections.verdict import headline, next_steps
from bayes_asv.report.svg import Panel
from bayes_asv.report.words import number
from tests.report.conftest import KINDS, load

pymupdf = pytest.importorskip("pymupdf")


def opened(paper: bytes) -> Any:
    return pymupdf.open(stream=paper, filetype="pdf")


def text_of(paper: bytes) -> str:
    """Return the words on all pages, with plain spaces and without the footers' breaks."""
    with opened(paper) as file:
        words = " ".join(page.get_text() for page in file)
    return " ".join(words.replace("\u00a0", " ").split())


@pytest.mark.parametrize("kind", KINDS)
def test_pdf_opens_and_says_the_verdict_on_page_one(papers: dict[str, bytes], kind: str) -> None:
    with opened(papers[kind]) as file:
        first = " ".join(file[0].get_text().replace("\u00a0", " ").split())
        assert headline(load(kind)) in first
        assert 1 <= file.page_count <= 9
        for page in file:
            inside = pymupdf.Rect(20, 15, page.rect.x1 - 20, page.rect.y1 - 15)
            for x0, y0, x1, y1, *_ in page.get_text("words"):
                assert inside.contains(pymupdf.Rect(x0, y0, x1, y1))


@pytest.mark.parametrize("kind", ["us", "si", "two_runs"])
def test_numbers_are_those_of_the_document(papers: dict[str, bytes], kind: str) -> None:
    document, text = load(kind), text_of(papers[kind])
    for p in document.parameters.values():
        for value in (p.mean, p.sd, *p.eti95):
            assert number(value, p.sd) in text
        assert number(p.nominal) in text
        assert p.si is not None
        assert number(p.si.mean, p.si.sd) in text
    for file in document.provenance.recordings:
        assert file.sha256 in text.replace(" ", "")
    for step in next_steps(document):
        assert step in text


@pytest.mark.parametrize(
    ("kind", "size"), [("us", (612, 792)), ("refused", (612, 792)), ("si", (595, 842))]
)
def test_paper_follows_the_units(
    papers: dict[str, bytes], kind: str, size: tuple[int, int]
) -> None:
    with opened(papers[kind]) as file:
        assert (round(file[0].rect.width), round(file[0].rect.height)) == size


def test_hostile_text_is_no_markup(papers: dict[str, bytes]) -> None:
    text = text_of(papers["hostile"])
    assert "<script>alert(1)</script>" in text
    assert "{{7*7}}" in text
    assert "#[7*7]" in text
    assert "$x$" in text
    assert b"/JavaScript" not in papers["hostile"]
    assert b"/URI" not in papers["hostile"]


def test_refused_report_is_one_page_without_figures(papers: dict[str, bytes]) -> None:
    with opened(papers["refused"]) as file:
        assert file.page_count == 1
    text = text_of(papers["refused"])
    assert "What to do instead" in text
    for step in next_steps(load("refused")):
        assert step in text


def test_report_of_what_did_not_converge_warns(papers: dict[str, bytes]) -> None:
    text = text_of(papers["not_converged"])
    assert "Do not quote them" in text
    assert "virtually certain" not in text


def test_html_and_pdf_say_the_same_in_the_same_order(
    pages: dict[str, str], papers: dict[str, bytes]
) -> None:
    titles = re.findall(r"<h[23]>([^<]*)</h[23]>", pages["us"])
    text, last = text_of(papers["us"]), -1
    for title in titles:
        if title == "What limits the answer":
            continue  # it stands beside, and a line is read across
        found = text.find(title, last + 1)
        assert found > last, title
        last = found


def test_figures_are_drawn_and_fonts_embedded(papers: dict[str, bytes]) -> None:
    with opened(papers["us"]) as file:
        assert sum(len(page.get_drawings()) for page in file) > 500
        fonts = {font[3] for page in file for font in page.get_fonts()}
    assert fonts
    assert all("DejaVuSans" in font for font in fonts)


def test_same_page_and_pictures_same_bytes(
    composed: dict[str, tuple[Page, dict[str, Panel]]],
    papers: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That the same document has the same page and pictures is asked of its HTML."""
    monkeypatch.setattr("bayes_asv.report.render.report_page", lambda _: composed["us"])
    assert pdf_report(load("us")) == papers["us"]


def test_writing(tmp_path: Path, papers: dict[str, bytes]) -> None:
    write_report(load("refused"), tmp_path / "r.PDF")
    assert (tmp_path / "r.PDF").read_bytes() == papers["refused"]
