"""Generate ``docs/online.md`` from the results of :mod:`benchmarks.online`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from bayes_asv.domain.files import write_atomically
from benchmarks.online_picture import draw_picture

__all__ = ["PAGE", "page", "write_page"]

Row = dict[str, Any]

PAGE = Path(__file__).parents[1] / "docs" / "online.md"
_TEXT = Path(__file__).parent / "online_page.md.in"


def write_page(results: Row) -> None:
    """Write the page and its picture.

    Parameters
    ----------
    results : dict
        All parts of :mod:`benchmarks.online`.
    """
    draw_picture(results)
    write_atomically(PAGE, page(results).encode())


def page(results: Row) -> str:
    """Insert tables and figures into the template.

    Parameters
    ----------
    results : dict
        All parts of :mod:`benchmarks.online`.

    Returns
    -------
    str
        Markdown.
    """
    text = _TEXT.read_text("utf-8")
    for name, value in _figures(results).items():
        if f"@{name}@" not in text:
            raise ValueError(f"the template has no place for {name}")
        text = text.replace(f"@{name}@", value)
    left = re.search("@[A-Z]+@", text)
    if left:
        raise ValueError(f"no value for {left.group()}")
    return text


def _figures(results: Row) -> dict[str, str]:
    coverage, watches = results["coverage"], results["alarms"]
    return {
        "SEED": str(coverage["seed"]),
        "COVERAGE": _coverage(coverage),
        "WHITE": _white(results["white"]["all"]),
        "AGAINST": _comparison(results["estimate"]),
        "SPEED": _speed(results["speed"]),
        "LOAD": f"{results['speed']['load']:.0f}",
        "CHANGE": _change(results["change"]),
        "ALARMS": _alarms(watches),
        "AFTER": _after(watches["after crossing"]["seconds"]),
        "EFFECTS": _effects(results["effects"]),
        "VERDICTS": _verdicts(results["verdicts"]),
        "FAILED": _failed(results["failed"]),
        "COMMITS": _commits(results),
    }


def _commits(results: Row) -> str:
    """List the commits of the parts, which are computed one by one."""
    names = dict.fromkeys(part["about"]["commit"] for part in results.values())
    return f"commit{'s' * (len(names) > 1)} {', '.join(names)}"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _span(ends: list[float], digits: int = 1, scale: float = 100.0) -> str:
    return " to ".join(f"{scale * v:.{digits}f}" for v in ends)


def _coverage(result: Row) -> str:
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
        for name, part in result["parts"].items()
    ]
    head = ["given values, drive", "runs", "coverage of 95 % intervals", "median error",
            "stated sd", "NIS inside its band", "NEES (95 % band)"]  # fmt: skip
    return _table(head, [row("**all**", result["all"]), row("**exact**", result["exact"]), *rows])


def _white(result: Row) -> str:
    return (
        f"the coverage is {100.0 * result['coverage']:.1f} % over {result['runs']} drives, "
        f"the NEES is {result['nees']:.2f} and the mean NIS {result['nis_mean']:.3f}, inside its "
        f"band in {100.0 * result['nis_inside']:.0f} % of the runs"
    )


def _effects(result: Row) -> str:
    rows = []
    for name, part in result["parts"].items():
        rows.append(
            [
                f"`{name}`",
                str(part["runs"]),
                f"{100.0 * part['coverage']:.0f} % ({_span(part['coverage_interval'], 0)})",
                f"{100.0 * part['rates']:.0f} %",
                f"{100.0 * part['consistent']:.0f} %",
                f"{100.0 * part['without']:.0f} %",
                f"{part['shift']:.2f} in {part['compared']}",
                _span(part["ratios"], 2, 1.0),
            ]
        )
    head = ["effect", "runs", "intervals with the true value", "those of c_f, c_r, i", "consistent",
            "consistent without it", "largest difference", "ratio of sd"]  # fmt: skip
    return _table(head, rows)


def _verdicts(result: Row) -> str:
    rows = [
        [name, str(part["runs"]), f"{100.0 * part['consistent']:.0f} %", f"{part['nis']:.3f}"]
        for name, part in result["parts"].items()
    ]
    return _table(["drives", "runs", "consistent", "median NIS"], rows)


def _failed(result: Row) -> str:
    parts = [
        f"{100.0 * float(loss):.0f} %: followed after {part['median']:.1f} s in the median and "
        f"{part['largest']:.1f} s at most ({part['runs']} drives); "
        f"{100.0 * part['trusted']:.1f} % of the time called consistent while more than three "
        "standard deviations off"
        for loss, part in result["parts"].items()
    ]
    return "On a rough road, for a loss of " + "; of ".join(parts) + "."


def _comparison(result: Row) -> str:
    return (
        f"over {result['drives']} drives the estimates differ by {result['shift_median']:.2f} of "
        f"its standard deviation in the median and {result['shift_largest']:.2f} at most, and the "
        f"standard deviations are {result['ratio_least']:.2f} to {result['ratio_largest']:.2f} "
        f"times as large"
    )


def _speed(result: Row) -> str:
    names = {"exact": "3 (given values exact)", "declared": "7 (mass, weight share, springs)"}
    rows = [
        [
            label,
            f"{part['compiled_steps_a_second']:,.0f}",
            f"{part['filterpy_steps_a_second']:,.0f}",
            f"{part['ratio']:,.0f}",
            f"{part['replay_times_faster']:.0f} (median {part['replay_median']:.0f})",
        ]
        for part, label in ((result[name], label) for name, label in names.items())
    ]
    head = ["parameters", "compiled, steps per second", "filterpy", "ratio",
            "replay of a minute at 800 Hz, times faster than real time"]  # fmt: skip
    return _table(head, rows)


def _change(result: Row) -> str:
    rows = [
        [
            name,
            str(part["drives"]),
            f"{part['lag_median']:.2f} s, {part['lag_largest']:.2f} s",
            f"{part['rms_percent_median']:.2f} %",
            f"{100.0 * part['consistent_share']:.1f} %",
        ]
        for name, part in (
            ("`--forget 60`", result["forget 60 s"]),
            ("constant", result["constant"]),
        )
    ]
    head = ["parameters", "drives", "lag: median, largest", "rms error",
            "share of time consistent"]  # fmt: skip
    return _table(head, rows)


def _alarms(result: Row) -> str:
    rows = [
        [
            name,
            f"{part['hours']:.1f} in {part['watches']} cars",
            str(part["alarms"]),
            f"{part['an_hour']:.2f} ({part['interval95'][0]:.2f} to {part['interval95'][1]:.2f})",
            f"{100.0 * part['told']:.2f} %",
        ]
        for name, part in result.items()
        if isinstance(part, dict) and "an_hour" in part
    ]
    head = ["front damper", "hours", "false alarms", "per hour (95 %)",
            "share of time consistent"]  # fmt: skip
    return _table(head, rows)


def _after(waits: list[float | None]) -> str:
    delays = sorted(w for w in waits if w is not None)
    if not delays:
        return f"no alarm in {len(waits)} drives"
    return (
        f"the alarm came in {len(delays)} of {len(waits)} drives, {delays[len(delays) // 2]:.1f} s "
        f"after the crossing in the median ({delays[0]:.1f} to {delays[-1]:.1f} s)"
    )
