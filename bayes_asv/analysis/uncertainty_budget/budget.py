"""The error budget of an answer, by linear algebra alone.

With P the precision of what was given and F the information of the data, the posterior's
covariance is Σ = (P + F)⁻¹, and an answer is gᵀθ.  Its variance gᵀΣg is a sum of independent
errors: that of a value given with deviation s contributes (gᵀΣe)²/s², the data gᵀΣFΣg, because
Σ(P + F)Σ = Σ.  These shares add up to one, whatever the order; and a source's share is by how
many percent the variance falls when the source's variance falls by one percent (Euler's
theorem for homogeneous functions).  It is the uncertainty budget of the GUM (JCGM 100:2008,
section 5) for a least-squares answer.  Shares are no forecast of what a *much* better value
would do: for that the covariance is computed again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Budget", "Remedy"]

Array = NDArray[np.float64]

_ENDLESS = 1e12  # so much better that it is as good as exact
_WANTED = 0.25  # of the variance: half of the width
_CLOSE = 1e-4
_ROUNDING = 1e-13  # of the largest eigenvalue


@dataclass(frozen=True)
class Remedy:
    """What would halve a width.

    Parameters
    ----------
    sources : tuple of int
        Parameters to be known better, by index; −1 stands for more data.
    times : float
        By how much the information of each has to grow: a deviation falls by its root.
    """

    sources: tuple[int, ...]
    times: float


@dataclass(frozen=True)
class Budget:
    """Prior deviations and data of D parameters.

    Parameters
    ----------
    sd : (D,) array
        Deviation of each beforehand; zero where it is exact.
    information : (D, D) array
        What the data say, F.
    """

    sd: Array
    information: Array

    def covariance(self, times: dict[int, float] | None = None, data: float = 1.0) -> Array:
        """Posterior covariance (D, D), with zeros for what is exact.

        Parameters
        ----------
        times : dict of int to float, optional
            By how much the prior information of some parameters grows.
        data : float
            By how much that of the data grows.
        """
        free = self.sd > 0.0
        precision = self.sd[free] ** -2.0
        for k, factor in (times or {}).items():
            if free[k]:
                precision[np.count_nonzero(free[:k])] *= factor
        # Scaled by the prior's deviations, so that a very good value harms no other digit.
        root = precision**-0.5
        told = root[:, None] * self.information[np.ix_(free, free)] * root
        strength, directions = np.linalg.eigh(told)
        # What is left of a direction that no data see is rounding, and must not be multiplied.
        strength[strength < _ROUNDING * strength[-1]] = 0.0
        inverse = (directions / (1.0 + data * strength)) @ directions.T
        out = np.zeros((len(self.sd), len(self.sd)))
        out[np.ix_(free, free)] = root[:, None] * inverse * root
        return out

    def variance(
        self, answer: Array, times: dict[int, float] | None = None, data: float = 1.0
    ) -> float:
        """Variance of an answer gᵀθ; arguments as for :meth:`covariance`."""
        return float(answer @ self.covariance(times, data) @ answer)

    def shares(self, answer: Array) -> tuple[Array, float]:
        """Share of each parameter's prior (D,), and of the data, in an answer's variance."""
        covariance = self.covariance()
        toward = covariance @ answer
        whole = float(answer @ toward)
        free = self.sd > 0.0
        out = np.zeros(len(self.sd))
        out[free] = (toward[free] / self.sd[free]) ** 2 / whole
        return out, float(toward @ self.information @ toward) / whole

    def elasticity(self, answer: Array, slope: Array) -> float:
        """Share of one noise in an answer's variance.

        Parameters
        ----------
        answer : (D,) array
            The answer, g.
        slope : (D, D) array
            dF/dlog of that noise's variance.
        """
        toward = self.covariance() @ answer
        return float(-(toward @ slope @ toward) / (answer @ toward))

    def halving(self, answer: Array, sources: Sequence[int]) -> list[Remedy]:
        """Find what would halve an answer's width, the least demanding first.

        Parameters
        ----------
        answer : (D,) array
            The answer, g.
        sources : sequence of int
            What could be known better; −1 for more data.

        Returns
        -------
        list of Remedy
            Every single source that can; where none can, every pair, and so on.  Empty when all
            of them together cannot.
        """
        wanted = _WANTED * self.variance(answer)
        for size in range(1, len(sources) + 1):
            found = [
                Remedy(group, self._times(answer, group, wanted))
                for group in combinations(sources, size)
                if self._improved(answer, group, _ENDLESS) < wanted
            ]
            if found:
                return sorted(found, key=lambda remedy: remedy.times)
        return []

    def _improved(self, answer: Array, group: Sequence[int], factor: float) -> float:
        data = factor if -1 in group else 1.0
        return self.variance(answer, {k: factor for k in group if k >= 0}, data)

    def _times(self, answer: Array, group: Sequence[int], wanted: float) -> float:
        """Bisect for the factor: more information never widens an answer."""
        low, high = 0.0, float(np.log(_ENDLESS))
        while high - low > _CLOSE:
            middle = 0.5 * (low + high)
            if self._improved(answer, group, float(np.exp(middle))) > wanted:
                low = middle
            else:
                high = middle
        return float(np.exp(high))
