"""The example of a report section in ``docs/extending.md`` can be followed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.report.conftest import DATA

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "extending.md"

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


def _blocks(kind: str) -> list[str]:
    part = PAGE.read_text(encoding="utf-8").split("## A report section\n")[1].split("\n## ")[0]
    return re.findall(rf"```{kind}\n(.*?)```", part, flags=re.DOTALL)


def _edited(text: str, diff: str) -> str:
    """Apply one block of the page; the context that it shows has to be there once."""
    lines = diff.splitlines()
    old = "\n".join(line[1:] for line in lines if line[:1] in " -")
    new = "\n".join(line[1:] for line in lines if line[:1] in " +")
    assert text.count(old) == 1, f"the page shows what is not there:\n{old}"
    return text.replace(old, new)


@pytest.fixture
def extended(tmp_path: Path) -> Path:
    """Copy the package and follow the steps of the page in it."""
    ignored = shutil.ignore_patterns("__pycache__", "static")
    shutil.copytree(ROOT / "bayes_asv", tmp_path / "bayes_asv", ignore=ignored)
    sections = tmp_path / "bayes_asv" / "report" / "sections"
    (file,) = _blocks("python")
    (sections / "lost_readings.py").write_text(file, encoding="utf-8")
    registry = sections / "__init__.py"
    text = registry.read_text(encoding="utf-8")
    for block in _blocks("diff"):
        text = _edited(text, block)
    registry.write_text(text, encoding="utf-8")
    return tmp_path


def test_the_steps_make_a_section_of_the_report(extended: Path) -> None:
    code = CODE.format(copy=str(extended), file=str(DATA / "us.json"))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=extended,
        env={**os.environ, "PYTHONPATH": str(extended)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows, sentences = done.stdout.splitlines()
    assert rows == "[['rear wheel, stops.csv', '60', '3']]"
    assert re.fullmatch(r"\['\d+ % of the readings of stops.csv are missing.'\]", sentences)
