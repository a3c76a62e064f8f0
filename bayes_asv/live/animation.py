"""The live view of a recording as an animation that a README can show (GIF)."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, check_writable, write_atomically
from bayes_asv.live.bands import Z95
from bayes_asv.live.braille import round_limits
from bayes_asv.live.downsampling import bucket_rows, thinned
from bayes_asv.live.history import SIDES, TRACES, Snapshot
from bayes_asv.live.metadata import AXLES, Scene
from bayes_asv.live.words import card, consistency
from bayes_asv.report.readable import number
from bayes_asv.report.svg import COLOURS, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

__all__ = ["animation", "write_animation"]

Array = NDArray[np.float64]

_WIDTH, _HEIGHT, _DPI = 9.6, 5.4, 80  # 768 by 432 pixels
_FRAMES_A_SECOND: Final = 12.5
_USUAL: Final = (4.0, 6.0)  # s that an animation lasts where no speed is given
_SHORTEST, _LONGEST = 8, 400  # frames
_HOLD: Final = 2.5  # s that the last picture stays
_WIDER: Final = 5.0  # times the last one: bands beyond that may leave the chart
_COLOURS_IN_ALL: Final = 96
_POINTS: Final = 800
_TONES: Final = {
    "good": COLOURS["good"], "below": COLOURS["below"], "above": COLOURS["above"],
    "muted": COLOURS["muted"],
}  # fmt: skip
_PAINT: Final = {"c_f": COLOURS["front"], "c_r": COLOURS["rear"], "i": COLOURS["ink"]}


def write_animation(
    scene: Scene,
    history: Snapshot,
    path: PathLike,
    speed: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Write a GIF, whole or not at all.

    Parameters
    ----------
    scene : Scene
        What stays.
    history : Snapshot
        All of the recording.
    path : str or os.PathLike
        The file.
    speed : float, optional
        Recording seconds a second; by default one, or what makes it last four to six seconds.
    progress : callable, optional
        Told a share and words.

    Raises
    ------
    InputError
        If there is nothing to draw, it would have more than 400 pictures, or the file cannot be
        written.
    """
    check_writable(path)
    write_atomically(path, animation(scene, history, speed, progress))


