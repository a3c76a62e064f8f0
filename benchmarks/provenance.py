"""What a published figure needs beside it: the commit it belongs to, and how sure it is."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from bayes_asv.domain.files import write_atomically

__all__ = ["current_commit", "keep", "share"]


def current_commit() -> str:
    """Return the abbreviated commit of the repository; empty outside of one."""
    return subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=Path(__file__).parent, capture_output=True, text=True, check=False,
    ).stdout.strip()  # fmt: skip


def share(hits: Sequence[bool]) -> dict[str, Any]:
    """Return a share with its exact 95 % interval."""
    ends = binomtest(sum(hits), len(hits)).proportion_ci(method="exact")
    return {"share": sum(hits) / len(hits), "interval": [float(ends.low), float(ends.high)]}


def keep(path: Path, result: object) -> None:
    """Write a result, as JSON, whole or not at all."""
    write_atomically(str(path), (json.dumps(result, indent=1) + "\n").encode("utf-8"))
