import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.page import Page, limits
from bayes_asv.report.render import html_report, write_report
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.sections.verdict import headline, next_steps
from bayes_asv.report.svg import Panel
from bayes_asv.report.words import number
from tests.report.conftest import KINDS, data, load, panel_keys

Attributes = list[tuple[str, str | None]]
VOID = {"meta", "link", "br", "img", "hr", "input"}


def text_of(page: str) -> str:
    """Return what a reader sees, with plain spaces."""
    bare = re.sub(r"<(style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    words = unescape(re.sub(r"<[^>]*>", " ", bare)).replace("\u00a0", " ")
    return " ".join(words.split())


class Checker(HTMLParser):
    """Collects ids and tags, and whether tags close in order."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str | None] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.attributes: Attributes = []

    def handle_starttag(self, tag: str, attrs: Attributes) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Attributes) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize("kind", KINDS)
def test_page_is_whole_and_needs_nothing(pages: dict[str, str], kind: str) -> None:
    page = pages[kind]
    checker = Checker()
    checker.feed(page)
    assert checker.open == []
    assert len(checker.ids) == len(set(checker.ids))
    assert "script" not in checker.tags
    assert "iframe" not in checker.tags
    for name, value in checker.attributes:
        assert not name.startswith("on")
        if name in ("href", "src", "xlink:href"):
            assert value is not None
            assert value.startswith(("#", "data:"))
        if "http" in (value or ""):
            assert name.startswith("xmlns")
    assert "url(http" not in page
    assert "@import" not in page


def test_hostile_text_is_shown_and_not_run(pages: dict[str, str]) -> None:
    page = pages["hostile"]
    assert "<script" not in page
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy[1] == "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    assert "<img" not in page
    assert "\x1b" not in page
    assert "\x00" not in page
    assert "\u202e" not in page
    text = text_of(page)
    assert '<script>alert(1)</script> {{7*7}} #[7*7] $x$ & "q"' in text
    assert "<img src=x onerror=alert(1)>" in text
    assert "{{7*7}}" in text


@pytest.mark.parametrize("kind", ["us", "si", "two_runs"])
def test_numbers_are_those_of_the_document(pages: dict[str, str], kind: str) -> None:
    document, text = load(kind), text_of(pages[kind])
    assert headline(document) in text
    for p in document.parameters.values():
        for shown in (p, p.si):
            assert shown is not None
            for value in (shown.mean, shown.sd, *shown.eti95):
                assert number(value, shown.sd) in text
            assert number(shown.nominal) in text
    for file in document.provenance.recordings:
        assert file.file in text
        assert file.sha256 in text
    for known in document.known.values():
        if known.posterior is not None:
            assert number(known.posterior.mean, known.posterior.sd) in text
    for step in next_steps(document):
        assert step in text
    assert f"{document.diagnostics.rhat_max:.3f}" in text


def test_us_report_shows_both_systems_and_si_report_one(pages: dict[str, str]) -> None:
    us, si = text_of(pages["us"]), text_of(pages["si"])
    assert "Parameters, in SI units" in us
    assert "lbf·s/in" in us
    assert "N·s/m" in us
    assert "in SI units" not in si
    assert "lbf" not in si


def test_refused_report_says_why_and_what_to_do_without_empty_figures(
    pages: dict[str, str],
) -> None:
    page, document = pages["refused"], load("refused")
    text = text_of(page)
    assert "No answer: the suspension parameters cannot be determined from this" in text
    assert "What to do instead" in text
    assert "The front wheel hardly moved in stops.csv (0.07 m/s² rms)." in text
    for step in next_steps(document):
        assert step in text
    assert "<figure" not in page
    assert "<svg" not in page
    assert len(page) < 20_000


def test_report_of_what_did_not_converge_warns_first(pages: dict[str, str]) -> None:
    text = text_of(pages["not_converged"])
    assert "the sampling did not converge" in text
    assert "Do not quote them" in text
    assert "virtually certain" not in text
    assert text.index("Do not quote") < text.index("Front damping rate")
    assert "Parameters, not to be relied on" in text


def test_several_runs_are_told_apart(pages: dict[str, str]) -> None:
    text = text_of(pages["two_runs"])
    for source in ("stops.csv", "bump.csv"):
        assert f"Motion and residuals, {source}" in text
        assert f"Front, {source}" in text
    assert "All together" in text


def test_least_document_makes_a_report() -> None:
    keep = ("schema", "verdict", "reasons", "warnings", "parameters", "diagnostics", "fit",
            "seconds", "version", "seed")  # fmt: skip
    least = {key: data("us")[key] for key in keep}
    for p in least["parameters"].values():
        del p["si"], p["label"]
    document = EstimateDocument.model_validate(least)
    text = text_of(html_report(document))
    assert headline(document) in text
    assert "unnamed vehicle" in text


def test_limits_name_a_stop_that_was_reached_and_residuals_with_a_pattern() -> None:
    document = load("us")
    assert document.vehicle.travel is not None
    document.vehicle.travel.rear_bump = 1.5
    document.runs[0].chassis["front_chassis"].whiteness_p = 1e-4
    found = " ".join(limits(document))
    assert "The rear suspension reached its bump limit in stops.csv" in found
    assert "The front residuals of stops.csv are not white (p < 0.001)" in found


def test_a_page_is_plain_data_and_names_its_pictures(
    composed: dict[str, tuple[Page, dict[str, Panel]]],
) -> None:
    import json

    page, pictures = composed["two_runs"]
    assert json.loads(json.dumps(page)) == page
    assert panel_keys(page) == set(pictures)


def test_same_document_same_page(pages: dict[str, str]) -> None:
    assert html_report(load("us")) == pages["us"]


@pytest.mark.parametrize("name", ["r.html", "r.HTM"])
def test_writing(tmp_path: Path, pages: dict[str, str], name: str) -> None:
    write_report(load("refused"), tmp_path / name)
    assert (tmp_path / name).read_bytes() == pages["refused"].encode()
    assert [p.name for p in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["r.docx", "r", "html"])
def test_another_suffix_is_refused_with_the_fix(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"end the name in \.html or \.pdf"):
        write_report(load("refused"), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="make the folder first"):
        write_report(load("refused"), tmp_path / "no" / "r.html")


def test_an_inconsistent_document_leaves_the_old_report(tmp_path: Path) -> None:
    (tmp_path / "r.html").write_text("old")
    document = load("us")
    document.runs[0].wheels.time = []
    with pytest.raises(InputError, match="cannot be made of this document") as caught:
        write_report(document, tmp_path / "r.html")
    assert "bayes-asv estimate --json" in str(caught.value)
    assert (tmp_path / "r.html").read_text() == "old"


@pytest.mark.parametrize("width", [390, 1100])
@pytest.mark.parametrize("kind", ["us", "two_runs", "refused", "not_converged", "hostile"])
def test_browser_shows_the_page_without_a_fault(
    browser: Any, pages: dict[str, str], tmp_path: Path, kind: str, width: int
) -> None:
    file = tmp_path / "report.html"
    file.write_text(pages[kind], encoding="utf-8")
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 850, "deviceScaleFactor": 1, "mobile": width < 500},
    )
    browser.get(file.as_uri())
    assert browser.get_log("browser") == []
    inner, scroll = browser.execute_script(
        "return [document.documentElement.clientWidth, document.documentElement.scrollWidth]"
    )
    assert width - 20 <= inner <= width  # a scroll bar may take the rest
    assert scroll <= inner
    beyond = browser.execute_script(
        "return [...document.querySelectorAll('body *:not(svg *, thead *)')]"
        ".filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
    )
    assert beyond == []
    assert browser.execute_script("return performance.getEntriesByType('resource').length") == 0
    # The verdict is on the first screen, and big.
    box = browser.execute_script(
        "const h = document.querySelector('.headline'); "
        "return [h.getBoundingClientRect().bottom, parseFloat(getComputedStyle(h).fontSize)]"
    )
    assert box[0] < 850
    assert box[1] >= 20


def test_draws_that_contradict_their_summary_are_not_drawn() -> None:
    """Draws without spread have no density and no correlation; those far away none here."""
    document = load("us")
    c_f, far = document.draws["c_f"], [1e9 + k for k in range(200)]
    draws = {"c_f": [0.0] * len(c_f), "c_r": far[: len(c_f)], "i": document.draws["i"]}
    page = html_report(document.model_copy(update={"draws": draws}))
    assert "posterior-i" in page
    assert "posterior-c-f" not in page
    assert "posterior-c-r" not in page
