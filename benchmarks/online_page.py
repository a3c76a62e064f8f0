"""Writes ``docs/online.md`` from the results of :mod:`benchmarks.online`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bayes_asv.domain.files import write_atomically
from benchmarks.online_picture import draw_picture

__all__ = ["PAGE", "page", "write_page"]

Row = dict[str, Any]

PAGE = Path(__file__).parents[1] / "docs" / "online.md"
_TEXT = Path(__file__).parent / "online_page.md.in"


def write_page(kept: Row) -> None:
    """Write the page and its picture.

    Parameters
    ----------
    kept : dict
        All parts of :mod:`benchmarks.online`.
    """
    draw_picture(kept)
    write_atomically(PAGE, page(kept).encode())


def page(kept: Row) -> str:
    """Put tables and figures into the page's text.

    Parameters
    ----------
    kept : dict
        All parts of :mod:`benchmarks.online`.

    Returns
    -------
    str
        Markdown.
    """
    text = _TEXT.read_text("utf-8")
    for name, value in _figures(kept).items():
        if f"@{name}@" not in text:
            raise ValueError(f"the page has no place for {name}")
        text = text.replace(f"@{name}@", value)
    if "@" in text:
        raise ValueError(f"no figure for {text[text.index('@') :].split()[0]}")
    return text


def _figures(kept: Row) -> dict[str, str]:
    coverage, fifty = kept["coverage"], kept["coverage"]["nees_of_50"]
    low, high = fifty["band95"]
    watches = kept["alarms"]
    return {
        "SEED": str(coverage["seed"]),
        "COVERAGE": _coverage(coverage),
        "NEES": f"{fifty['mean']:.2f} (95 % of filters that are right: {low:.2f} to {high:.2f})",
        "WHITE": _white(kept["white"]["all"]),
        "AGAINST": _against(kept["estimate"]),
        "SPEED": _speed(kept["speed"]),
        "LOAD": f"{kept['speed']['load']:.0f}",
        "CHANGE": _change(kept["change"]),
        "ALARMS": _alarms(watches),
        "AFTER": _after(watches["after crossing"]["seconds"]),
    }


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _span(ends: list[float], digits: int = 1, scale: float = 100.0) -> str:
    return " to ".join(f"{scale * v:.{digits}f}" for v in ends)


def _coverage(found: Row) -> str:
    def row(name: str, part: Row) -> list[str]:
        return [
            name,
            str(part["runs"]),
            f"{100.0 * part['coverage']:.1f} % ({_span(part['coverage_interval'])})",
            f"{part['median_error_percent']:.2f} %",
            f"{part['median_sd_percent']:.2f} %",
            f"{100.0 * part['nis_inside']:.0f} %",
            f"{part['nees']:.2f} ({_span(part['nees_band95'], 2, 1.0)})",
        ]

    names = {"exact": "exact", "declared": "as declared"}
    rows = [
        row(f"{names[name.split(', ')[0]]}, {', '.join(name.split(', ')[1:])}", part)
        for name, part in found["parts"].items()
    ]
    head = ["given values, drive", "runs", "95 % intervals that hold", "median error",
            "one deviation", "NIS inside its band", "NEES (95 % band)"]  # fmt: skip
    return _table(head, [row("**all**", found["all"]), row("**exact**", found["exact"]), *rows])


def _white(found: Row) -> str:
    return (
        f"{100.0 * found['coverage']:.1f} % of the intervals hold over {found['runs']} drives, "
        f"NEES is {found['nees']:.2f} and the mean NIS {found['nis_mean']:.3f}, inside its band in "
        f"{100.0 * found['nis_inside']:.0f} % of the runs"
    )


def _against(found: Row) -> str:
    return (
        f"{found['drives']} drives: the medians are {found['shift_median']:.2f} of its deviation "
        f"apart in the middle and {found['shift_largest']:.2f} at most, the deviations "
        f"{found['ratio_least']:.2f} to {found['ratio_largest']:.2f} times as wide"
    )


def _speed(found: Row) -> str:
    rows = [
        [
            {"exact": "3 (given values exact)", "declared": "7 (mass, weight share, springs)"}[
                name
            ],
            f"{found[name]['compiled_steps_a_second']:,.0f}",
            f"{found[name]['filterpy_steps_a_second']:,.0f}",
            f"{found[name]['ratio']:,.0f}",
            f"{found[name]['replay_times_faster']:.0f} (median {found[name]['replay_median']:.0f})",
        ]
        for name in ("exact", "declared")
    ]
    head = ["parameters learnt", "compiled, steps a second", "filterpy", "ratio",
            "a minute at 800 Hz, times faster than it lasted"]  # fmt: skip
    return _table(head, rows)


def _change(found: Row) -> str:
    rows = [
        [
            name,
            str(part["drives"]),
            f"{part['lag_median']:.2f} s, {part['lag_largest']:.2f} s",
            f"{part['rms_percent_median']:.2f} %",
            f"{100.0 * part['consistent_share']:.1f} %",
        ]
        for name, part in (
            ("`--forget 60`", found["forget 60 s"]),
            ("taken for constant", found["constant"]),
        )
    ]
    head = ["parameters", "drives", "lag: median, largest", "rms error of the course",
            "time in which nothing was amiss"]  # fmt: skip
    return _table(head, rows)


def _alarms(found: Row) -> str:
    rows = [
        [
            name,
            f"{part['hours']:.1f} in {part['watches']} cars",
            str(part["alarms"]),
            f"{part['an_hour']:.2f} ({part['interval95'][0]:.2f} to {part['interval95'][1]:.2f})",
            f"{100.0 * part['told']:.2f} %",
        ]
        for name, part in found.items()
        if isinstance(part, dict) and "an_hour" in part
    ]
    head = ["front damper", "hours", "false alarms", "an hour (95 %)",
            "time in which one could have come"]  # fmt: skip
    return _table(head, rows)


def _after(waits: list[float | None]) -> str:
    came = sorted(w for w in waits if w is not None)
    if not came:
        return f"no alarm in {len(waits)} drives"
    return (
        f"{len(came)} of {len(waits)} drives brought the alarm, {came[len(came) // 2]:.1f} s after "
        f"the crossing in the middle, {came[0]:.1f} to {came[-1]:.1f} s in all"
    )
