"""Static calibration: a sensor held still in known or unknown positions.

Three axes that are held still in six positions or more need no known angles: gravity has the same
size in all of them.  With offsets o, sensitivities 1/s and readings r, ``|s (r − o)| = g`` is
solved by least squares.  One axis, or a potentiometer, takes the value of each position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import least_squares

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["AxisCalibration", "StaticCalibration", "calibrate_axes", "calibrate_values", "plateaus"]

_SHORTEST: Final = 0.5  # s that a position is held at least
_SMOOTH: Final = 0.1  # s over which the readings vary little while a sensor lies still
_STILL: Final = 6.0
"""Times the noise of still readings: a hand moves a sensor by hundreds of times that."""
_FEWEST_POSITIONS: Final = 6  # three offsets and three sensitivities
_LARGEST_SD: Final = 0.05  # relative deviation of a scale beyond which positions do not tell it


@dataclass(frozen=True, slots=True)
class AxisCalibration:
    """The calibration of one axis: value = scale (reading − offset).

    Parameters
    ----------
    offset, offset_sd : float
        Reading at zero and its standard deviation, in the unit of the readings; deviations are NaN
        where there are as many positions as unknowns.
    scale, scale_sd : float
        Value per reading and its standard deviation.
    """

    offset: float
    offset_sd: float
    scale: float
    scale_sd: float


@dataclass(frozen=True, slots=True)
class StaticCalibration:
    """What a static test gave.

    Parameters
    ----------
    axes : tuple of AxisCalibration
        One for each column.
    positions : int
        Number of positions that were used.
    residual : float
        Root-mean-square of what is left, in the unit of the value.
    largest : float
        Largest of what is left.
    """

    axes: tuple[AxisCalibration, ...]
    positions: int
    residual: float
    largest: float


def plateaus(
    time: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[tuple[float, float, NDArray[np.float64]], ...]:
    """Find the positions in which a sensor was held still.

    Parameters
    ----------
    time : (N,) array
        Stamps, s.
    values : (C, N) array
        Readings of the axes of one sensor.

    Returns
    -------
    tuple of (start, end, mean)
        Times, s, and the mean readings (C,) of each position.
    """
    step = float(np.median(np.diff(time)))
    width = max(3, round(_SMOOTH / step))
    if time.size < 2 * width:
        return ()
    windows = np.lib.stride_tricks.sliding_window_view(values, width, axis=1)
    spread = np.max(windows.std(axis=2), axis=0)
    # most of a static test is still, so that a low quantile is the noise of a still sensor
    still_spread = float(np.quantile(spread, 0.2))
    resolution = float(np.ptp(values)) * 1e-6
    still = spread <= _STILL * max(still_spread, resolution)
    result = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        last = end + width - 1
        if time[last - 1] - time[begin] >= _SHORTEST:
            mean = values[:, begin:last].mean(axis=1)
            result.append((float(time[begin]), float(time[last - 1]), mean))
    return tuple(result)


def calibrate_axes(positions: NDArray[np.float64], factor: float, where: str) -> StaticCalibration:
    """Calibrate the three axes of an accelerometer from its readings in still positions.

    Parameters
    ----------
    positions : (P, 3) array
        Mean readings of each position, P at least six.
    factor : float
        m/s² per unit of the readings as the sensor states it; the start of the search.
    where : str
        Name of the file, for messages.

    Returns
    -------
    StaticCalibration
        Scales in m/s² per reading.

    Raises
    ------
    InputError
        If the positions do not determine offsets and sensitivities.
    """
    count = len(positions)
    if count < _FEWEST_POSITIONS:
        raise InputError(
            where, f"has {count} still positions, but three axes need six",
            "hold the sensor still for two seconds with each of its six faces down",
        )  # fmt: skip

    def excess(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        turned = unknown[3:] * (positions - unknown[:3])
        return np.asarray(np.linalg.norm(turned, axis=1) - STANDARD_GRAVITY, dtype=float)

    middle = 0.5 * (positions.max(axis=0) + positions.min(axis=0))
    half = 0.5 * np.ptp(positions, axis=0)
    start = np.concatenate([middle, np.full(3, factor)])
    x_scale = np.concatenate([np.full(3, max(float(half.max()), 1e-9)), np.full(3, factor)])
    fit = least_squares(excess, start, x_scale=x_scale)
    sd = _deviations(np.asarray(fit.jac, dtype=float), fit.fun, where)
    axes = tuple(
        AxisCalibration(float(fit.x[k]), float(sd[k]), float(fit.x[3 + k]), float(sd[3 + k]))
        for k in range(3)
    )
    for k, axis in enumerate(axes):
        if axis.scale <= 0.0 or axis.scale_sd > _LARGEST_SD * axis.scale:
            raise InputError(
                where, f"positions do not turn axis {k + 1} far enough to calibrate it",
                "hold the sensor still with each of its six faces down",
            )  # fmt: skip
    return _result(axes, count, fit.fun)


def calibrate_values(
    positions: NDArray[np.float64], values: Sequence[float], where: str
) -> StaticCalibration:
    """Calibrate one axis or a potentiometer from known values: a straight line through them.

    Parameters
    ----------
    positions : (P,) array
        Mean reading of each position, in the order of time.
    values : sequence of P float
        Known value of each position, at least two different ones.
    where : str
        Name of the file, for messages.

    Returns
    -------
    StaticCalibration

    Raises
    ------
    InputError
        If the numbers of positions and values differ, or the readings are all the same.
    """
    known = np.array(values, dtype=float)
    if len(positions) != known.size:
        raise InputError(
            where, f"has {len(positions)} still positions, but {known.size} values were given",
            "give one value for each position, in the order of time",
        )  # fmt: skip
    if known.size < 2 or np.ptp(known) == 0.0 or np.ptp(positions) == 0.0:
        raise InputError(
            where, "has no two different positions", "hold the sensor in two positions or more"
        )
    # reading = offset + value / scale: the errors are those of the readings
    design = np.column_stack([np.ones_like(known), known])
    (offset, slope), *_ = np.linalg.lstsq(design, positions, rcond=None)
    left = positions - design @ np.array([offset, slope])
    free = known.size - 2
    noise = float(np.sqrt(left @ left / free)) if free else np.nan
    spread = noise * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    scale = 1.0 / float(slope)
    axis = AxisCalibration(float(offset), float(spread[0]), scale, float(spread[1]) * scale**2)
    return _result((axis,), known.size, left * scale)


def _deviations(
    jacobian: NDArray[np.float64], left: NDArray[np.float64], where: str
) -> NDArray[np.float64]:
    """Return standard deviations of least squares; residuals give the noise where any are free."""
    rows, columns = jacobian.shape
    information = jacobian.T @ jacobian
    if np.linalg.matrix_rank(information, hermitian=True) < columns:
        raise InputError(
            where, "positions do not determine all offsets and sensitivities",
            "hold the sensor still with each of its six faces down",
        )  # fmt: skip
    noise = float(left @ left) / (rows - columns) if rows > columns else np.nan
    return np.asarray(np.sqrt(noise * np.diag(np.linalg.inv(information))), dtype=float)


def _result(
    axes: tuple[AxisCalibration, ...], count: int, left: NDArray[np.float64]
) -> StaticCalibration:
    return StaticCalibration(
        axes, count, float(np.sqrt(np.mean(left**2))), float(np.abs(left).max())
    )
