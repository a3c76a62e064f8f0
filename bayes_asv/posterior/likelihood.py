"""Posterior density over a parameter space, many points at a time."""

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

from bayes_asv.filters import kalman, kalman_ar
from bayes_asv.filters.kalman import MISSING, Laws, Measurements
from bayes_asv.posterior.effects import NominalReadings, SensorPatterns, law_table
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.missing_band import log_determinant
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["WHITE", "Perturbation", "Posterior", "ResidualAR", "shared_work"]

Array = NDArray[np.float64]

_MANY = 8  # points from which on two threads share them


class ResidualAR(NamedTuple):
    """A vector autoregression on the normalised innovations of one run.

    Parameters
    ----------
    coefficients : (p, ny, ny) array
        ν_k = Σ_j A_j ν_{k−j} + e_k; p = 0 when the innovations are white.
    root : (ny, ny) array
        Lower-triangular inverse root of the covariance of e.
    """

    coefficients: Array
    root: Array

    @property
    def order(self) -> int:
        """Number of lags."""
        return len(self.coefficients)


WHITE = ResidualAR(np.zeros((0, 0, 0)), np.zeros((0, 0)))
"""No autoregression: innovations that are white and of unit variance."""


class Perturbation(NamedTuple):
    """A change of one run: of its inputs' moments, of its outputs, and forces on the body.

    Parameters
    ----------
    moments : (E, nu, ORDER) array
        Added to the moments of the inputs.
    reading : (E, ny) array
        Added to the outputs.
    force : (E, ne) array
        On the body at the suspension elements, N.
    """

    moments: Array
    reading: Array
    force: Array


