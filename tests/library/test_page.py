"""The page of the library: every block runs and prints what is shown, every name is in one."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import bayes_asv as asv
from tests.page_examples import run_examples

PAGE = Path(__file__).parents[2] / "docs" / "library.md"


def _blocks() -> list[tuple[str, str]]:
    """Language and text of every code block, in order."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def test_every_block_runs_and_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_examples(PAGE) == sum(language == "python" for language, _ in _blocks())
    plt.close("all")
    written = {path.name for path in tmp_path.iterdir()}
    assert written >= {"report.html", "estimate.json", "draws.nc", "mine.csv", "trace.csv"}


@pytest.mark.parametrize("name", asv.__all__)
def test_every_name_is_in_an_example_and_has_a_docstring(name: str) -> None:
    code = "\n".join(text for language, text in _blocks() if language == "python")
    assert re.search(rf"\basv\.{name}\b", code), name
    assert name == "__version__" or getattr(asv, name).__doc__


def test_the_example_of_the_package_runs() -> None:
    found = doctest.testmod(asv)
    assert found.attempted > 3
    assert found.failed == 0
