"""Drawings of the documentation, which take the colour of the page that they stand on."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import HTML, display
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

__all__ = [
    "BODY",
    "INK",
    "WHEEL",
    "axes_of_a_sensor",
    "drawing",
    "motion_ratio",
    "mounting",
    "signs",
]

INK = "#010203"  # stands for the colour of the text of the page
WHEEL, BODY = "#d9730d", "#2f7fd1"
STYLE = {
    "font.size": 12, "svg.fonttype": "none", "font.family": "sans-serif", "text.color": INK,
    "axes.edgecolor": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
}  # fmt: skip


@contextmanager
def drawing(name: str, alt: str, size: tuple[float, float], **grid: Any) -> Iterator[Any]:
    """Draw into axes, and show the result as part of the page."""
    with plt.rc_context({**STYLE, "svg.hashsalt": name}):
        figure, axes = plt.subplots(figsize=size, layout="constrained", **grid)
        yield axes
        _show(figure, name, alt)


def _show(figure: Figure, name: str, alt: str) -> None:
    file = io.StringIO()
    figure.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    plt.close(figure)
    svg = file.getvalue()[file.getvalue().index("<svg") :].replace(INK, "currentColor")
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", svg)  # unique on the page
    width = figure.get_figwidth() * 72.0
    svg = re.sub(
        r'<svg (.*?) width="[\d.]+pt"',
        rf'<svg role="img" aria-label="{alt}" \1',
        svg,
        flags=re.DOTALL,
    )
    svg = re.sub(
        r'height="[\d.]+pt"', f'style="width:100%;max-width:{1.25 * width:.0f}px"', svg, count=1
    )
    kind = "drawing wide" if width > 550.0 else "drawing"  # what would be too small on a phone
    display(HTML(f'<figure class="{kind}">{svg}</figure>'))


_AXLES = (1.6, -1.6)
_HUB, _FLOOR = 0.55, 1.05


def _car(ax: Axes) -> None:
    """Draw a car from its left side, driving to the right."""
    ax.plot([-2.9, 3.0], [0, 0], color=INK, lw=1)
    for x in _AXLES:
        ax.add_patch(Circle((x, _HUB), 0.55, fill=False, ec=INK, lw=2))
        ax.add_patch(Circle((x, _HUB), 0.09, fc=INK, ec="none"))
        z = np.linspace(_HUB + 0.1, _FLOOR, 40)
        coil = 0.09 * np.sin(np.linspace(0, 10 * np.pi, 40))
        ax.plot(x - 0.22 + coil, z, color=INK, lw=1)
    body = [
        (-2.4, 1.05),
        (-2.5, 1.5),
        (-1.3, 1.6),
        (-0.7, 2.3),
        (0.3, 2.3),
        (0.9, 1.6),
        (2.5, 1.4),
        (2.6, 1.05),
    ]
    ax.fill(*zip(*body, strict=True), fc=INK, alpha=0.06)
    ax.plot(*zip(*body, body[0], strict=True), color=INK, lw=1.6)
    ax.set_aspect("equal")
    ax.axis("off")


def _sensor(ax: Axes, x: float, z: float, colour: str) -> None:
    ax.add_patch(Rectangle((x - 0.11, z - 0.08), 0.22, 0.16, fc=colour, ec="none", zorder=5))
    ax.annotate(
        "", (x, z + 0.52), (x, z + 0.06), zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2},
    )  # fmt: skip


def mounting() -> None:
    """Draw where four accelerometers go."""
    alt = "Side view of a car with a sensor on each hub and one on the frame above each axle"
    with drawing("mounting", alt, (6.4, 3.3)) as ax:
        _car(ax)
        for x, axle in zip(_AXLES, ("front", "rear"), strict=True):
            _sensor(ax, x + 0.16, _HUB, WHEEL)
            _sensor(ax, x + 0.16, _FLOOR + 0.12, BODY)
            side = 1 if x > 0 else -1
            for z, kind, colour, to in (
                (_HUB, "wheel", WHEEL, -0.45),
                (_FLOOR + 0.12, "chassis", BODY, 2.35 if x > 0 else 2.0),
            ):
                far = x + (0.95 if kind == "chassis" else 0.3) * side
                ax.annotate(
                    f"{axle}_{kind}",
                    (x + 0.16, z - 0.08 if kind == "wheel" else z + 0.1),
                    (far, to),
                    ha="center", color=colour, family="monospace", zorder=7,
                    arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.8},
                )  # fmt: skip
        ax.annotate(
            "", (2.95, 0.2), (2.3, 0.2), arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2}
        )
        ax.text(2.62, 0.28, "ahead", ha="center", fontsize=9)
        ax.set(xlim=(-3.1, 3.3), ylim=(-0.7, 2.7))


def signs() -> None:
    """Draw the directions that are positive."""
    alt = "Acceleration is positive upward, pitch nose up, deflection in extension"
    with drawing("signs", alt, (6.4, 2.9)) as ax:
        _car(ax)
        turn = np.radians(np.linspace(150, 60, 40))
        ax.plot(0.2 + 1.15 * np.cos(turn[::-1]), 1.55 + 1.15 * np.sin(turn[::-1]), color=BODY, lw=2)
        end = 0.2 + 1.15 * np.cos(turn[0]), 1.55 + 1.15 * np.sin(turn[0])
        ax.annotate(
            "", (end[0] - 0.06, end[1] - 0.12), end,
            arrowprops={"arrowstyle": "-|>", "color": BODY, "lw": 2},
        )  # fmt: skip
        ax.text(0.35, 2.82, "pitch: nose up", color=BODY, ha="center")
        for z, colour, words in ((2.0, BODY, "acceleration:\nupward"),):
            ax.annotate(
                "",
                (2.1, z + 0.55),
                (2.1, z),
                arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2},
            )
            ax.text(2.25, z + 0.15, words, color=colour)
        x = -1.6
        ax.annotate(
            "", (x - 0.75, _FLOOR), (x - 0.75, _HUB),
            arrowprops={"arrowstyle": "<|-|>", "color": WHEEL, "lw": 2},
        )  # fmt: skip
        for z in (_HUB, _FLOOR):
            ax.plot([x - 0.85, x], [z, z], color=WHEEL, lw=0.8)
        ax.text(x - 0.95, 0.72, "deflection:\nextension", color=WHEEL, ha="right")
        ax.set(xlim=(-4.1, 3.6), ylim=(-0.15, 3.1))


def axes_of_a_sensor() -> None:
    """Draw an upright, an inverted and a tilted sensor, with what each reads at rest."""
    alt = "Readings at rest: plus one g upright, minus one upside down, shares when tilted"
    with drawing("axes", alt, (6.4, 2.6), ncols=3) as axes:
        cases = (
            (0.0, "upright", "z reads +1.00 g", "as it is"),
            (180.0, "upside down", "z reads −1.00 g", "sign = -1"),
            (20.0, "tilted by 20°", "x reads 0.34 g, z 0.94 g", "axis = [0.342, 0, 0.940]"),
        )
        for ax, (angle, title, reading, entry) in zip(np.asarray(axes).flat, cases, strict=True):
            turn = np.radians(angle)
            up = np.array([-np.sin(turn), np.cos(turn)])
            along = np.array([np.cos(turn), np.sin(turn)])
            box = np.array(
                [-0.5 * along, 0.5 * along, 0.5 * along + 0.45 * up, -0.5 * along + 0.45 * up]
            )
            ax.fill(*(box - 0.22 * up).T, fc=BODY, alpha=0.3, ec=BODY)
            for way, name, size in ((up, "z", 0.95), (along, "x", 0.85)):
                ax.annotate(
                    "",
                    size * way,
                    0.0 * way,
                    arrowprops={"arrowstyle": "-|>", "color": BODY, "lw": 2},
                )
                ax.text(*((size + 0.14) * way), name, color=BODY, ha="center", va="center")
            ax.annotate(
                "",
                (1.25, 0.6),
                (1.25, -0.3),
                arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2},
            )
            ax.text(1.3, 0.7, "up", ha="center", fontsize=9)
            ax.text(0.1, 1.45, title, ha="center", fontsize=11)
            ax.text(0.1, -1.35, reading, ha="center", fontsize=9)
            ax.text(0.1, -1.72, entry, ha="center", fontsize=8, family="monospace")
            ax.set(xlim=(-1.4, 1.6), ylim=(-1.8, 1.65), aspect="equal")
            ax.axis("off")


def motion_ratio() -> None:
    """Draw how the travel of wheel and damper differ."""
    alt = "A control arm: the damper is attached half way, so it moves less than the wheel"
    with drawing("ratio", alt, (5.6, 2.9)) as ax:
        for lift, alpha in ((0.0, 1.0), (0.55, 0.3)):
            ax.plot(
                [0, 3.0], [0.6, 0.6 + lift], color=INK, lw=3, alpha=alpha, solid_capstyle="round"
            )
            ax.add_patch(
                Rectangle((2.95, 0.0 + lift), 0.35, 1.2, fc=INK, alpha=0.12 * alpha + 0.03, ec=INK)
            )
            ax.plot([1.85, 1.35], [0.6 + 0.617 * lift, 2.5], color=BODY, lw=4, alpha=alpha)
        ax.add_patch(Circle((0, 0.6), 0.07, fc=INK))
        ax.add_patch(Circle((1.35, 2.5), 0.07, fc=INK))
        ax.add_patch(
            FancyBboxPatch(
                (-0.6, 0.3), 0.45, 2.4, boxstyle="round,pad=0.03", fc=INK, alpha=0.08, ec="none"
            )
        )
        ax.plot([-0.1, 1.35], [2.5, 2.5], color=INK, lw=2)
        ax.text(-0.38, 1.5, "frame", rotation=90, va="center", ha="center")
        ax.annotate(
            "",
            (3.65, 1.15),
            (3.65, 0.6),
            arrowprops={"arrowstyle": "<|-|>", "color": WHEEL, "lw": 1.8},
        )
        ax.text(3.75, 0.87, "wheel travel\n40 mm", color=WHEEL, va="center")
        ax.text(1.95, 1.9, "damper travel\n25 mm", color=BODY, va="center")
        ax.text(3.1, 2.45, "motion_ratio = 25 / 40 = 0.625", ha="center", family="monospace")
        ax.set(xlim=(-0.8, 5.1), ylim=(-0.1, 2.9), aspect="equal")
        ax.axis("off")