@dataclass(frozen=True)
class Posterior:
    """Log-posterior of a :class:`ParameterSpace`, given the autoregression of each run's residuals.

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
        """Return the same posterior with other residual autoregressions."""
        return replace(self, colours=colours)

    def run_log_likelihood(self, z: Array, run: int) -> Array:
        """Log-likelihood (W,) of one run at coordinates (W, D)."""
        recording = self.space.timelines[run]
        if recording.retimed is None:
            value = self._log_likelihood(z, run, recording)
        else:
            weights = recording.retimed.weights(self.space.clock_errors(z, run))
            lines = (recording, *recording.retimed.lines)
            value = np.sum(
                [w * self._log_likelihood(z, run, one) for w, one in _used(weights, lines)], axis=0
            )
        return np.where(np.isfinite(value), value, -np.inf)

    def _log_likelihood(self, z: Array, run: int, recording: PreparedRecording) -> Array:
        """Log-likelihood (W,) of one run, prepared for certain errors of its clocks."""
        colour = self.colours[run]
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        if colour.order > 0:
            value = kalman_ar.log_likelihood(
                system, noise, recording.measurements, recording.closes, *colour
            )
        elif not self.space.sites:
            value = kalman.log_likelihood(system, noise, recording.measurements)
            value += self.given_back(z, run)
        else:
            value = self._with_effects(z, run) + self.given_back(z, run)
        return np.asarray(value)

    def _with_effects(self, z: Array, run: int) -> Array:
        """Log-likelihood (W,) of one run whose car or sensors have effects."""
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        recording = self.space.timelines[run]
        values = [self.space.effects(point) for point in z]
        tables = np.stack([law_table(self.space.car, v, run) for v in values])
        readings = [self.as_declared(point, run) for point in z]
        if all(one is readings[0] for one in readings):  # no sensor differs
            data, laws = self._declared(recording, run, readings[0], tables)
            return kalman.log_likelihood(system, noise, data, laws)
        out = np.empty(len(z))
        for w in range(len(z)):
            data, laws = self._declared(recording, run, readings[w], tables[w : w + 1])
            out[w] = kalman.log_likelihood(system.one(w), noise.one(w), data, laws)[0]
        return out

    def _declared(
        self, recording: PreparedRecording, run: int, nominal: NominalReadings, tables: Array
    ) -> tuple[Measurements, Laws | None]:
        """Measurements of sensors as declared, and the laws; None where no force law acts."""
        data = recording.measurements._replace(moments=nominal.moments, reading=nominal.reading)
        if tables.shape[1] == 0:
            return data, None
        added = np.zeros((len(data.step), len(self.space.car.elements)))
        pole = self.patterns[run].pole
        return data, Laws(tables, pole, nominal.wheel, recording.elapsed, added)

    def given_back(self, z: Array, run: int) -> Array:
        """½ log det of a band that was cut out of a run (W,), at coordinates (W, D)."""
        cut = self.space.timelines[run].cut
        if cut is None:
            return np.zeros(len(z))
        return log_determinant(cut, self.space.noises(z, run))

    def by_run(self, z: Array, runs: Sequence[int] | None = None) -> Array:
        """Log-likelihood (R, W) of runs, or of all of them, at coordinates (W, D).

        Many points are cut in two, and the pieces of all runs shared between the threads of the
        pool.  A thread of the pool must not call this: it would wait for one that it occupies.
        """
        runs = range(len(self.colours)) if runs is None else runs
        pieces = np.array_split(z, 2) if len(z) >= _MANY and self.pool else [z]
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
        """Normalised innovations (E, ny) of one run at coordinates (D,), white if all is well."""
        if self.space.sites:
            return self.scored(z, run)[0]
        colour = self.colours[run] if colour is None else colour
        recording = self.space.timelines[run]
        retimed = recording.retimed
        if retimed is None:
            return self._innovations(z, run, recording, colour)
        weights = retimed.weights(self.space.clock_errors(z[None], run))
        out = np.zeros(recording.reading.shape)
        for weight, one in _used(weights, (recording, *retimed.lines)):
            nu = self._innovations(z, run, one, colour)
            for y in range(nu.shape[1]):  # the same readings, at other instants
                out[recording.kind[:, y] != MISSING, y] += weight * nu[one.kind[:, y] != MISSING, y]
        return out

    def _innovations(
        self, z: Array, run: int, recording: PreparedRecording, colour: ResidualAR
    ) -> Array:
        """Normalised innovations (E, ny) of one run, prepared for certain errors of its clocks."""
        system, noise = self.space.state_space(z[None], run), self.space.noises(z[None], run)
        if colour.order == 0:
            passed = kalman.filter_pass(system, noise, recording.measurements)
            return np.asarray(passed.innovations[0])
        return kalman_ar.innovations(
            system, noise, recording.measurements, recording.closes, *colour
        )

    def scored(
        self, z: Array, run: int, nudge: Perturbation | None = None
    ) -> tuple[Array, Array, Array]:
        """Innovations (E, ny), logarithms of their variances (E, ny) and states of one run.

        Zero where there is no value; the states (E, nx + ne) are deflections and their rates
        element by element, body rates, and excess forces.  A perturbation changes what was read,
        or adds forces.
        """
        recording = self.space.timelines[run]
        nominal = self.as_declared(z, run)
        if nudge is not None:
            nominal = nominal._replace(
                moments=nominal.moments + nudge.moments, reading=nominal.reading + nudge.reading
            )
        table = law_table(self.space.car, self.space.effects(z), run)[None]
        data, laws = self._declared(recording, run, nominal, table)
        if nudge is not None and np.any(nudge.force):
            laws = Laws(
                table, self.patterns[run].pole, nominal.wheel, recording.elapsed, nudge.force
            )
        system, noise = self.space.state_space(z[None], run), self.space.noises(z[None], run)
        passed = kalman.filter_pass(system, noise, data, laws)
        states = passed.states[0]
        if laws is None:
            states = np.hstack([states, np.zeros((len(states), len(self.space.car.elements)))])
        return passed.innovations[0], passed.log_variances[0], states

    def as_declared(
        self, z: Array, run: int, line: PreparedRecording | None = None
    ) -> NominalReadings:
        """Return what sensors as declared would have read in a run, at coordinates (D,).

        With ``line``, from its readings in place of the run's own.
        """
        line = self.space.timelines[run] if line is None else line
        if not self.patterns:
            return NominalReadings(line.moments, line.reading, np.zeros((0, 0)))
        return self.patterns[run].corrected(line, self.space.effects(z), self.space.zeros(z, run))


def _used(
    weights: Array, lines: Sequence[PreparedRecording]
) -> Iterator[tuple[Array, PreparedRecording]]:
    """Pair recordings with their weights (W,), but those that have none."""
    return ((w, line) for w, line in zip(weights.T, lines, strict=True) if np.any(w))


@contextmanager
def shared_work(target: Posterior) -> Iterator[Posterior]:
    """Give a posterior two threads for as long as the context lasts, and BLAS none beside its own.

    A thread of BLAS waits for its next small product by spinning, on a core that a filter could
    use.
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
