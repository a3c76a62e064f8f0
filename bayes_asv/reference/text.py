"""Terminal lines about modes, point estimates and the reproduction."""

from __future__ import annotations

import math
from typing import Any

from bayes_asv.report.words import LABELS, number, percent, plain, probability, readable_unit

__all__ = ["greybox_lines", "modes_lines", "reproduction_lines", "study_lines"]

Document = dict[str, Any]


def modes_lines(document: Document) -> list[str]:
    """Describe the document of ``bayes-asv modes``."""
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
    printed = ", ".join(
        f"{m['natural_hz']:.3f} Hz (damped {m['damped_hz']:.3f}, ratio {m['ratio']:.3f})"
        for m in document["as_app_c1"]
    )
    lines.append(f"As in App. C.1 of the reference (m/4, ω(1−ζ)): {printed}")
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
    """Describe the spectral study at one damping."""
    peaks = study["peaks_of_an_endless_record_hz"]
    moving = sum(m["oscillates"] for m in study["modes"])
    peaks_text = (
        "a sufficiently long record shows both peaks"
        if study["peaks_can_be_read"]
        else "the theoretical spectrum has only one peak"
    )
    lines = [
        f"Both axles damped to {percent(study['damping'])}: {moving} mode"
        f"{'s oscillate' if moving > 1 else ' oscillates'}; {peaks_text} "
        f"(front {_frequencies(peaks['front'])} Hz, rear {_frequencies(peaks['rear'])} Hz)."
    ]
    for reading in study["readings"]:
        lines.append(
            f"  {reading['seconds']:.0f} s over white noise, {reading['records']} records: "
            f"identified from peaks {percent(reading['peaks']['share'])}, by subspaces "
            f"{percent(reading['subspace']['share'])}"
        )
    return lines


def greybox_lines(document: Document) -> list[str]:
    """Describe the document of ``bayes-asv greybox``."""
    lines = []
    for way in document["estimates"]:
        lines.append(_heading(way))
        if way["verdict"] == "refused":
            lines += [f"  Reason: {plain(reason)}." for reason in way["reasons"]]
            continue
        for name, p in way["parameters"].items():
            sd = p["sd"] if math.isfinite(p["sd"] or 0.0) else None
            lines.append(
                f"  {LABELS[name]}: {number(p['value'], sd)} ± {number(p['sd'], p['sd'])} "
                f"{readable_unit(p['unit'])}"
            )
        fit = ", ".join(f"{n.replace('_', ' ')} {v:.1f} %" for n, v in way["fit_percent"].items())
        lines.append(f"  fit: {fit}")
        p_values = ", ".join(probability(w["p"]) for w in way["whiteness"].values())
        lines.append(f"  whiteness of the residuals: p = {p_values}")
        worst = min((t["p"] for t in way["independence"]), default=None)
        lines.append(f"  independence of residuals and inputs: smallest p = {probability(worst)}")
        lines.append(f"  AIC {number(way['aic'], 1.0)}, BIC {number(way['bic'], 1.0)}")
        if any((w["p"] or 0.0) < 0.01 for w in way["whiteness"].values()):
            lines.append(
                "  The residuals are not white, so the standard deviations above are too small; "
                "'bayes-asv estimate' gives valid intervals."
            )
    lines += [f"Note: {plain(w)}." for w in document["warnings"]]
    return lines


def _heading(way: Document) -> str:
    if way["coordinates"] == "deflection":
        words = f"In deflections, initial state {way['initial']}, biases estimated"
    else:
        words = (
            f"Integrated twice (the reference's method), initial state {way['initial']}, "
            f"{way['removed']} removed, inputs {way['between_samples']} between samples"
        ).replace("none removed", "nothing removed")
    return (
        words
        + {"ok": ":", "refused": ": refused", "not_converged": ": not converged"}[way["verdict"]]
    )


def reproduction_lines(document: Document) -> list[str]:
    """Describe the reproduction: figures that differ by more than 0.5 %, and Table 8.1."""
    rows = [
        (key, row) for key, table in document["tables"].items() if key != "8.1"
        for row in table["rows"] if row["printed"] is not None
    ]  # fmt: skip
    count = len(rows) + sum(len(r["printed"]) for r in document["tables"]["8.1"]["rows"])
    lines = [
        f"{count} printed figures of Tables {', '.join(document['tables'])} compared. Differences "
        "above 0.5 %:"
    ]
    for key, row in rows:
        if abs(row["difference_percent"]) > 0.5:
            lines.append(
                f"  Table {key}, {row['label']}: printed {number(row['printed'])}, by its rule "
                f"{number(row['its_way'])}, correct {number(row['corrected'])} "
                f"{readable_unit(row['unit'])}".rstrip()
            )
    lines.append("Table 8.1 on shipped runs (the reference's recordings are not public):")
    for row in document["tables"]["8.1"]["rows"]:
        for run, ours in row["ours"].items():
            interval = "refused"
            if ours["posterior"] is not None:
                low, high = ours["posterior_eti95"]
                sd = (high - low) / 4.0
                mean, bottom, top = (number(v, sd, 1) for v in (ours["posterior"], low, high))
                interval = f"{mean} ({bottom} to {top})"
            lines.append(
                f"  {row['name']}, {run.removesuffix('.csv')}: true {number(ours['truth'])}, "
                f"reference's method {number(ours['its_way'])}, "
                f"deflection {number(ours['deflection'])}, "
                f"posterior {interval} {readable_unit(row['unit'])}"
            )
    for study in document["spectral"]:
        lines += study_lines(study)
    return lines


def _frequencies(values: list[float]) -> str:
    return ", ".join(f"{v:.2f}" for v in values) or "–"
