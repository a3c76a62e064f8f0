"""Merging of the two boards' blocks into a recording in counts, with its gaps noted.

Slave 1's clock is the reference, against which Slave 2's is measured: both boards recorded the
start mark and the end mark, so that the ratio of the clocks is that of their elapsed ticks
(firmware/PROTOCOL.md, Time). Readings stay as they were taken. The metadata describe the clocks,
and `bayes_asv.domain.recording.sample_offsets` evaluates them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.acquire.blocks import CPU, Block, Head, Times
from bayes_asv.acquire.messages import SYNCHS
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.recording import COUNTS, Recording

__all__ = ["MergedRun", "format_ranges", "merge_blocks"]

Array = NDArray[np.float64]

_MAX_DRIFT: Final = 5e-3  # a crystal has 1e-4, a ceramic resonator 5e-3
_BOARDS: Final = ("front", "rear")
_MAX_RANGES: Final = 12


@dataclass(frozen=True)
class MergedRun:
    """Recording of two blocks.

    Parameters
    ----------
    recording : Recording or None
        In counts; None with fewer than two rows.
    faults : tuple of str
        Why it is incomplete; empty if it is complete.
    warnings : tuple of str
        Other notes.
    drift : float or None
        Relative error of Slave 2's clock against Slave 1's, positive if it runs fast.
    offset : float or None
        Time by which Slave 2's rows start after Slave 1's of the same number, at the first row, s.
    """

    recording: Recording | None
    faults: tuple[str, ...]
    warnings: tuple[str, ...]
    drift: float | None = None
    offset: float | None = None


@dataclass(frozen=True)
class _Clocks:
    """First rows of both boards, in ticks of Slave 1's clock after the start mark."""

    first: tuple[float, float]
    drift: float | None
    synchronised: bool


def merge_blocks(front: Block, rear: Block, source: str = "") -> MergedRun:
    """Merge two blocks, complete or not.

    Row k of the recording holds row k of Slave 1 and the row of Slave 2 that started nearest to it;
    after a long wait for a trigger the two numbers differ by the drift. Rows that neither board
    delivered are left out; cells that one board did not deliver are missing.

    Parameters
    ----------
    front, rear : Block
        Of Slave 1 and Slave 2.
    source : str
        For messages.

    Returns
    -------
    MergedRun
    """
    blocks = (front, rear)
    faults = [fault for block, name in zip(blocks, _BOARDS, strict=True)
              for fault in _block_faults(block, name)]  # fmt: skip
    heads = [block.head for block in blocks]
    head = heads[0] or heads[1]
    if head is None:
        return MergedRun(None, (*faults, "no block states the sampling rate"), ())
    if heads[0] and heads[1] and _run_key(heads[0]) != _run_key(heads[1]):
        faults.append("the two blocks are not of one run, so the rear board's is left out")
        blocks, heads = (front, Block(rear.board)), [heads[0], None]
    clocks, clock_faults = _clocks(blocks, heads)
    faults += clock_faults
    warnings = [
        warning
        for own, name in zip(heads, _BOARDS, strict=True)
        for warning in _warnings(own, name)
    ]
    rate = head.actual_rate
    shift = round((clocks.first[1] - clocks.first[0]) / head.cycles)
    values, first = _align([block.readings() for block in blocks], shift)
    present = ~np.isnan(values).all(axis=0)
    if present.sum() < 2:
        return MergedRun(
            None, (*faults, "fewer than two rows arrived"), tuple(warnings), clocks.drift
        )
    start = int(np.argmax(present))
    rows = np.flatnonzero(present)
    offset = _rear_offset(clocks, head, first + start, shift)
    metadata = [
        ("sample_rate", f"{rate:.12g} Hz"),
        *_delays(blocks, clocks, offset),
        *([] if clocks.drift is None else [("clock rear", f"{1e6 * clocks.drift:.4f} ppm")]),
        ("logger run", _run_description(head)),
        ("first row", f"{first + start + 1}"),
        *(("note", note) for note in (*faults, *warnings)),
    ]
    recording = Recording(
        (rows - start) / rate, values[:, rows], (COUNTS,) * 4, tuple(metadata), source
    )  # fmt: skip
    return MergedRun(
        recording,
        tuple(faults),
        tuple(warnings),
        clocks.drift,
        offset if clocks.synchronised else None,
    )


def format_ranges(numbers: Array | NDArray[np.int64] | list[int]) -> str:
    """Format ascending numbers as ``3, 7 to 12``."""
    whole = np.asarray(numbers, dtype=np.int64)
    parts = np.split(whole, np.flatnonzero(np.diff(whole) > 1) + 1)
    ranges = [f"{p[0]}" if p.size == 1 else f"{p[0]} to {p[-1]}" for p in parts if p.size]
    more = f" and {len(ranges) - _MAX_RANGES} more ranges" if len(ranges) > _MAX_RANGES else ""
    return ", ".join(ranges[:_MAX_RANGES]) + more


