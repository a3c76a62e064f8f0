"""SVG that can share a page: one look, ids of its own, the same bytes for the same figure."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["COLOURS", "Panel", "canvas", "gauge", "panel", "style", "themed"]

# Okabe and Ito's palette, safe for colour-blind readers; the darker four keep 3:1 on white.
COLOURS: Final = {
    "ink": "#1b1f24",
    "muted": "#5b6470",
    "grid": "#d9dde2",
    "front": "#0072b2",
    "rear": "#d55e00",
    "prior": "#946c00",
    "good": "#007a5a",
    "below": "#b0244a",
    "above": "#6a4fb3",
}

WIDTH, HEIGHT = 4.3, 2.9  # inches; two panels stand side by side on a page, one fills a phone


class Panel(NamedTuple):
    """One picture.

    Attributes
    ----------
    key : str
        Unique in the report; ids inside begin with it.
    alt : str
        What it shows, for those who cannot see it.
    svg : str
        The ``<svg>`` element.
    wide : bool
        Whether it takes the whole width of a page.
    """

    key: str
    alt: str
    svg: str
    wide: bool = False


@contextmanager
def style() -> Iterator[None]:
    """Draw in the report's look whatever matplotlib was told before."""
    import matplotlib as mpl

    ours: dict[str, Any] = {
        "font.family": "DejaVu Sans",  # travels with matplotlib, so every machine draws alike
        "font.size": 9.5,
        "axes.labelsize": 9.5,
        "axes.titlesize": 9.5,
        "xtick.labelsize": 9,
        "ytick.labelsize": 9,
        "legend.fontsize": 8.5,
        "legend.frameon": False,
        "legend.borderaxespad": 0.2,
        "legend.handlelength": 1.6,
        "text.color": COLOURS["ink"],
        "axes.labelcolor": COLOURS["ink"],
        "axes.edgecolor": COLOURS["muted"],
        "xtick.color": COLOURS["muted"],
        "ytick.color": COLOURS["muted"],
        "xtick.labelcolor": COLOURS["ink"],
        "ytick.labelcolor": COLOURS["ink"],
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": COLOURS["grid"],
        "grid.linewidth": 0.6,
        "axes.linewidth": 0.8,
        "lines.linewidth": 1.3,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "svg.fonttype": "path",
        "svg.hashsalt": "bayes_asv",  # without it the ids are random
        "text.parse_math": False,  # units come from a file
        "axes.unicode_minus": True,
        "path.simplify": True,
        "path.simplify_threshold": 0.15,
    }
    kept = ("backend", "backend_fallback", "toolbar", "interactive")
    rc: dict[Any, Any] = {k: v for k, v in mpl.rcParamsDefault.items() if k not in kept}
    rc.update(ours)
    with mpl.rc_context(rc):
        yield


def canvas(width: float = WIDTH, height: float = HEIGHT) -> Canvas:
    """Make an empty figure that belongs to no window."""
    from matplotlib.figure import Figure as Canvas

    return Canvas(figsize=(width, height), layout="constrained")


def panel(figure: Canvas, key: str, alt: str, *, wide: bool = False) -> Panel:
    """Turn a matplotlib figure into a picture of the report.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Drawn inside :func:`style`.
    key : str
        Unique in the report, letters, digits and hyphens.
    alt : str
        What it shows.
    wide : bool
        Whether it takes the whole width of a page.

    Returns
    -------
    Panel
        With ids that begin with `key`, no metadata, no document type, coordinates of 1/100 point.
    """
    buffer = io.StringIO()
    none = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=none, dpi=200)
    text = buffer.getvalue()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    return Panel(key, alt, _named(_prefixed(_shortened(text), key), alt), wide)


def _prefixed(text: str, key: str) -> str:
    """Put `key` before every id and every reference to one."""
    text = re.sub(r'(\sid=")', rf"\g<1>{key}-", text)
    text = re.sub(r'(href="#)', rf"\g<1>{key}-", text)
    return text.replace("url(#", f"url(#{key}-")


def _shortened(text: str) -> str:
    """Leave coordinates at 1/100 point: half the size, and no eye can tell."""

    def curt(found: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", lambda m: f"{float(m[0]):.2f}", found[0])

    return re.sub(r'\s(?:d|x|y)="[^"]*"', curt, text)


def _named(text: str, alt: str) -> str:
    """Scale with the page, and tell a screen reader what this is."""
    head, rest = text.split(">", 1)
    head = re.sub(r'\s(?:width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{escape(alt, quote=True)}">{rest}'


def themed(svg: str) -> str:
    """Let a page's colour scheme recolour a picture by custom properties."""
    for name, colour in COLOURS.items():
        svg = svg.replace(f"{colour};", f"var(--{name}, {colour});")
        svg = svg.replace(f'{colour}"', f'var(--{name}, {colour})"')
    return svg


def gauge(key: str, share: float, low: float, high: float, reach: float, colour: str) -> Panel:
    """Draw where a parameter lies against nominal, as a dot with its 95 % interval.

    Parameters
    ----------
    key : str
        Unique in the report.
    share, low, high : float
        Mean and interval over nominal, less one.
    reach : float
        Where the scale ends on either side, as a share.
    colour : str
        One of :data:`COLOURS`.

    Returns
    -------
    Panel
        300 × 40 units.
    """

    def x(value: float) -> float:
        return 150.0 + 130.0 * max(-1.08, min(1.08, value / reach))

    ink, muted, grid = COLOURS["ink"], COLOURS["muted"], COLOURS["grid"]
    paint = COLOURS[colour]
    left, right = x(low), x(high)
    wide = max(right - left, 2.0)
    left = (left + right) / 2.0 - wide / 2.0
    font = "font-family: 'DejaVu Sans', Verdana, sans-serif; font-size: 11px"
    ends = "".join(
        f'<text x="{x(s * reach):.2f}" y="37" text-anchor="middle" '
        f'style="fill: {muted}; {font}">{word}</text>'
        for s, word in (
            (-1, f"−{100 * reach:.0f} %"), (0, "nominal"), (1, f"+{100 * reach:.0f} %"),
        )
    )  # fmt: skip
    ticks = "".join(
        f'<path d="M{x(s * reach / 2):.2f} 9V17" style="stroke: {grid}; stroke-width: 1.5"/>'
        for s in (-2, -1, 1, 2)
    )
    alt = f"{100 * share:+.0f} % from nominal, on a scale of ±{100 * reach:.0f} %"
    return Panel(
        key,
        alt,
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 300 40" role="img" '
        f'aria-label="{escape(alt)}">'
        f'<path d="M10 13H290" style="stroke: {grid}; stroke-width: 3; stroke-linecap: round"/>'
        f"{ticks}"
        f'<path d="M150 3V23" style="stroke: {ink}; stroke-width: 2"/>'
        f'<rect x="{left:.2f}" y="8" width="{wide:.2f}" height="10" rx="1" '
        f'style="fill: {paint}; fill-opacity: 0.35"/>'
        f'<circle cx="{x(share):.2f}" cy="13" r="5" style="fill: {paint}"/>'
        f"{ends}</svg>",
    )
