"""An emulated logger with a laptop at it, ready for a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.firmware.emulated import Emulated, VirtualPort, missing
from tests.firmware.frames import (
    SEND,
    START,
    STATUS,
    Block,
)
from tests.firmware.laptop import Laptop
from tests.firmware.scenarios import Setup, build_firmware, system_1, system_2

__all__ = ["LONGEST_RUN", "Logger", "switched_on", "why_not"]

BOOT = 4.0  # s: Slave 1 sets up its modem for 3 s at most
LONGEST_RUN = 20.0  # s: 800 rows at 50 Hz take 16


def why_not() -> str | None:
    """Why the emulated logger cannot run on this machine; None when it can."""
    return missing()


@dataclass
class Logger:
    """The two ends: the emulator with the boards in it, and the laptop."""

    emulated: Emulated
    laptop: Laptop

    def start(self, rate: int = 800, **settings: int) -> float:
        """Configure and start a run; the virtual time just before."""
        result, _, _ = self.laptop.configure(rate=rate, **settings)
        assert result == 0
        before = self.emulated.now
        assert self.laptop.ask(START) == b"\0"
        return before

    def finish(self) -> None:
        """Wait until the run waits for its transfer."""
        self.laptop.wait_for("Slave 1: run done", LONGEST_RUN)

    def transfer(self, within: float = 240.0) -> tuple[Block, Block]:
        """Start the transfer and fetch both blocks."""
        assert self.laptop.ask(SEND) == b"\0"
        return self.laptop.transfer(within)

    def state(self) -> int:
        """State of Slave 1."""
        return self.laptop.ask(STATUS)[0]

    def check_nothing_lost(self) -> None:
        """Assert that no part of any board was too slow for what came to it."""
        self.emulated.statistics()
        for board in ("slave_1", "slave_2"):
            totals = self.emulated.totals("board", name=board)
            for fault in (
                "conversions_lost",
                "serial_overruns",
                "serial_framing",
                "serial_overwritten",
            ):
                assert totals[fault] == 0, (board, fault, totals)
        assert self.emulated.totals("wire_total", name="synch")["contentions"] == 0
        assert self.emulated.events("warning") == []
        assert self.emulated.events("crash") == []


@contextmanager
def switched_on(folder: Path, setup: Setup, master: bool = False) -> Iterator[Logger]:
    """An emulated logger in standby, System 2 or with the Master System 1.

    Parameters
    ----------
    folder
        An empty folder.
    """
    build_firmware()
    scenario = system_1(setup) if master else system_2(setup)
    with Emulated(scenario, folder) as emulated:
        logger = Logger(emulated, Laptop(VirtualPort(emulated)))
        logger.laptop.listen(BOOT)
        yield logger
