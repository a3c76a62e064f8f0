"""Tables of ``docs/roomster.md``, written between its markers from the results."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv.domain.files import write_atomically
from benchmarks.roomster.drives import HELD_OUT, WORKED_ON

__all__ = ["PAGE", "tables", "write_tables"]

Row = dict[str, Any]

PAGE = Path(__file__).parents[2] / "docs" / "roomster.md"
BANDS = ("3", "4", "6")


def write_tables(result: Row) -> None:
    """Write every table between its two markers in the page.

    Raises
    ------
    ValueError
        If a marker is missing.
    """
    text = PAGE.read_text(encoding="utf-8")
    for name, table in tables(result).items():
        found = re.findall(rf"<!-- {name} -->\n(.*?)<!-- end {name} -->", text, re.DOTALL)
        if len(found) != 1:
            raise ValueError(f"{PAGE}: marker {name} occurs {len(found)} times")
        marks = (f"<!-- {name} -->\n", f"<!-- end {name} -->")
        text = text.replace(f"{marks[0]}{found[0]}{marks[1]}", f"{marks[0]}{table}{marks[1]}")
    write_atomically(PAGE, text.encode("utf-8"))


def tables(result: Row) -> dict[str, str]:
    """Return every table of the page by the name of its marker."""
    return {
        "coherence": _coherence(result["coherence"]),
        "posterior": _posterior(result["posterior"]),
        "bands": _bands(result["bands"]),
        "widths": _widths(result),
        "between": _between(result["between"]),
        "variants": _variants(result["variants"]),
        "prediction": _prediction(result["prediction"]),
    }


def _coherence(rows: Row) -> str:
    shown = [band for band in rows[WORKED_ON[0]]["bands"] if band[1] <= 8.0]
    head = ["drive, axle", *(f"{low:g} – {high:g}" for low, high in shown)]
    out = []
    for name, row in rows.items():
        for axle, word in enumerate(("front", "rear")):
            cells = []
            for k in range(len(shown)):
                free, car = row["left_by_any"][k][axle], row["left_by_half_car"][k][axle]
                cells.append(f"{100 * free:.0f} / {100 * car:.0f}")
            out.append([f"{name} {word}", *cells])
    return _table(head, out)


def _posterior(rows: Row) -> str:
    head = ["drive", "s", "c_f/m, 1/s", "c_r/m, 1/s", "i/m, m²", "k_f/m, 1/s²", "k_r/m, 1/s²",
            "c_f, N·s/m", "c_r, N·s/m", "i, kg·m²", "power λ", "residual front, rear"]  # fmt: skip
    out = []
    for name, row in rows.items():
        share = row["share"]
        physical = [
            f"{_round(row[n]['mean'], 2)} ({_round(row[n]['eti95'][0], 2)} – "
            f"{_round(row[n]['eti95'][1], 2)})"
            for n in ("c_f", "c_r", "i")
        ]
        out.append(
            [
                name if name in WORKED_ON else f"*{name}*",
                f"{row['seconds']:.0f}",
                *(_pm(row[n], 2) for n in ("c_f/m", "c_r/m", "i/m")),
                *(_pm(row[n], 0) for n in ("k_f/m", "k_r/m")),
                *physical,
                "–" if share is None else f"{share:.2f}",
                ", ".join(f"{100 * x:.0f} %" for x in row["nrmse"]),
            ]
        )
    return _table(head, out)


def _bands(rows: Row) -> str:
    head = ["drive", *(f"{n} below {b} Hz" for n in ("c_f/m", "c_r/m", "i/m") for b in BANDS)]
    out = [
        [drive, *(_pm(row[b][n], 2) for n in ("c_f/m", "c_r/m", "i/m") for b in BANDS)]
        for drive, row in rows.items()
    ]
    return _table(head, out)


def _widths(result: Row) -> str:
    head = ["comparison", "χ² / contrasts, full likelihood", "χ² / contrasts, with power λ"]
    out = []
    plain = counted = freedom = 0.0
    for name, row in result["halves"].items():
        out.append(_ratio_row(f"halves of {name}", row["q"], row["q_counted"], row["freedom"]))
        plain, counted = plain + row["q"], counted + row["q_counted"]
        freedom += row["freedom"]
    out.append(_ratio_row("all halves", plain, counted, freedom))
    found = result["between"]
    every, some = found["all_readings"]["q"], found["counted"]["q"]
    out.append(_ratio_row("the four drives", every, some, found["freedom"]))
    for key, words in (
        ("ends_cut", "the four drives without their ends"),
        ("best_variants", "the four drives, each with the best-fitting lag or gain"),
    ):
        out.append([words, "–", f"{found[key]['q'] / found['freedom']:.1f} (of 9)"])
    return _table(head, out)


def _ratio_row(name: str, plain: float, counted: float, freedom: float) -> list[str]:
    return [name, f"{plain / freedom:.1f}", f"{counted / freedom:.1f} (of {freedom:.0f})"]


def _between(found: Row) -> str:
    head = ["", "own sd", "sd between drives (95 %)", "mean car (95 %)"]
    out = []
    for name, unit in (("c_f", "N·s/m"), ("c_r", "N·s/m"), ("i", "kg·m²")):
        low, middle, high = found["spread_percent"][name]
        car = found["mean_car"][name]
        out.append(
            [
                name,
                f"{found['own_percent'][name]:.1f} %",
                f"{middle:.1f} % ({low:.1f} – {high:.0f} %)",
                f"{_round(car['mean'], 2)} {unit} ({_round(car['eti95'][0], 2)} – "
                f"{_round(car['eti95'][1], 2)})",
            ]
        )
    return _table(head, out)


def _variants(rows: Row) -> str:
    names = [n for n in rows[WORKED_ON[0]] if n != "best"]
    out = []
    for drive, row in rows.items():
        cells = []
        for name in names:
            one = row[name]
            left = ", ".join(f"{100 * x:.1f}" for x in one["nrmse"])
            mark = "**" if name == row["best"] else ""
            cells.append(
                f"{mark}{left}{mark}; {one['c_f/m']:.2f}, {one['c_r/m']:.2f}, {one['i/m']:.2f}"
            )
        out.append([drive, *cells])
    return _table(["drive", *names], out)


def _prediction(rows: Row) -> str:
    head = ["estimated from", "predicted", "model", "own model", "linear filter", "rigid",
            "within 50 %", "within 95 %", "gain over filter", "gain over zero"]  # fmt: skip
    out = []
    for group, label in ((WORKED_ON, "the other three"), (HELD_OUT, "*02 and 10*")):
        for name in WORKED_ON:
            others = [rows[name][other] for other in group if other != name]
            fits = [rows[other][other]["nrmse"] for other in group if other != name]
            out.append(
                [
                    name,
                    label,
                    _percent(o["nrmse"] for o in others),
                    _percent(fits),
                    _percent(o["nrmse_filter"] for o in others),
                    _percent(o["nrmse_stiff"] for o in others),
                    _percent(o["cover50"] for o in others),
                    _percent(o["cover95"] for o in others),
                    _nats(o["gain"]["filter"] for o in others),
                    _nats(o["gain"]["nothing"] for o in others),
                ]
            )
    return _table(head, out)


def _percent(pairs: Iterable[Sequence[float]]) -> str:
    front, rear = 100.0 * np.mean(np.array(list(pairs)), axis=0)
    return f"{front:.0f}, {rear:.0f} %"


def _nats(pairs: Iterable[Sequence[float]]) -> str:
    front, rear = np.mean(np.array(list(pairs)), axis=0)
    return f"{front:+.2f}, {rear:+.2f}"


def _pm(row: Row, digits: int) -> str:
    return f"{row['mean']:.{digits}f} ± {row['sd']:.{digits}f}"


def _round(value: float, digits: int) -> str:
    return f"{float(f'{value:.{digits}g}'):.10g}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
