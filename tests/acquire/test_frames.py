"""Frames against the golden ones of PROTOCOL.md and against the tests' own laptop."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.acquire.frames import Frame, StreamDecoder, cobs_decode, cobs_encode, decode, encode
from bayes_asv.acquire.messages import Settings, parse_event, parse_hello
from tests.firmware import frames as reference

PROTOCOL = Path(__file__).parents[2] / "firmware" / "PROTOCOL.md"


def golden() -> Iterator[tuple[str, bytes, bytes]]:
    """Name, body and bytes on the serial line of each golden frame."""
    found = re.search(r"```golden\n(.*?)```", PROTOCOL.read_text("utf-8"), re.DOTALL)
    assert found
    for line in found[1].splitlines():
        name, body, serial, _ = (part.strip() for part in line.split("|"))
        yield name, bytes.fromhex(body), bytes.fromhex(serial)


GOLDEN = {name: (body, serial) for name, body, serial in golden()}


@pytest.mark.parametrize("name", sorted(GOLDEN))
def test_golden_frames_are_read_and_written(name: str) -> None:
    body, serial = GOLDEN[name]
    frame = decode(serial[:-1])
    assert frame == Frame(body[0] >> 4, body[0] & 15, body[1], body[2], body[3:-2])
    assert encode(frame) == serial
    assert StreamDecoder().feed(serial) == [frame]


def test_golden_payloads_mean_what_the_protocol_says() -> None:
    def payload(name: str) -> bytes:
        return GOLDEN[name][0][3:-2]

    assert Settings(rate=800).payload() == payload("CONFIG 800 Hz")
    hello = parse_hello(payload("HELLO reply"))
    assert hello is not None
    assert hello == (1, 1, 0, 700, 3, 1)
    frame = decode(GOLDEN["EVENT saturated"][1][:-1])
    assert frame is not None
    event = parse_event(frame)
    assert event is not None
    assert (event.code, event.board, event.text) == (4, 2, "Slave 2: saturated")


@given(st.binary(max_size=700))
def test_stuffing_is_that_of_the_tests_own_laptop(data: bytes) -> None:
    assert cobs_encode(data) == reference.cobs_encode(data)
    assert cobs_decode(cobs_encode(data)) == data


@given(st.binary(max_size=300))
def test_anything_is_unstuffed_as_by_the_tests_own_laptop(data: bytes) -> None:
    chunk = data.replace(b"\0", b"")
    assert cobs_decode(chunk) == reference.cobs_decode(chunk)


@given(st.binary(max_size=26), st.integers(0, 15), st.integers(0, 255), st.integers(1, 255))
def test_a_spoilt_byte_makes_no_frame(payload: bytes, to: int, kind: int, flip: int) -> None:
    frame = Frame(to, 1, kind, 7, payload)
    line = encode(frame)
    assert line == reference.cobs_encode(reference.encode_body(reference.Frame(*frame))) + b"\0"
    for place in range(len(line)):
        spoilt = line[:place] + bytes([line[place] ^ flip]) + line[place + 1 :]
        assert all(
            found == frame for found in StreamDecoder().feed(spoilt) if not isinstance(found, str)
        )


@given(
    st.lists(st.one_of(st.binary(max_size=20), st.sampled_from(["# end", "12 1 2 3 4"]))),
    st.lists(st.integers(1, 40)),
)
def test_portions_do_not_matter(pieces: list[bytes | str], sizes: list[int]) -> None:
    """Frames and lines in any order, cut anywhere, come out whole and in order."""
    expected: list[Frame | str] = []
    line = b""
    for piece in pieces:
        if isinstance(piece, str):
            expected.append(piece)
            line += piece.encode() + b"\r\n"
        else:
            expected.append(Frame(0, 1, 0x40, 3, piece))
            line += b"\0" + encode(Frame(0, 1, 0x40, 3, piece))
    splitter, found = StreamDecoder(), []
    for size in [*sizes, len(line)]:
        portion, line = line[:size], line[size:]
        found += splitter.feed(portion)
    found += splitter.feed(line)
    assert found == expected
    assert splitter.corrupted == 0


def test_noise_without_end_is_dropped_and_what_follows_is_read() -> None:
    splitter = StreamDecoder()
    frame = Frame(0, 1, 0x89, 4, b"abc")
    assert splitter.feed(b"\xff" * 100_000) == []
    assert splitter.feed(b"\0" + encode(frame)) == [frame]
    assert splitter.corrupted > 0
