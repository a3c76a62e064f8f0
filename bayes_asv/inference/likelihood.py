"""The posterior density of a parameter space, many points at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.inference.cut import given_back
from bayes_asv.inference.parameters import Space
from bayes_asv.kernels import coloured, innovations

__all__ = ["WHITE", "Colour", "Target", "shared_work"]

Array = NDArray[np.float64]


class Colour(NamedTuple):
    """A vector autoregression on the normalised innovations of one run.

    Parameters
    ----------
    coefficients : (p, 2, 2) array
        ν_k = Σ_j A_j ν_{k−j} + e_k; p = 0 when the innovations are white.
    root : (2, 2) array
        Lower-triangular inverse root of the covariance of e.
    """

    coefficients: Array
    root: Array

    @property
    def order(self) -> int:
        """Number of lags."""
        return len(self.coefficients)


WHITE = Colour(np.zeros((0, 2, 2)), np.eye(2))


@dataclass(frozen=True)
class Target:
    """Log-posterior of a :class:`Space`, given the colour of each run's innovations.

    Parameters
    ----------
    space : Space
        Coordinates, priors and recordings.
    colours : tuple of Colour
        One a run.
    pool : ThreadPoolExecutor or None
        Where batches are split; the answer does not depend on it.
    """

    space: Space
    colours: tuple[Colour, ...]
    pool: ThreadPoolExecutor | None = None

    def with_colours(self, colours: tuple[Colour, ...]) -> Target:
        """Return the same target with other colours."""
        return replace(self, colours=colours)

    def run_log_likelihood(self, z: Array, run: int) -> Array:
        """Log-likelihood (W,) of one run at coordinates (W, D)."""
        out = np.zeros(len(z))
        cars, noises = self.space.measured(z, run), self.space.noises(z, run)
        colour = self.colours[run]
        if colour.order == 0:
            innovations.log_likelihood(cars, noises, *self._laid_out(run), out)
            cut = self.space.timelines[run].cut
            if cut is not None:
                out += given_back(cut, noises)
        else:
            closes = self.space.timelines[run].closes
            coloured.log_likelihood(cars, noises, *self._laid_out(run), closes, *colour, out)
        return np.where(np.isfinite(out), out, -np.inf)

    def log_likelihood(self, z: Array) -> Array:
        """Log-likelihood (W,) of all runs at coordinates (W, D)."""
        runs = range(len(self.colours))
        return np.asarray(np.sum([self.run_log_likelihood(z, run) for run in runs], axis=0))

    def in_parallel(self, work: Callable[[Array], Array], z: Array) -> Array:
        """Share the rows of z (W, D) between two threads, if there are any to share them."""
        if self.pool is None or len(z) < 8:
            return work(z)
        return np.concatenate(list(self.pool.map(work, np.array_split(z, 2))))

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,), not normalised, at coordinates (W, D)."""
        value = self.space.log_prior(z)
        ok = np.flatnonzero(np.isfinite(value))
        value[ok] += self.in_parallel(self.log_likelihood, z[ok])
        return value

    def innovations(self, z: Array, run: int, colour: Colour | None = None) -> Array:
        """Normalised innovations (E, 2) of one run at coordinates (D,), white if all is well."""
        colour = self.colours[run] if colour is None else colour
        line = self.space.timelines[run]
        car, noise = self.space.measured(z[None], run)[0], self.space.noises(z[None], run)[0]
        kept = np.zeros((len(line.step), 2))
        if colour.order == 0:
            innovations.residuals(car, noise, *self._laid_out(run), kept)
        else:
            coloured.residuals(car, noise, *self._laid_out(run), line.closes, *colour, kept)
        return kept

    def _laid_out(self, run: int) -> tuple[NDArray[np.generic], ...]:
        line = self.space.timelines[run]
        return (
            line.step, line.moments, line.spread, line.kind, line.reading,
            line.extra, line.start,
        )  # fmt: skip


@contextmanager
def shared_work(target: Target) -> Iterator[Target]:
    """Give a target two threads for as long as the context lasts."""
    with ThreadPoolExecutor(2) as pool:
        yield replace(target, pool=pool)
