"""Fig. 3.1: the half car and its symbols."""

from __future__ import annotations

from typing import Any

import numpy as np

from bayes_asv.report.svg import COLOURS, Panel, canvas, panel

__all__ = ["half_car"]

_FRONT, _REAR, _CG = 8.0, 0.0, 3.76  # car drawn nose to the right; CG at wdf = 0.47


def half_car() -> Panel:
    """Draw the half car: chassis on springs and dampers, wheels as inputs."""
    figure = canvas(width=7.0, height=3.4)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set_aspect("equal")
    ink = COLOURS["ink"]
    axes.plot([_REAR - 0.7, _FRONT + 0.7], [4.0, 4.0], color=ink, linewidth=5.0)
    axes.plot([_CG], [4.0], "o", color=ink, markersize=9, markerfacecolor="white")
    axes.text(_CG - 0.15, 4.55, "CG", ha="right")
    axes.text(_CG + 1.9, 4.4, "m, i", ha="center", fontsize=11)
    for x, s, colour in ((_FRONT, "f", "front"), (_REAR, "r", "rear")):
        paint = COLOURS[colour]
        _spring(axes, x - 0.45, 1.2, 4.0, paint)
        _damper(axes, x + 0.45, 1.2, 4.0, paint)
        axes.plot([x - 0.8, x + 0.8], [1.2, 1.2], color=paint, linewidth=2.5)
        axes.text(x - 0.85, 2.6, f"k{_SUB[s]}", ha="right", color=paint, fontsize=11)
        axes.text(x + 0.85, 2.6, f"c{_SUB[s]}", ha="left", color=paint, fontsize=11)
        _arrow(axes, (x, 0.25), (x, 1.15), paint)
        axes.text(x + 0.2, 0.45, f"u{_SUB[s]}", color=paint, fontsize=11)
        end = 1.3 if s == "f" else -1.3
        _arrow(axes, (x + end, 4.0), (x + end, 5.0), ink)
        axes.text(x + end, 5.1, f"x{_SUB[s]}", ha="center", fontsize=11)
    _arrow(axes, (_CG, 4.2), (_CG, 5.6), ink)
    axes.text(_CG + 0.2, 5.4, "x", fontsize=11)
    turn = np.linspace(-0.2, 0.9, 30)
    axes.plot(_CG + 1.2 * np.cos(turn), 4.0 + 1.2 * np.sin(turn), color=ink, linewidth=1.2)
    _arrow(axes, (_CG + 1.2 * np.cos(0.8), 4.0 + 1.2 * np.sin(0.8)),
           (_CG + 1.2 * np.cos(1.0), 4.0 + 1.2 * np.sin(1.0)), ink)  # fmt: skip
    axes.text(_CG + 1.0, 5.1, "θ", fontsize=11)
    for left, right, word in ((_REAR, _CG, f"l{_SUB['r']} = l·wdf"),
                              (_CG, _FRONT, f"l{_SUB['f']} = l·(1−wdf)")):  # fmt: skip
        style = {"arrowstyle": "<->", "color": COLOURS["muted"], "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (left, 6.1), (right, 6.1), arrowprops=style)
        axes.text(0.5 * (left + right), 6.25, word, ha="center", color=COLOURS["muted"])
    axes.text(_FRONT + 1.9, 2.6, "front", color=COLOURS["front"], ha="left")
    axes.text(_REAR - 1.9, 2.6, "rear", color=COLOURS["rear"], ha="right")
    axes.set(xlim=(-3.2, 11.2), ylim=(0.0, 6.9))
    alt = (
        "Half car: a rigid chassis of mass m and pitch inertia i on a spring and a damper at each "
        "axle; wheel positions u are the inputs; heave x and pitch θ, nose up, are the degrees of "
        "freedom"
    )
    return panel(figure, "figure-3-1", alt, wide=True)


_SUB = {"f": "_f", "r": "_r"}


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0, "linewidth": 1.2}
    axes.annotate("", end, start, arrowprops=style)


def _spring(axes: Any, x: float, low: float, high: float, colour: str) -> None:
    turns = 7
    y = np.concatenate([[low], np.linspace(low + 0.5, high - 0.5, 2 * turns), [high]])
    side = np.concatenate([[0.0], 0.22 * (-1.0) ** np.arange(2 * turns), [0.0]])
    side[[1, -2]] = 0.0
    axes.plot(x + side, y, color=colour, linewidth=1.4)


def _damper(axes: Any, x: float, low: float, high: float, colour: str) -> None:
    middle = 0.5 * (low + high)
    axes.plot([x, x], [low, middle - 0.5], color=colour, linewidth=1.4)
    axes.plot([x - 0.24, x - 0.24, x + 0.24, x + 0.24],
              [middle + 0.4, middle - 0.5, middle - 0.5, middle + 0.4],
              color=colour, linewidth=1.4)  # fmt: skip
    axes.plot([x - 0.17, x + 0.17], [middle, middle], color=colour, linewidth=2.2)
    axes.plot([x, x], [middle, high], color=colour, linewidth=1.4)
