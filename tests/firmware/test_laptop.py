"""The tests' own laptop against the golden frames, and the wiring against the pin map."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware.emulated import EMULATOR, FIRMWARE
from tests.firmware.frames import (
    Block,
    Frame,
    Head,
    Times,
    block_of,
    cobs_decode,
    cobs_encode,
    decode_body,
    encode_body,
)


def golden() -> Iterator[tuple[str, bytes, bytes]]:
    """Name, body and bytes on the serial line of each golden frame."""
    text = (FIRMWARE / "PROTOCOL.md").read_text()
    found = re.search(r"```golden\n(.*?)```", text, re.DOTALL)
    assert found
    for line in found[1].splitlines():
        name, body, serial, _ = (part.strip() for part in line.split("|"))
        yield name, bytes.fromhex(body), bytes.fromhex(serial)


GOLDEN = {name: (body, serial) for name, body, serial in golden()}


@pytest.mark.parametrize("name", sorted(GOLDEN))
def test_golden_frames_are_read_and_written(name: str) -> None:
    body, serial = GOLDEN[name]
    assert cobs_encode(body) + b"\0" == serial
    assert cobs_decode(serial[:-1]) == body
    frame = decode_body(body)
    assert frame is not None
    assert encode_body(frame) == body


def test_the_golden_crc_is_over_the_head_and_the_payloads_that_follow() -> None:
    payloads = []
    for name in ("HEAD", "TIMES", "QUALITY", "ROWS"):
        frame = decode_body(GOLDEN[name][0])
        assert frame is not None
        payloads.append(frame.payload)
    everything = payloads[0][:-4] + b"".join(payloads[1:])
    assert payloads[0][-4:] == zlib.crc32(everything).to_bytes(4, "little")


@given(st.lists(st.integers(0, 1023), min_size=2, max_size=120), st.integers(0, 255))
def test_a_block_comes_back_and_a_spoilt_one_does_not(values: list[int], spoil: int) -> None:
    rows = len(values) // 2
    bits = "".join(f"{value:010b}"[::-1] for value in values[: 2 * rows])  # the lowest bit first
    bits += "0" * (-len(bits) % 200)
    packed = bytes(int(bits[i : i + 8][::-1], 2) for i in range(0, len(bits), 8))
    parts = [packed[i : i + 25] for i in range(0, len(packed), 25)]
    times = struct.pack(Times.FORMAT, 1056, 2720, 16000, 0, 4_157_756, 828, -8)
    head = struct.pack(
        Head.FORMAT, 1, 1, 3 + len(parts), rows, 800, 1, 5000, 4, 0, 0, 0, 0, 0xFFFF, 0
    )[:-4]
    after = [times, bytes(18), *parts]
    crc = zlib.crc32(head + b"".join(after)).to_bytes(4, "little")
    payloads = dict(enumerate([head + crc, *after]))
    block = block_of(payloads)
    assert block.rows.ravel().tolist() == values[: 2 * rows]
    assert block.elapsed() == 4_157_756
    last = bytearray(payloads[len(parts) + 2])
    last[spoil % 25] ^= 1 << spoil % 8
    with pytest.raises(ValueError, match="CRC-32 differs"):
        block_of(payloads | {len(parts) + 2: bytes(last)})


def test_an_end_mark_beyond_32_bits_is_unwrapped() -> None:
    """At 50 Hz a tick is 2 us; a ring that waits an hour and a half for its trigger wraps."""
    head = Head(1, 1, 4, 10, 50, 8, 10_000, 4, 1, 0, 0, 0, 0, 0)
    true = 2**32 + 12_345_678
    times = Times(1056, 2720, 500, 0, true % 2**32, (true - 500) // 10_000, 0)
    block = Block(head, times, b"", np.zeros((10, 2), dtype=np.int64))
    assert block.elapsed() == true


@given(st.binary(max_size=600))
def test_stuffing_comes_back_and_has_no_zero(data: bytes) -> None:
    stuffed = cobs_encode(data)
    assert 0 not in stuffed
    assert cobs_decode(stuffed) == data


@given(st.binary(max_size=26), st.integers(0, 15), st.integers(0, 255), st.integers(0, 7))
def test_a_spoilt_body_is_no_frame(payload: bytes, to: int, kind: int, bit: int) -> None:
    body = encode_body(Frame(to, 1, kind, 7, payload))
    assert decode_body(body) == Frame(to, 1, kind, 7, payload)
    for i in range(len(body)):
        assert decode_body(body[:i] + bytes([body[i] ^ 1 << bit]) + body[i + 1 :]) is None


def pins() -> dict[str, str]:
    """Pins by their names in the firmware, such as ``radio_ce: B0``."""
    text = (FIRMWARE / "src" / "pins.h").read_text()
    found = re.findall(r"(\w+) = \d+;\s*// P([A-D])(\d)", text)
    return {name: letter + number for name, letter, number in found}


@pytest.mark.parametrize("system", ["system_1", "system_2"])
def test_the_wiring_follows_the_pin_map(system: str) -> None:
    pin, text = pins(), (EMULATOR / f"{system}.wiring").read_text()
    radio = " ".join(
        f"{k}={pin[f'radio_{k}']}" for k in ("ce", "csn", "sck", "mosi", "miso", "irq")
    )
    boards = ("slave_1", "slave_2", "master") if system == "system_1" else ("slave_1", "slave_2")
    for board in boards:
        assert f"radio {board} {radio}\n" in text
    out, into = pin["synch_out"], pin["synch_in"]
    assert f"wire synch slave_1.{out} slave_1.{into} slave_2.{into}\n" in text
    assert f"button start slave_1.{pin['button']}\n" in text
    assert f"light status slave_1.{pin['status_light']}\n" in text
    bar = " ".join(f"slave_1.C{int(pin['bar_first'][1]) + i}" for i in range(5))
    assert f"bar rate {bar}\n" in text
    assert f"knob rate slave_1.{pin['adc_potentiometer']} " in text
    if system == "system_2":
        assert f"modem slave_1 cts={pin['modem_cts']} sleep={pin['modem_sleep']}\n" in text
