"""Picture of the modes of the whole car: ``python -m benchmarks.cars_picture``.

For ``docs/cars.md``; the car is that of ``data/vehicles/baja2008_roll.toml`` without damping.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.models.mode_shapes import CarMode, car_modes
from bayes_asv.models.textbook_cars import FullCar7, full_car

__all__ = ["PICTURE", "draw_modes"]

Array = NDArray[np.float64]

_ROOT: Final = Path(__file__).parents[1]
PICTURE: Final = _ROOT / "docs" / "cars.png"
_LIFT: Final = 0.32  # m that the largest height of a mode is drawn as
_ABOVE: Final = 0.55  # m of body above its wheels at rest, as drawn
_BODY, _WHEEL, _REST = "#1b6ca8", "#c0392b", "#b0b0b0"


def _seen(places: Array, heights: Array) -> tuple[Array, Array]:
    """Oblique view from the left and ahead: x runs to the right, y away from the eye."""
    ahead, left = places.T
    return -ahead - 0.45 * left, heights - 0.32 * left


def _panel(ax: Any, car: FullCar7, found: CarMode) -> None:
    """Draw one mode over the car at rest."""
    a, b = 0.5 * car.t_f, 0.5 * car.t_r
    corners = np.array([[car.l_f, a], [car.l_f, -a], [-car.l_r, b], [-car.l_r, -b]])
    shape = np.real(found.mode.shape)
    body, wheels = _LIFT * shape[:4] + _ABOVE, _LIFT * shape[4:]
    ring = [0, 1, 3, 2, 0]
    x, y = _seen(corners, np.full(4, _ABOVE))
    ax.plot(x[ring], y[ring], color=_REST, lw=1.0)
    ax.plot(*_seen(corners, np.zeros(4)), "o", mfc="none", mec=_REST, ms=7)
    x, y = _seen(corners, body)
    ax.fill(x[ring[:4]], y[ring[:4]], color=_BODY, alpha=0.18, lw=0)
    ax.plot(x[ring], y[ring], color=_BODY, lw=1.8)
    under, low = _seen(corners, wheels)
    for j in range(4):
        ax.plot([x[j], under[j]], [y[j], low[j]], color="#555555", lw=0.8)
    ax.plot(under, low, "o", color=_WHEEL, ms=7)
    ax.set_title(f"{found.kind}, {found.mode.natural:.2f} Hz", fontsize=10)
    ax.set(xlim=(-1.75, 1.75), ylim=(-0.75, 1.2), aspect="equal")
    ax.axis("off")


def draw_modes(path: Path = PICTURE) -> None:
    """Draw all seven modes of the nominal car."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    car = full_car(read_vehicle(_ROOT / "data" / "vehicles" / "baja2008_roll.toml"))
    found = car_modes(car, damped=False)
    figure, axes = plt.subplots(2, 4, figsize=(11.0, 4.9), layout="constrained")
    for ax, mode in zip(axes.flat, found, strict=False):
        _panel(ax, car, mode)
    legend = axes.flat[-1]
    legend.axis("off")
    legend.plot([], [], color=_BODY, lw=1.8, label="chassis")
    legend.plot([], [], "o", color=_WHEEL, label="wheels")
    legend.plot([], [], color=_REST, label="at rest")
    legend.plot([], [], " ", label="front to the left")
    legend.legend(loc="center", frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    draw_modes()
