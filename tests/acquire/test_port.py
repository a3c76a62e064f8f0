"""The port, on pseudo-terminals: saved bytes, and an unplugged cable."""

from __future__ import annotations

import os
import threading
import time
import tty
from pathlib import Path
from types import SimpleNamespace

import pytest

from bayes_asv.acquire.port import PortLostError, SavingPort, find_port
from bayes_asv.domain.errors import InputError


class Cable:
    """A pseudo-terminal behind a name, which can be unplugged and plugged in again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plug_in()

    def plug_in(self) -> None:
        self.ours, self.theirs = os.openpty()
        tty.setraw(self.theirs)
        self.path.symlink_to(os.ttyname(self.theirs))

    def unplug(self) -> None:
        self.path.unlink()
        os.close(self.ours)
        os.close(self.theirs)


def test_bytes_are_saved_before_they_are_returned(tmp_path: Path) -> None:
    cable, keep = Cable(tmp_path / "port"), tmp_path / "raw"
    with SavingPort(str(cable.path), keep) as port:
        assert port.write(b"hello") == 5
        assert os.read(cable.ours, 10) == b"hello"
        os.write(cable.ours, b"\x01\x00\r\n\x11\x13")
        received = b""
        while len(received) < 6:
            received += port.read(max(1, port.in_waiting))
            assert keep.read_bytes() == received
        assert received == b"\x01\x00\r\n\x11\x13"
        port.timeout = 0.05
        assert port.read() == b""
    cable.unplug()


def test_unplugged_cable_stops_the_clock(tmp_path: Path) -> None:
    cable, messages = Cable(tmp_path / "port"), list[str]()
    with SavingPort(str(cable.path), tmp_path / "raw", say=messages.append) as port:
        cable.unplug()
        threading.Timer(0.8, cable.plug_in).start()
        port.timeout = 0.2
        before, began = port.clock(), time.monotonic()
        while not port.losses or not messages[-1].startswith(f"{cable.path} is back"):
            assert port.read() == b""
        assert time.monotonic() - began > 0.7
        assert port.clock() - before < 0.3
        os.write(cable.ours, b"more")
        port.timeout = 2.0
        assert port.read(4) == b"more"
        assert port.losses == 1
    assert (tmp_path / "raw").read_bytes() == b"more"
    cable.unplug()


def test_waiting_for_a_cable_is_limited(tmp_path: Path) -> None:
    cable = Cable(tmp_path / "port")
    with SavingPort(str(cable.path), tmp_path / "raw", patience=0.4) as port:
        cable.unplug()
        with pytest.raises(PortLostError, match="did not come back"):
            port.read()


def test_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    cable, keep = Cable(tmp_path / "port"), tmp_path / "raw"
    keep.write_bytes(b"older")
    with pytest.raises(InputError, match="--resume"):
        SavingPort(str(cable.path), keep)
    with SavingPort(str(cable.path), keep, resume=True) as port:
        os.write(cable.ours, b"+new")
        port.read(4)
    assert keep.read_bytes() == b"older+new"
    with pytest.raises(InputError, match="folder does not exist"):
        SavingPort(str(cable.path), tmp_path / "none" / "raw")
    cable.unplug()


def test_missing_port_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        SavingPort(str(tmp_path / "nowhere"), tmp_path / "raw")
    assert not (tmp_path / "raw").exists()


def a_port(device: str, vid: int | None, description: str) -> SimpleNamespace:
    return SimpleNamespace(device=device, vid=vid, description=description, name=device[5:])


def test_find_port(monkeypatch: pytest.MonkeyPatch) -> None:
    board = a_port("/dev/ttyS0", None, "n/a")
    first = a_port("/dev/ttyUSB0", 0x0403, "FT232R")
    second = a_port("/dev/ttyUSB1", 0x067B, "PL2303")

    def set_ports(*ports: SimpleNamespace) -> None:
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: list(ports))

    set_ports(board, first)
    assert find_port() == "/dev/ttyUSB0"
    set_ports(board)
    with pytest.raises(InputError, match="none was found"):
        find_port()
    set_ports(first, second)
    with pytest.raises(InputError, match=r"ttyUSB0 \(FT232R\), /dev/ttyUSB1 \(PL2303\)"):
        find_port()
