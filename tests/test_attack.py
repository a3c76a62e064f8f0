"""The attack of `benchmarks.attack` in short: no input and no signal breaks anything."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bayes_asv.filters import prediction
from bayes_asv.posterior.threads import threads
from benchmarks import attack, strikes

SUMMARY = ("standard output closed", "no file may be written", "C locale")


def test_mutated_inputs_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    found = attack.attack_readers(300, 20.0, seed=5)
    assert {name: one["faults"] for name, one in found.items() if one["faults"]} == {}
    assert all(one["inputs"] for one in found.values())
    assert sum(one["accepted"] for one in found.values()) > 100  # mutations are not all nonsense


def test_the_attack_notices_what_crashes_hangs_or_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(path: Path) -> None:
        kind = sum(path.read_bytes()) % 3
        if kind == 0:
            raise KeyError("x")
        if kind == 1:
            bytearray(1 << 40)
        while True:
            pass

    monkeypatch.setattr(attack, "SECONDS_AN_INPUT", 0.05)
    target = attack.Target((bytes(range(48, 57)),), broken)
    with attack.bounds():
        found = attack._attack_one("broken", target, 30, 10.0, 1, tmp_path, tmp_path / "kept")
    kinds = {what.split()[0] for what in found["faults"]}
    assert kinds == {"KeyError", "MemoryError", "TooSlow"}
    assert len(list((tmp_path / "kept").iterdir())) == 3


def test_struck_commands_leave_old_or_new_outputs_and_nothing_else() -> None:
    found = strikes.strike_commands(4, 15.0, seed=3, commands=("simulate",))
    assert found["faults"] == {}


def test_a_killed_transfer_loses_nothing() -> None:
    """A killed season has a test in ``library/test_fleet.py``."""
    transfer = strikes.strike_transfers(1, 20.0, seed=4)
    assert transfer["kills"] > 0
    assert transfer["faults"] == {}


def test_shortages_end_in_one_line() -> None:
    found = attack.attack_resources(SUMMARY)
    assert {name: one["faults"] for name, one in found.items() if one["faults"]} == {}


@pytest.mark.parametrize("old", [None, b"old"])
def test_a_process_killed_while_it_writes_leaves_nothing(tmp_path: Path, old: bytes | None) -> None:
    if not hasattr(os, "O_TMPFILE"):
        pytest.skip("this system has no files without a name")
    file = tmp_path / "out.json"
    if old is not None:
        file.write_bytes(old)
    code = (
        "import os, signal, sys\n"
        "from bayes_asv.domain.files import write_atomically\n"
        "def pieces():\n"
        "    yield 100_000 * b'new'\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
        "write_atomically(sys.argv[1], pieces())\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(file)], check=False)
    assert done.returncode == -9
    assert [path.name for path in tmp_path.iterdir()] == ([] if old is None else ["out.json"])
    assert old is None or file.read_bytes() == old


def test_an_interrupt_does_not_wait_for_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bayes_asv.posterior.threads._processors", lambda: 2)

    def interrupted() -> None:
        with threads() as shared:
            shared.map(time.sleep, [1.0, 1.0, 1.0])
            raise KeyboardInterrupt

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - begin < 0.5


def test_without_a_folder_for_the_cache_everything_is_compiled_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(**_: object) -> object:
        raise RuntimeError("cannot cache function: no locator available")

    assert prediction._cacheable()
    monkeypatch.setattr(prediction, "njit", refused)
    assert not prediction._cacheable()
