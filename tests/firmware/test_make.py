"""The firmware's own checks on this computer: golden frames, and host tests under sanitizers."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.firmware.emulated import FIRMWARE, make


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_golden_frames_are_what_an_independent_program_computes(tmp_path: Path) -> None:
    assert make(FIRMWARE, "golden", builds=False).stderr == ""
    program = [sys.executable, str(FIRMWARE / "tests" / "golden_frames.py")]
    frames = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    protocol = (FIRMWARE / "PROTOCOL.md").read_text(encoding="utf-8")
    assert frames in protocol
    # and a frame that is another does not pass
    other = tmp_path / "PROTOCOL.md"
    last = frames.rstrip()[-1]
    wrong = frames.rstrip()[:-1] + ("0" if last != "0" else "1")
    other.write_text(protocol.replace(frames.rstrip(), wrong), encoding="utf-8")
    assert subprocess.run([*program, "--check", str(other)], capture_output=True).returncode != 0


@pytest.mark.skipif(
    not all(map(shutil.which, ("make", "g++"))), reason="make or g++ is not installed"
)
def test_the_host_tests_pass() -> None:
    said = make(FIRMWARE, "host").stdout
    counted = re.search(r"(\d+) tests, (\d+) checks, 0 tests failed", said)
    assert counted, said
    assert int(counted[1]) > 100
