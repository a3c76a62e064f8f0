"""Figures as SVG: one style, ids unique on the page, the same bytes for the same figure."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import AXLES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = [
    "AXLES",
    "COLOURS",
    "SMALL",
    "WIDTH",
    "Panel",
    "axle_colour",
    "axle_panels",
    "canvas",
    "curve_array",
    "draw_autocorrelations",
    "draw_level",
    "draw_spectra",
    "gauge",
    "label_rows",
    "label_spectra",
    "legend_above",
    "mark_stop",
    "panel",
    "place_style",
    "power_of_ten",
    "shared_limits",
    "style",
    "themed",
]

Curve = Sequence[float | None]

# Okabe and Ito's palette, safe for colour-blind readers; the darker four keep 3:1 on white.
COLOURS: Final = {
    "ink": "#1b1f24",
    "muted": "#5b6470",
    "grid": "#d9dde2",
    "front": "#0072b2",
    "rear": "#d55e00",
    "prior": "#946c00",
    "good": "#007184",
    "below": "#b0244a",
    "above": "#6a4fb3",
}

WIDTH, HEIGHT = 4.3, 2.9  # inches; a page has two panels side by side, a phone one
SMALL: Final = (3.4, 1.8)
"""Width and height of a panel of which a page has three side by side, inches."""
_GAUGE: Final = 10.0  # times its interval: the longest scale of a gauge

_SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Panel(NamedTuple):
    """One picture."""

    key: str
    """Unique in the report; ids inside begin with it."""
    alt: str
    """Description for screen readers."""
    svg: str
    """The ``<svg>`` element."""
    wide: bool = False
    """Whether it takes the whole width of a page."""


@contextmanager
def style() -> Iterator[None]:
    """Draw in the style of the report, whatever the user's matplotlib settings are."""
    import matplotlib as mpl

    ours: dict[str, Any] = {
        "font.family": "DejaVu Sans",  # is part of matplotlib, so that every machine draws alike
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
    """Make an empty figure without a window."""
    from matplotlib.figure import Figure as Canvas

    return Canvas(figsize=(width, height), layout="constrained")


def panel(figure: Canvas, key: str, alt: str, *, wide: bool = False) -> Panel:
    """Turn a figure that was drawn inside :func:`style` into a picture of the report.

    `key` is of letters, digits and hyphens.  The picture has ids that begin with it, no metadata,
    no document type, and coordinates of 1/100 point.
    """
    buffer = io.StringIO()
    none = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=none, dpi=200)
    text = buffer.getvalue()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    return Panel(key, alt, _named(_prefixed(_shortened(text), key), alt), wide)


def _prefixed(text: str, key: str) -> str:
    """Put `key` in front of every id and every reference to one."""
    text = re.sub(r'(\sid=")', rf"\g<1>{key}-", text)
    text = re.sub(r'(href="#)', rf"\g<1>{key}-", text)
    return text.replace("url(#", f"url(#{key}-")


def _shortened(text: str) -> str:
    """Round coordinates to 1/100 point, which halves the size."""

    def rounded(found: re.Match[str]) -> str:
        return re.sub(r"-?\d+\.\d{3,}", lambda m: f"{float(m[0]):.2f}", found[0])

    return re.sub(r'\s(?:d|x|y)="[^"]*"', rounded, text)


def _named(text: str, alt: str) -> str:
    """Scale with the page, with a label for screen readers."""
    head, rest = text.split(">", 1)
    head = re.sub(r'\s(?:width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{escape(alt, quote=True)}">{rest}'


def themed(svg: str) -> str:
    """Replace colours by custom properties, which the colour scheme of a page sets."""
    for name, colour in COLOURS.items():
        svg = svg.replace(f"{colour};", f"var(--{name}, {colour});")
        svg = svg.replace(f'{colour}"', f'var(--{name}, {colour})"')
    return svg


def curve_array(curve: Curve) -> NDArray[np.float64]:
    """Return a curve of a document as an array, with nan where it has no number."""
    return np.array([np.nan if v is None else v for v in curve], dtype=float)


def shared_limits(curves: Sequence[Curve]) -> tuple[float, float]:
    """Limits of an axis that several curves share, so that they can be compared."""
    values = np.concatenate([curve_array(curve) for curve in curves])
    values = values[np.isfinite(values)]
    if not len(values):
        return -1.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or 1.0
    return low - margin, high + margin


def power_of_ten(value: float) -> str:
    """Write 10⁻² for 0.01, without markup that the text of a unit could be taken for."""
    if value <= 0.0:
        return ""
    return "10" + str(round(math.log10(value))).translate(_SUPERSCRIPTS)


def axle_panels(
    key: str,
    draw: Callable[[Axes, str], str | None],
    height: float = HEIGHT,
    places: Iterable[str] = AXLES,
) -> tuple[Panel, ...]:
    """Draw one panel an axle, or one for each of other places such as ``front_left``.

    Parameters
    ----------
    key : str
        With braces for the place, such as ``wheel-{}-0``.
    draw : callable
        From axes and place to a description for screen readers; None where nothing is to draw.
    height : float
        Inches.
    places : iterable of str
        Names of the places.
    """
    panels = []
    for place in places:
        figure = canvas(height=height)
        alt = draw(figure.subplots(), place)
        if alt is not None:
            panels.append(panel(figure, key.format(place.replace("_", "-")), alt))
    return tuple(panels)


def axle_colour(name: str) -> str:
    """Colour of the axle that a name begins with, as ``front_left`` or ``rear damping rate``."""
    axle = re.split("[ _]", name, maxsplit=1)[0]
    return COLOURS[axle if axle in AXLES else "muted"]


def legend_above(axes: Axes, columns: int = 3) -> None:
    """Put the legend above the axes."""
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, columnspacing=1.2)


