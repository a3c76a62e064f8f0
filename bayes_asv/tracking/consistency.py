"""Does the filter's noise explain what its predictions miss?  Asked while it runs.

A filter that is right has innovations that are white and of the variance it says.  Three
numbers tell: the mean of their normalised squares over a window that slides along (NIS), the level
that the noise had to be raised to, and the correlation from reading to reading.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.consistency_sums import LAGS, SUMS, Limits, judge, slide

__all__ = ["LAGS", "WINDOW", "Consistency", "Summary", "Watched", "band"]

Array = NDArray[np.float64]

WINDOW = 0.5
"""Length of the window of the mean NIS, s."""
MEMORY = 2.0
"""Length of the window over which correlation is looked for, s."""

_NORMAL95 = 1.959964
_DOUBT = 4.5  # deviations of the mean: hardly ever by chance
_COLOURED = 300.0  # χ² with 20 degrees of freedom: nothing that chance would do
_WHITE_AGAIN = 150.0
_SWOLLEN = 4.0  # times the declared variance
_CUT = 3.0  # deviations
_MOSTLY = 0.9  # share of the rows that have to be well
_SLIGHT = 0.05  # of the mean NIS, a fortieth of a deviation: too little to matter


def band(readings: Array, normal: float = _NORMAL95) -> tuple[Array, Array]:
    """Where the mean of so many squared standard normals lies, after Wilson & Hilferty (1931).

    Parameters
    ----------
    readings : (N,) array
        How many; where there are none, the band is the whole line.
    normal : float
        Half-width in deviations of a normal; 95 % by default.

    Returns
    -------
    low, high : (N,) arrays
    """
    n = np.maximum(np.asarray(readings, np.float64), 1.0)
    c = 2.0 / (9.0 * n)
    low = np.maximum(1.0 - c - normal * np.sqrt(c), 0.0) ** 3
    high = (1.0 - c + normal * np.sqrt(c)) ** 3
    none = np.asarray(readings) < 0.5
    return np.where(none, 0.0, low), np.where(none, np.inf, high)


@dataclass
class Watched:
    """What the watch says of each of N rows.

    Parameters
    ----------
    mean, low, high : (N,) arrays
        Mean NIS a reading over the window, and its 95 % band.
    colour : (N,) array
        Box–Pierce statistic of both axles over :data:`LAGS` lags.
    consistent : (N,) bool array
        Whether nothing was amiss of late.
    """

    mean: Array
    low: Array
    high: Array
    colour: Array
    consistent: NDArray[np.bool_]


@dataclass(frozen=True)
class Summary:
    """How a whole recording went.

    Parameters
    ----------
    nis_mean : float
        Mean of the normalised innovations squared; NaN without a reading.
    nis_band95 : pair of float
        Where it lies 95 % of the time if all is well.
    readings : int
        Readings that it stands on.
    share : float
        Share of the rows at which nothing was amiss.
    level : float
        Largest factor by which the noise's variance was raised.
    colour : float
        Largest Box–Pierce statistic of both axles over two seconds, χ² with twenty degrees.
    correlation : (2, LAGS + 1) array
        Autocorrelation of the normalised innovations, front and rear.
    faults : tuple of str
        ``swollen`` noise, ``coloured`` innovations, ``uneven`` ones, a filter that was
        ``optimistic`` or ``pessimistic`` all along; empty when all was well.
    recovered : bool
        Whether nothing was amiss for the last two seconds, whatever was before.
    """

    nis_mean: float
    nis_band95: tuple[float, float]
    readings: int
    share: float
    level: float
    colour: float
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
class Consistency:
    """Keeps watch over rows as they come.

    Parameters
    ----------
    rate : float
        Rows a second.
    declared : bool
        Whether all sensors' noise was given: a raised level then means that something is amiss.
    """

    rate: float
    declared: bool = True
    nis: float = 0.0
    readings: float = 0.0
    rows: int = 0
    rows_consistent: int = 0
    rows_well: int = 0
    worst_colour: float = 0.0
    worst_level: float = 1.0
    products: Array = field(default_factory=lambda: np.zeros((2, LAGS + 1)))
    _past: Array = field(init=False)
    _sums: Array = field(init=False)
    _since: int = field(init=False)
    _doubt: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, bool))

    def __post_init__(self) -> None:
        self._window = max(round(WINDOW * self.rate), 20)
        self._long = max(round(MEMORY * self.rate), 100)
        # NIS, readings, normalised innovations of both axles
        self._past = np.zeros((self._long + LAGS, 4))
        self._sums = np.zeros(SUMS)
        self._since = 0  # rows since these were summed afresh
        counts = np.arange(2.0 * self._window + 1.0)  # as many readings as a window can hold
        self._limits = Limits(
            np.stack([*band(counts), *band(counts, _DOUBT)]),
            _COLOURED,
            _WHITE_AGAIN,
            _SWOLLEN if self.declared else np.inf,
            0.5 * _SWOLLEN if self.declared else np.inf,
        )

    def watch(self, nis: Array, readings: Array, innovations: Array, level: Array) -> Watched:
        """Take N rows.

        Parameters
        ----------
        nis, readings : (N,) arrays
            Squared deviations of each row and the number of readings in it.
        innovations : (N, 2) array
            Normalised; zero where there is none.
        level : (N, 2) array
            Level of the noise's variance, front and rear.
        """
        n = len(nis)
        # cut, so that a sharp edge or two, where a spline errs, do not pass for a colour
        cut = np.clip(innovations, -_CUT, _CUT) * (readings > 0)[:, None]
        rows = np.concatenate([self._past, np.column_stack([nis, readings, cut])])
        self._past = rows[n:].copy()
        totals, colour = np.empty((n, 2)), np.empty(n)
        mean, low, high, consistent = np.empty(n), np.empty(n), np.empty(n), np.empty(n, bool)
        self._since = slide(
            rows, len(rows) - n, self._window, self._long, self._since, self._sums, self.products,
            totals, colour,
        )  # fmt: skip
        judge(totals, colour, level, self._limits, self._doubt, mean, low, high, consistent)
        self.nis += float(nis.sum())
        self.readings += float(readings.sum())
        self.rows += n
        if n:
            self.worst_colour = max(self.worst_colour, float(colour.max()))
            self.worst_level = max(self.worst_level, float(level.max()))
        self.rows_consistent += int(consistent.sum())
        wrong = np.flatnonzero(~consistent)
        self.rows_well = n - 1 - int(wrong[-1]) if len(wrong) else self.rows_well + n
        return Watched(mean, low, high, colour, consistent)

    def summary(self) -> Summary:
        """Say how it went from the first row to the last."""
        mean = self.nis / self.readings if self.readings else np.nan
        low, high = (float(v) for v in band(np.array(self.readings)))
        share = self.rows_consistent / self.rows if self.rows else 1.0
        power = np.maximum(self.products[:, :1], 1e-300)
        found = []
        if share < _MOSTLY or self._doubt.any():
            if self.worst_level > _SWOLLEN and self.declared:
                found.append("swollen")
            if self.worst_colour > _COLOURED:
                found.append("coloured")
            if not found:
                found.append("uneven")
        elif self.readings and not (low <= mean <= high) and abs(mean - 1.0) > _SLIGHT:
            found.append("optimistic" if mean > 1.0 else "pessimistic")
        return Summary(
            nis_mean=float(mean),
            nis_band95=(low, high),
            readings=int(self.readings),
            share=share,
            level=self.worst_level,
            colour=self.worst_colour,
            correlation=np.asarray(self.products / power),
            faults=tuple(found),
            recovered=self.rows_well >= self._long and share > 0.5,
        )
