"""Run the examples of a page of the documentation, and hold what they print against the page."""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
from pathlib import Path

__all__ = ["assert_shown", "run_examples"]

NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-\d+)?")
TOLERANCE = 0.1  # relative; draws of a posterior differ between machines, and what is made of them


def _agree(shown: str, printed: str) -> bool:
    """Whether two lines have the same words, and the same numbers within their tolerance.

    Five units in the last place that is shown are always allowed: some numbers are near zero.
    """
    if NUMBER.sub("#", shown) != NUMBER.sub("#", printed):
        return False
    for ours, theirs in zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True):
        mantissa, _, power = ours.partition("e")
        last_place = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
        allowed = max(5.0 * last_place, TOLERANCE * float(ours))
        if abs(float(ours) - float(theirs)) > allowed * (1.0 + 1e-9):
            return False
    return True


def _lines(text: str) -> list[str]:
    """Lines without the width of columns."""
    return [" ".join(line.split()) for line in text.strip().splitlines()]


def assert_shown(shown: str, printed: str) -> None:
    """Check that a page shows what was printed; a line with … stands for any lines."""
    lines = _lines(printed)
    parts = [_lines(part) for part in re.split(r"^…$", shown.strip(), flags=re.MULTILINE)]
    begin = 0
    for k, part in enumerate(parts):
        at_end = k == len(parts) - 1 and (part or k == 0)
        last = len(lines) - len(part)
        starts = range(max(begin, last) if at_end else begin, last + 1)
        found = next(
            (j for j in starts if (j == 0 or k > 0) and all(map(_agree, part, lines[j:]))), None
        )
        text = "\n".join(part)
        assert found is not None, f"the page shows\n{text}\nand what is printed is\n{printed}"
        begin = found + len(part)


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
        assert_shown(shown if after == "text" else "", printed)
        ran += 1
    return ran
