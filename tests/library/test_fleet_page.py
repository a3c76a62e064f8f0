"""The page about seasons: its examples run and print what is shown."""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "fleet.md"


def _masked(text: str) -> str:
    """Mask digits, whose last place may differ between machines, and the width of columns."""
    return "\n".join(
        " ".join(re.sub(r"\d+(\.\d+)?", "#", line).split()) for line in text.splitlines()
    )


def test_every_example_runs_and_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    program = Path(sys.executable).parent
    monkeypatch.setenv("PATH", f"{program}{os.pathsep}{os.environ['PATH']}")
    text = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    names: dict[str, object] = {}
    ran = 0
    for (language, code), (after, shown) in zip(blocks, [*blocks[1:], ("", "")], strict=True):
        if language == "text":
            continue
        if language == "sh":
            done = subprocess.run(
                ["sh", "-e"], input=code, text=True, capture_output=True, check=True
            )
            printed = done.stdout
        else:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, f"block of {PAGE.name}", "exec"), names)
            printed = out.getvalue()
        assert _masked(printed) == _masked(shown if after == "text" else ""), code
        ran += 1
    assert ran == 3
    assert {"season.parquet", "season.html", "season.pdf"} <= {p.name for p in tmp_path.iterdir()}
