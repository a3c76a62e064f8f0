"""The report's tables as rows of text."""

from __future__ import annotations

import math
from typing import Any

from bayes_asv.report.readable import number, percent, plain, probability, readable_unit
from bayes_asv.report.words import LABELS

__all__ = [
    "fit_table",
    "known_table",
    "noise_table",
    "parameter_table",
    "provenance_tables",
    "travel_table",
]

Document = dict[str, Any]

_CHANNELS = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")


def table(title: str, columns: list[str], rows: list[list[str]], note: str = "") -> Document:
    """Set up a table section; the first column is text, the others are figures."""
    return {"kind": "table", "title": title, "columns": columns, "rows": rows, "note": note}


def parameter_table(parameters: Document, *, si: bool, title: str) -> Document:
    """Mean, deviation, interval, nominal and probability of every parameter."""
    rows = []
    for name, p in parameters.items():
        shown = p["si"] if si else p
        unit, sd = readable_unit(shown["unit"]), shown["sd"]
        low, high = shown["eti95"]
        label = _capital(LABELS.get(name, plain(p.get("label", name))))
        rows.append(
            [
                f"{label} [{unit}]" if unit else label,
                number(shown["mean"], sd),
                number(sd, sd),
                f"{number(low, sd)} to {number(high, sd)}",
                number(shown.get("nominal")),
                probability(p.get("p_below_nominal")),
            ]
        )
    columns = ["parameter", "mean", "sd", "95 % interval", "nominal", "P(below nominal)"]
    return table(title, columns, rows)


def known_table(document: Document) -> Document | None:
    """Return what was given, and what the recordings made of it."""
    rows = []
    for name, k in (document.get("known") or {}).items():
        unit, sd = readable_unit(k["unit"]), k.get("sd") or 0.0
        label = _capital(plain(k.get("label", name)))
        after = k.get("posterior")
        rows.append(
            [
                f"{label} [{unit}]" if unit else label,
                f"{number(k['value'], sd)} ± {number(sd, sd)}" if sd else
                f"{number(k['value'])} (exact)",
                f"{number(after['mean'], after['sd'])} ± {number(after['sd'], after['sd'])}"
                if after else "–",
                _shift(k["value"], sd, after),
            ]
        )  # fmt: skip
    if not rows:
        return None
    if all(row[2] == "–" for row in rows):
        note = "± is one deviation."
        return table("Given values", ["given value", "as given"], [r[:2] for r in rows], note)
    return table(
        "Given values, before and after",
        ["given value", "as given", "after the data", "moved by"],
        rows,
        "± is one deviation; the move is counted in deviations of the given value. A move beyond "
        "two says that the value or the model is wrong.",
    )


def _shift(value: float, sd: float, after: Document | None) -> str:
    if after is None or not sd:
        return "–"
    text = number((after["mean"] - value) / sd, 1.0)
    return "0.0 sd" if text == "0.0" else f"{'' if text.startswith('−') else '+'}{text} sd"


def fit_table(document: Document) -> Document | None:
    """How much of the measured movement the free-running simulation leaves."""
    by_run = document.get("fit_by_run") or []
    entries = [(plain(e["source"]), e) for e in by_run]
    if len(entries) != 1 and document.get("fit"):
        entries.append(("All together", document["fit"]))
    rows = [
        [source, *(_fit(entry.get(c)) for c in ("front_chassis", "rear_chassis"))]
        for source, entry in entries
    ]
    if not rows:
        return None
    return table(
        "Fit of the simulation",
        ["recording", "front chassis, rms error", "rear chassis, rms error"],
        rows,
        "Free-running simulation from the wheel accelerations; the error is in percent of the "
        "measured movement (NRMSE), so 0 % is perfect.",
    )


def _fit(entry: Document | None) -> str:
    if not entry:
        return "–"
    error = entry["nrmse_percent"]
    return f"{number(error, 0.1 * abs(error) or None)} %"


