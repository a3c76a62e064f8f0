"""The error budget as bars: what each answer's variance is made of."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.budget_words import budgets, sd_words
from bayes_asv.report.readable import percent
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

__all__ = ["budget_bars"]

Document = dict[str, Any]

# Parts of a bar in their order: words, colour, hatch.
_PARTS: Final = {
    "m": ("sprung mass", "above", ""),
    "l": ("wheelbase", "below", ""),
    "wdf": ("front weight fraction", "good", ""),
    "k_f": ("front spring rate", "front", ""),
    "k_r": ("rear spring rate", "rear", ""),
    "prior": ("belief before the data", "prior", ""),
    "wheel": ("wheel sensors", "muted", ""),
    "chassis": ("chassis sensors", "muted", "////"),
    "other": ("rest of the recordings", "grid", ""),
}
_SEEN: Final = 0.005  # least share that is drawn
_WRITTEN: Final = 0.07  # and that has its number written over it


def budget_bars(document: Document) -> Panel | None:
    """Draw a bar an answer, cut into the shares of its variance."""
    found = budgets(document)
    if not found:
        return None
    names = list(found)
    parts = {name: _parts(budget) for name, budget in found.items()}
    figure = canvas(6.6, 0.62 * len(names) + 1.0)
    axes = figure.subplots()
    drawn = [p for p in _PARTS if any(parts[n].get(p, 0.0) >= _SEEN for n in names)]
    for row, name in enumerate(names):
        start = 0.0
        for part in drawn:
            share = parts[name].get(part, 0.0)
            share = share if share >= _SEEN else 0.0
            words, colour, hatch = _PARTS[part]
            axes.barh(
                row, share, left=start, height=0.46, color=COLOURS[colour],
                alpha=0.55 if hatch else 1.0, hatch=hatch, linewidth=0,
                label=words if row == 0 else None,
            )  # fmt: skip
            if share >= _WRITTEN:
                axes.text(
                    start + 0.5 * share, row - 0.27, percent(share),
                    ha="center", va="bottom", fontsize=8.5, color=COLOURS["ink"],
                )  # fmt: skip
            start += share
        axes.text(
            1.02, row, sd_words(found[name]["sd_percent"]), va="center",
            fontsize=9, color=COLOURS["ink"],
        )  # fmt: skip
    axes.set(
        yticks=range(len(names)), yticklabels=[QUANTITIES[n][1] for n in names],
        xlim=(0.0, 1.0), ylim=(len(names) - 0.6, -0.75), xlabel="share of the variance",
        xticks=[0.0, 0.25, 0.5, 0.75, 1.0],
        xticklabels=[percent(s) for s in (0.0, 0.25, 0.5, 0.75, 1.0)],
    )  # fmt: skip
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside upper left", ncols=4, columnspacing=1.2, handlelength=1.1)
    return panel(figure, "width", "what the variance of each answer is made of", wide=True)


def _parts(budget: Document) -> Document:
    """Shares by part of a bar."""
    out = {name: share for name, share in budget["shares"].items() if name in _PARTS}
    data = float(budget["shares"].get("data", 0.0))
    for part in ("wheel", "chassis"):
        own = [s for name, s in budget["noises"].items() if name.endswith(part)]
        out[part] = float(sum(own))
    out["other"] = max(data - out["wheel"] - out["chassis"], 0.0)
    return out
