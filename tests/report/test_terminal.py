"""Answers in the terminal: at most 80 columns, each number once, colours where they are shown."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from collections.abc import Sequence

import pytest
from rich.console import Console

from bayes_asv.report.schema import DiagnoseDocument, EstimateDocument, TrackDocument
from bayes_asv.report.sections.diagnosis import diagnosis_lines
from bayes_asv.report.sections.parameters import answers
from bayes_asv.report.sections.verdict import track_lines, verdict_lines
from bayes_asv.report.terminal import answer_text
from bayes_asv.report.words import estimate_text, interval
from tests.report.conftest import DATA, KINDS, load, table

ANSI = re.compile(r"\x1b\[[0-9;]*m")
SCRIPT = """
import types
from bayes_asv.cli.common import print_answer
from bayes_asv.report.schema import read_saved
from bayes_asv.report.sections.verdict import verdict_lines
document = read_saved({file!r})
print_answer(types.SimpleNamespace(document=document, lines=lambda: verdict_lines(document)))
"""


def shown(
    document: EstimateDocument | TrackDocument | DiagnoseDocument, lines: Sequence[str]
) -> str:
    stream = io.StringIO()
    console = Console(file=stream, width=80)
    for part in answer_text(document, lines, 80):
        console.print(part, soft_wrap=True)
    return stream.getvalue()


@pytest.mark.parametrize("kind", KINDS)
def test_an_estimate_fits_a_terminal_and_keeps_its_words(kind: str) -> None:
    document = load(kind)
    text = shown(document, verdict_lines(document))
    longest = max((line for line in text.splitlines()), key=len)
    assert len(longest) <= 80 or " " not in longest.strip()
    unwrapped = re.sub(r"\n {2,}", " ", text)
    for line in verdict_lines(document):
        if "(95 %: " not in line:
            assert line in unwrapped
    assert "\x1b" not in text


@pytest.mark.parametrize("kind", ["us", "si", "two_runs"])
def test_every_number_of_a_parameter_is_said_once(kind: str) -> None:
    document = load(kind)
    text = shown(document, verdict_lines(document))
    for name in answers(document.parameters):
        p = document.parameters[name]
        assert text.count(interval(p, 1)) == 1
        assert text.count(estimate_text(p, p.unit)) == 1


def test_an_interval_of_more_than_a_factor_of_ten_has_no_mean() -> None:
    """Neither in the table nor in the sentence; the interval itself is stated."""
    document = load("us")
    wide = document.parameters["c_f"]
    wide.mean, wide.sd, wide.eti95 = 41.7, 60.3, [1.3, 104.0]
    text = shown(document, verdict_lines(document))
    assert "not determined" in text
    assert "1.3 to 100" in text
    assert "41.7" not in text
    parameters = table(document, "Parameters")
    assert parameters is not None
    row = next(row for row in parameters.rows if row[0].startswith("Front damping rate"))
    assert row[1:3] == ["not determined", "–"]
    wide.eti95 = [10.0, 104.0]  # nominal is below it: by how much is not known
    text = shown(document, verdict_lines(document))
    assert "not determined" in text
    assert "stiffer than nominal" in re.sub(r"\s+", " ", text)
    assert " % stiffer" not in text.split("Rear")[0]
    wide.eti95 = [10.5, 104.0]
    assert "not determined" not in shown(document, verdict_lines(document))


def test_a_diagnosis_has_parameters_before_and_after_in_a_table() -> None:
    document = DiagnoseDocument.model_validate_json((DATA / "diagnosis.json").read_text("utf-8"))
    text = shown(document, diagnosis_lines(document))
    after = document.parameters_after["c_f"]
    assert text.count(interval(after)) == 1
    assert "linear car" in text
    assert max(map(len, text.splitlines())) <= 80


def test_a_track_has_a_table() -> None:
    text = (DATA / "commit_3f70d75" / "track.json").read_text("utf-8")
    document = TrackDocument.model_validate_json(text)
    said = shown(document, track_lines(document))
    assert said.count(interval(document.parameters["c_f"], 1)) == 1
    assert "P(below)" in said


def in_a_terminal(**environment: str) -> str:
    """What the answer looks like in a terminal of 80 columns."""
    parent, child = pty.openpty()
    env = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
    env |= {"TERM": "xterm-256color", "COLUMNS": "80", **environment}
    code = SCRIPT.format(file=str(DATA / "us.json"))
    with subprocess.Popen([sys.executable, "-c", code], stdout=child, env=env) as process:
        os.close(child)
        received = b""
        while True:
            try:
                block = os.read(parent, 4096)
            except OSError:  # Linux reports the end in this way
                break
            if not block:
                break
            received += block
        assert process.wait() == 0
    os.close(parent)
    return received.decode().replace("\r\n", "\n")


def test_a_terminal_shows_the_same_in_colour_and_without_where_it_is_not_wanted() -> None:
    code = SCRIPT.format(file=str(DATA / "us.json"))
    piped = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    coloured, plain = in_a_terminal(), in_a_terminal(NO_COLOR="1")
    assert re.search(r"\x1b\[1;3[0-9]m", coloured)
    assert not re.search(r"\x1b\[(\d;)*(3|4)[0-9]", plain)
    assert b"\x1b" not in piped
    assert ANSI.sub("", coloured) == ANSI.sub("", plain) == piped.decode()