def travel_table(document: Document) -> Document | None:
    """Largest, smallest and usual travel, with the share of the limits that was used."""
    stops = (document.get("vehicle") or {}).get("travel") or {}
    rows, unit, velocity_unit = [], "", ""
    runs = document.get("runs") or []
    for run in runs:
        unit = readable_unit(run["travel"]["unit"])
        velocity_unit = readable_unit(run["travel"].get("velocity_unit", ""))
        for axle in ("front", "rear"):
            curve = run["travel"].get(axle)
            if curve is None:
                continue
            bump, droop = curve["largest_bump"], curve["largest_droop"]
            sd = _sd(curve["deflection"])
            speeds = [v for v in curve["velocity"] if v is not None] or [0.0]
            label = _capital(axle)
            if len(runs) > 1:
                label += f", {plain(run['source'])}"
            rows.append(
                [
                    label,
                    _three(-bump), _used(bump, stops.get(f"{axle}_bump")),
                    _three(droop), _used(droop, stops.get(f"{axle}_droop")),
                    _three(sd), _three(min(speeds)), _three(max(speeds)),
                ]
            )  # fmt: skip
    if not rows:
        return None
    return table(
        "Suspension travel and damper velocity",
        [
            "axle", f"least travel (bump) [{unit}]", "of limit",
            f"greatest travel (droop) [{unit}]", "of limit", f"sd [{unit}]",
            f"fastest bound [{velocity_unit}]", f"fastest rebound [{velocity_unit}]",
        ],
        rows,
        "Extension is positive; travel is from rest. Limits are those of the vehicle file.",
    )  # fmt: skip


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _used(value: float, limit: float | None) -> str:
    return percent(value / limit) if limit else "–"


def _three(value: float) -> str:
    """Three significant digits."""
    return number(value, abs(value) * 0.1 if value else None)


def _sd(values: list[float | None]) -> float:
    there = [v for v in values if v is not None]
    if len(there) < 2:
        return 0.0
    mean = math.fsum(there) / len(there)
    return math.sqrt(math.fsum((v - mean) ** 2 for v in there) / (len(there) - 1))


def noise_table(document: Document) -> Document | None:
    """Noise of each sensor as found, beside what was declared."""
    rows, unit = [], ""
    entries = document.get("noise") or []
    for entry in entries:
        unit = readable_unit(entry["unit"])
        for channel in _CHANNELS:
            noise = entry.get(channel)
            if not noise:
                continue
            label = _capital(channel.replace("_", " "))
            if len(entries) > 1:
                label += f", {plain(entry['source'])}"
            given = noise.get("given")
            rows.append(
                [
                    label,
                    f"{number(noise['mean'], noise['sd'])} ± {number(noise['sd'], noise['sd'])}",
                    "not given" if given is None else number(given),
                ]
            )
    if not rows:
        return None
    return table(
        "Sensor noise",
        ["sensor", f"found, rms [{unit}]", "declared"],
        rows,
        "Much more than declared means a loose mount, or a motion that the half car does not know.",
    )


def provenance_tables(document: Document) -> list[Document]:
    """Files with their hashes, versions and seed."""
    origin = document.get("provenance") or {}
    files = [*origin.get("recordings", []), origin.get("vehicle") or {}]
    rows = [[plain(f.get("file") or "–"), plain(f.get("sha256") or "no hash")]
            for f in files if f]  # fmt: skip
    found = []
    if rows:
        found.append(
            {**table("Where this comes from", ["file", "SHA-256"], rows), "kind": "hashes"}
        )
    versions = {
        "bayes_asv": document.get("version"),
        "Python": origin.get("python"),
        **(origin.get("packages") or {}),
    }
    lines = [
        "Versions: " + ", ".join(f"{k} {plain(v)}" for k, v in versions.items() if v) + ".",
        f"Seed {document.get('seed')}: the same files, versions and seed give the same numbers.",
    ]
    likelihood = (document.get("diagnostics") or {}).get("likelihood")
    if likelihood:
        lines.append(f"Likelihood: {plain(likelihood)}.")
    found.append({"kind": "text", "title": "", "lines": lines})
    return found
