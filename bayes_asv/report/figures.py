"""The report's figures, in its order, each with a caption that says what to look for."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from bayes_asv.report.readable import plain
from bayes_asv.report.svg import Panel, style

__all__ = ["MOST_RUNS", "Figure", "figures"]

Document = dict[str, Any]

MOST_RUNS: Final = 6
"""Runs that get figures of their own: more would make a page that nobody can open."""


_FOREST: Final = (
    "Look whether the thick bars reach each other: they are what each run says by itself, 95 %, "
    "with the given values held, since their errors are common to all runs; thin lines have "
    "everything in them. The band is the answer from all runs, the dashed line nominal."
)


class Figure(NamedTuple):
    """One or several pictures under one caption."""

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]


def figures(document: Document) -> list[Figure]:
    """Draw every figure that a document has data for.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of Figure
        In the order of the report; empty for a refused document. The same document gives the
        same bytes.
    """
    # matplotlib costs half a second, so nothing above imports it.
    from bayes_asv.report import plots_budget as plots_width
    from bayes_asv.report import plots_consistency as plots_agreement
    from bayes_asv.report import plots_parameters, plots_residuals, plots_time

    found: list[Figure] = []
    with style():
        rows = plots_agreement.forest(document)
        if rows is not None:
            found.append(Figure("agreement", "One run against another", _FOREST, (rows,)))
        runs = document.get("runs", [])[:MOST_RUNS]
        for n, run in enumerate(runs):
            found += _of_run(plots_time, run, n, len(runs), document)
        draws = document.get("draws") or {}
        if draws:
            found.append(
                Figure(
                    "posterior",
                    "What the data say about each parameter",
                    "Look at where the dashed nominal line stands: outside the shaded 95 % "
                    "interval the car differs from its data sheet. The brown prior, what was "
                    "believed before, should be flat here; then it is the recording that speaks.",
                    plots_parameters.posteriors(document),
                )
            )
            corner = plots_parameters.corner(document)
            if corner is not None:
                found.append(
                    Figure(
                        "corner",
                        "How the parameters hang together",
                        "Look for slanted clouds: there the data fix a combination of two "
                        "parameters better than either. Numbers are correlations; dashed lines are "
                        "nominal where they fall into view.",
                        (corner,),
                    )
                )
        bars = plots_width.budget_bars(document)
        if bars is not None:
            found.append(
                Figure(
                    "width",
                    "What the uncertainty of each answer is made of",
                    "Look at the longest piece of a bar: knowing better what it stands for narrows "
                    "the answer most. On the right stands the answer's deviation.",
                    (bars,),
                )
            )
        if runs:
            found.append(
                Figure(
                    "velocity",
                    "Damper velocity",
                    "Look for bars far from the middle and for unequal shares: a rate is learnt "
                    "only at the velocities that were driven, and bound (compression, left of "
                    "zero) and rebound are averaged. Velocity is that of the suspension at the "
                    "wheel; below 2 % of the largest it counts as still.",
                    plots_time.velocities(document["runs"]),
                )
            )
        for n, run in enumerate(runs):
            found += _left_over(plots_residuals, run, n, len(runs))
    return [figure for figure in found if figure.panels]


def _of_run(plots: Any, run: Document, n: int, count: int, document: Document) -> list[Figure]:
    of = f", {plain(run['source'])}" if count > 1 else ""
    return [
        Figure(
            f"chassis-{n}",
            f"Chassis acceleration, measured and simulated{of}",
            "Look at the lower strip: what the simulation leaves should stay inside the band, "
            "where 95 % of the readings are predicted to lie, and show no shape of its own.",
            plots.chassis(run, n),
        ),
        Figure(
            f"wheels-{n}",
            f"Wheel acceleration, which drives the simulation{of}",
            "Look for flat tops, spikes and steps: they are faults of a sensor, not of the road, "
            "and everything else is computed from these two curves.",
            plots.wheels(run, n),
        ),
        Figure(
            f"travel-{n}",
            f"Suspension travel, reconstructed{of}",
            "Look at how near the curve comes to a limit: a stop that was touched bends the "
            "answer. Shading, where it is wide enough to be seen, is the 95 % interval.",
            plots.travels(run, document.get("vehicle", {}).get("travel") or {}, n),
        ),
    ]


def _left_over(plots: Any, run: Document, n: int, count: int) -> list[Figure]:
    of = f", {plain(run['source'])}" if count > 1 else ""
    return [
        Figure(
            f"spectrum-{n}",
            f"Spectrum of the chassis acceleration and of what is left{of}",
            "Look for peaks in the lower curve: a peak is a motion that the half car does not "
            "know, such as an engine or a loose mount; a curve without any "
            "is sensor noise, and rises to the left by what wheel sensors add.",
            plots.spectra(run, n),
        ),
        Figure(
            f"whiteness-{n}",
            f"Autocorrelation of the innovations{of}",
            "Look for bars outside the band: about one in twenty may; a pattern, or a whiteness "
            "probability below 1 %, means that the intervals are too narrow.",
            plots.whiteness(run, n),
        ),
    ]
