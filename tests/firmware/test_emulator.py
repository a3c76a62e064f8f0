"""The emulator itself: its own tests, its sentences, its pseudo-terminal, its repeatability."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest
import serial

from tests.firmware.emulated import (
    EMULATOR,
    Emulated,
    EmulatorError,
    Terminal,
    VirtualPort,
    build,
    build_programs,
    make,
    missing,
)

REASON = missing()
pytestmark = pytest.mark.skipif(REASON is not None, reason=str(REASON))


def echo(extra: str = "") -> str:
    """A board that sends every byte back plus one, on a cable."""
    return f"board echo elf={build_programs()}/echo.elf\ncable echo\n{extra}"


def test_its_own_tests_pass() -> None:
    """Devices and the part, under AddressSanitizer and UBSan."""
    assert " 0 failures" in make(EMULATOR, "test").stdout


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(build()), *words], capture_output=True, text=True, check=False, timeout=60
    )


def test_wrong_usage_and_unreadable_scenarios_are_one_sentence_and_status_2(tmp_path: Path) -> None:
    assert run().returncode == 2
    assert run("--fast").returncode == 2
    none = run(str(tmp_path / "none"))
    assert none.returncode == 2
    assert none.stderr.strip().endswith("none: cannot be read: No such file or directory")
    wrong = tmp_path / "wrong.scenario"
    wrong.write_text("seed 1\nbord a\n")
    said = run(str(wrong))
    assert said.returncode == 2
    assert said.stderr.startswith(f'emulator: {wrong}:2: "bord" is no statement')
    assert said.stderr.count("\n") == 1
    good = tmp_path / "good.scenario"
    good.write_text(echo("duration 0.1\n"))
    said = run("--events", str(tmp_path / "no" / "folder"), str(good))
    assert said.returncode == 2
    assert "cannot be written" in said.stderr


def test_the_laptop_can_be_a_test_in_virtual_time(tmp_path: Path) -> None:
    with Emulated(echo("duration 100\n"), tmp_path) as emulated:
        port = VirtualPort(emulated, timeout=5.0)
        began = time.monotonic()
        port.write(bytes([1, 2, 3]))
        assert port.read(3) == bytes([2, 3, 4])
        # Three bytes at 9600 baud there, the last one back at 9615.
        assert emulated.now == pytest.approx((9.5 + 20) / 9600 + 10 / 9615, abs=1e-4)
        assert port.read(1) == b""
        assert emulated.now == pytest.approx(5.0 + 4.1e-3, abs=1e-3)
        emulated.wait(60)
        assert time.monotonic() - began < 30
        emulated.wait(1000)
        assert emulated.now == pytest.approx(100)
        assert not emulated.running
        emulated.statistics()
        totals = emulated.totals("board", name="echo")
        assert totals["serial_received"] == totals["serial_sent"] == 3
        assert totals["asleep"] > 0.99 * totals["cycles"]


def test_wrong_commands_are_refused_and_the_emulator_goes_on(tmp_path: Path) -> None:
    with Emulated(echo(), tmp_path) as emulated:
        for command, sentence in (
            ("press start", 'there is no button "start" in this scenario'),
            ("jump", '"jump" is not something that can happen'),
            ("run fast", "run and wait need a time: run 0.1"),
        ):
            with pytest.raises(EmulatorError, match=sentence):
                emulated.do(command)
        assert emulated.wait(0.1) == b""


def test_a_scenario_that_is_wrong_raises_its_sentence(tmp_path: Path) -> None:
    with (
        pytest.raises(EmulatorError, match="board needs elf="),
        Emulated("board a\n", tmp_path) as emulated,
    ):
        emulated.wait(1.0)


def test_the_same_seed_gives_the_same_log(tmp_path: Path) -> None:
    logs = []
    for i, seed in enumerate((5, 5, 6)):
        folder = tmp_path / str(i)
        folder.mkdir()
        program = build_programs() / "converter.elf"
        noisy = f"seed {seed}\nboard a elf={program}\ninput a.A0 volts=1 noise=20mV\nlog adc\n"
        with Emulated(noisy, folder) as emulated:
            emulated.wait(0.05)
        logs.append((folder / "events.jsonl").read_bytes())
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]
    assert len(logs[0]) > 500


def test_pyserial_speaks_with_it_over_a_pseudo_terminal(tmp_path: Path) -> None:
    with Terminal(echo("speed 20\n"), tmp_path) as emulated:
        with serial.Serial(emulated.path, 9600, timeout=10) as port:
            port.write(bytes(range(64)))
            assert port.read(64) == bytes(range(1, 65))
        with serial.Serial(emulated.path, 9600, timeout=10) as port:  # opened again: still there
            port.write(b"\xff")
            assert port.read(1) == b"\0"
        assert emulated.stop() == 0
    assert emulated.totals("laptop")["received"] == 65


def test_virtual_time_waits_for_a_slow_reader_and_loses_nothing(tmp_path: Path) -> None:
    """More than the pseudo-terminal holds, as fast as possible, read only afterwards."""
    lines = "".join(f"at {0.01 + 0.5 * i} send {'5a' * 400}\n" for i in range(150))
    with Terminal(echo(f"speed 0\nduration 80\n{lines}"), tmp_path) as emulated:
        terminal = os.open(emulated.path, os.O_RDWR | os.O_NOCTTY)
        time.sleep(1.5)
        got = bytearray()
        deadline = time.monotonic() + 60
        assert emulated.alive()
        while len(got) < 60000 and time.monotonic() < deadline:
            got += os.read(terminal, 4096)
        os.close(terminal)
        assert bytes(got) == b"\x5b" * 60000
        assert emulated.wait(60) == 0


def test_virtual_time_keeps_to_the_speed_that_is_asked_for(tmp_path: Path) -> None:
    with Terminal(echo("speed 4\nduration 4\n"), tmp_path) as emulated:
        terminal = os.open(emulated.path, os.O_RDWR | os.O_NOCTTY)
        began = time.monotonic()
        assert emulated.wait(30) == 0
        os.close(terminal)
    # One second, 0.1 s until it starts, and whatever else the machine has to do.
    assert 0.95 < time.monotonic() - began < 15
