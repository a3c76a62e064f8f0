"""The example of a report section in ``docs/extending.md`` can be followed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.extension_steps import ROOT, apply, blocks, copy_package, run
from tests.report.conftest import DATA

PAGE = ROOT / "docs" / "extending.md"
HEADING = "A report section"

CODE = """
import bayes_asv
from bayes_asv.report.page import limits, report_page
from bayes_asv.report.render import html_report, pdf_report
from bayes_asv.report.schema import read_saved

assert bayes_asv.__file__.startswith({copy!r})
document = read_saved({file!r})
document.draws = {{}}
run = document.runs[0]
assert not any(s["title"] == "Lost readings" for s in report_page(document)[0]["sections"])
run.missing["rear_wheel"], run.clipped["rear_wheel"] = 60, 3
page, _ = report_page(document)
(section,) = [s for s in page["sections"] if s["title"] == "Lost readings"]
print(section["rows"])
print([line for line in limits(document) if "are missing" in line])
assert "Lost readings" in html_report(document)
assert pdf_report(document).startswith(b"%PDF")
"""


@pytest.fixture
def extended(tmp_path: Path) -> Path:
    """Copy the package and follow the steps of the page in it."""
    sections = copy_package(tmp_path) / "report" / "sections"
    (file,) = blocks(PAGE, HEADING, "python")
    (sections / "lost_readings.py").write_text(file, encoding="utf-8")
    apply(sections / "__init__.py", blocks(PAGE, HEADING, "diff"))
    return tmp_path


def test_the_steps_make_a_section_of_the_report(extended: Path) -> None:
    done = run(extended, "-c", CODE.format(copy=str(extended), file=str(DATA / "us.json")))
    assert done.returncode == 0, done.stderr
    rows, sentences = done.stdout.splitlines()
    assert rows == "[['rear wheel, stops.csv', '60', '3']]"
    assert re.fullmatch(r"\['\d+ % of the readings of stops.csv are missing.'\]", sentences)
