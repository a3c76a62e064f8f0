"""The two boards' blocks on one time line: a recording in counts, its gaps told.

Slave 1's clock is the reference and Slave 2's is measured against it: both boards know when the
start mark and the end mark were, so Slave 2's seconds are `elapsed` of Slave 1 over `elapsed` of
Slave 2 of Slave 1's (firmware/PROTOCOL.md, Time). Readings stay as they were taken. What is known
of clocks goes into the metadata, where `bayes_asv.domain.recording.sample_offsets` finds it.
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

__all__ = ["Merged", "merged", "ranges"]

Array = NDArray[np.float64]

_BELIEVABLE: Final = 5e-3  # ratio; a crystal is good to 1e-4, a ceramic resonator to 5e-3
_BOARDS: Final = ("front", "rear")
_MOST_RANGES: Final = 12


@dataclass(frozen=True)
class Merged:
    """What two blocks give.

    Parameters
    ----------
    recording : Recording or None
        In counts; None where not two rows came.
    faults : tuple of str
        Why it is not whole; empty when it is.
    warnings : tuple of str
        What to know besides.
    drift : float or None
        How much Slave 2's clock runs fast, as a ratio.
    offset : float or None
        s by which Slave 2's rows begin after Slave 1's of the same number, at the first row.
    """

    recording: Recording | None
    faults: tuple[str, ...]
    warnings: tuple[str, ...]
    drift: float | None = None
    offset: float | None = None


@dataclass(frozen=True)
class _Clocks:
    """Rows of both boards in ticks of Slave 1's clock after the start mark."""

    first: tuple[float, float]
    drift: float | None
    synchronised: bool


def merged(front: Block, rear: Block, source: str = "") -> Merged:
    """Put two blocks together, however much of them has come.

    Row k of the recording holds row k of Slave 1 and the row of Slave 2 that began nearest to it;
    after a long wait for a trigger the two numbers differ by the drift. Rows that came from neither
    board are left out, cells that came from one are missing.

    Parameters
    ----------
    front, rear : Block
        Of Slave 1 and Slave 2.
    source : str
        For messages.

    Returns
    -------
    Merged
    """
    blocks = (front, rear)
    faults = [fault for block, name in zip(blocks, _BOARDS, strict=True)
              for fault in _faults_of(block, name)]  # fmt: skip
    heads = [block.head for block in blocks]
    head = heads[0] or heads[1]
    if head is None:
        return Merged(None, (*faults, "no block says how fast the rows were taken"), ())
    if heads[0] and heads[1] and _run_of(heads[0]) != _run_of(heads[1]):
        faults.append("the two blocks are not of one run, so the rear's is left out")
        blocks, heads = (front, Block(rear.board)), [heads[0], None]
    clocks, doubts = _clocks(blocks, heads)
    faults += doubts
    warnings = [said for own, name in zip(heads, _BOARDS, strict=True) for said in _said(own, name)]
    rate = head.actual_rate
    shift = round((clocks.first[1] - clocks.first[0]) / head.cycles)
    values, first = _table([block.readings() for block in blocks], shift)
    here = ~np.isnan(values).all(axis=0)
    if here.sum() < 2:
        return Merged(None, (*faults, "not two rows came"), tuple(warnings), clocks.drift)
    start = int(np.argmax(here))
    rows = np.flatnonzero(here)
    late = _lateness(clocks, head, first + start, shift)
    metadata = [
        ("sample_rate", f"{rate:.12g} Hz"),
        *_delays(blocks, clocks, late, head),
        *([] if clocks.drift is None else [("clock rear", f"{1e6 * clocks.drift:.4f} ppm")]),
        ("logger run", _run_words(head)),
        ("first row", f"{first + start + 1}"),
        *(("note", note) for note in (*faults, *warnings)),
    ]
    recording = Recording(
        (rows - start) / rate, values[:, rows], (COUNTS,) * 4, tuple(metadata), source
    )  # fmt: skip
    offset = late if clocks.synchronised else None
    return Merged(recording, tuple(faults), tuple(warnings), clocks.drift, offset)


def ranges(numbers: Array | NDArray[np.int64] | list[int]) -> str:
    """Write ascending numbers as ``3, 7 to 12``."""
    whole = np.asarray(numbers, dtype=np.int64)
    parts = np.split(whole, np.flatnonzero(np.diff(whole) > 1) + 1)
    said = [f"{p[0]}" if p.size == 1 else f"{p[0]} to {p[-1]}" for p in parts if p.size]
    more = f" and {len(said) - _MOST_RANGES} more stretches" if len(said) > _MOST_RANGES else ""
    return ", ".join(said[:_MOST_RANGES]) + more


