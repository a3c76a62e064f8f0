"""Each run's own value beside the answer from all: a forest plot."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.report.readable import number, plain, readable_unit
from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

__all__ = ["forest"]

Document = dict[str, Any]

_COMPARED: Final = {
    "c_f": ("front damping", "front"),
    "c_r": ("rear damping", "rear"),
    "i": ("pitch inertia", "muted"),
}
_MOST: Final = 40  # runs that a page has room for
_LONGEST: Final = 22  # letters of a file's name
_NEAR: Final = 0.35  # of the range: farther off nominal is told and not drawn


def forest(document: Document) -> Panel | None:
    """Draw every run's interval for c_f, c_r and i, with the answer and nominal.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    Panel or None
        None with a single run.
    """
    found = document.get("agreement")
    if not found or not found["runs"] or not document.get("parameters"):
        return None
    runs = found["runs"][:_MOST]
    apart = found["verdict"] == "disagree"
    labels = [_short(plain(run["source"])) for run in runs]
    labels += ["mean car", "a run to come"] if apart else ["all runs"]
    figure = canvas(6.0, 0.23 * len(labels) + 1.3)
    columns = figure.subplots(1, len(_COMPARED), sharey=True)
    for axes, (name, (words, colour)) in zip(columns, _COMPARED.items(), strict=True):
        answer = found["mean_car" if apart else "joint"].get(name)
        told = [run["parameters"].get(name) or {} for run in runs]
        ends = [v for p in told for v in _ends(p)] + ([] if answer is None else answer["eti95"])
        if answer is None or not ends:
            axes.axis("off")
            continue
        paint = COLOURS[colour]
        low, high = answer["eti95"]
        axes.axvspan(low, high, color=paint, alpha=0.14, linewidth=0)
        for row, p in enumerate(told):
            own = p.get("own")
            if not own:
                continue
            if p.get("eti95"):
                axes.plot(p["eti95"], [row, row], color=paint, linewidth=1.0, alpha=0.6)
            axes.plot(own["eti95"], [row, row], color=paint, linewidth=4.0, solid_capstyle="butt")
            axes.plot(own["mean"], row, "o", color=paint, markersize=4.5)
        for row, p in enumerate([answer, *([found["next_run"][name]] if apart else [])]):
            at = len(runs) + row
            axes.plot(p["eti95"], [at, at], color=COLOURS["ink"], linewidth=1.6)
            axes.plot(p["median"], at, "D", color=COLOURS["ink"], markersize=5.0)
        _frame(axes, ends, document["parameters"][name].get("nominal"))
        unit = readable_unit(answer["unit"])
        axes.set_xlabel(f"{words} [{unit}]")
        axes.set(yticks=range(len(labels)), yticklabels=labels, ylim=(len(labels) - 0.4, -0.6))
        axes.axhline(len(runs) - 0.5, color=COLOURS["grid"], linewidth=0.8)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.locator_params(axis="x", nbins=4)
    return panel(figure, "agreement", "each run's own values beside the answer from all", wide=True)


def _ends(parameter: Document) -> list[float]:
    return [*(parameter.get("eti95") or []), *((parameter.get("own") or {}).get("eti95") or [])]


def _frame(axes: Any, ends: list[float], nominal: float | None) -> None:
    """Set the range by what is known, and draw nominal where it falls into it."""
    low, high = min(ends), max(ends)
    span = (high - low) or abs(high) or 1.0
    left, right = low - 0.06 * span, high + 0.06 * span
    if nominal is not None and low - _NEAR * span <= nominal <= high + _NEAR * span:
        left, right = min(left, nominal - 0.03 * span), max(right, nominal + 0.03 * span)
        axes.axvline(nominal, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0)
        axes.set_title(f"nominal {number(nominal)}", fontsize=8.5)
    elif nominal is not None:
        arrow = f"← nominal {number(nominal)}" if nominal < low else f"nominal {number(nominal)} →"
        axes.set_title(arrow, fontsize=8.5)
    axes.set_xlim(left, right)


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
