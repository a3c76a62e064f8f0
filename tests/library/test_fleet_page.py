"""The page about seasons: its examples run and print what is shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.page_examples import run_examples

PAGE = Path(__file__).parents[2] / "docs" / "fleet.md"


def test_every_example_runs_and_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_examples(PAGE) == 3
    assert {"season.parquet", "season.html", "season.pdf"} <= {p.name for p in tmp_path.iterdir()}
