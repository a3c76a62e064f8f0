"""Run the examples of a page of the documentation, and hold what they print against the page."""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
from pathlib import Path

__all__ = ["masked", "run_examples"]


def masked(text: str) -> str:
    """Mask digits, whose last place may differ between machines, and the width of columns."""
    return "\n".join(
        " ".join(re.sub(r"\d+(\.\d+)?", "#", line).split()) for line in text.splitlines()
    )


def run_examples(page: Path) -> int:
    """Run every block of shell and Python in the working directory; return their number.

    The block of text after one is what it prints.
    """
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    names: dict[str, object] = {}
    ran = 0
    for (language, code), (after, shown) in zip(blocks, [*blocks[1:], ("", "")], strict=True):
        if language == "text":
            continue
        if language == "sh":
            printed = subprocess.run(
                ["sh", "-e"], input=code, text=True, capture_output=True, check=True,
                env={**os.environ, "PATH": path},
            ).stdout  # fmt: skip
        else:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, f"block of {page.name}", "exec"), names)
            printed = out.getvalue()
        assert masked(printed) == masked(shown if after == "text" else ""), code
        ran += 1
    return ran
