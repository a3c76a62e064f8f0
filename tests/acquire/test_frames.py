"""Frames against the golden frames of PROTOCOL.md and a second implementation in the tests."""

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
    match = re.search(r"```golden\n(.*?)```", PROTOCOL.read_text("utf-8"), re.DOTALL)
    assert match
    for row in match[1].splitlines():
        name, body, serial, _ = (part.strip() for part in row.split("|"))
        yield name, bytes.fromhex(body), bytes.fromhex(serial)


GOLDEN = {name: (body, serial) for name, body, serial in golden()}


@pytest.mark.parametrize("name", sorted(GOLDEN))
def test_golden_frames_are_decoded_and_encoded(name: str) -> None:
    body, serial = GOLDEN[name]
    frame = decode(serial[:-1])
    assert frame == Frame(body[0] >> 4, body[0] & 15, body[1], body[2], body[3:-2])
    assert encode(frame) == serial
    assert StreamDecoder().feed(serial) == [frame]


def test_golden_payloads() -> None:
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
def test_cobs_encode(data: bytes) -> None:
    assert cobs_encode(data) == reference.cobs_encode(data)
    assert cobs_decode(cobs_encode(data)) == data


@given(st.binary(max_size=300))
def test_cobs_decode(data: bytes) -> None:
    chunk = data.replace(b"\0", b"")
    assert cobs_decode(chunk) == reference.cobs_decode(chunk)


@given(st.binary(max_size=26), st.integers(0, 15), st.integers(0, 255), st.integers(1, 255))
def test_corrupted_byte_gives_no_frame(payload: bytes, to: int, kind: int, mask: int) -> None:
    frame = Frame(to, 1, kind, 7, payload)
    sent = encode(frame)
    assert sent == reference.cobs_encode(reference.encode_body(reference.Frame(*frame))) + b"\0"
    for index in range(len(sent)):
        corrupted = sent[:index] + bytes([sent[index] ^ mask]) + sent[index + 1 :]
        assert all(
            item == frame for item in StreamDecoder().feed(corrupted) if not isinstance(item, str)
        )


@given(
    st.lists(st.one_of(st.binary(max_size=20), st.sampled_from(["# end", "12 1 2 3 4"]))),
    st.lists(st.integers(1, 40)),
)
def test_chunk_size_has_no_effect(items: list[bytes | str], sizes: list[int]) -> None:
    """Frames and text lines in any order, cut anywhere, are decoded completely and in order."""
    expected: list[Frame | str] = []
    stream = b""
    for item in items:
        if isinstance(item, str):
            expected.append(item)
            stream += item.encode() + b"\r\n"
        else:
            expected.append(Frame(0, 1, 0x40, 3, item))
            stream += b"\0" + encode(Frame(0, 1, 0x40, 3, item))
    decoder, decoded = StreamDecoder(), []
    for size in [*sizes, len(stream)]:
        chunk, stream = stream[:size], stream[size:]
        decoded += decoder.feed(chunk)
    decoded += decoder.feed(stream)
    assert decoded == expected
    assert decoder.corrupted == 0


def test_endless_noise_is_discarded_and_the_next_frame_is_decoded() -> None:
    decoder = StreamDecoder()
    frame = Frame(0, 1, 0x89, 4, b"abc")
    assert decoder.feed(b"\xff" * 100_000) == []
    assert decoder.feed(b"\0" + encode(frame)) == [frame]
    assert decoder.corrupted > 0
