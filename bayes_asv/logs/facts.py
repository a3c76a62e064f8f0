"""Statistics of one channel of a log, without knowledge of what it measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.preprocessing.quantization import quiet_level

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.log import LoggedChannel

__all__ = ["ChannelFacts", "channel_facts", "rest_level"]

_MOST: Final = 1_000_000
"""Readings of a channel that are looked at: more do not change a level or a noise."""
_WINDOW: Final = 0.5  # s: longer than a wheel hop, shorter than a stop
_QUIET: Final = 0.1  # share of the windows that count as rest
_GAP: Final = 3.5  # steps: two lost readings; one is jitter of a stamp


@dataclass(frozen=True, slots=True)
class ChannelFacts:
    """Facts about a channel, readings in the unit of the file.

    Parameters
    ----------
    name, source, unit : str
        As in the file.
    readings : int
        Number of readings.
    rate : float
        From the median step, Hz; NaN for a single reading.
    duration : float
        From the first stamp to the last, s.
    gaps : int
        Steps of more than three and a half of the usual ones.
    longest_gap : float
        The longest step, s; 0 without a gap.
    low, high : float
        Smallest and largest reading.
    rest : float
        Median reading of the tenth of the half seconds that are quietest.
    noise : float
        Standard deviation of one reading's noise; 0 for fewer than eight readings.
    step : float
        Smallest difference of two readings where readings repeat, 0 otherwise.
    repeated : float
        Share of the readings that equal the one before.
    """

    name: str
    source: str
    unit: str
    readings: int
    rate: float
    duration: float
    gaps: int
    longest_gap: float
    low: float
    high: float
    rest: float
    noise: float
    step: float
    repeated: float


def channel_facts(channel: LoggedChannel) -> ChannelFacts:
    """Describe one channel of a log."""
    time, values = channel.time, channel.values
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else np.nan
    gaps = steps > _GAP * usual
    some = values[:_MOST]
    levels = np.unique(some)
    step = float(np.min(np.diff(levels))) if 1 < levels.size < some.size // 2 else 0.0
    return ChannelFacts(
        name=channel.name,
        source=channel.source,
        unit=channel.unit,
        readings=int(values.size),
        rate=channel.rate,
        duration=float(time[-1] - time[0]),
        gaps=int(np.count_nonzero(gaps)),
        longest_gap=float(steps[gaps].max(initial=0.0)),
        low=float(values.min()),
        high=float(values.max()),
        rest=rest_level(time, values),
        noise=quiet_level(some, step) if some.size >= 8 else 0.0,
        step=step,
        repeated=float(np.mean(np.diff(some) == 0.0)) if some.size > 1 else 0.0,
    )


def rest_level(time: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return the median reading (N,) of the quietest half seconds."""
    return float(np.median(values[quiet_windows(time, values)]))


def quiet_windows(time: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the readings (N,) of the tenth of the half seconds that vary least."""
    _, window, count = np.unique(
        np.floor((time - time[0]) / _WINDOW), return_inverse=True, return_counts=True
    )  # windows in a gap are none
    full = count >= max(2, 0.5 * np.median(count))
    mean = np.bincount(window, values) / count
    spread = np.bincount(window, (values - mean[window]) ** 2) / count
    limit = np.quantile(spread[full], _QUIET) if full.any() else np.inf
    return (full & (spread <= limit))[window] if full.any() else np.ones(values.size, bool)
