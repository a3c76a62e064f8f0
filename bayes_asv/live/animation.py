"""Animation (GIF) of the live view of a recording, for a README."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, check_writable, write_atomically
from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.live.braille import round_limits
from bayes_asv.live.downsampling import bucket_rows, downsample
from bayes_asv.live.history import Snapshot
from bayes_asv.live.metadata import MeasuredOutput, ViewMetadata
from bayes_asv.live.session import FRAME_RATE
from bayes_asv.live.text import consistency_text, parameter_card
from bayes_asv.report.svg import COLOURS, style
from bayes_asv.report.words import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

__all__ = ["animation", "write_animation"]

Array = NDArray[np.float64]

_WIDTH, _HEIGHT, _DPI = 9.6, 5.4, 80  # 768 by 432 pixels
_DEFAULT_LENGTH: Final = (4.0, 6.0)  # s, shortest and longest, where no speed is given
_MIN_FRAMES, _MAX_FRAMES = 8, 400
_HOLD: Final = 2.5  # s for which the last frame is shown
_MAX_WIDTH: Final = 5.0  # times the final one: wider bands may leave the chart
_PALETTE: Final = 96  # colours
_POINTS: Final = 800
_TONES: Final = {
    "good": COLOURS["good"], "below": COLOURS["below"], "above": COLOURS["above"],
    "muted": COLOURS["muted"],
}  # fmt: skip


def _colour(name: str) -> str:
    """Colour of a parameter, an output or an element: that of its axle."""
    for axle, end in (("front", "c_f"), ("rear", "c_r")):
        if name.startswith((axle, end)):
            return COLOURS[axle]
    return COLOURS["ink"]


def write_animation(
    metadata: ViewMetadata,
    history: Snapshot,
    path: PathLike,
    speed: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Write a GIF atomically.

    Parameters
    ----------
    metadata : ViewMetadata
        Names, units and limits.
    history : Snapshot
        The whole recording.
    path : str or os.PathLike
        The file.
    speed : float, optional
        Recording seconds per second; by default one, or what makes it last four to six seconds.
    progress : callable, optional
        Called with the share done and a short text.

    Raises
    ------
    InputError
        If there is nothing to draw, it would have more than 400 frames, or the file cannot be
        written.
    """
    check_writable(path)
    write_atomically(path, animation(metadata, history, speed, progress))


