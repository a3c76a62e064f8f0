"""Posterior against prior and nominal, and the corner plot."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.report.readable import number, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel
from bayes_asv.report.words import LABELS, SHOWN

__all__ = ["corner", "posteriors", "prior_of"]

Document = dict[str, Any]
Array = NDArray[np.float64]

PAINT: Final = {"c_f": "front", "c_r": "rear", "i": "muted", "k_g": "muted"}


def prior_of(name: str, document: Document) -> tuple[float, float] | None:
    """Median and deviation of the logarithm of a log-normal prior.

    Parameters
    ----------
    name : str
        ``c_f``, ``c_r``, ``i`` or ``k_g``.
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    tuple of float or None
        For ``k_g`` = √(i/m) it follows from those of ``i`` and the sprung mass.
    """
    priors = document.get("prior") or {}
    if name in priors:
        return priors[name]["median"], priors[name]["log_sd"]
    if name != "k_g" or "i" not in priors:
        return None
    inertia, p = priors["i"], document["parameters"]
    mass = document.get("known", {}).get("m", {})
    relative = (mass.get("sd") or 0.0) / mass["value"] if mass.get("value") else 0.0
    median = p["k_g"]["nominal"] * math.sqrt(inertia["median"] / p["i"]["nominal"])
    return median, 0.5 * math.hypot(inertia["log_sd"], relative)


def posteriors(document: Document) -> tuple[Panel, ...]:
    """Draw density of posterior and prior, with nominal, a panel a parameter."""
    panels = []
    for name in SHOWN:
        draws, p = _draws(document, name), document["parameters"].get(name)
        if p is None or len(draws) < 3 or not p["sd"]:
            continue
        nominal = p.get("nominal")
        there = [p["mean"]] if nominal is None else [p["mean"], nominal]
        margin = max(4.5 * p["sd"], 0.12 * (max(there) - min(there)))
        start, stop = float(min(there) - margin), float(max(there) + margin)
        figure = canvas(height=2.2)
        axes = figure.subplots()
        paint = COLOURS[PAINT[name]]
        grid = np.unique(
            np.concatenate(
                [np.linspace(start, stop, 200), p["mean"] + p["sd"] * np.linspace(-4.5, 4.5, 200)]
            )
        )
        density = _density(draws, grid)
        low, high = p["eti95"]
        inside = (grid >= low) & (grid <= high)
        axes.fill_between(grid[inside], density[inside], color=paint, alpha=0.3, linewidth=0)
        axes.plot(grid, density, color=paint, label="posterior")
        prior = prior_of(name, document)
        if prior is not None:
            positive = grid[grid > 0.0]
            z = (np.log(positive) - math.log(prior[0])) / prior[1]
            height = np.exp(-0.5 * z**2) / (positive * prior[1] * math.sqrt(2.0 * math.pi))
            axes.plot(positive, height, color=COLOURS["prior"], linewidth=1.8, label="prior")
        if nominal is not None:
            axes.axvline(
                nominal, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.2,
                label=f"nominal {number(nominal)}",
            )  # fmt: skip
        axes.set(xlabel=_label(name, p), ylabel="density", xlim=(start, stop), yticks=[])
        axes.set_ylim(0.0, 1.08 * float(density.max()))
        axes.grid(visible=False)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.2)
        panels.append(panel(figure, f"posterior-{name.replace('_', '-')}",
                            f"posterior, prior and nominal of the {LABELS[name]}"))  # fmt: skip
    return tuple(panels)


def corner(document: Document) -> Panel | None:
    """Draw every pair of parameters against each other, with correlations above the diagonal."""
    names = [n for n in SHOWN if len(_draws(document, n)) > 2 and document["parameters"][n]["sd"]]
    if len(names) < 2:
        return None
    count = len(names)
    draws = {n: _draws(document, n) for n in names}
    figure = canvas(5.4, 4.7)
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
                    color=COLOURS["ink"],
                )  # fmt: skip
                continue
            _cell(axes, document, across, down, x, y)
            axes.tick_params(labelsize=8.5, labelbottom=row == count - 1)
            axes.tick_params(axis="y", labelleft=row > 0 and column == 0)
            if row == count - 1:
                axes.set_xlabel(_short(across, document), fontsize=9)
                axes.tick_params(axis="x", labelrotation=40)
            if column == 0 and row > 0:
                axes.set_ylabel(_short(down, document), fontsize=9)
    figure.align_labels()
    return panel(figure, "corner", "draws of every pair of parameters", wide=True)


def _cell(axes: Any, document: Document, across: str, down: str, x: Array, y: Array) -> None:
    """One scatter, or the histogram on the diagonal."""
    p, q = document["parameters"][across], document["parameters"][down]
    if across == down:
        axes.hist(x, bins=24, color=COLOURS[PAINT[across]], alpha=0.75)
        axes.set_yticks([])
    else:
        # A thousand dots a cell as paths would weigh megabytes.
        axes.scatter(x, y, s=5.0, color=COLOURS["front"], alpha=0.3, linewidths=0, rasterized=True)
        axes.set_ylim(q["mean"] - 4.0 * q["sd"], q["mean"] + 4.0 * q["sd"])
        axes.axhline(q["nominal"], color=COLOURS["ink"], linestyle=(0, (4, 3)), linewidth=0.8)
    axes.set_xlim(p["mean"] - 4.0 * p["sd"], p["mean"] + 4.0 * p["sd"])
    axes.axvline(p["nominal"], color=COLOURS["ink"], linestyle=(0, (4, 3)), linewidth=0.8)
    axes.locator_params(axis="x", nbins=3)
    if across != down:
        axes.locator_params(axis="y", nbins=3)


def _draws(document: Document, name: str) -> Array:
    values = (document.get("draws") or {}).get(name) or []
    return np.array([v for v in values if v is not None], dtype=float)


def _density(draws: Array, grid: Array) -> Array:
    """Gaussian kernel density with Silverman's rule of thumb."""
    sd = float(draws.std(ddof=1)) or 1.0
    width = 1.06 * sd * len(draws) ** -0.2
    z = (grid[:, None] - draws[None, :]) / width
    density: Array = np.exp(-0.5 * z**2).mean(axis=1) / (width * math.sqrt(2.0 * math.pi))
    return density


def _label(name: str, p: Document) -> str:
    unit = readable_unit(p["unit"])
    return f"{LABELS[name]} [{unit}]" if unit else LABELS[name]


def _short(name: str, document: Document) -> str:
    words = {"c_f": "front\ndamping", "c_r": "rear\ndamping", "i": "pitch\ninertia",
             "k_g": "radius of\ngyration"}  # fmt: skip
    unit = readable_unit(document["parameters"][name]["unit"])
    return f"{words[name]}\n[{unit}]"