def animation(
    scene: Scene,
    history: Snapshot,
    speed: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> bytes:
    """Draw a GIF; the same history gives the same bytes.

    Parameters
    ----------
    scene, history, speed, progress
        As for `write_animation`.

    Returns
    -------
    bytes
        The file.

    Raises
    ------
    InputError
        As there.
    """
    if len(history.time) < 2:
        raise InputError(scene.source, "has no rows to draw", "give another recording")
    length = float(history.time[-1] - history.time[0])
    pace = speed or length / min(max(length, _USUAL[0]), _USUAL[1])
    count = max(math.ceil(length / pace * _FRAMES_A_SECOND), _SHORTEST)
    if count > _LONGEST:
        raise InputError(
            scene.source, f"gives {count} pictures at ×{pace:g}", "give a greater --speed"
        )
    from PIL.Image import Dither

    pictures: list[Image] = []
    with style():
        board = _Board(scene, history, pace)
        for n in range(1, count + 1):
            pictures.append(board.picture(history.time[0] + length * n / count))
            if progress is not None:
                progress(n / count, "drawing")
    palette = _with_tones(pictures[-1]).quantize(_COLOURS_IN_ALL)
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[colours.sum(axis=1).argmax()] = 255  # paper stays white
    palette.putpalette(colours.ravel().tolist())
    flat = [picture.quantize(palette=palette, dither=Dither.NONE) for picture in pictures]
    each = round(1000.0 / _FRAMES_A_SECOND)
    buffer = io.BytesIO()
    flat[0].save(
        buffer, "GIF", save_all=True, append_images=flat[1:], loop=0, optimize=True,
        duration=[each] * (count - 1) + [round(1000.0 * _HOLD)],
    )  # fmt: skip
    return buffer.getvalue()


class _Board:
    """A figure drawn twice, with its curves and without; each picture has some of both."""

    def __init__(self, scene: Scene, history: Snapshot, pace: float) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._scene, self._history = scene, history
        self._pace = "" if abs(pace - 1.0) < 0.005 else f" (shown at ×{pace:.2g})"
        size = bucket_rows(len(history.time), _POINTS)
        self._time, self._traces = thinned(history.time, history.traces, size, SIDES)
        self._index = {name: place for place, name in enumerate(TRACES)}
        self._curves: list[Any] = []
        figure = Figure((_WIDTH, _HEIGHT), dpi=_DPI, facecolor="white")
        self._canvas: Any = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(
            3, 6, left=0.1, right=0.985, top=0.825, bottom=0.095, hspace=0.55, wspace=1.9,
            height_ratios=(1.2, 1.0, 1.0),
        )  # fmt: skip
        self._head = figure.text(0.012, 0.965, "", fontsize=11, fontweight="bold", va="center")
        self._verdict = figure.text(0.988, 0.965, "", fontsize=10, va="center", ha="right")
        self._titles = [
            self._parameter(figure.add_subplot(grid[0, 2 * n : 2 * n + 2]), n) for n in range(3)
        ]
        rows = [grid[1, :3], grid[1, 3:], grid[2, :3], grid[2, 3:]]
        axes = [figure.add_subplot(place) for place in rows]
        for n, axle in enumerate(AXLES):
            self._acceleration(axes[n], axle)
            self._deflection(axes[2 + n], axle, n)
        self._with = self._drawn()
        for artist in self._curves:
            artist.set_visible(False)
        self._without = self._drawn()

    def picture(self, now: float) -> Image:
        """Draw what was known at a stamp."""
        from PIL import Image

        history = self._history
        place = max(int(np.searchsorted(history.time, now, side="right")) - 1, 0)
        known = history.known[place].tolist()
        trace = dict(zip(TRACES, history.traces[place].tolist(), strict=True))
        for n, parameter in enumerate(self._scene.parameters):
            said = card(parameter, known[n], known[3 + n])
            value, sense = self._titles[n]
            value.set_text(f"{parameter.label}: {said.value} {said.width}")
            sense.set_text(said.sense)
            sense.set_color(_TONES[said.tone])
        judged = consistency(
            trace["nis"], trace["nis low"], trace["nis high"], known[6] > 0.5, known[7]
        )
        self._verdict.set_text(f"prediction errors: {judged.short}")
        self._verdict.set_color(_TONES[judged.tone])
        gone = now - float(history.time[0])
        self._head.set_text(f"{self._scene.vehicle}   {gone:.2f} s{self._pace}")
        renderer = self._canvas.get_renderer()
        pixels = np.asarray(renderer.buffer_rgba())
        pixels[...] = self._without
        for axes in self._canvas.figure.axes:
            box = axes.get_window_extent(renderer)
            rows = slice(round(len(pixels) - box.y1), round(len(pixels) - box.y0))
            reached = round(axes.transData.transform((now, 0.0))[0])
            past = slice(round(box.x0), max(reached, round(box.x0)))
            pixels[rows, past] = self._with[rows, past]
        for text in (self._head, self._verdict, *(t for pair in self._titles for t in pair)):
            text.draw(renderer)
        return Image.fromarray(pixels[..., :3].copy())

    def _drawn(self) -> NDArray[np.uint8]:
        """Pixels of the figure, its changing words left out."""
        self._canvas.draw()
        return np.array(self._canvas.buffer_rgba())

    def _parameter(self, axes: Axes, n: int) -> tuple[Any, Any]:
        history, parameter = self._history, self._scene.parameters[n]
        time = history.run[:, 0]
        middle, spread = history.run[:, 1 + n], np.exp(Z95 * history.run[:, 4 + n])
        paint = _PAINT[parameter.name]
        self._curves.append(
            axes.fill_between(time, middle / spread, middle * spread, color=paint, alpha=0.2, lw=0)
        )
        self._curves += axes.plot(time, middle, color=paint, lw=1.8)
        axes.axhline(parameter.nominal, color=COLOURS["ink"], ls=(0, (5, 3)), lw=0.9)
        axes.set_ylabel(parameter.unit, fontsize=8)
        width = middle * (spread - 1.0 / spread)
        late = np.logical_and.accumulate((width <= _WIDER * width[-1])[::-1])[::-1]
        low = min(float((middle / spread)[late].min()), 0.9 * parameter.nominal)
        high = max(float((middle * spread)[late].max()), 1.1 * parameter.nominal)
        low, high = max(low, 0.0), min(high, 3.0 * parameter.nominal)
        room = 0.08 * (high - low)
        axes.set_ylim(max(low - room, 0.0), high + room)
        self._dressed(axes)
        axes.annotate(
            f"nominal {number(parameter.nominal)}", (0.99, parameter.nominal),
            xycoords=("axes fraction", "data"), xytext=(0, 2), textcoords="offset points",
            ha="right", fontsize=7.5, zorder=20,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip
        value = axes.text(0.0, 1.22, "", transform=axes.transAxes, fontsize=8.5, fontweight="bold")
        sense = axes.text(0.0, 1.07, "", transform=axes.transAxes, fontsize=8.5)
        return value, sense

    def _acceleration(self, axes: Axes, axle: str) -> None:
        self._band(axes, f"{axle} predicted", COLOURS[axle])
        measured = self._column(f"{axle} measured")
        predicted = self._column(f"{axle} predicted")
        self._curves += axes.plot(self._time, measured, color=COLOURS["ink"], alpha=0.3, lw=3.0)
        self._curves += axes.plot(self._time, predicted, color=COLOURS[axle], lw=1.0)
        axes.set_ylim(*self._shared([f"{a} measured" for a in AXLES]))
        axes.set_ylabel(f"{self._scene.acceleration[0]}\nup positive", fontsize=8)
        words = f"{axle} chassis: measured (grey), predicted"
        axes.set_title(words, loc="left", fontsize=8.5, pad=3)
        self._dressed(axes)

    def _deflection(self, axes: Axes, axle: str, n: int) -> None:
        self._band(axes, f"{axle} deflection", COLOURS[axle])
        deflection = self._column(f"{axle} deflection")
        self._curves += axes.plot(self._time, deflection, color=COLOURS[axle], lw=1.4)
        limits = [end for pair in self._scene.limits for end in pair if end is not None]
        axes.set_ylim(*self._shared([f"{a} deflection" for a in AXLES], limits))
        for end in self._scene.limits[n]:
            if end is not None:
                axes.axhline(end, color=COLOURS["ink"], ls=(0, (5, 3)), lw=0.9)
        axes.set_ylabel(f"{self._scene.deflection[0]}\nextension\npositive", fontsize=8)
        axes.set_title(f"{axle} deflection and stops", loc="left", fontsize=8.5, pad=3)
        axes.set_xlabel("time [s]", fontsize=8)
        self._dressed(axes)

    def _band(self, axes: Axes, name: str, paint: str) -> None:
        low, high = self._column(f"{name} low"), self._column(f"{name} high")
        self._curves.append(axes.fill_between(self._time, low, high, color=paint, alpha=0.2, lw=0))

    def _column(self, name: str) -> NDArray[np.floating]:
        return self._traces[:, self._index[name]]

    def _shared(self, names: list[str], more: list[float] | None = None) -> tuple[float, float]:
        values = np.concatenate([self._column(name) for name in names])
        values = np.concatenate((values[np.isfinite(values)], more or []))
        return round_limits(float(values.min()), float(values.max())) if len(values) else (-1, 1)

    def _dressed(self, axes: Axes) -> None:
        axes.set_xlim(float(self._history.time[0]), float(self._history.time[-1]))
        axes.tick_params(labelsize=8)
        axes.yaxis.labelpad = 1.0


def _with_tones(picture: Image) -> Image:
    """Return a picture with a stripe of each tone below, for a palette that has them all."""
    from PIL import Image, ImageColor

    width, height = picture.size
    stripe = height // 20
    made = Image.new("RGB", (width, height + stripe * len(_TONES)))
    made.paste(picture)
    for n, tone in enumerate(_TONES.values()):
        box = (0, height + n * stripe, width, height + (n + 1) * stripe)
        made.paste(ImageColor.getrgb(tone), box)
    return made
