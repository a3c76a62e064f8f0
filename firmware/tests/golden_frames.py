"""Golden frames of PROTOCOL.md, computed here by other code than the firmware's.

``python3 firmware/tests/golden_frames.py`` prints them; with ``--check FILE`` it compares FILE's
list
with what it computes and exits with 1 when they differ. Only the standard library is used.
"""

from __future__ import annotations

import binascii
import struct
import sys
from pathlib import Path


def body(to: int, sender: int, kind: int, seq: int, payload: bytes = b"") -> bytes:
    """One frame's body with its CRC-16; ``binascii.crc_hqx`` is CCITT with polynomial 0x1021."""
    start = bytes([to << 4 | sender, kind, seq]) + payload
    return start + struct.pack("<H", binascii.crc_hqx(start, 0xFFFF))


def cobs(data: bytes) -> bytes:
    """Consistent overhead byte stuffing for fewer than 254 bytes, with the closing zero."""
    return b"".join(bytes([len(part) + 1]) + part for part in data.split(b"\0")) + b"\0"


def packed(values: list[int]) -> bytes:
    """10-bit values from the lowest bit up, as in a ROWS frame."""
    whole = sum(value << 10 * j for j, value in enumerate(values))
    return whole.to_bytes(25, "little")


def frames() -> list[tuple[str, bytes]]:
    """Name and body of every golden frame."""
    values = [570, 641, 569, 641, 0, 1023, 1, 1022, 512, 511, 600, 650, 3, 5, 7, 11, 13, 17, 19, 23]
    head = struct.pack("<BBBHHHHBBBHBH", 1, 3, 83, 800, 800, 1, 5000, 4, 0, 0, 0, 0, 0xFFFF)
    times = struct.pack("<HHHIIIh", 1056, 2720, 8000, 0, 4013000, 801, -1)
    quality = struct.pack("<HHHHBHHHHBB", 400, 700, 9112, 512, 0, 600, 680, 10256, 128, 0, 0)
    block = head + times + quality + packed(values)
    return [
        ("HELLO", body(1, 0, 0x01, 1)),
        ("HELLO reply", body(0, 1, 0x81, 1, struct.pack("<BBBHBB", 1, 1, 0, 700, 3, 1))),
        ("CONFIG 800 Hz", body(1, 0, 0x02, 2, struct.pack("<HBBBHH", 800, 0, 0, 4, 200, 20))),
        ("CONFIG reply", body(0, 1, 0x82, 2, struct.pack("<BHH", 0, 1, 5000))),
        ("START", body(1, 0, 0x03, 3)),
        ("START reply", body(0, 1, 0x83, 3, b"\0")),
        ("GET 16 of board 1", body(1, 0, 0x07, 4, struct.pack("<BBI", 1, 0, 0xFFFF))),
        ("HEAD", body(0, 1, 0x40, 0, head + struct.pack("<I", binascii.crc32(block)))),
        ("TIMES", body(0, 1, 0x40, 1, times)),
        ("QUALITY", body(0, 1, 0x40, 2, quality)),
        ("ROWS", body(0, 1, 0x40, 3, packed(values))),
        ("DONE board 2", body(1, 0, 0x08, 5, struct.pack("<BI", 2, 0xCBF43926))),
        ("DONE refused", body(0, 1, 0x88, 5, b"\3")),
        ("EVENT saturated", body(0, 1, 0x41, 7, b"\4\2\0Slave 2: saturated")),
        ("HEARD", body(1, 0, 0x0C, 7)),
        ("ARM check", body(2, 1, 0x21, 9, b"\2")),
        ("ARM reply", body(1, 2, 0xA1, 9, b"\2")),
        ("TIME reply", body(1, 2, 0xA2, 10, struct.pack("<BBII", 2, 1, 123456, 0))),
    ]


def listing() -> str:
    """Lines ``name | body | on the serial line | radio packet`` in hex."""
    lines = []
    for name, data in frames():
        packet = (bytes([len(data)]) + data).ljust(32, b"\0")
        lines.append(f"{name} | {data.hex()} | {cobs(data).hex()} | {packet.hex()}")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Print the list, or compare it with a file's."""
    if sys.argv[1:2] != ["--check"]:
        print(listing(), end="")
        return 0
    text = Path(sys.argv[2]).read_text(encoding="utf-8")
    listed = text.split("```golden\n", 1)[1].split("```", 1)[0]
    if listed == listing():
        return 0
    print(
        "the golden frames in", sys.argv[2], "differ from tests/golden_frames.py", file=sys.stderr
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
