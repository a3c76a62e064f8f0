"""``bayes-asv reproduce`` on the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.reference import printed
from tests.cli.conftest import ROOT, Check, Command, Said


@pytest.fixture(scope="module")
def written(invoke: Command, tmp_path_factory: pytest.TempPathFactory) -> tuple[Said, Path]:
    folder = tmp_path_factory.mktemp("reproduce")
    return invoke("reproduce", "-o", folder, "--seed", 3), folder


@pytest.fixture(scope="module")
def document(written: tuple[Said, Path]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((written[1] / "reproduce.json").read_text(encoding="utf-8"))
    return found


def test_every_printed_figure_stands_beside_ours(document: dict[str, Any]) -> None:
    tables = document["tables"]
    assert list(tables) == ["4.1", "4.2", "5.1", "7.1", "8.1"]
    wanted = {
        "4.1": list(printed.TABLE_41.values()),
        "4.2": [v for pair in printed.TABLE_42.values() for v in pair],
        "5.1": [*printed.TABLE_51.values()],
        "7.1": list(printed.TABLE_71.values()),
    }
    for key, values in wanted.items():
        rows = [row for row in tables[key]["rows"] if row["printed"] is not None]
        if key == "5.1":
            shown = [row["corrected"] for row in rows]
            found = [row["printed"] for row in rows if row["name"] in printed.TABLE_51_FOUND]
            assert found == list(printed.TABLE_51_FOUND.values())
        else:
            shown = [row["printed"] for row in rows]
        assert sorted(shown) == sorted(values)
        assert all(row["obtained"] is not None and row["where"] for row in rows)
    for row in tables["8.1"]["rows"]:
        assert list(row["printed"].values()) == list(printed.TABLE_81[row["name"]])
        for ours in row["ours"].values():
            assert ours["posterior_eti95"][0] < ours["posterior"] < ours["posterior_eti95"][1]
    assert "not public" in " ".join(tables["8.1"]["notes"])


def test_what_was_obtained_is_right(document: dict[str, Any]) -> None:
    for key in ("4.1", "4.2", "5.1"):
        for row in document["tables"][key]["rows"]:
            assert row["obtained"] == pytest.approx(row["corrected"], rel=1e-4), row["name"]
    for row in document["tables"]["7.1"]["rows"]:
        assert row["difference_percent"] == pytest.approx(0.0, abs=0.2)
    covered = [
        ours["posterior_covers"]
        for row in document["tables"]["8.1"]["rows"]
        for ours in row["ours"].values()
    ]
    assert all(covered)  # of one car, whose truth the shipped runs' estimates are known to cover
    for row in document["tables"]["8.1"]["rows"]:
        for ours in row["ours"].values():
            assert abs(ours["deflection_error_percent"]) < 1.0


def test_the_page_stands_alone_and_holds_every_figure(written: tuple[Said, Path]) -> None:
    said, folder = written
    assert (said.status, said.err) == (0, "")
    page = (folder / "reproduce.html").read_text(encoding="utf-8")
    for number in ("3.1", "4.1", "5.2", "6.6", "7.2", "8.1", "8.2", "8.3", "8.4", "8.5"):
        assert f"Fig. {number}:" in page
    assert page.count("<svg") == 10
    assert "<script" not in page
    assert not re.findall(r'(?:src|href)="(?!#|data:)', page)
    ids = re.findall(r'\sid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert str(ROOT) not in page


def test_a_folder_that_cannot_be_made(invoke: Command, refuse: Check, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("x")
    assert refuse(invoke("reproduce", "-o", file / "below"), "cannot be made")
