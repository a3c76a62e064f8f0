"""Parameters and given values: tables, posterior against prior and nominal, joint posterior."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import SideRatio
from bayes_asv.report.schema.parts import Known, Parameter
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table, Text
from bayes_asv.report.words import (
    LABELS,
    MISSING,
    capitalized,
    estimate_text,
    interval,
    is_determined,
    labelled,
    likelihood_words,
    number,
    plain,
    plus_minus,
    probability,
    readable_unit,
)

__all__ = [
    "DETAILS_SECTION", "SECTION", "answers", "given_table", "log_normal_prior", "moved_values",
    "parameter_table", "short_label", "side_lines",
]  # fmt: skip

Array = NDArray[np.float64]

_DISTINCT: Final = 0.95  # probability from which left and right dampers are called different
_MOVED: Final = 2.0  # standard deviations: one given value in twenty moves farther by chance
_POSTERIOR: Final = (
    "The dashed line is the nominal value: where it is outside the shaded 95 % interval, the car "
    "differs from its data sheet. The prior (brown) should be flat over the posterior; then the "
    "recordings and not the prior determine the answer."
)
_CORNER: Final = (
    "Draws of every pair of parameters, with their correlation. In a slanted cloud the data "
    "determine a combination of the two parameters better than either. Dashed lines are nominal "
    "values, where they are in range."
)


def answers(parameters: Mapping[str, Parameter]) -> list[str]:
    """Names of the parameters that the first page shows: all but the damping ratios."""
    return [n for n in parameters if QUANTITIES[n][0] != "dimensionless"]


def short_label(name: str) -> str:
    """Name of a parameter without ``rate``, for a narrow place."""
    return LABELS[name].removesuffix(" rate")


def _title(document: EstimateDocument) -> str:
    return "Parameters" if document.verdict == "ok" else "Parameters, not to be relied on"


def _content(document: EstimateDocument) -> Iterator[Block]:
    if document.parameters:
        yield parameter_table(document.parameters, _title(document))
    if document.left_over_right:
        yield Text("Left and right dampers", side_lines(document))


def _details(document: EstimateDocument) -> Iterator[Block]:
    parameters = document.parameters
    if (
        parameters
        and document.vehicle.units != "SI"
        and all(p.si is not None for p in parameters.values())
    ):
        yield _si_table(parameters, f"{_title(document)}, in SI units")
    if document.known:
        yield given_table(document.known)
    if document.draws:
        yield Figure(
            "posterior", "Posterior", f"{_POSTERIOR} {_CORNER}",
            (*_corner(document), *_posteriors(document)), 3,
        )  # fmt: skip


def _limits(document: EstimateDocument) -> list[str]:
    """Name the given values that the recordings contradict."""
    return [
        f"The recordings moved the {LABELS.get(name) or plain(document.known[name].label or name)} "
        f"by {_shift(size)}: the given value or the model is wrong."
        for name, size in moved_values(document.known).items()
        if abs(size) > _MOVED
    ]


SECTION: Final = Section(_content)

DETAILS_SECTION: Final = Section(
    _details, _limits, about="input", title="Parameters, given values and priors"
)


def moved_values(known: Mapping[str, Known]) -> dict[str, float]:
    """Shift of each given value that is not exact, in its standard deviations."""
    return {
        name: (value.posterior.mean - value.value) / value.sd
        for name, value in known.items()
        if value.posterior is not None and value.sd
    }


def parameter_table(parameters: Mapping[str, Parameter], title: str) -> Table:
    """Mean, standard deviation, interval, nominal value and probability of every parameter."""
    rows = [
        [
            capitalized(labelled(name, p.label, p.unit)),
            estimate_text(p, "", 2),
            number(p.sd, p.sd) if is_determined(p.eti95) else MISSING,
            interval(p), number(p.nominal),
            MISSING if p.withheld else probability(p.p_below_nominal),
        ]
        for name, p in parameters.items()
    ]  # fmt: skip
    columns = ["parameter", "mean", "sd", "95 % interval", "nominal", "P(below nominal)"]
    return Table(title, columns, rows)


def _si_table(parameters: Mapping[str, Parameter], title: str) -> Table:
    """Parameters in SI units."""
    rows = [
        [
            capitalized(labelled(name, p.label, p.si.unit)),
            plus_minus(p.si), interval(p.si),
            number(p.si.nominal),
        ]
        for name, p in parameters.items()
        if p.si is not None
    ]  # fmt: skip
    return Table(title, ["parameter", "mean ± sd", "95 % interval", "nominal"], rows)


def side_lines(document: EstimateDocument) -> list[str]:
    """Compare the left with the right damper of each axle that has two."""
    return [_side_sentence(axle, ratio) for axle, ratio in document.left_over_right.items()]


def _side_sentence(axle: str, ratio: SideRatio) -> str:
    p = max(ratio.p_left_softer, 1.0 - ratio.p_left_softer)
    start = (
        f"The {axle} left damper has {estimate_text(ratio, '')} times the rate of the right one "
        f"(95 %: {interval(ratio, 1)})"
        if is_determined(ratio.eti95)
        else f"The rate of the {axle} left damper over that of the right one is not determined "
        f"(95 %: {interval(ratio, 1)})"
    )
    if p < _DISTINCT:
        return f"{start}; the sides cannot be distinguished."
    softer = "softer" if ratio.p_left_softer > 0.5 else "stiffer"
    return f"{start}; it is {likelihood_words(p)} that it is the {softer} one."


def given_table(known: Mapping[str, Known]) -> Table:
    """Given values, with their posterior where there is one."""
    rows = []
    for name, value in known.items():
        sd, posterior = value.sd or 0.0, value.posterior
        after = shift = MISSING
        if posterior is not None:
            after = plus_minus(posterior)
            shift = _shift((posterior.mean - value.value) / sd) if sd else MISSING
        given = number(value.value, sd)
        given += f" ± {number(sd, sd)}" if sd else " (exact)"
        label = capitalized(labelled(name, value.label, value.unit))
        rows.append([label, given, after, shift])
    if all(row[2] == MISSING for row in rows):
        note = "± is one standard deviation."
        return Table("Given values", ["given value", "as given"], [r[:2] for r in rows], note)
    return Table(
        "Given values, prior and posterior",
        ["given value", "as given", "posterior", "shift"],
        rows,
        "± is one standard deviation; the shift is in standard deviations of the given value. A "
        "shift beyond two means that the value or the model is wrong.",
    )


def _shift(deviations: float) -> str:
    text = number(deviations, 1.0)
    return "0.0 sd" if text == "0.0" else f"{'' if text.startswith('−') else '+'}{text} sd"


def log_normal_prior(name: str, document: EstimateDocument) -> tuple[float, float] | None:
    """Median and standard deviation of the logarithm of a log-normal prior.

    The prior of k_g = √(i/m) follows from those of i and of the sprung mass.
    """
    if name in document.prior:
        return document.prior[name].median, document.prior[name].log_sd
    inertia, p = document.prior.get("i"), document.parameters
    nominal = p["i"].nominal if "i" in p else None
    if name != "k_g" or inertia is None or not p["k_g"].nominal or not nominal:
        return None
    mass = document.known.get("m")
    relative = (mass.sd or 0.0) / mass.value if mass is not None and mass.value else 0.0
    median = p["k_g"].nominal * math.sqrt(inertia.median / nominal)
    return median, 0.5 * math.hypot(inertia.log_sd, relative)


def _posteriors(document: EstimateDocument) -> tuple[svg.Panel, ...]:
    """Draw the densities of posterior and prior with the nominal value, one panel a parameter."""
    panels = []
    for name in answers(document.parameters):
        draws, p = _draws(document, name), document.parameters[name]
        if not len(draws) or not p.sd:
            continue
        centres = [p.mean] if p.nominal is None else [p.mean, p.nominal]
        margin = max(4.5 * p.sd, 0.12 * (max(centres) - min(centres)))
        start, stop = float(min(centres) - margin), float(max(centres) + margin)
        fine = p.mean + p.sd * np.linspace(-4.5, 4.5, 200)
        grid = np.unique(np.concatenate([np.linspace(start, stop, 200), fine]))
        density = _density(draws, grid)
        if not density.any():
            continue  # the document contradicts itself
        figure = svg.canvas(*svg.SMALL)
        axes = figure.subplots()
        paint = svg.axle_colour(LABELS[name])
        inside = (grid >= p.eti95[0]) & (grid <= p.eti95[1])
        axes.fill_between(grid[inside], density[inside], color=paint, alpha=0.3, linewidth=0)
        axes.plot(grid, density, color=paint, label="posterior")
        log_normal = log_normal_prior(name, document)
        if log_normal is not None:
            positive = grid[grid > 0.0]
            z = (np.log(positive) - math.log(log_normal[0])) / log_normal[1]
            height = np.exp(-0.5 * z**2) / (positive * log_normal[1] * math.sqrt(2.0 * math.pi))
            axes.plot(positive, height, color=svg.COLOURS["prior"], linewidth=1.8, label="prior")
        if p.nominal is not None:
            axes.axvline(
                p.nominal, color=svg.COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.2,
                label=f"nominal {number(p.nominal)}",
            )  # fmt: skip
        axes.set(xlabel=labelled(name, "", p.unit), ylabel="density", xlim=(start, stop), yticks=[])
        axes.set_ylim(0.0, 1.08 * float(density.max()))
        axes.grid(visible=False)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.2)
        alt = f"posterior, prior and nominal value of the {LABELS[name]}"
        panels.append(svg.panel(figure, f"posterior-{name.replace('_', '-')}", alt))
    return tuple(panels)


def _corner(document: EstimateDocument) -> tuple[svg.Panel, ...]:
    """Draw every pair of parameters against each other, with correlations above the diagonal."""
    p = document.parameters
    every = {n: _draws(document, n) for n in answers(p) if p[n].sd}
    whole = max(map(len, every.values()), default=0)
    draws = {n: x for n, x in every.items() if len(x) == whole > 0}  # pairs are of one draw each
    names, count = list(draws), len(draws)
    if count < 2:
        return ()
    figure = svg.canvas(*(size * max(1.0, count / 4) for size in (5.4, 4.7)))
    grid = figure.subplots(count, count, squeeze=False)
    for row, down in enumerate(names):
        for column, across in enumerate(names):
            axes = grid[row, column]
            axes.grid(visible=False)
            x, y = draws[across], draws[down]
            if column > row:
                axes.axis("off")
                r = float(np.corrcoef(x, y)[0, 1])
                axes.text(
                    0.5, 0.5, number(round(r, 2), 0.1), transform=axes.transAxes,
                    ha="center", va="center", fontsize=9.0 + 7.0 * abs(r),
                    color=svg.COLOURS["ink"],
                )  # fmt: skip
                continue
            _cell(axes, document, across, down, x, y)
            axes.tick_params(labelsize=8.5, labelbottom=row == count - 1)
            axes.tick_params(axis="y", labelleft=row > 0 and column == 0)
            if row == count - 1:
                axes.set_xlabel(_short_label(across, document), fontsize=9)
                axes.tick_params(axis="x", labelrotation=40)
            if column == 0 and row > 0:
                axes.set_ylabel(_short_label(down, document), fontsize=9)
    figure.align_labels()
    return (svg.panel(figure, "corner", "draws of every pair of parameters", wide=True),)


def _cell(
    axes: Any, document: EstimateDocument, across: str, down: str, x: Array, y: Array
) -> None:
    """One scatter plot, or the histogram on the diagonal."""
    p, q = document.parameters[across], document.parameters[down]
    dashed = {"color": svg.COLOURS["ink"], "linestyle": (0, (4, 3)), "linewidth": 0.8}
    if across == down:
        axes.hist(x, bins=24, color=svg.axle_colour(LABELS[across]), alpha=0.75)
        axes.set_yticks([])
    else:
        # A thousand dots a cell as paths would weigh megabytes.
        axes.scatter(
            x, y, s=5.0, color=svg.COLOURS["front"], alpha=0.3, linewidths=0, rasterized=True
        )
        axes.set_ylim(q.mean - 4.0 * q.sd, q.mean + 4.0 * q.sd)
        if q.nominal is not None:
            axes.axhline(q.nominal, **dashed)
    axes.set_xlim(p.mean - 4.0 * p.sd, p.mean + 4.0 * p.sd)
    if p.nominal is not None:
        axes.axvline(p.nominal, **dashed)
    axes.locator_params(axis="x", nbins=3)
    if across != down:
        axes.locator_params(axis="y", nbins=3)


def _draws(document: EstimateDocument, name: str) -> Array:
    """Draws of a parameter; none where they have no spread that could be drawn."""
    values = document.draws.get(name, []) if name in document.parameters else []
    draws = np.array([v for v in values if v is not None], dtype=float)
    return draws if len(draws) > 2 and np.ptp(draws) > 0.0 else np.empty(0)


def _density(draws: Array, grid: Array) -> Array:
    """Gaussian kernel density estimate with Silverman's rule of thumb."""
    sd = float(draws.std(ddof=1)) or 1.0
    width = 1.06 * sd * len(draws) ** -0.2
    z = (grid[:, None] - draws[None, :]) / width
    density: Array = np.exp(-0.5 * z**2).mean(axis=1) / (width * math.sqrt(2.0 * math.pi))
    return density


def _short_label(name: str, document: EstimateDocument) -> str:
    words = "\n".join(short_label(name).rsplit(" ", 1))
    return f"{words}\n[{readable_unit(document.parameters[name].unit)}]"
