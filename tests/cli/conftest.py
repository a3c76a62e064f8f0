"""The command line as a person runs it, and one estimate that several tests look at."""

from __future__ import annotations

import contextlib
import io
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from bayes_asv.cli import main

ROOT = Path(__file__).parents[2]


class Said(NamedTuple):
    """Exit status and what was written."""

    status: int
    out: str
    err: str

    @property
    def sentences(self) -> list[str]:
        """Lines of the standard output without the breaks at words, and without empty ones."""
        return [line for line in re.sub(r"\n {2,}", " ", self.out).splitlines() if line]


class Saved(NamedTuple):
    """One full estimate: the process that made it, and its files."""

    said: Said
    json_file: Path
    netcdf: Path
    document: dict[str, Any]


Command = Callable[..., Said]
Check = Callable[..., str]


@pytest.fixture(scope="session")
def stops() -> Path:
    """Return a recording that gives a good answer."""
    return ROOT / "data" / "recordings" / "stops-400hz.csv"


@pytest.fixture(scope="session")
def bump() -> Path:
    """Return another recording of the same car."""
    return ROOT / "data" / "recordings" / "bump-400hz.csv"


@pytest.fixture(scope="session")
def baja() -> Path:
    """Return the car of both."""
    return ROOT / "data" / "vehicles" / "baja2008.toml"


@pytest.fixture(scope="session")
def run() -> Command:
    """Run the program as a process of its own."""

    def process(*words: object, cwd: Path | None = None) -> Said:
        done = subprocess.run(
            [sys.executable, "-m", "bayes_asv", *map(str, words)],
            capture_output=True,
            encoding="utf-8",
            cwd=cwd or ROOT,
            timeout=300,
            check=False,
        )
        return Said(done.returncode, done.stdout, done.stderr)

    return process


@pytest.fixture(scope="session")
def invoke() -> Command:
    """Run the program inside this process, which is quicker; streams are no terminals."""

    def call(*words: object) -> Said:
        out, err = io.StringIO(), io.StringIO()
        old, sys.argv = sys.argv, ["bayes-asv", *map(str, words)]
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                main()
        except SystemExit as leaving:
            status = leaving.code
        finally:
            sys.argv = old
        assert isinstance(status, int)
        return Said(status, out.getvalue(), err.getvalue())

    return call


@pytest.fixture(scope="session")
def saved(run: Command, stops: Path, baja: Path, tmp_path_factory: pytest.TempPathFactory) -> Saved:
    """Estimate once, with every output there is."""
    folder = tmp_path_factory.mktemp("estimate")
    json_file, netcdf = folder / "estimate.json", folder / "draws.nc"
    said = run("estimate", stops, "-v", baja, "--json", json_file, "--netcdf", netcdf, "--seed", 7)
    return Saved(said, json_file, netcdf, json.loads(json_file.read_text(encoding="utf-8")))


@pytest.fixture(scope="session")
def refuse() -> Check:
    """Hold a refusal to its promise: status 2, one line, no traceback, and the words given."""

    def check(said: Said, *words: str) -> str:
        assert said.status == 2, said
        assert said.out == ""
        lines = said.err.splitlines()
        assert len(lines) == 1, said.err
        assert lines[0].startswith("bayes-asv: "), lines[0]
        assert "Traceback" not in said.err
        for word in words:
            assert word in lines[0], lines[0]
        return lines[0]

    return check
