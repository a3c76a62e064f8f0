"""The reproduction as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from bayes_asv.reference.pictures import Picture
from bayes_asv.report.readable import number, percent, readable_unit
from bayes_asv.report.svg import themed

__all__ = ["page_tables", "reproduction_page"]

Document = dict[str, Any]

_REMOVED: Final = {
    "none": "nothing",
    "rest": "mean of the first 0.1 s",
    "trend": "linear trend",
    "constant": "constant, ends on zero",
}


def reproduction_page(document: Document, figures: Sequence[Picture]) -> str:
    """Set a reproduction as a page.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/reproduce/1``.
    figures : sequence of Picture
        From :func:`bayes_asv.reference.pictures.pictures`.

    Returns
    -------
    str
        HTML without scripts and without references to anything outside.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    def environment(package: str) -> Environment:
        return Environment(
            loader=PackageLoader(package, "templates"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )

    css = environment("bayes_asv.report").get_template("report.css").render()
    page = {
        "title": "The reference reproduced",
        "subtitle": "S. C. Hoffman, Automotive suspension parameter estimation using smart "
        "wireless sensor technology, California Polytechnic State University, 2008",
        "lead": [
            "Every table of the reference with figures that can be computed stands here as "
            "printed, in its own way again, corrected, and as obtained by this package; every "
            "figure with data is drawn again from ours.",
            "The reference's own recordings are not public. Where it shows results of drives, ours "
            "are simulated drives of one car whose truth is known.",
        ],
        "tables": page_tables(document),
        "figures": [
            {"number": f.number, "title": f.title, "caption": f.caption, "key": f.panel.key}
            for f in figures
        ],
        "footer": f"bayes_asv {document['version']}, seed {document['seed']}, "
        f"{document['seconds']:.0f} s",
    }
    drawn = {f.panel.key: Markup(themed(f.panel.svg)) for f in figures}
    template = environment("bayes_asv.reference").get_template("reproduce.html.j2")
    return template.render(page=page, pictures=drawn, css=Markup(css))


def page_tables(document: Document) -> list[Document]:
    """Turn a document's tables into rows of text."""
    tables = [_compared(key, table) for key, table in document["tables"].items() if key != "8.1"]
    tables.insert(2, _spectral(document["spectral"]))
    return [*tables, _table_81(document["tables"]["8.1"]), _drift(document["drift"]),
            _errata(document["errata"])]  # fmt: skip


def _compared(key: str, table: Document) -> Document:
    rows = []
    for row in table["rows"]:
        label = row["label"] + (f" [{readable_unit(row['unit'])}]" if row["unit"] else "")
        difference = row["difference_percent"]
        rows.append(
            [
                label, *(_figure(row[c]) for c in ("printed", "its_way", "corrected", "obtained")),
                percent(None if difference is None else difference / 100.0, 2), row["where"],
            ]
        )  # fmt: skip
    return {
        "id": f"table-{key.replace('.', '-')}",
        "title": f"Table {key}: {table['title']}",
        "kind": "plain",
        "columns": ["", "printed", "its way", "corrected", "obtained", "difference", "where"],
        "rows": rows,
        "notes": table["notes"],
    }


def _spectral(studies: list[Document]) -> Document:
    rows = []
    for study in studies:
        moving = [m for m in study["modes"] if m["oscillates"]]
        for reading in study["readings"]:
            slow = reading["slow_mode_by_subspace"]
            rows.append(
                [
                    percent(study["damping"]),
                    ", ".join(f"{m['damped_hz']:.2f}" for m in moving),
                    str(max(len(v) for v in study["peaks_of_an_endless_record_hz"].values())),
                    f"{reading['seconds']:.0f} s",
                    _share(reading["peaks"]),
                    _share(reading["subspace"]),
                    f"{number(slow['natural_hz']['median'], 0.01)} Hz, "
                    f"{number(slow['ratio']['median'], 0.01)} "
                    f"({number(slow['ratio']['q05'], 0.01)} to "
                    f"{number(slow['ratio']['q95'], 0.01)})",
                ]
            )
    records = studies[0]["readings"][0]["records"]
    return {
        "id": "spectral",
        "title": "Chapter 4: modes from a spectrum, and from subspaces",
        "kind": "plain",
        "columns": [
            "damping", "damped frequencies [Hz]", "peaks of an endless record", "record",
            "read from peaks", "read by subspaces", "slow mode by subspaces, ratio (5 to 95 %)",
        ],
        "rows": rows,
        "notes": [
            f"Read: every mode that oscillates within {studies[0]['within_percent']:.0f} % of its "
            f"damped frequency; shares of {records} records over white noise with their 95 % "
            "interval (Wilson). Peaks: the most prominent ones of one spectrum at 20 s, of the "
            "mean of overlapping segments of 10 s at 600 s. Subspaces: covariance-driven "
            "stochastic subspace identification with four states.",
            "Verdict: at 10 % the spectrum has both peaks, and one record is too short to show "
            "them; from 30 % on the second peak does not exist, and no record is long enough, as "
            "chapter 4 concluded. Subspaces read modes where peaks cannot, but need long records "
            "over white noise and lose the fast mode when it is overdamped.",
        ],
    }  # fmt: skip


def _share(reading: Document) -> str:
    low, high = reading["interval95"]
    return f"{percent(reading['share'])} ({percent(low)} to {percent(high)})"


def _table_81(table: Document) -> Document:
    """Set Table 8.1 with its columns as rows: ours are too many to stand side by side."""
    quantities = table["rows"]
    rows = [
        [f"printed, {column}", *(_figure(q["printed"][column]) for q in quantities)]
        for column in ("400 Hz", "800 Hz", "2008 Baja car")
    ]
    runs = list(quantities[0]["ours"])
    rows.append(["our car, truth", *(_figure(q["ours"][runs[0]]["truth"]) for q in quantities)])
    for run in runs:
        name = run.removesuffix(".csv")
        ours = [q["ours"][run] for q in quantities]
        for way, word in (("its_way", "its way"), ("deflection", "deflection")):
            rows.append(
                [
                    f"{name}, {word}",
                    *(f"{_figure(o[way])} ({_signed(o[f'{way}_error_percent'])})" for o in ours),
                ]
            )
        rows.append([f"{name}, posterior", *(_interval(o) for o in ours)])
    return {
        "id": "table-8-1",
        "title": f"Table 8.1: {table['title']}",
        "kind": "plain",
        "columns": ["", *(f"{q['name']} [{readable_unit(q['unit'])}]" for q in quantities)],
        "rows": rows,
        "notes": [*table["notes"], "In brackets: error against the truth, or the 95 % interval."],
    }


def _interval(ours: Document) -> str:
    if ours["posterior"] is None:
        return "refused"
    low, high = ours["posterior_eti95"]
    sd = (high - low) / 4.0
    mean, bottom, top = (number(v, sd, 1) for v in (ours["posterior"], low, high))
    return f"{mean} ({bottom} to {top})"


def _drift(rows: list[Document]) -> Document:
    return {
        "id": "drift",
        "title": "Section 8.1: what is taken off before integrating, and what it does",
        "kind": "plain",
        "columns": [
            "run", "taken off", "largest travel, front [in]", "rear [in]", "error of c_f", "c_r",
            "i",
        ],
        "rows": [
            [
                row["run"].removesuffix(".csv"),
                _REMOVED[row["removed"]] + (" (the reference's)" if row["reference"] else ""),
                number(row["largest_deflection_in"]["front"], 0.1),
                number(row["largest_deflection_in"]["rear"], 0.1),
                *(_signed(row["error_percent"][n]) for n in ("c_f", "c_r", "i")),
            ]
            for row in rows
        ],
        "notes": [
            "The same two drives, integrated twice after each removal; errors are those of the "
            "reference's grey box against the truth of the simulated car. In deflections nothing "
            "is integrated and nothing has to be taken off."
        ],
    }  # fmt: skip


def _errata(rows: list[Document]) -> Document:
    return {
        "id": "errata",
        "title": "Where the reference disagrees with itself",
        "kind": "left",
        "columns": ["place", "printed", "right", "why"],
        "rows": [[row["where"], row["printed"], row["right"], row["why"]] for row in rows],
        "notes": [],
    }


def _figure(value: float | None) -> str:
    return number(value)


def _signed(value: float | None) -> str:
    if value is None:
        return number(None)
    return f"{value:+.1f} %".replace("-", "−")
