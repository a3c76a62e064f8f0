"""Bytes of the serial line cut into frames and lines of text, as they come."""

from __future__ import annotations

import re
from typing import Final

from bayes_asv.acquire.frames import LONGEST_BODY, Frame, decoded

__all__ = ["Splitter"]

_LONGEST_CHUNK: Final = 128  # bytes; no frame (32) and no line (100) is longer
_LINE: Final = re.compile(rb"([\x20-\x7e]+)\r?\n")


class Splitter:
    """Takes bytes in any portions, gives frames and lines.

    A zero byte ends a frame. Printable characters up to a line feed are a line: no frame to the
    laptop begins so, since its address byte is not printable. All else is spoilt and counted.

    Attributes
    ----------
    spoilt : int
        Chunks that were neither.
    """

    def __init__(self) -> None:
        self.spoilt = 0
        self._bytes = bytearray()

    def feed(self, data: bytes) -> list[Frame | str]:
        """Take bytes; what has become whole with them, in order."""
        self._bytes += data
        found: list[Frame | str] = []
        while self._bytes:
            line = _LINE.match(self._bytes)
            if line is not None:
                found.append(line[1].decode("ascii"))
                del self._bytes[: line.end()]
                continue
            end = self._bytes.find(0)
            if end < 0:
                if len(self._bytes) > _LONGEST_CHUNK:
                    self._give_up()
                    continue
                break
            chunk = bytes(self._bytes[:end])
            del self._bytes[: end + 1]
            if chunk:
                found += self._frame(chunk)
        return found

    def _frame(self, chunk: bytes) -> list[Frame | str]:
        # A frame is told from a spoilt one by its CRC; it may follow noise that has no zero byte
        # behind it, such as half a line, but then nobody knows where it begins.
        frame = decoded(chunk) if len(chunk) <= LONGEST_BODY + 1 else None
        if frame is None:
            self.spoilt += 1
            return []
        return [frame]

    def _give_up(self) -> None:
        """Drop what can be neither frame nor line, up to where one may begin."""
        self.spoilt += 1
        end = self._bytes.find(b"\n")
        del self._bytes[: end + 1 if end >= 0 else len(self._bytes)]
