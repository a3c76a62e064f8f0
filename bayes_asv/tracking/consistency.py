"""Consistency of the online filter: whether its errors match its stated uncertainty.

The innovations of a correct filter are white and have the variance that it states.  Three
statistics test this while it runs: the mean normalised innovation squared (NIS) over a sliding
window, the Box–Pierce statistic of their autocorrelation over a longer one, and the factor by which
the filter had to raise its noise variance (Bar-Shalom, Li & Kirubarajan 2001, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.filters.consistency_sums import (
    LAGS,
    ConsistencyLimits,
    flag_inconsistency,
    sums_length,
    update_sums,
)

__all__ = [
    "LAGS", "WINDOW", "ConsistencyMonitor", "ConsistencySummary", "WindowStatistics", "nis_band",
]  # fmt: skip

Array = NDArray[np.float64]

WINDOW = 0.5
"""Length of the window of the mean NIS, s."""
WHITENESS_WINDOW = 2.0
"""Length of the window of the Box–Pierce statistic, s."""

# Deviation of the mean NIS that is flagged, in its standard deviations: 7 in a million by chance.
_NIS_ONSET = 4.5
# Box–Pierce statistics of an output at which the flag is set and cleared.  Under the model it is χ²
# with LAGS = 10 degrees of freedom: mean 10 and standard deviation 4.5.
_BOX_PIERCE_ONSET = 150.0
_BOX_PIERCE_END = 75.0
# Factor on the declared noise variance at which the flag is set; it is cleared at half of that.
_NOISE_ONSET = 4.0
_CLIP = 3.0  # bound on an innovation in lagged products, standard deviations
_REQUIRED_SHARE = 0.9  # least share of consistent rows
# Tolerance of the mean NIS of a whole recording: 2.5 % of a standard deviation.
_NIS_TOLERANCE = 0.05


def nis_band(readings: Array, z: float = NORMAL_975) -> tuple[Array, Array]:
    """Interval of the mean of n squared standard normals (Wilson & Hilferty 1931).

    The cube root of χ²_n / n is close to N(1 − c, c) with c = 2 / (9 n).

    Parameters
    ----------
    readings : (N,) array
        Number n of squares; where it is zero, the interval is [0, ∞).
    z : float
        Half-width in standard deviations; 95 % by default.

    Returns
    -------
    low, high : (N,) arrays
    """
    n = np.maximum(np.asarray(readings, np.float64), 1.0)
    c = 2.0 / (9.0 * n)
    low = np.maximum(1.0 - c - z * np.sqrt(c), 0.0) ** 3
    high = (1.0 - c + z * np.sqrt(c)) ** 3
    none = np.asarray(readings) < 0.5
    return np.where(none, 0.0, low), np.where(none, np.inf, high)


@dataclass
class WindowStatistics:
    """Statistics of the windows that end with each of N rows.

    Parameters
    ----------
    mean, low, high : (N,) arrays
        Mean NIS per reading, and its 95 % band.
    box_pierce : (N,) array
        Box–Pierce statistic over :data:`LAGS` lags, summed over all outputs.
    consistent : (N,) bool array
        Whether all statistics are inside their limits, with hysteresis.
    """

    mean: Array
    low: Array
    high: Array
    box_pierce: Array
    consistent: NDArray[np.bool_]


@dataclass(frozen=True)
class ConsistencySummary:
    """Consistency over a whole recording.

    Parameters
    ----------
    nis_mean : float
        Mean normalised innovation squared; NaN without a reading.
    nis_band95 : pair of float
        Its 95 % band for a correct filter.
    readings : int
        Number of readings in that mean.
    consistent_share : float
        Share of the rows at which the filter was consistent.
    max_noise_factor : float
        Largest factor on the declared noise variance.
    max_box_pierce : float
        Largest Box–Pierce statistic over all outputs; χ² with ``LAGS`` degrees of freedom per
        output for white innovations.
    correlation : (ny, LAGS + 1) array
        Autocorrelation of the normalised innovations of each output.
    faults : tuple of str
        ``swollen``: noise variance above the declared one; ``coloured``: autocorrelated
        innovations; ``uneven``: mean NIS above its band for some of the time; ``optimistic`` or
        ``pessimistic``: mean NIS of the whole recording above or below its band.  Empty for a
        consistent filter.
    recovered : bool
        Whether the filter was consistent for the last two seconds, or for the second half of a
        recording of less than four: if the initial parameters are far off, the first motion is not
        predicted well.
    """

    nis_mean: float
    nis_band95: tuple[float, float]
    readings: int
    consistent_share: float
    max_noise_factor: float
    max_box_pierce: float
    correlation: Array
    faults: tuple[str, ...]
    recovered: bool

    @property
    def verdict(self) -> str:
        """``consistent``, ``recovered`` or ``inconsistent``."""
        if not self.faults:
            return "consistent"
        return "recovered" if self.recovered else "inconsistent"


@dataclass
class ConsistencyMonitor:
    """Tests the innovations of each row as it comes.

    Parameters
    ----------
    rate : float
        Rows per second, Hz.
    declared : bool
        Whether the noise of all sensors is declared; only then does a raised noise factor indicate
        a fault.
    outputs : int
        Number of outputs, ny.
    """

    rate: float
    declared: bool = True
    outputs: int = 2
    nis: float = 0.0
    readings: float = 0.0
    rows: int = 0
    rows_consistent: int = 0
    rows_since_fault: int = 0
    max_box_pierce: float = 0.0
    max_noise_factor: float = 1.0
    lagged_products: Array = field(init=False)
    _history: Array = field(init=False)
    _sums: Array = field(init=False)
    _rows_since_recompute: int = field(init=False)
    _flags: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, bool))

    def __post_init__(self) -> None:
        self._nis_window = max(round(WINDOW * self.rate), 20)
        self._whiteness_window = max(round(WHITENESS_WINDOW * self.rate), 100)
        self.lagged_products = np.zeros((self.outputs, LAGS + 1))
        # NIS, readings, normalised innovations of the outputs
        self._history = np.zeros((self._whiteness_window + LAGS, 2 + self.outputs))
        self._sums = np.zeros(sums_length(self.outputs))
        self._rows_since_recompute = 0
        counts = np.arange(self.outputs * self._nis_window + 1.0)
        self._limits = ConsistencyLimits(
            np.stack([*nis_band(counts), nis_band(counts, _NIS_ONSET)[1]]),
            self.outputs * _BOX_PIERCE_ONSET,
            self.outputs * _BOX_PIERCE_END,
            _NOISE_ONSET if self.declared else np.inf,
            0.5 * _NOISE_ONSET if self.declared else np.inf,
        )

    def update(
        self, nis: Array, readings: Array, innovations: Array, noise_factor: Array
    ) -> WindowStatistics:
        """Process N rows.

        Parameters
        ----------
        nis, readings : (N,) arrays
            NIS of each row, and the number of readings in it.
        innovations : (N, ny) array
            Normalised innovations; zero without a reading.
        noise_factor : (N, ny) array
            Factor on the declared noise variance of each output.
        """
        n = len(nis)
        # clipped, so that interpolation errors at one or two sharp edges do not appear as
        # autocorrelation
        clipped = np.clip(innovations, -_CLIP, _CLIP) * (readings > 0)[:, None]
        rows = np.concatenate([self._history, np.column_stack([nis, readings, clipped])])
        self._history = rows[n:].copy()
        sums, box_pierce = np.empty((n, 2)), np.empty(n)
        mean, low, high, consistent = np.empty(n), np.empty(n), np.empty(n), np.empty(n, bool)
        self._rows_since_recompute = update_sums(
            rows, len(rows) - n, self._nis_window, self._whiteness_window,
            self._rows_since_recompute, self._sums, self.lagged_products, sums, box_pierce,
        )  # fmt: skip
        flag_inconsistency(
            sums, box_pierce, noise_factor, self._limits, self._flags, mean, low, high, consistent
        )
        self.nis += float(nis.sum())
        self.readings += float(readings.sum())
        self.rows += n
        if n:
            self.max_box_pierce = max(self.max_box_pierce, float(box_pierce.max()))
            self.max_noise_factor = max(self.max_noise_factor, float(noise_factor.max()))
        self.rows_consistent += int(consistent.sum())
        faulty = np.flatnonzero(~consistent)
        self.rows_since_fault = (
            n - 1 - int(faulty[-1]) if len(faulty) else self.rows_since_fault + n
        )
        return WindowStatistics(mean, low, high, box_pierce, consistent)

    def summary(self) -> ConsistencySummary:
        """Summarise all rows so far."""
        mean = self.nis / self.readings if self.readings else np.nan
        low, high = (float(v) for v in nis_band(np.array(self.readings)))
        share = self.rows_consistent / self.rows if self.rows else 1.0
        power = np.maximum(self.lagged_products[:, :1], 1e-300)
        faults = []
        if share < _REQUIRED_SHARE or self._flags.any():
            if self.max_noise_factor > _NOISE_ONSET and self.declared:
                faults.append("swollen")
            if self.max_box_pierce > self.outputs * _BOX_PIERCE_ONSET:
                faults.append("coloured")
            if not faults:
                faults.append("uneven")
        elif self.readings and not (low <= mean <= high) and abs(mean - 1.0) > _NIS_TOLERANCE:
            faults.append("optimistic" if mean > 1.0 else "pessimistic")
        return ConsistencySummary(
            nis_mean=float(mean),
            nis_band95=(low, high),
            readings=int(self.readings),
            consistent_share=share,
            max_noise_factor=self.max_noise_factor,
            max_box_pierce=self.max_box_pierce,
            correlation=np.asarray(self.lagged_products / power),
            faults=tuple(faults),
            recovered=self.rows_since_fault >= min(self._whiteness_window, self.rows / 2)
            and share > 0.5,
        )