def animation(
    metadata: ViewMetadata,
    history: Snapshot,
    speed: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> bytes:
    """Draw a GIF; the same history gives the same bytes.

    Parameters
    ----------
    metadata, history, speed, progress
        As for `write_animation`.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    InputError
        If there is nothing to draw, or it would have more than 400 frames.
    """
    if len(history.time) < 2:
        raise InputError(metadata.source, "has no rows to draw", "give another recording")
    length = float(history.time[-1] - history.time[0])
    pace = speed or length / min(max(length, _DEFAULT_LENGTH[0]), _DEFAULT_LENGTH[1])
    count = max(math.ceil(length / pace * FRAME_RATE), _MIN_FRAMES)
    if count > _MAX_FRAMES:
        raise InputError(
            metadata.source, f"gives {count} pictures at ×{pace:g}", "give a greater --speed"
        )
    from PIL.Image import Dither

    frames: list[Image] = []
    with style():
        painter = _Painter(metadata, history, pace)
        for n in range(1, count + 1):
            frames.append(painter.frame(history.time[0] + length * n / count))
            if progress is not None:
                progress(n / count, "drawing")
    palette = _with_tones(frames[-1]).quantize(_PALETTE)
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[colours.sum(axis=1).argmax()] = 255  # a white background
    palette.putpalette(colours.ravel().tolist())
    indexed = [frame.quantize(palette=palette, dither=Dither.NONE) for frame in frames]
    duration = round(1000.0 / FRAME_RATE)
    buffer = io.BytesIO()
    indexed[0].save(
        buffer, "GIF", save_all=True, append_images=indexed[1:], loop=0, optimize=True,
        duration=[duration] * (count - 1) + [round(1000.0 * _HOLD)],
    )  # fmt: skip
    return buffer.getvalue()


class _Painter:
    """Renders the figure twice, with its curves and without, and combines both for each frame."""

    def __init__(self, metadata: ViewMetadata, history: Snapshot, pace: float) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._metadata, self._history = metadata, history
        self._pace = "" if abs(pace - 1.0) < 0.005 else f" (shown at ×{pace:.2g})"
        size = bucket_rows(len(history.time), _POINTS)
        self._time, self._traces = downsample(
            history.time, history.traces, size, metadata.band_sides
        )
        self._index = {name: n for n, name in enumerate(metadata.traces)}
        self._curves: list[Any] = []
        figure = Figure((_WIDTH, _HEIGHT), dpi=_DPI, facecolor="white")
        self._canvas: Any = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(
            3, 6, left=0.1, right=0.985, top=0.825, bottom=0.095, hspace=0.55, wspace=1.9,
            height_ratios=(1.2, 1.0, 1.0),
        )  # fmt: skip
        self._head = figure.text(0.012, 0.965, "", fontsize=11, fontweight="bold", va="center")
        self._verdict = figure.text(0.988, 0.965, "", fontsize=10, va="center", ha="right")

        def cells(row: int, count: int) -> list[Any]:
            if 6 % count == 0:
                step = 6 // count
                return [grid[row, n : n + step] for n in range(0, 6, step)]
            inner = grid[row, :].subgridspec(1, count, wspace=0.5)
            return [inner[0, n] for n in range(count)]

        self._titles = [
            self._draw_parameter(figure.add_subplot(cell), n)
            for n, cell in enumerate(cells(0, len(metadata.parameters)))
        ]
        for output, cell in zip(metadata.outputs, cells(1, len(metadata.outputs)), strict=True):
            self._draw_output(figure.add_subplot(cell), output)
        for n, cell in enumerate(cells(2, len(metadata.elements))):
            self._draw_deflection(figure.add_subplot(cell), metadata.elements[n], n)
        self._with_curves = self._pixels()
        for artist in self._curves:
            artist.set_visible(False)
        self._without_curves = self._pixels()

    def frame(self, now: float) -> Image:
        """Draw the state at a stamp."""
        from PIL import Image

        history = self._history
        row = max(int(np.searchsorted(history.time, now, side="right")) - 1, 0)
        estimates = history.estimates[row].tolist()
        trace = dict(zip(self._metadata.traces, history.traces[row].tolist(), strict=True))
        na = len(self._metadata.parameters)
        for n, parameter in enumerate(self._metadata.parameters):
            card = parameter_card(parameter, estimates[n], estimates[na + n])
            value, sense = self._titles[n]
            value.set_text(f"{parameter.label}: {card.value} {card.width}")
            sense.set_text(card.sense)
            sense.set_color(_TONES[card.tone])
        consistency = consistency_text(
            trace["nis"], trace["nis low"], trace["nis high"], estimates[-2] > 0.5, estimates[-1]
        )
        self._verdict.set_text(f"prediction errors: {consistency.short}")
        self._verdict.set_color(_TONES[consistency.tone])
        elapsed = now - float(history.time[0])
        self._head.set_text(f"{self._metadata.vehicle}   {elapsed:.2f} s{self._pace}")
        renderer = self._canvas.get_renderer()
        pixels = np.asarray(renderer.buffer_rgba())
        pixels[...] = self._without_curves
        for axes in self._canvas.figure.axes:
            box = axes.get_window_extent(renderer)
            rows = slice(round(len(pixels) - box.y1), round(len(pixels) - box.y0))
            end = round(axes.transData.transform((now, 0.0))[0])
            past = slice(round(box.x0), max(end, round(box.x0)))
            pixels[rows, past] = self._with_curves[rows, past]
        for text in (self._head, self._verdict, *(t for pair in self._titles for t in pair)):
            text.draw(renderer)
        return Image.fromarray(pixels[..., :3].copy())

    def _pixels(self) -> NDArray[np.uint8]:
        """Pixels of the figure without its changing texts."""
        self._canvas.draw()
        return np.array(self._canvas.buffer_rgba())

    def _draw_parameter(self, axes: Axes, n: int) -> tuple[Any, Any]:
        history, parameter = self._history.parameters, self._metadata.parameters[n]
        time = history[:, 0]
        median, factor = (
            history[:, 1 + n],
            np.exp(NORMAL_975 * history[:, 1 + len(self._metadata.parameters) + n]),
        )
        colour = _colour(parameter.name)
        band = axes.fill_between(
            time, median / factor, median * factor, color=colour, alpha=0.2, lw=0
        )
        self._curves.append(band)
        self._curves += axes.plot(time, median, color=colour, lw=1.8)
        axes.axhline(parameter.nominal, color=COLOURS["ink"], ls=(0, (5, 3)), lw=0.9)
        axes.set_ylabel(parameter.unit, fontsize=8)
        width = median * (factor - 1.0 / factor)
        late = np.logical_and.accumulate((width <= _MAX_WIDTH * width[-1])[::-1])[::-1]
        low = min(float((median / factor)[late].min()), 0.9 * parameter.nominal)
        high = max(float((median * factor)[late].max()), 1.1 * parameter.nominal)
        low, high = max(low, 0.0), min(high, 3.0 * parameter.nominal)
        margin = 0.08 * (high - low)
        axes.set_ylim(max(low - margin, 0.0), high + margin)
        self._set_style(axes)
        axes.annotate(
            f"nominal {number(parameter.nominal)}", (0.99, parameter.nominal),
            xycoords=("axes fraction", "data"), xytext=(0, 2), textcoords="offset points",
            ha="right", fontsize=7.5, zorder=20,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip
        value = axes.text(0.0, 1.22, "", transform=axes.transAxes, fontsize=8.5, fontweight="bold")
        sense = axes.text(0.0, 1.07, "", transform=axes.transAxes, fontsize=8.5)
        return value, sense

    def _draw_output(self, axes: Axes, output: MeasuredOutput) -> None:
        key, colour = output.key, _colour(output.key)
        self._draw_band(axes, f"{key} predicted", colour)
        measured = self._column(f"{key} measured")
        predicted = self._column(f"{key} predicted")
        self._curves += axes.plot(self._time, measured, color=COLOURS["ink"], alpha=0.3, lw=3.0)
        self._curves += axes.plot(self._time, predicted, color=colour, lw=1.0)
        alike = [o.key for o in self._metadata.outputs if o.unit == output.unit]
        axes.set_ylim(*self._common_limits([f"{other} measured" for other in alike]))
        axes.set_ylabel(f"{output.unit}\n{output.sign}", fontsize=8)
        name = output.label.removesuffix(" acceleration")
        axes.set_title(f"{name}: measured (grey), predicted", loc="left", fontsize=8.5, pad=3)
        self._set_style(axes)

    def _draw_deflection(self, axes: Axes, axle: str, n: int) -> None:
        self._draw_band(axes, f"{axle} deflection", _colour(axle))
        deflection = self._column(f"{axle} deflection")
        self._curves += axes.plot(self._time, deflection, color=_colour(axle), lw=1.4)
        limits = [end for pair in self._metadata.limits for end in pair if end is not None]
        axes.set_ylim(
            *self._common_limits([f"{e} deflection" for e in self._metadata.elements], limits)
        )
        for end in self._metadata.limits[n]:
            if end is not None:
                axes.axhline(end, color=COLOURS["ink"], ls=(0, (5, 3)), lw=0.9)
        axes.set_ylabel(f"{self._metadata.deflection[0]}\nextension\npositive", fontsize=8)
        axes.set_title(
            f"{axle.replace('_', ' ')} deflection and stops", loc="left", fontsize=8.5, pad=3
        )
        axes.set_xlabel("time [s]", fontsize=8)
        self._set_style(axes)

    def _draw_band(self, axes: Axes, name: str, colour: str) -> None:
        low, high = self._column(f"{name} low"), self._column(f"{name} high")
        self._curves.append(axes.fill_between(self._time, low, high, color=colour, alpha=0.2, lw=0))

    def _column(self, name: str) -> NDArray[np.floating]:
        return self._traces[:, self._index[name]]

    def _common_limits(
        self, names: list[str], more: list[float] | None = None
    ) -> tuple[float, float]:
        values = np.concatenate([self._column(name) for name in names])
        values = np.concatenate((values[np.isfinite(values)], more or []))
        return round_limits(float(values.min()), float(values.max())) if len(values) else (-1, 1)

    def _set_style(self, axes: Axes) -> None:
        axes.set_xlim(float(self._history.time[0]), float(self._history.time[-1]))
        axes.tick_params(labelsize=8)
        axes.yaxis.labelpad = 1.0


def _with_tones(frame: Image) -> Image:
    """Append a stripe of each tone to a frame, so that a palette made from it has them all."""
    from PIL import Image, ImageColor

    width, height = frame.size
    stripe = height // 20
    extended = Image.new("RGB", (width, height + stripe * len(_TONES)))
    extended.paste(frame)
    for n, tone in enumerate(_TONES.values()):
        box = (0, height + n * stripe, width, height + (n + 1) * stripe)
        extended.paste(ImageColor.getrgb(tone), box)
    return extended
