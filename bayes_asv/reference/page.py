"""The reproduction as a self-contained HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from bayes_asv.reference.figures import Figure
from bayes_asv.report.svg import themed
from bayes_asv.report.words import number, percent, readable_unit

__all__ = ["reproduction_page", "table_sections"]

Document = dict[str, Any]

_REMOVED: Final = {
    "none": "nothing",
    "rest": "mean of the first 0.1 s",
    "trend": "linear trend",
    "constant": "constant, zero final displacement",
}


def reproduction_page(document: Document, figures: Sequence[Figure]) -> str:
    """Render a reproduction as a page.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/reproduce/1``.
    figures : sequence of Figure
        From :func:`bayes_asv.reference.figures.draw_figures`.

    Returns
    -------
    str
        HTML without scripts and external references.
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
            "This page shows every table of the reference that can be computed: as printed, "
            "recomputed by the reference's method, corrected, and as obtained by this package. "
            "Every figure with data is drawn again from ours.",
            "The reference's own recordings are not public. Where it shows results of drives, ours "
            "are simulated drives of one car with known true values.",
        ],
        "tables": table_sections(document),
        "figures": [
            {"number": f.number, "title": f.title, "caption": f.caption, "key": f.panel.key}
            for f in figures
        ],
        "footer": f"bayes_asv {document['version']}, seed {document['seed']}, "
        f"{document['seconds']:.0f} s",
    }
    drawn = {f.panel.key: Markup(themed(f.panel.svg)) for f in figures}
    template = environment("bayes_asv.reference").get_template("reproduce.html.j2")
    return template.render(page=page, svgs=drawn, css=Markup(css))


def table_sections(document: Document) -> list[Document]:
    """Convert the tables of a document to rows of text."""
    tables = [_comparison(key, table) for key, table in document["tables"].items() if key != "8.1"]
    tables.insert(2, _spectral(document["spectral"]))
    return [*tables, _table_81(document["tables"]["8.1"]), _drift(document["drift"]),
            _errata(document["errata"])]  # fmt: skip


def _comparison(key: str, table: Document) -> Document:
    rows = []
    for row in table["rows"]:
        label = row["label"] + (f" [{readable_unit(row['unit'])}]" if row["unit"] else "")
        difference = row["difference_percent"]
        rows.append(
            [
                label, *(_number(row[c]) for c in ("printed", "its_way", "corrected", "obtained")),
                percent(None if difference is None else difference / 100.0, 2), row["where"],
            ]
        )  # fmt: skip
    return {
        "id": f"table-{key.replace('.', '-')}",
        "title": f"Table {key}: {table['title']}",
        "kind": "plain",
        "columns": [
            "",
            "printed",
            "as in reference",
            "corrected",
            "obtained",
            "difference",
            "where",
        ],
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
                    _rate_text(reading["peaks"]),
                    _rate_text(reading["subspace"]),
                    f"{number(slow['natural_hz']['median'], 0.01)} Hz, "
                    f"{number(slow['ratio']['median'], 0.01)} "
                    f"({number(slow['ratio']['q05'], 0.01)} to "
                    f"{number(slow['ratio']['q95'], 0.01)})",
                ]
            )
    records = studies[0]["readings"][0]["records"]
    return {
        "id": "spectral",
        "title": "Chapter 4: modes from spectra and from subspace identification",
        "kind": "plain",
        "columns": [
            "damping", "damped frequencies [Hz]", "peaks of the theoretical spectrum", "record",
            "identified from peaks", "by subspaces", "slow mode by subspaces, ratio (5 to 95 %)",
        ],
        "rows": rows,
        "notes": [
            "Identified: every oscillating mode within "
            f"{studies[0]['within_percent']:.0f} % of its damped frequency, as a proportion of "
            f"{records} records over white noise with its 95 % interval (Wilson). Peaks: the most "
            "prominent ones of a periodogram at 20 s, of the mean over overlapping segments of "
            "10 s at 600 s. Subspaces: covariance-driven stochastic subspace identification with "
            "four states.",
            "Conclusion: at 10 % the spectrum has both peaks, but one record is too short to show "
            "them. From 30 % on the second peak does not exist, so no record is long enough, as "
            "chapter 4 concluded. Subspace identification finds modes without peaks, but needs "
            "long records over white noise and fails for an overdamped fast mode.",
        ],
    }  # fmt: skip


def _rate_text(reading: Document) -> str:
    low, high = reading["interval95"]
    return f"{percent(reading['share'])} ({percent(low)} to {percent(high)})"


def _table_81(table: Document) -> Document:
    """Transpose Table 8.1, since our columns are too many for one row."""
    quantities = table["rows"]
    rows = [
        [f"printed, {column}", *(_number(q["printed"][column]) for q in quantities)]
        for column in ("400 Hz", "800 Hz", "2008 Baja car")
    ]
    runs = list(quantities[0]["ours"])
    rows.append(
        ["our car, true value", *(_number(q["ours"][runs[0]]["truth"]) for q in quantities)]
    )
    for run in runs:
        name = run.removesuffix(".csv")
        ours = [q["ours"][run] for q in quantities]
        for way, word in (("its_way", "reference's method"), ("deflection", "deflection")):
            rows.append(
                [
                    f"{name}, {word}",
                    *(
                        f"{_number(o[way])} ({_signed_percent(o[f'{way}_error_percent'])})"
                        for o in ours
                    ),
                ]
            )
        rows.append([f"{name}, posterior", *(_interval(o) for o in ours)])
    return {
        "id": "table-8-1",
        "title": f"Table 8.1: {table['title']}",
        "kind": "plain",
        "columns": ["", *(f"{q['name']} [{readable_unit(q['unit'])}]" for q in quantities)],
        "rows": rows,
        "notes": [*table["notes"], "In brackets: relative error, or the 95 % interval."],
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
        "title": "Section 8.1: detrending before integration and its effect",
        "kind": "plain",
        "columns": [
            "run", "removed", "largest travel, front [in]", "rear [in]", "error of c_f", "c_r",
            "i",
        ],
        "rows": [
            [
                row["run"].removesuffix(".csv"),
                _REMOVED[row["removed"]] + (" (as in reference)" if row["reference"] else ""),
                number(row["largest_deflection_in"]["front"], 0.1),
                number(row["largest_deflection_in"]["rear"], 0.1),
                *(_signed_percent(row["error_percent"][n]) for n in ("c_f", "c_r", "i")),
            ]
            for row in rows
        ],
        "notes": [
            "The same two drives, integrated twice after each kind of detrending; errors of the "
            "reference's grey box relative to the true values of the simulated car. The deflection "
            "form needs no integration and no detrending."
        ],
    }  # fmt: skip


def _errata(rows: list[Document]) -> Document:
    return {
        "id": "errata",
        "title": "Errata of the reference",
        "kind": "left",
        "columns": ["place", "printed", "correct", "reason"],
        "rows": [[row["where"], row["printed"], row["right"], row["why"]] for row in rows],
        "notes": [],
    }


def _number(value: float | None) -> str:
    return number(value)


def _signed_percent(value: float | None) -> str:
    if value is None:
        return number(None)
    return f"{value:+.1f} %".replace("-", "−")
