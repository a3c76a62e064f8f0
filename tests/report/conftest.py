"""Small documents, and the reports made of them once for all tests."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from bayes_asv.report.html import Document, html_report
from bayes_asv.report.pdf import pdf_report

Made = TypeVar("Made")

DATA = Path(__file__).parent / "data"
KINDS = ("us", "si", "two_runs", "budget", "refused", "not_converged", "hostile")
HOSTILE = "<script>alert(1)</script> {{7*7}} #[7*7] $x$ & \"q\" 's' \x00\x1b[31m\u202eevil"


def load(kind: str) -> Document:
    """Read a document, or make one from another."""
    if kind == "not_converged":
        document = load("us")
        document["verdict"] = kind
        document["diagnostics"].update(rhat_max=1.034, ess_bulk_min=212.0, ess_tail_min=140.0)
        document["warnings"] = ["the ensembles had not agreed after 7680 draws each"]
        return document
    if kind == "budget":
        document = load("us")
        document["width"] = json.loads((DATA / "width.json").read_text(encoding="utf-8"))
        return document
    if kind == "hostile":
        document = load("us")
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
    read: Document = json.loads((DATA / f"{kind}.json").read_text(encoding="utf-8"))
    return read


@pytest.fixture
def documents() -> dict[str, Document]:
    return {kind: load(kind) for kind in KINDS}


class _Once(dict[str, Made]):
    def __init__(self, make: Callable[[Document], Made]) -> None:
        super().__init__()
        self.make = make

    def __missing__(self, kind: str) -> Made:
        self[kind] = self.make(load(kind))
        return self[kind]


@pytest.fixture(scope="session")
def pages() -> dict[str, str]:
    """HTML by kind of document."""
    return _Once(html_report)


@pytest.fixture(scope="session")
def papers() -> dict[str, bytes]:
    """PDF by kind of document."""
    return _Once(pdf_report)
