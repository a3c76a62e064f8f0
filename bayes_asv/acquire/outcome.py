"""What an acquisition came to: a recording, a verdict, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bayes_asv import __version__
from bayes_asv.acquire.dump import dumps_in, merged_dumps
from bayes_asv.acquire.frames import Address
from bayes_asv.acquire.laptop import Laptop
from bayes_asv.acquire.merge import Merged, merged
from bayes_asv.acquire.messages import Code
from bayes_asv.domain.recording import Recording

__all__ = ["Outcome", "concluded", "document", "lines"]


@dataclass(frozen=True)
class Outcome:
    """What came, and what of it may be relied on.

    Parameters
    ----------
    verdict : {'ok', 'incomplete', 'refused'}
        Whole; written with gaps; nothing to write.
    reasons, warnings : tuple of str
        Why it is not whole; what to know besides.
    recording : Recording or None
        In counts.
    blocks : tuple of dict
        What came of each board's block.
    drift, offset : float or None
        See :class:`bayes_asv.acquire.merge.Merged`.
    repeats, spoilt : int
        Commands sent again; pieces of the line that were neither frame nor text.
    events : tuple of str
        What the logger told, as it wrote it.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    recording: Recording | None
    blocks: tuple[dict[str, Any], ...]
    drift: float | None
    offset: float | None
    repeats: int
    spoilt: int
    events: tuple[str, ...]


def concluded(
    laptop: Laptop,
    faults: tuple[str, ...] = (),
    *,
    rate: float | None = None,
    source: str = "",
    warnings: tuple[str, ...] = (),
) -> Outcome:
    """Put together what a laptop holds.

    Parameters
    ----------
    laptop : Laptop
        After the talk, or after a replay.
    faults : tuple of str
        What went wrong in the talk.
    rate : float or None
        Rows a second, Hz, of a text dump that does not say it.
    source : str
        Name of the recording.
    warnings : tuple of str
        What happened besides, such as a cable that was out.
    """
    front, rear = (laptop.blocks[b] for b in (Address.SLAVE_1, Address.SLAVE_2))
    dumps = dumps_in(laptop.lines)
    made: Merged
    if front.come or rear.come or not dumps:
        made = merged(front, rear, source)
    else:
        made = merged_dumps(dumps, rate, source)
    seen = [e.said for e in laptop.events if e.code in (Code.POOR_SIGNAL, Code.NO_PULSE)]
    noticed = [*warnings, *made.warnings, *(s for s in dict.fromkeys(seen) if s not in faults)]
    # Nothing came: that no block came either says nothing more.
    nothing = not (front.come or rear.come or dumps)
    reasons = faults if nothing and faults else (*faults, *made.faults)
    verdict = "refused" if made.recording is None else "incomplete" if reasons else "ok"
    return Outcome(
        verdict,
        reasons,
        tuple(noticed),
        _noted(made.recording, (*faults, *warnings, *seen)),
        (_told(front, "front"), _told(rear, "rear")),
        made.drift,
        made.offset,
        laptop.repeats,
        laptop.spoilt,
        tuple(event.text for event in laptop.events),
    )


def _noted(recording: Recording | None, notes: tuple[str, ...]) -> Recording | None:
    """Add to the notes of a recording what the talk adds."""
    if recording is None:
        return None
    more = tuple(("note", note) for note in dict.fromkeys(notes))
    return Recording(
        recording.time,
        recording.values,
        recording.units,
        (*recording.metadata, *more),
        recording.source,
    )


def _told(block: Any, name: str) -> dict[str, Any]:
    head = block.head
    return {
        "board": name,
        "run": None if head is None else head.run,
        "frames": block.come,
        "frames_expected": block.expected,
        "rows": None if head is None else head.rows,
        "verified": block.verified,
        "overruns": None if head is None else head.overruns,
        "readings_at_rail": None if head is None else head.saturated,
        "frames_disputed": block.disputed,
        "fetched_again": block.dropped,
    }


def document(outcome: Outcome, recording: str, raw: str) -> dict[str, Any]:
    """Return the JSON document of schema ``bayes_asv/acquire/1``."""
    rows = 0 if outcome.recording is None else len(outcome.recording.time)
    rate = None if outcome.recording is None else outcome.recording.get("sample_rate")
    return {
        "schema": "bayes_asv/acquire/1",
        "verdict": outcome.verdict,
        "reasons": list(outcome.reasons),
        "warnings": list(outcome.warnings),
        "recording": None if outcome.recording is None else recording,
        "raw": raw,
        "rows": rows,
        "sample_rate": rate,
        "drift_ppm": None if outcome.drift is None else round(1e6 * outcome.drift, 4),
        "offset_us": None if outcome.offset is None else round(1e6 * outcome.offset, 3),
        "blocks": list(outcome.blocks),
        "events": list(outcome.events),
        "commands_repeated": outcome.repeats,
        "frames_spoilt": outcome.spoilt,
        "version": __version__,
    }


def lines(outcome: Outcome, recording: str, raw: str) -> list[str]:
    """Say it to a person."""
    if outcome.recording is None:
        said = [
            f"No recording was written: {outcome.reasons[0] if outcome.reasons else 'no rows'}."
        ]
        rest = outcome.reasons[1:]
    else:
        made = outcome.recording
        seconds = float(made.time[-1] - made.time[0])
        whole = "whole and checked" if outcome.verdict == "ok" else "NOT whole"
        said = [
            f"{recording}: {len(made.time)} rows at {made.get('sample_rate')}, {seconds:.3f} s, "
            f"{whole}."
        ]
        if outcome.drift is not None:
            said.append(
                f"The rear board's clock runs {1e6 * outcome.drift:+.2f} ppm against the front's; "
                "the recording's metadata correct it."
            )
        rest = outcome.reasons
    said += [f"Not whole: {reason}." for reason in rest]
    said += [f"Note: {warning}." for warning in outcome.warnings]
    said.append(f"Every byte that came is in {raw}.")
    return said
