"""What a diagnosis changed: the gap, the parameters, and the laws of dampers and springs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.plots_time import AXLES, values_of
from bayes_asv.report.readable import number, percent, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["gap_bars", "laws", "moved"]

Document = dict[str, Any]

_GAPS: Final = {"fit": "runs fitted", "holdout": "held out"}
_BARS: Final = (("before", "muted"), ("after", "good"), ("floor", "prior"))
_NAMES: Final = {"before": "before", "after": "after", "floor": "sensor noise alone"}
_MOVED: Final = {"c_f": "front", "c_r": "rear", "i": "good"}
_NEAR: Final = 3.0  # times nominal: farther off is no matter of a picture


def gap_bars(document: Document) -> Panel | None:
    """Draw the gap before and after beside what sensor noise alone leaves, fitted and held out."""
    gap = document["gap"]
    there = [(k, words) for k, words in _GAPS.items() if gap.get(k)]
    if not there:
        return None
    figure = canvas(6.0, 0.75 * len(there) + 1.0)
    axes = figure.subplots()
    most = max(gap[k][bar] for k, _ in there for bar, _ in _BARS) or 1.0
    for row, (key, _) in enumerate(there):
        for n, (bar, colour) in enumerate(_BARS):
            value, at = gap[key][bar], row + 0.27 * (n - 1)
            axes.barh(
                at, value, height=0.24, color=COLOURS[colour], linewidth=0,
                label=_NAMES[bar] if row == 0 else None,
            )  # fmt: skip
            axes.text(
                value + 0.012 * most, at, number(value, 0.01 * value), va="center", fontsize=8.5,
                color=COLOURS["ink"],
            )  # fmt: skip
    axes.set(
        yticks=range(len(there)), yticklabels=[words for _, words in there],
        ylim=(len(there) - 0.5, -0.5), xlim=(0.0, 1.12 * most),
        xlabel=f"rms of measured − simulated [{readable_unit(gap['unit'])}]",
    )  # fmt: skip
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside upper left", ncols=3, columnspacing=1.4)
    return panel(figure, "gap", "gap before and after, with what sensor noise leaves", wide=True)


def moved(document: Document) -> Panel | None:
    """Draw each parameter before and after over nominal, with its 95 % interval."""
    before, after = document["parameters_before"], document["parameters_after"]
    names = [
        n for n in _MOVED
        if n in before and n in after and (after[n].get("nominal") or 0.0) > 0.0
    ]  # fmt: skip
    if not names:
        return None
    figure = canvas(6.0, 0.55 * len(names) + 1.0)
    axes = figure.subplots()
    ends = []
    for row, name in enumerate(names):
        nominal = after[name]["nominal"]
        for at, told, paint, marker in (
            (row - 0.15, before[name], COLOURS["muted"], "o"),
            (row + 0.15, after[name], COLOURS[_MOVED[name]], "D"),
        ):
            low, high = (min(v / nominal, _NEAR) for v in told["eti95"])
            axes.plot([low, high], [at, at], color=paint, linewidth=4.0, solid_capstyle="butt")
            axes.plot(min(told["mean"] / nominal, _NEAR), at, marker, color=paint, markersize=5.5)
            ends += [low, high]
    axes.plot([], [], "o-", color=COLOURS["muted"], linewidth=3.0, label="before")
    axes.plot([], [], "D-", color=COLOURS["ink"], linewidth=3.0, label="after")
    axes.axvline(1.0, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0, label="nominal")
    span = max(*ends, 1.0) - min(*ends, 1.0)
    axes.set(
        yticks=range(len(names)), yticklabels=[QUANTITIES[n][1] for n in names],
        ylim=(len(names) - 0.45, -0.55), xlabel="of nominal",
        xlim=(min(*ends, 1.0) - 0.06 * span, max(*ends, 1.0) + 0.06 * span),
    )  # fmt: skip
    axes.xaxis.set_major_formatter(lambda value, _: percent(value))
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside upper left", ncols=3, columnspacing=1.4)
    return panel(figure, "moved", "parameters before and after, over nominal", wide=True)


def laws(document: Document) -> tuple[Panel, ...]:
    """Draw force against velocity, and force against deflection, where an effect bends them."""
    found = document.get("laws") or {}
    there = [
        (axle, part, along, found[axle][part])
        for axle in AXLES
        for part, along in (("damper", "velocity"), ("spring", "deflection"))
        if (found.get(axle) or {}).get(part)
    ]
    panels = []
    for axle, part, along, curve in there:
        alone = len(there) == 1
        figure = canvas(6.0, 3.4) if alone else canvas(height=3.2)
        axes = figure.subplots()
        sides = ("bound", "rebound") if part == "damper" else ("bump", "droop")
        _law(axes, curve, values_of(curve[along]), axle, sides)
        unit, force = readable_unit(curve["unit"]), readable_unit(curve["force_unit"])
        axes.set(
            xlabel=f"suspension {along} [{unit}], extension +",
            ylabel=f"{axle} {part} force [{force}]\nagainst extension +",
        )
        alt = f"{axle} {part}: force against {along}, before and after"
        panels.append(panel(figure, f"law-{axle}-{part}", alt, wide=alone))
    return tuple(panels)


def _law(axes: Axes, curve: Document, grid: Any, axle: str, sides: tuple[str, str]) -> None:
    ink, muted, paint = COLOURS["ink"], COLOURS["muted"], COLOURS[axle]
    axes.axhline(0.0, color=muted, linewidth=0.8)
    axes.axvline(0.0, color=muted, linewidth=0.8)
    axes.plot(
        grid, values_of(curve["nominal"]), color=ink, linestyle=(0, (5, 3)), linewidth=1.0,
        label="nominal",
    )  # fmt: skip
    drawn = [("before", muted, "-"), ("after", paint, "-")]
    if curve.get("after_end"):
        drawn.append(("after_end", paint, ":"))
    for key, colour, dashes in drawn:
        low, high = (values_of(side) for side in curve[key]["band95"])
        axes.fill_between(grid, low, high, color=colour, alpha=0.28, linewidth=0)
        label = {"before": "before", "after": "after", "after_end": "after, run's end"}
        axes.plot(
            grid, values_of(curve[key]["median"]), color=colour, linestyle=dashes, label=label[key]
        )
    # What compression is called, for those who do not think in signs.
    for share, height, side, words in (
        (0.02, 0.93, "left", f"← {sides[0]}"), (0.98, 0.03, "right", f"{sides[1]} →"),
    ):  # fmt: skip
        axes.text(
            share, height, words, transform=axes.transAxes, ha=side, fontsize=8.5, color=muted
        )
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(drawn) + 1,
                columnspacing=1.0)  # fmt: skip