def _block_faults(block: Block, name: str) -> list[str]:
    """Why a block is incomplete."""
    head = block.head
    if block.received == 0:
        return [f"nothing of the {name} board's block was received"]
    if head is None:
        return [f"the head of the {name} board's block is missing, so its rows cannot be placed"]
    faults = []
    if block.complete and not block.verified:
        faults.append(f"the CRC-32 of the {name} board's block differs: its readings are left out")
    elif not block.complete:
        lost = np.flatnonzero(np.isnan(block.readings()).any(axis=1)) + 1
        if lost.size:
            verb = "was" if lost.size == 1 else "were"
            faults.append(
                f"{lost.size} of {head.rows} rows of the {name} board {verb} not received: "
                f"{format_ranges(lost)}"
            )
        faults.append(f"the {name} board's block is incomplete, so its CRC-32 cannot be checked")
    if head.overruns:
        faults.append(
            f"the {name} board missed {head.overruns} rows (overruns): as many repeat the row "
            "before them"
        )
    return faults


def _warnings(head: Head | None, name: str) -> list[str]:
    if head is None or not head.saturated:
        return []
    return [f"{head.saturated} readings of the {name} board are 0 or 1023"]


def _run_key(head: Head) -> tuple[int, int, int]:
    return head.run, head.prescale, head.cycles


def _clocks(
    blocks: tuple[Block, Block], heads: list[Head | None]
) -> tuple[_Clocks, list[str]]:  # fmt: skip
    """Time of both boards' first rows, and faults of the synchronisation."""
    times = [block.times for block in blocks]
    if None in heads:
        return _Clocks((0.0, 0.0), None, False), []
    if times[0] is None or times[1] is None:
        return _Clocks((0.0, 0.0), None, False), [
            "the boards' times were not received: a simultaneous start is assumed, and "
            "the drift of the rear board's clock is unknown"
        ]
    # The drift needs both marks; without it the rows are placed by their numbers.
    ends = [block.elapsed() for block in blocks]
    drift = ends[1] / ends[0] - 1.0 if ends[0] and ends[1] else None
    faults = []
    if drift is None:
        faults.append("the end mark is missing: the drift of the rear board's clock is unknown")
    elif abs(drift) > _MAX_DRIFT:
        faults.append(
            f"a drift of {1e6 * drift:.0f} ppm is implausible: the rear board's clock is not "
            "corrected"
        )
        drift = None
    first = [_first_tick(own, head) for own, head in zip(times, heads, strict=True)]
    return _Clocks((first[0], first[1] / (1.0 + (drift or 0.0))), drift, True), faults


def _first_tick(times: Times | None, head: Head | None) -> float:
    assert times is not None
    assert head is not None
    return float(times.lead + times.first_row * head.cycles)


def _rear_offset(clocks: _Clocks, head: Head, row: int, shift: int) -> float:
    """Time by which Slave 2's row starts after the row of Slave 1 beside it, s."""
    clock_ratio = 1.0 + (clocks.drift or 0.0)
    front = clocks.first[0] + row * head.cycles
    rear = clocks.first[1] + (row - shift) * head.cycles / clock_ratio
    return float(rear - front) * head.prescale / CPU


def _delays(blocks: tuple[Block, Block], clocks: _Clocks, offset: float) -> list[tuple[str, str]]:
    """Delays of the four channels after the stamps; those within a board are the same on both."""
    times = blocks[0].times or blocks[1].times
    if times is None:
        return [("note", "the channels' delays were not received: the vehicle file's are used")]
    delays = []
    for channel in CHANNELS:
        cycles = times.wheel_delay if channel.endswith("wheel") else times.chassis_delay
        delay = cycles / CPU
        if channel.startswith("rear"):
            delay = delay / (1.0 + (clocks.drift or 0.0)) + offset
        delays.append((f"delay {channel}", f"{delay:.9f} s"))
    return delays


def _align(readings: list[Array], shift: int) -> tuple[Array, int]:
    """Both boards' readings by Slave 1's row numbers, shape (4, rows), and the first number."""
    front, rear = readings
    first, last = min(0, shift), max(len(front), len(rear) + shift)
    values = np.full((len(CHANNELS), last - first), np.nan)
    values[:2, -first : len(front) - first] = front.T
    values[2:, shift - first : shift - first + len(rear)] = rear.T
    return values, first


def _run_description(head: Head) -> str:
    synch = SYNCHS[head.synch] if head.synch < len(SYNCHS) else "unknown"
    trigger = "" if head.trigger is None else f", trigger at row {head.trigger + 1}"
    return f"{head.run}, synchronised by {synch}, {head.readings} readings averaged{trigger}"
