"""The firmware's own checks on this computer: golden frames, and host tests under sanitizers."""

from __future__ import annotations

import re
import shutil

import pytest

from tests.firmware.emulated import FIRMWARE, make


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_golden_frames_are_what_an_independent_program_computes() -> None:
    make(FIRMWARE, "golden")


@pytest.mark.skipif(
    not all(map(shutil.which, ("make", "g++"))), reason="make or g++ is not installed"
)
def test_the_host_tests_pass() -> None:
    said = make(FIRMWARE, "host").stdout
    counted = re.search(r"(\d+) tests, (\d+) checks, 0 tests failed", said)
    assert counted, said
    assert int(counted[1]) > 100
