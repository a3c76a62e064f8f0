"""Modes, point estimates and the reproduction in lines for a terminal."""

from __future__ import annotations

import math
from typing import Any

from bayes_asv.report.readable import number, percent, plain, probability, readable_unit
from bayes_asv.report.words import LABELS

__all__ = ["greybox_lines", "modes_lines", "reproduction_lines", "study_lines"]

Document = dict[str, Any]


def modes_lines(document: Document) -> list[str]:
    """Tell the document of ``bayes-asv modes``."""
    lines = [f"Modes of {plain(document['vehicle'])}, wheels held still:"]
    for mode in document["modes"]:
        shape = ", ".join(
            f"{axle} {part['size']:.2f}"
            + (f" at {round(part['phase_deg']):+d}°" if part["size"] else "")
            for axle, part in mode["shape"].items()
        )
        kind = (
            f"damped {mode['damped_hz']:.3f} Hz, ratio {mode['ratio']:.3f}"
            if mode["oscillates"]
            else "does not oscillate"
        )
        lines.append(f"  {mode['natural_hz']:.3f} Hz, {kind}; shape: {shape}".replace("-", "−"))
    theirs = ", ".join(
        f"{m['natural_hz']:.3f} Hz (damped {m['damped_hz']:.3f}, ratio {m['ratio']:.3f})"
        for m in document["as_app_c1"]
    )
    lines.append(f"As App. C.1 of the reference has it (m/4, ω(1−ζ)): {theirs}")
    for study in document["spectral"]:
        lines += study_lines(study)
    recording = document["recording"]
    if recording is not None:
        lines.append(f"Spectrum of {plain(recording['source'])}, highest peaks below 30 Hz:")
        for channel, spectrum in recording["channels"].items():
            peaks = ", ".join(f"{f:.1f}" for f in spectrum["peaks_hz"]) or "none"
            lines.append(f"  {channel.replace('_', ' ')}: {peaks} Hz")
    return lines


def study_lines(study: Document) -> list[str]:
    """Tell what a spectrum shows at one damping."""
    peaks = study["peaks_of_an_endless_record_hz"]
    moving = sum(m["oscillates"] for m in study["modes"])
    word = (
        "both peaks can be read from a long enough record"
        if study["peaks_can_be_read"]
        else "there is one peak, and no record is long enough to show another"
    )
    lines = [
        f"Both axles damped to {percent(study['damping'])}: {moving} mode"
        f"{'s oscillate' if moving > 1 else ' oscillates'}; {word} "
        f"(front {_list(peaks['front'])} Hz, rear {_list(peaks['rear'])} Hz)."
    ]
    for reading in study["readings"]:
        lines.append(
            f"  {reading['seconds']:.0f} s over white noise, {reading['records']} records: read "
            f"from peaks {percent(reading['peaks']['share'])}, by subspaces "
            f"{percent(reading['subspace']['share'])}"
        )
    return lines


def greybox_lines(document: Document) -> list[str]:
    """Tell the document of ``bayes-asv greybox``."""
    lines = []
    for way in document["estimates"]:
        lines.append(_way(way))
        if way["verdict"] == "refused":
            lines += [f"  Why: {plain(reason)}." for reason in way["reasons"]]
            continue
        for name, p in way["parameters"].items():
            sd = p["sd"] if math.isfinite(p["sd"] or 0.0) else None
            lines.append(
                f"  {LABELS[name]}: {number(p['value'], sd)} ± {number(p['sd'], p['sd'])} "
                f"{readable_unit(p['unit'])}"
            )
        fit = ", ".join(f"{n.replace('_', ' ')} {v:.1f} %" for n, v in way["fit_percent"].items())
        lines.append(f"  fit: {fit}")
        white = ", ".join(probability(w["p"]) for w in way["whiteness"].values())
        lines.append(f"  whiteness of each residual: probability {white}")
        worst = min((t["p"] for t in way["independence"]), default=None)
        lines.append(f"  residuals independent of the inputs: probability {probability(worst)}")
        lines.append(f"  AIC {number(way['aic'], 1.0)}, BIC {number(way['bic'], 1.0)}")
        if any((w["p"] or 0.0) < 0.01 for w in way["whiteness"].values()):
            lines.append(
                "  The residuals are not white, so the deviations above claim too much; "
                "'bayes-asv estimate' gives intervals that hold."
            )
    lines += [f"Note: {plain(w)}." for w in document["warnings"]]
    return lines


def _way(way: Document) -> str:
    if way["coordinates"] == "deflection":
        words = f"In deflections, initial state {way['initial']}, biases estimated"
    else:
        words = (
            f"Integrated twice (the reference's way), initial state {way['initial']}, "
            f"{way['removed']} removed, inputs {way['between_samples']} between samples"
        ).replace("none removed", "nothing removed")
    return (
        words
        + {"ok": ":", "refused": ": refused", "not_converged": ": not converged"}[way["verdict"]]
    )


def reproduction_lines(document: Document) -> list[str]:
    """Tell the reproduction: every figure that is off by more than its printed digits, and 8.1."""
    rows = [
        (key, row) for key, table in document["tables"].items() if key != "8.1"
        for row in table["rows"] if row["printed"] is not None
    ]  # fmt: skip
    count = len(rows) + sum(len(r["printed"]) for r in document["tables"]["8.1"]["rows"])
    lines = [
        f"{count} printed figures of Tables {', '.join(document['tables'])} beside ours. Off by "
        "more than 0.5 %:"
    ]
    for key, row in rows:
        if abs(row["difference_percent"]) > 0.5:
            lines.append(
                f"  Table {key}, {row['label']}: printed {number(row['printed'])}, in its way "
                f"{number(row['its_way'])}, right {number(row['corrected'])} "
                f"{readable_unit(row['unit'])}".rstrip()
            )
    lines.append("Table 8.1 on shipped runs (the reference's recordings are not public):")
    for row in document["tables"]["8.1"]["rows"]:
        for run, ours in row["ours"].items():
            answer = "refused"
            if ours["posterior"] is not None:
                low, high = ours["posterior_eti95"]
                sd = (high - low) / 4.0
                mean, bottom, top = (number(v, sd, 1) for v in (ours["posterior"], low, high))
                answer = f"{mean} ({bottom} to {top})"
            lines.append(
                f"  {row['name']}, {run.removesuffix('.csv')}: truth {number(ours['truth'])}, its "
                f"way {number(ours['its_way'])}, deflection {number(ours['deflection'])}, "
                f"posterior {answer} {readable_unit(row['unit'])}"
            )
    for study in document["spectral"]:
        lines += study_lines(study)
    return lines


def _list(values: list[float]) -> str:
    return ", ".join(f"{v:.2f}" for v in values) or "–"
