"""The same seed gives the same bytes, whatever the threads and the state of the compiled cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT

DATA = ROOT / "data"


def _answer(command: str, recording: str, threads: int, cache: Path | None) -> bytes:
    """The document of a command in a process of its own, without the seconds it took."""
    count = str(threads)
    environment = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), count)
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    files = (str(DATA / "recordings" / recording), "-v", str(DATA / "vehicles" / "baja2008.toml"))
    done = subprocess.run(
        [sys.executable, "-m", "bayes_asv", command, *files, "--seed", "3", "--json", "-"],
        env={**os.environ, **environment},
        capture_output=True,
        check=True,
    )
    document = json.loads(done.stdout)
    assert document.pop("seconds") > 0
    return json.dumps(document).encode()


@pytest.mark.parametrize(
    ("command", "recording", "cold"),
    [("estimate", "bump-400hz.csv", True), ("diagnose", "valved-bump-400hz.csv", False)],
)
def test_same_seed_same_bytes(command: str, recording: str, cold: bool, tmp_path: Path) -> None:
    first = _answer(command, recording, 1, tmp_path if cold else None)
    assert not cold or list(tmp_path.rglob("*.nbi"))
    assert _answer(command, recording, 2, tmp_path if cold else None) == first
