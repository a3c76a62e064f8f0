"""The port, on pseudo-terminals: bytes on disk first, and a plug that is pulled."""

from __future__ import annotations

import os
import threading
import time
import tty
from pathlib import Path
from types import SimpleNamespace

import pytest

from bayes_asv.acquire.port import GoneError, KeptPort, found_port
from bayes_asv.domain.errors import InputError


class Plug:
    """A pseudo-terminal behind a name, that can be pulled and put in again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.put_in()

    def put_in(self) -> None:
        self.ours, self.theirs = os.openpty()
        tty.setraw(self.theirs)
        self.path.symlink_to(os.ttyname(self.theirs))

    def pull(self) -> None:
        self.path.unlink()
        os.close(self.ours)
        os.close(self.theirs)


def test_bytes_are_on_disk_before_they_are_given(tmp_path: Path) -> None:
    plug, keep = Plug(tmp_path / "port"), tmp_path / "raw"
    with KeptPort(str(plug.path), keep) as port:
        assert port.write(b"hello") == 5
        assert os.read(plug.ours, 10) == b"hello"
        os.write(plug.ours, b"\x01\x00\r\n\x11\x13")
        got = b""
        while len(got) < 6:
            got += port.read(max(1, port.in_waiting))
            assert keep.read_bytes() == got
        assert got == b"\x01\x00\r\n\x11\x13"
        port.timeout = 0.05
        assert port.read() == b""
    plug.pull()


def test_a_plug_that_is_pulled_stops_the_clock_until_it_is_back(tmp_path: Path) -> None:
    plug, said = Plug(tmp_path / "port"), list[str]()
    with KeptPort(str(plug.path), tmp_path / "raw", say=said.append) as port:
        plug.pull()
        threading.Timer(0.8, plug.put_in).start()
        port.timeout = 0.2
        before, began = port.clock(), time.monotonic()
        while not port.losses or not said[-1].startswith(f"{plug.path} is back"):
            assert port.read() == b""
        assert time.monotonic() - began > 0.7
        assert port.clock() - before < 0.3
        os.write(plug.ours, b"more")
        port.timeout = 2.0
        assert port.read(4) == b"more"
        assert port.losses == 1
    assert (tmp_path / "raw").read_bytes() == b"more"
    plug.pull()


def test_one_does_not_wait_for_ever(tmp_path: Path) -> None:
    plug = Plug(tmp_path / "port")
    with KeptPort(str(plug.path), tmp_path / "raw", patience=0.4) as port:
        plug.pull()
        with pytest.raises(GoneError, match="did not come back"):
            port.read()


def test_what_was_kept_is_not_written_over(tmp_path: Path) -> None:
    plug, keep = Plug(tmp_path / "port"), tmp_path / "raw"
    keep.write_bytes(b"older")
    with pytest.raises(InputError, match="--resume"):
        KeptPort(str(plug.path), keep)
    with KeptPort(str(plug.path), keep, resume=True) as port:
        os.write(plug.ours, b"+new")
        port.read(4)
    assert keep.read_bytes() == b"older+new"
    with pytest.raises(InputError, match="folder does not exist"):
        KeptPort(str(plug.path), tmp_path / "none" / "raw")
    plug.pull()


def test_a_port_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        KeptPort(str(tmp_path / "nowhere"), tmp_path / "raw")
    assert not (tmp_path / "raw").exists()


def a_port(device: str, vid: int | None, description: str) -> SimpleNamespace:
    return SimpleNamespace(device=device, vid=vid, description=description, name=device[5:])


def test_the_one_port_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    board = a_port("/dev/ttyS0", None, "n/a")
    first = a_port("/dev/ttyUSB0", 0x0403, "FT232R")
    second = a_port("/dev/ttyUSB1", 0x067B, "PL2303")

    def there(*ports: SimpleNamespace) -> None:
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: list(ports))

    there(board, first)
    assert found_port() == "/dev/ttyUSB0"
    there(board)
    with pytest.raises(InputError, match="none is there"):
        found_port()
    there(first, second)
    with pytest.raises(InputError, match=r"ttyUSB0 \(FT232R\), /dev/ttyUSB1 \(PL2303\)"):
        found_port()
