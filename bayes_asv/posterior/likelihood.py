"""The posterior density of a parameter space, many points at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from bayes_asv.filters import ekf as extended
from bayes_asv.filters import kalman as innovations
from bayes_asv.filters import kalman_ar as coloured
from bayes_asv.posterior.effects import NominalReadings, SensorPatterns, rows
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.missing_band import given_back
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["WHITE", "Perturbation", "Posterior", "ResidualAR", "shared_work"]

Array = NDArray[np.float64]

_MANY = 8  # points from which on two threads share them


class ResidualAR(NamedTuple):
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


class Perturbation(NamedTuple):
    """A change of one run: of the wheels' moments, of chassis readings, and forces at the axles.

    Parameters
    ----------
    moments : (E, 2, ORDER) array
        Added to the moments of the wheel accelerations.
    reading : (E, 2) array
        Added to the chassis readings, m/s².
    force : (E, 2) array
        On the chassis at the axles, N.
    """

    moments: Array
    reading: Array
    force: Array


WHITE = ResidualAR(np.zeros((0, 2, 2)), np.eye(2))


@dataclass(frozen=True)
class Posterior:
    """Log-posterior of a :class:`ParameterSpace`, given the colour of each run's innovations.

    Parameters
    ----------
    space : ParameterSpace
        Coordinates, priors and recordings.
    colours : tuple of ResidualAR
        One a run.
    pool : ThreadPoolExecutor or None
        Where batches are split; the answer does not depend on it.
    patterns : tuple of SensorPatterns
        One a run where the space has effects; their innovations are taken to be white.
    """

    space: ParameterSpace
    colours: tuple[ResidualAR, ...]
    pool: ThreadPoolExecutor | None = None
    patterns: tuple[SensorPatterns, ...] = ()

    def with_colours(self, colours: tuple[ResidualAR, ...]) -> Posterior:
        """Return the same target with other colours."""
        return replace(self, colours=colours)

    def run_log_likelihood(self, z: Array, run: int) -> Array:
        """Log-likelihood (W,) of one run at coordinates (W, D)."""
        if self.space.sites:
            return self._with_effects(z, run)
        out = np.zeros(len(z))
        cars, noises = self.space.measured(z, run), self.space.noises(z, run)
        colour = self.colours[run]
        if colour.order == 0:
            innovations.log_likelihood(cars, noises, *self._laid_out(run), out)
            out += self.given_back(z, run)
        else:
            closes = self.space.timelines[run].closes
            coloured.log_likelihood(cars, noises, *self._laid_out(run), closes, *colour, out)
        return np.where(np.isfinite(out), out, -np.inf)

    def given_back(self, z: Array, run: int) -> Array:
        """Nats (W,) that a band which was cut out of a run is no witness for, at (W, D)."""
        cut = self.space.timelines[run].cut
        return np.zeros(len(z)) if cut is None else given_back(cut, self.space.noises(z, run))

    def by_run(self, z: Array, runs: Sequence[int] | None = None) -> Array:
        """Log-likelihood (R, W) of runs, or of all of them, at coordinates (W, D).

        Many points are cut in two, and the pieces of all runs shared between the threads of the
        pool.  A thread of the pool must not call this: it would wait for one that it takes up.
        """
        runs = range(len(self.colours)) if runs is None else runs
        pieces = np.array_split(z, 2) if len(z) >= _MANY else [z]
        work = self.pool.map if self.pool else map
        shares = [(piece, run) for run in runs for piece in pieces]
        values = list(work(lambda share: self.run_log_likelihood(*share), shares))
        return np.concatenate(values).reshape(len(runs), len(z))

    def log_likelihood(self, z: Array) -> Array:
        """Log-likelihood (W,) of all runs at coordinates (W, D); as :meth:`by_run`."""
        return np.asarray(self.by_run(z).sum(axis=0))

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,), not normalised, at coordinates (W, D); as :meth:`by_run`."""
        value = self.space.log_prior(z)
        ok = np.isfinite(value)
        if np.any(ok):
            value[ok] += self.log_likelihood(z[ok])
        return value

    def innovations(self, z: Array, run: int, colour: ResidualAR | None = None) -> Array:
        """Normalised innovations (E, 2) of one run at coordinates (D,), white if all is well."""
        if self.space.sites:
            return self.scored(z, run)[0]
        colour = self.colours[run] if colour is None else colour
        line = self.space.timelines[run]
        car, noise = self.space.measured(z[None], run)[0], self.space.noises(z[None], run)[0]
        kept = np.zeros((len(line.step), 2))
        if colour.order == 0:
            innovations.residuals(car, noise, *self._laid_out(run), kept)
        else:
            coloured.residuals(car, noise, *self._laid_out(run), line.closes, *colour, kept)
        return kept

    def scored(
        self, z: Array, run: int, nudge: Perturbation | None = None
    ) -> tuple[Array, Array, Array]:
        """Innovations (E, 2), logarithms of their variances (E, 2) and states (E, 6) of one run.

        Zero where there is no value; the states are δ_f, δ̇_f, δ_r, δ̇_r and both excess forces.
        A nudge changes what was read, or adds forces.
        """
        line, known = self.space.timelines[run], self.patterns[run]
        kept, logs = np.zeros((len(line.step), 2)), np.zeros((len(line.step), 2))
        states = np.zeros((len(line.step), 6))
        values = self.space.effects(z)
        driven, reading, wheel = self.as_declared(z, run)
        added = np.zeros_like(reading)
        if nudge is not None:
            driven, reading, added = driven + nudge.moments, reading + nudge.reading, nudge.force
        car, noise = self.space.measured(z[None], run)[0], self.space.noises(z[None], run)[0]
        extended.residuals(
            car, noise, rows(values, run), known.pole, line.step, driven, line.spread, line.kind,
            reading, line.extra, line.start, wheel, line.elapsed, added, kept, logs, states,
        )  # fmt: skip
        return kept, logs, states

    def as_declared(
        self, z: Array, run: int, line: PreparedRecording | None = None
    ) -> NominalReadings:
        """Return what sensors as declared would have read in a run, at coordinates (D,).

        With ``line``, from its readings in place of the run's own.
        """
        line = self.space.timelines[run] if line is None else line
        return self.patterns[run].corrected(line, self.space.effects(z), self.space.zeros(z, run))

    def _with_effects(self, z: Array, run: int) -> Array:
        """Log-likelihood (W,) of one run whose car or sensors have effects."""
        line, known = self.space.timelines[run], self.patterns[run]
        out = np.zeros(len(z))
        cars, noises = self.space.measured(z, run), self.space.noises(z, run)
        added = np.zeros_like(line.reading)
        for w in range(len(z)):
            values = self.space.effects(z[w])
            driven, reading, wheel = self.as_declared(z[w], run)
            extended.log_likelihood(
                cars[w : w + 1], noises[w : w + 1], rows(values, run)[None], known.pole, line.step,
                driven, line.spread, line.kind, reading, line.extra, line.start, wheel,
                line.elapsed, added, out[w : w + 1],
            )  # fmt: skip
        out += self.given_back(z, run)
        return np.where(np.isfinite(out), out, -np.inf)

    def _laid_out(self, run: int) -> tuple[NDArray[np.generic], ...]:
        line = self.space.timelines[run]
        return (
            line.step, line.moments, line.spread, line.kind, line.reading,
            line.extra, line.start,
        )  # fmt: skip


@contextmanager
def shared_work(target: Posterior) -> Iterator[Posterior]:
    """Give a target two threads for as long as the context lasts, and BLAS none beside its own.

    A thread of BLAS waits for its next small product by spinning, on a core that a pass could use:
    a diagnosis took a quarter longer on two cores.
    """
    with ThreadPoolExecutor(2) as pool, _BLAS.alone():
        yield replace(target, pool=pool)


class _Blas:
    """Libraries that have threads of their own, and who asked them to have one only."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._asked = 0
        self._limit: Any = None

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Let BLAS have one thread; as many as before once nobody asks for that any more."""
        with self._lock:
            self._asked += 1
            if self._asked == 1:
                self._limit = _libraries().limit(limits=1, user_api="blas")
        try:
            yield
        finally:
            with self._lock:
                self._asked -= 1
                if self._asked == 0:
                    self._limit.restore_original_limits()


_BLAS = _Blas()


@lru_cache(maxsize=1)
def _libraries() -> ThreadpoolController:
    """Find the libraries that have threads of their own, once: it takes a millisecond."""
    return ThreadpoolController()