def _faults_of(block: Block, name: str) -> list[str]:
    """Why a block is not whole, in words."""
    head = block.head
    if block.come == 0:
        return [f"nothing of the {name} board's block came"]
    if head is None:
        return [f"the head of the {name} board's block is missing, so its rows cannot be placed"]
    faults = []
    if block.complete and not block.verified:
        faults.append(f"the CRC-32 of the {name} board's block differs: its readings are left out")
    elif not block.complete:
        lost = np.flatnonzero(np.isnan(block.readings()).any(axis=1)) + 1
        if lost.size:
            rows = "row" if lost.size == 1 else "rows"
            faults.append(
                f"{lost.size} of {head.rows} {rows} of the {name} board did not come: "
                f"{ranges(lost)}"
            )
        faults.append(f"the {name} board's block is not complete, so its CRC-32 is not checked")
    if head.overruns:
        faults.append(
            f"the {name} board missed {head.overruns} rows (overruns): as many repeat the row "
            "before them"
        )
    return faults


def _said(head: Head | None, name: str) -> list[str]:
    if head is None or not head.saturated:
        return []
    return [f"{head.saturated} readings of the {name} board are 0 or 1023"]


def _run_of(head: Head) -> tuple[int, int, int]:
    return head.run, head.prescale, head.cycles


def _clocks(
    blocks: tuple[Block, Block], heads: list[Head | None]
) -> tuple[_Clocks, list[str]]:  # fmt: skip
    """Where both boards' first rows lie, and what about it is not known."""
    times = [block.times for block in blocks]
    if None in heads:
        return _Clocks((0.0, 0.0), None, False), []
    if times[0] is None or times[1] is None:
        return _Clocks((0.0, 0.0), None, False), [
            "the boards' times did not come: that both began together is assumed, and the drift "
            "of the rear's clock is not known"
        ]
    # No drift without both marks; the rows are then where their numbers say.
    ends = [block.elapsed() for block in blocks]
    drift = ends[1] / ends[0] - 1.0 if ends[0] and ends[1] else None
    doubts = []
    if drift is None:
        doubts.append("the end mark is missing: the drift of the rear's clock is not known")
    elif abs(drift) > _BELIEVABLE:
        doubts.append(
            f"a drift of {1e6 * drift:.0f} ppm is not believable: the rear's clock is not corrected"
        )
        drift = None
    first = [_first_tick(own, head) for own, head in zip(times, heads, strict=True)]
    return _Clocks((first[0], first[1] / (1.0 + (drift or 0.0))), drift, True), doubts


def _first_tick(times: Times | None, head: Head | None) -> float:
    assert times is not None
    assert head is not None
    return float(times.lead + times.first_row * head.cycles)


def _lateness(clocks: _Clocks, head: Head, row: int, shift: int) -> float:
    """Seconds by which Slave 2's row begins after the row of Slave 1 beside it."""
    slower = 1.0 + (clocks.drift or 0.0)
    own = clocks.first[0] + row * head.cycles
    other = clocks.first[1] + (row - shift) * head.cycles / slower
    return float(other - own) * head.prescale / CPU


def _delays(
    blocks: tuple[Block, Block], clocks: _Clocks, late: float, head: Head
) -> list[tuple[str, str]]:
    """Delays of the four channels after the stamps; the boards' own are alike."""
    known = blocks[0].times or blocks[1].times
    if known is None:
        return [("note", "the channels' delays did not come: the vehicle's are used")]
    said = []
    for channel in CHANNELS:
        cycles = known.wheel_delay if channel.endswith("wheel") else known.chassis_delay
        delay = cycles / CPU
        if channel.startswith("rear"):
            delay = delay / (1.0 + (clocks.drift or 0.0)) + late
        said.append((f"delay {channel}", f"{delay:.9f} s"))
    return said


def _table(readings: list[Array], shift: int) -> tuple[Array, int]:
    """Both boards' readings by Slave 1's row numbers, shape (4, rows), and the first of them."""
    front, rear = readings
    first, last = min(0, shift), max(len(front), len(rear) + shift)
    values = np.full((len(CHANNELS), last - first), np.nan)
    values[:2, -first : len(front) - first] = front.T
    values[2:, shift - first : shift - first + len(rear)] = rear.T
    return values, first


def _run_words(head: Head) -> str:
    synch = SYNCHS[head.synch] if head.synch < len(SYNCHS) else "unknown"
    trigger = "" if head.trigger is None else f", trigger at row {head.trigger + 1}"
    return f"{head.run}, synchronised by {synch}, {head.readings} readings averaged{trigger}"