def label_rows(figure: Canvas, axes: Axes, labels: Sequence[str], columns: int = 3) -> None:
    """Label the rows of a bar chart, with the legend above it."""
    axes.set(yticks=range(len(labels)), yticklabels=labels)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside upper left", ncols=columns, columnspacing=1.3)


def draw_level(axes: Axes, value: float, text: str, *, above: bool) -> None:
    """Draw a dashed horizontal line with its text above or below it, at the right."""
    axes.axhline(value, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0)
    axes.annotate(
        text, (0.99, value), xycoords=("axes fraction", "data"), xytext=(0, 3 if above else -3),
        textcoords="offset points", ha="right", va="bottom" if above else "top", fontsize=8.5,
    )  # fmt: skip


def mark_stop(axes: Axes, at: float, text: str) -> None:
    """Draw a dashed vertical line with its text above the axes."""
    axes.axvline(at, color=COLOURS["ink"], linestyle=(0, (5, 3)), linewidth=1.0)
    axes.annotate(
        text, (at, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
        textcoords="offset points", ha="left" if at < 0.0 else "right", va="bottom", fontsize=8.5,
    )  # fmt: skip


Look = dict[str, Any]
"""Colour and style of a line."""


def place_style(name: str) -> Look:
    """Colour of the axle and dashes of the side that a name has, for curves in one panel."""
    body = not name.startswith(AXLES)
    dashes: Any = (0, (4, 1.5)) if "right" in name or "travel" in name else "-"
    return {"color": COLOURS["good"] if body else axle_colour(name), "linestyle": dashes}


def draw_spectra(axes: Axes, frequency: Curve, spectra: Sequence[tuple[str, Look, Curve]]) -> bool:
    """Draw spectral densities (label, look, values); False if one has no positive value."""
    densities = []
    for label, look, values in spectra:
        density = curve_array(values)
        density[~(density > 0.0)] = np.nan
        if not np.isfinite(density).any():
            return False  # a channel that never moved has no logarithm
        densities.append((label, look, density))
    for label, look, density in densities:
        axes.loglog(curve_array(frequency), density, label=label, **look)
    return True


def label_spectra(axes: Axes) -> None:
    """Label the axes of spectra: frequencies as they are, densities as powers of ten."""
    axes.set_xlabel("frequency [Hz]")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_major_formatter(lambda value, _: power_of_ten(value))


def draw_autocorrelations(
    axes: Axes,
    curves: Sequence[tuple[str, str, Sequence[float]]],
    band: float,
    lag_seconds: float,
) -> None:
    """Draw autocorrelations (label, place, values) from lag 1 on, with the 95 % band ±`band`."""
    axes.axhspan(-band, band, color=COLOURS["muted"], alpha=0.2, linewidth=0)
    axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
    end, longest = max(2.2 * band, 1e-3), 1
    for n, (label, place, values) in enumerate(curves):
        look = place_style(place)
        lags = np.arange(1, len(values) + 1) + 0.3 * (n - 0.5 * (len(curves) - 1))
        axes.vlines(lags, 0.0, values, color=look["color"], linewidth=1.6)
        axes.plot(lags, values, "os^D"[n % 4], color=look["color"], markersize=3.0, label=label)
        end, longest = max(end, 1.15 * max(map(abs, values))), max(longest, len(values))
    axes.set(
        xlabel=f"lag [samples of {1e3 * lag_seconds:.3g} ms]", ylabel="autocorrelation",
        ylim=(-end, end), xlim=(0.3, longest + 0.7),
    )  # fmt: skip
    legend_above(axes, 2)


def gauge(
    key: str,
    mean: float | None,
    low: float,
    high: float,
    nominal: float | None,
    colour: str,
    reference: str = "",
) -> Panel:
    """Draw the mean and 95 % interval of a parameter on a scale that fits them, 300 × 52 units.

    Without a mean the interval alone is drawn.  The scale includes the nominal value unless the
    interval would then take less than a tenth of it; an arrow then points to where nominal is.
    `colour` is one of :data:`COLOURS`.  `reference` is another name for the nominal value.
    """  # fmt: skip
    from matplotlib.ticker import MaxNLocator

    middle = 0.5 * (low + high) if mean is None else mean
    left, right, outside = _gauge_scale(middle, low, high, nominal)

    def x(value: float) -> float:
        return 12.0 + 276.0 * min(max((value - left) / (right - left), 0.0), 1.0)

    ink, muted, grid = COLOURS["ink"], COLOURS["muted"], COLOURS["grid"]
    paint, font = (
        COLOURS[colour],
        "font-family: 'DejaVu Sans', Verdana, sans-serif; font-size: 11px",
    )
    ticks = [
        t
        for t in MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(left, right)
        if left <= t <= right
    ]
    parts = [f'<path d="M12 25H288" style="stroke: {grid}; stroke-width: 3"/>']
    for tick in ticks:
        parts.append(
            f'<path d="M{x(tick):.2f} 22V31" style="stroke: {muted}; stroke-width: 1"/>'
            f'<text x="{min(max(x(tick), 16.0), 284.0):.2f}" y="48" text-anchor="middle" '
            f'style="fill: {muted}; {font}">{_tick_text(float(tick), ticks)}</text>'
        )
    begin, end = x(low), x(high)
    parts.append(
        f'<rect x="{begin:.2f}" y="18" width="{max(end - begin, 1.0):.2f}" height="14" '
        f'style="fill: {paint}; fill-opacity: 0.3"/>'
        f'<path d="M{begin:.2f} 17V33M{end:.2f} 17V33" style="stroke: {paint}; stroke-width: 2"/>'
    )
    if mean is not None:
        parts.append(f'<path d="M{x(mean):.2f} 16V34" style="stroke: {paint}; stroke-width: 4"/>')
    alt = "95 % interval" if mean is None else "mean with its 95 % interval"
    if nominal is not None:
        at, words = x(nominal), reference or f"nominal {_short(nominal)}"
        anchor = "middle"
        if outside:
            anchor = "start" if outside < 0 else "end"
            words = f"◂ {words}" if outside < 0 else f"{words} ▸"
        else:
            anchor = "start" if at < 50.0 else "end" if at > 250.0 else "middle"
            parts.append(
                f'<path d="M{at:.2f} 14V35" style="stroke: {ink}; stroke-width: 2; '
                'stroke-dasharray: 4 2"/>'
            )
        parts.append(
            f'<text x="{at:.2f}" y="10" text-anchor="{anchor}" '
            f'style="fill: {ink}; {font}">{words}</text>'
        )
        alt = f"mean with its 95 % interval, {words.strip('◂▸ ')}"
    return Panel(
        key,
        alt,
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 300 52" role="img" '
        f'aria-label="{escape(alt)}">{"".join(parts)}</svg>',
    )


def _gauge_scale(
    mean: float, low: float, high: float, nominal: float | None
) -> tuple[float, float, int]:
    """Return the ends of a gauge, and the side (−1, 1) on which nominal is beyond them, or 0."""
    width = (high - low) or 1e-3 * abs(mean) or 1.0
    first, last = min(low, mean), max(high, mean)
    ends = [first, last] if nominal is None else [first, last, nominal]
    span = max(ends) - min(ends)
    if nominal is None or span <= _GAUGE * width:
        margin = 0.08 * max(span, width) if nominal is not None else width
        return min(ends) - margin, max(ends) + margin, 0
    if nominal < first:
        return last + width - _GAUGE * width, last + width, -1
    return first - width, first - width + _GAUGE * width, 1


def _tick_text(value: float, ticks: Sequence[float]) -> str:
    """Write a tick with the decimals that tell it from its neighbours."""
    step = min(np.diff(ticks), default=abs(value) or 1.0)
    places = max(-math.floor(math.log10(step) + 1e-9), 0)
    if places and abs(step * 10**places - round(step * 10**places)) > 1e-6:
        places += 1
    return f"{value:.{places}f}".replace("-", "−")


def _short(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")
