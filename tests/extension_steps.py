"""Follow the steps that a page of the documentation shows, in a copy of the package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

__all__ = ["ROOT", "apply", "blocks", "copy_package", "run"]

ROOT = Path(__file__).parents[1]


def blocks(page: Path, heading: str, kind: str) -> list[str]:
    """Return the blocks of a kind, such as ``python`` or ``diff``, below a heading of a page."""
    part = page.read_text(encoding="utf-8").split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return re.findall(rf"```{kind}\n(.*?)```", part, flags=re.DOTALL)


def copy_package(folder: Path) -> Path:
    """Copy the package into a folder, and return the copy."""
    ignored = shutil.ignore_patterns("__pycache__", "static")
    shutil.copytree(ROOT / "bayes_asv", folder / "bayes_asv", ignore=ignored)
    return folder / "bayes_asv"


def apply(path: Path, diffs: Iterable[str]) -> None:
    """Apply diffs of a page to a file; the context that they show has to be there once."""
    text = path.read_text(encoding="utf-8")
    for diff in diffs:
        lines = diff.splitlines()
        old = "\n".join(line[1:] for line in lines if line[:1] in " -")
        new = "\n".join(line[1:] for line in lines if line[:1] in " +")
        assert text.count(old) == 1, f"the page shows what is not there:\n{old}"
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


def run(
    folder: Path, *words: str, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder with the copy of the package that is there."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
