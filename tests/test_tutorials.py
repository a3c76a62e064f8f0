"""Every tutorial is followed as it stands: its commands run, and print what it shows."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import re
import runpy
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bayes_asv.cli import main
from tests.page_examples import assert_shown

ROOT = Path(__file__).parents[1]
TUTORIALS = ROOT / "docs" / "tutorials"
LOGS = ROOT.parent / "shared" / "data" / "logs"
BLOCK = re.compile(r"^```([^\n]+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CAPTION = re.compile(r":caption: (\S+)\n\n")
REAL = {"arduino": "teensy_accelerometer.csv", "motec": "motec_sample1.ld"}


def _blocks(page: str) -> list[tuple[str, str]]:
    return BLOCK.findall((TUTORIALS / f"{page}.md").read_text("utf-8"))


def _status(line: str) -> int:
    return int(line.rpartition("# exit status ")[2]) if "# exit status" in line else 0


def _run(line: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run a line of a shell in this process and return what it prints."""
    program, *words = shlex.split(line, comments=True)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        if program == "python":
            monkeypatch.setattr(sys, "argv", words)
            runpy.run_path(words[0], run_name="__main__")
        else:
            assert program == "bayes-asv", line
            monkeypatch.setattr(sys, "argv", [program, *words])
            with pytest.raises(SystemExit) as end:
                main()
            assert (end.value.code or 0) == _status(line), printed.getvalue()
    return printed.getvalue()


def _steps(page: str, real: bool) -> Iterator[tuple[str, str, str]]:
    """Language, text and output of the blocks that need a real file, or of all others."""
    blocks = [*_blocks(page), ("", "")]
    for (language, text), (following, shown) in itertools.pairwise(blocks):
        names_it = language == "sh" and REAL.get(page, "…") in text
        if names_it == real and language != "text":
            yield language, text, shown if following == "text" else ""


@pytest.mark.parametrize(
    "page", ["first-answer", "arduino", "motec", "aim", "racecapture", "phyphox"]
)
def test_a_tutorial_leads_to_its_report(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("car.toml", "example_logs.py"):
        shutil.copy(TUTORIALS / name, tmp_path)
    for language, text, shown in _steps(page, real=False):
        caption = CAPTION.match(text)
        if caption and language.endswith("toml"):
            Path(caption[1]).write_text(text[caption.end() :], encoding="utf-8")
        elif caption:  # the head of a file
            head = Path(caption[1]).read_text("utf-8")[: len(text)]
            assert_shown(text[caption.end() :] + "…", head)
        elif language == "toml":  # a part of the vehicle file
            assert text in (tmp_path / "car.toml").read_text("utf-8")
        elif language == "python":
            exec(compile(text, f"{page}.md", "exec"), {})
        elif language == "sh":
            printed = "".join(_run(line, monkeypatch) for line in text.splitlines())
            if shown:
                assert_shown(shown, printed)
    assert (tmp_path / "report.html").stat().st_size > 50_000
    document = json.loads((tmp_path / "estimate.json").read_text("utf-8"))
    assert document["verdict"] == "ok"
    for name, true in (("c_f", 1008.0), ("c_r", 1750.0), ("i", 70.7)):
        found = document["parameters"][name]
        assert abs(found["mean"] - true) < 4.0 * found["sd"] < 0.1 * true


@pytest.mark.parametrize("page", REAL)
def test_a_tutorial_says_what_a_real_file_lacks(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = LOGS / REAL[page]
    if not file.exists():
        pytest.skip(f"{file.name} is not here")
    monkeypatch.chdir(tmp_path)
    (tmp_path / file.name).symlink_to(file)
    steps = list(_steps(page, real=True))
    assert steps
    for _, text, shown in steps:
        assert_shown(shown, "".join(_run(line, monkeypatch) for line in text.splitlines()))
