"""The page of the library: every block runs and prints what is shown, every name is in one."""

from __future__ import annotations

import contextlib
import doctest
import io
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import bayes_asv as asv

PAGE = Path(__file__).parents[2] / "docs" / "library.md"
NUMBERS = re.compile(r"\d+(\.\d+)?")


def _blocks() -> list[tuple[str, str]]:
    """Language and text of every code block, in order."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def _masked(text: str) -> str:
    """Mask digits, whose last place may differ between machines, and the width of columns."""
    return "\n".join(" ".join(NUMBERS.sub("#", line).split()) for line in text.splitlines())


def test_every_block_runs_and_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = _blocks()
    names: dict[str, object] = {}
    assert {language for language, _ in blocks} == {"python", "text"}
    for number, (language, code) in enumerate(blocks):
        if language != "python":
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, f"block {number} of {PAGE.name}", "exec"), names)
        after = blocks[number + 1] if number + 1 < len(blocks) else ("", "")
        shown = after[1] if after[0] == "text" else ""
        assert _masked(printed.getvalue()) == _masked(shown), code
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
