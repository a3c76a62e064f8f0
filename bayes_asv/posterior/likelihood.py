"""Posterior density over a parameter space, many points at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from bayes_asv.filters import kalman, kalman_ar
from bayes_asv.filters.kalman import MISSING, Laws, Measurements, SensorNoise, StateSpace
from bayes_asv.posterior.effects import NominalReadings, SensorCorrections, law_table
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.posterior.threads import Threads, threads
from bayes_asv.preprocessing.missing_band import log_determinant
from bayes_asv.preprocessing.prepared_recording import (
    ClockVariants,
    PreparedRecording,
    interpolation_weights,
)

__all__ = [
    "WHITE", "ClockExpansion", "Perturbation", "Posterior", "ResidualAR", "shared_work",
]  # fmt: skip

Array = NDArray[np.float64]

_FARTHEST = 4.0  # standard deviations from the mode up to which a polynomial is trusted
_LARGEST_LOG = 3.0  # of a change of curvature: far from the mode nothing is known of it
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


class ClockExpansion(NamedTuple):
    """Change of a run's log-likelihood by errors of its clocks, expanded at the mode.

    With u the errors in steps of :class:`bayes_asv.preprocessing.prepared_recording.ClockVariants`,

        L(z, u) ≈ L(z, 0) + exp(aᵀδ) [uᵀ g(δ) − ½ uᵀ H(δ) u],    δ = R (z − z̄).

    The exponential is the inverse power of the noise, which scales slopes and curvatures alike; g
    and H are polynomials of second degree through P = (d + 1)(d + 2) / 2 points.

    Parameters
    ----------
    centre : (D,) array
        z̄.
    inverse : (d, D) array
        R: to standard deviations along the principal axes of the posterior.
    growth : (d,) array
        a.
    slopes, curvatures : (P, K) and (P, K, K) arrays
        g and H at the middle and at :meth:`ClockVariants.points`.
    """

    centre: Array
    inverse: Array
    growth: Array
    slopes: Array
    curvatures: Array

    def change(self, z: Array, u: Array) -> Array:
        """Return L(z, u) − L(z, 0) for coordinates (W, D) and errors (W, K)."""
        away = (z - self.centre) @ self.inverse.T
        weights = interpolation_weights(np.clip(away, -_FARTHEST, _FARTHEST))
        size = np.exp(np.clip(away @ self.growth, -_LARGEST_LOG, _LARGEST_LOG))
        curved = np.einsum("wi,wij,wj->w", u, np.tensordot(weights, self.curvatures, 1), u)
        return np.asarray(size * (np.sum(u * (weights @ self.slopes), axis=1) - 0.5 * curved))


@dataclass(frozen=True)
class Posterior:
    """Log-posterior of a :class:`ParameterSpace`, given the autoregression of each run's residuals.

    Parameters
    ----------
    space : ParameterSpace
        Coordinates, priors and recordings.
    residual_ars : tuple of ResidualAR
        One a run.
    pool : Threads or None
        Where batches are split; the answer does not depend on it.
    sensor_corrections : tuple of SensorCorrections
        One a run where the space has effects; their innovations are taken to be white.
    retimed_corrections : tuple of tuple of SensorCorrections
        The same for each recording with other errors of its clocks.
    expansions : tuple of ClockExpansion or None
        One a run, to be used in place of the recordings with other errors of the clocks; empty to
        use those.
    perturbations : tuple of Perturbation
        One a run: known changes of what was read, and known forces; empty without any.
    """

    space: ParameterSpace
    residual_ars: tuple[ResidualAR, ...]
    pool: Threads | None = None
    sensor_corrections: tuple[SensorCorrections, ...] = ()
    retimed_corrections: tuple[tuple[SensorCorrections, ...], ...] = ()
    expansions: tuple[ClockExpansion | None, ...] = ()
    perturbations: tuple[Perturbation, ...] = ()

    def with_residual_ar(self, colours: tuple[ResidualAR, ...]) -> Posterior:
        """Return the same posterior with other residual autoregressions."""
        return replace(self, residual_ars=colours)

    def run_log_likelihood(self, z: Array, run: int) -> Array:
        """Log-likelihood (W,) of one run at coordinates (W, D)."""
        recording = self.space.recordings[run]
        if recording.clock_variants is None:
            value = self._log_likelihood(z, run, recording)
        else:
            errors = self.space.clock_errors(z, run)
            expansion = self.expansions[run] if self.expansions else None
            if expansion is not None:
                u = (errors - recording.clock_variants.middle) / recording.clock_variants.step
                value = self._log_likelihood(z, run, recording) + expansion.change(z, u)
            else:
                weights = recording.clock_variants.weights(errors)
                recordings = (recording, *recording.clock_variants.recordings)
                value = np.sum(
                    [w * self._log_likelihood(z, run, x) for w, x in _used(weights, recordings)],
                    axis=0,
                )
        return np.where(np.isfinite(value), value, -np.inf)

    def expanded(self, z: Array, covariance: Array) -> Posterior:
        """Expand the change by errors of clocks at the mode, to sample with one pass a point.

        Parameters
        ----------
        z, covariance : (D,) and (D, D) arrays
            Mode and covariance, along whose principal axes derivatives are taken.
        """
        runs = range(len(self.residual_ars))
        return replace(self, expansions=tuple(self._expansion(z, covariance, r) for r in runs))

    def _expansion(self, z: Array, covariance: Array, run: int) -> ClockExpansion | None:
        recording = self.space.recordings[run]
        retimed = recording.clock_variants
        if retimed is None:
            return None
        clocks = self.space.clock_coordinates(run)
        own = [k for k in self.space.coordinates_of_run(run) if k not in clocks]
        variance, axes = np.linalg.eigh(covariance[np.ix_(own, own)])
        way = np.zeros((len(z), len(own)))
        way[own] = axes * np.sqrt(np.maximum(variance, 0.0))
        away = np.vstack([np.zeros(len(own)), ClockVariants.points(len(own))])
        values = np.stack(
            [
                self._log_likelihood(z + away @ way.T, run, x)
                for x in (recording, *retimed.recordings)
            ]
        )
        slopes, curvatures = _derivatives(values, len(clocks))
        size = np.trace(np.linalg.solve(curvatures[0], curvatures), axis1=1, axis2=2)
        logs = np.log(np.maximum(size / len(clocks), np.exp(-_LARGEST_LOG)))
        growth = 0.5 * (logs[1 : len(own) + 1] - logs[len(own) + 1 : 2 * len(own) + 1])
        scale = np.exp(away @ growth)
        return ClockExpansion(
            z, np.asarray(np.linalg.pinv(way), np.float64), growth,
            slopes / scale[:, None], curvatures / scale[:, None, None],
        )  # fmt: skip

    def _log_likelihood(self, z: Array, run: int, recording: PreparedRecording) -> Array:
        """Log-likelihood (W,) of one run, prepared for certain errors of its clocks."""
        colour = self.residual_ars[run]
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        if colour.order > 0:
            value = kalman_ar.log_likelihood(
                system, noise, recording.measurements, recording.ends_group, *colour
            )
        elif not (self.space.placed_effects or self.perturbations):
            value = kalman.log_likelihood(system, noise, recording.measurements)
            value += self.removed_band_correction(z, run)
        else:
            value = self._with_effects(z, run, recording) + self.removed_band_correction(z, run)
        return np.asarray(value)

    def _with_effects(self, z: Array, run: int, recording: PreparedRecording) -> Array:
        """Log-likelihood (W,) of one run whose car or sensors have effects."""
        out = np.empty(len(z))
        for sets, model in self._models(z, run, recording):
            out[sets] = kalman.log_likelihood(*model)
        return out

    def _models(
        self, z: Array, run: int, recording: PreparedRecording, nudge: Perturbation | None = None
    ) -> Iterator[tuple[list[int], tuple[StateSpace, SensorNoise, Measurements, Laws | None]]]:
        """Divide points (W, D) by what sensors would have read, each part with its models."""
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        values = [self.space.effects(point) for point in z]
        tables = np.stack([law_table(self.space.car, v, run) for v in values])
        known = self._sensor_corrections(run, recording) if self.sensor_corrections else None
        if known is not None:
            biases = self.space.input_biases(z, run)
            on_outputs = biases @ recording.rigid_gain.T
            system = system._replace(biases=np.hstack([biases, on_outputs]))
        no_zeros = np.zeros(len(recording.inputs))  # the filter takes them off
        as_read = NominalReadings(recording.moments, recording.reading, np.zeros((0, 0)))
        parts: dict[int, tuple[NominalReadings, list[int]]] = {}
        for w, value in enumerate(values):
            nominal = as_read if known is None else known.corrected(recording, value, no_zeros)
            parts.setdefault(id(nominal), (nominal, []))[1].append(w)
        for nominal, sets in parts.values():
            whole = len(sets) == len(z)
            yield (
                sets,
                (
                    system if whole else system.subset(sets),
                    noise if whole else noise.subset(sets),
                    *self._declared(recording, run, nominal, tables[sets], nudge),
                ),
            )

    def _sensor_corrections(self, run: int, recording: PreparedRecording) -> SensorCorrections:
        """Patterns of a run, prepared for certain errors of its clocks."""
        retimed = self.space.recordings[run].clock_variants
        if retimed is None or recording not in retimed.recordings:
            return self.sensor_corrections[run]
        return self.retimed_corrections[run][retimed.recordings.index(recording)]

    def _declared(
        self,
        recording: PreparedRecording,
        run: int,
        nominal: NominalReadings,
        tables: Array,
        nudge: Perturbation | None,
    ) -> tuple[Measurements, Laws | None]:
        """Measurements of sensors as declared, and the laws; None where no force acts."""
        moments, reading, _ = self._with_known_changes(nominal, run)
        added = self.known_force(run)
        if nudge is not None:
            moments, reading = moments + nudge.moments, reading + nudge.reading
            added = added + nudge.force
        data = recording.measurements._replace(moments=moments, reading=reading)
        if tables.shape[1] == 0 and not np.any(added):
            return data, None
        pole = self.sensor_corrections[run].pole
        return data, Laws(tables, pole, nominal.wheel, recording.elapsed, added)

    def removed_band_correction(self, z: Array, run: int) -> Array:
        """½ log det of a band that was cut out of a run (W,), at coordinates (W, D)."""
        cut = self.space.recordings[run].removed_band
        if cut is None:
            return np.zeros(len(z))
        return log_determinant(cut, self.space.noises(z, run))

    def by_run(self, z: Array, runs: Sequence[int] | None = None) -> Array:
        """Log-likelihood (R, W) of runs, or of all of them, at coordinates (W, D).

        Many points are divided, and the pieces of all runs shared between the threads of the
        pool.  A thread of the pool must not call this: it would wait for one that it occupies.
        """
        runs = range(len(self.residual_ars)) if runs is None else runs
        pieces = np.array_split(z, self.pool.count) if len(z) >= _MANY and self.pool else [z]
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
        """Normalised innovations of one run, white if all is well.

        (E, ny) at coordinates (D,), and (W, E, ny) at (W, D), which takes little more time for as
        many points as there are lanes in :data:`bayes_asv.filters.vector_code.LANES`.
        """
        points = np.atleast_2d(z)
        out = self._innovations(points, run, self.residual_ars[run] if colour is None else colour)
        return out[0] if z.ndim == 1 else out

    def _innovations(self, z: Array, run: int, colour: ResidualAR) -> Array:
        """Normalised innovations (W, E, ny) of one run at coordinates (W, D)."""
        if self.space.placed_effects or self.perturbations:
            return self.filter_passes(z, run)[0]
        recording = self.space.recordings[run]
        retimed = recording.clock_variants
        if retimed is None:
            return self._of_recording(z, run, recording, colour)
        weights = retimed.weights(self.space.clock_errors(z, run))
        out = np.zeros((len(z), *recording.reading.shape))
        for weight, one in _used(weights, (recording, *retimed.recordings)):
            nu = self._of_recording(z, run, one, colour)
            for y in range(nu.shape[2]):  # the same readings, at other instants
                here, there = recording.kind[:, y] != MISSING, one.kind[:, y] != MISSING
                out[:, here, y] += weight[:, None] * nu[:, there, y]
        return out

    def _of_recording(
        self, z: Array, run: int, recording: PreparedRecording, colour: ResidualAR
    ) -> Array:
        """Normalised innovations (W, E, ny) of a run, prepared for certain errors of its clocks."""
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        if colour.order == 0:
            return kalman.filter_pass(system, noise, recording.measurements).innovations
        return kalman_ar.innovations(
            system, noise, recording.measurements, recording.ends_group, *colour
        )

    def innovations_and_variances(
        self, z: Array, run: int, nudge: Perturbation | None = None
    ) -> tuple[Array, Array, Array]:
        """Innovations (E, ny), logarithms of their variances (E, ny) and states (E, nx + ne).

        Of one run at coordinates (D,); otherwise as :meth:`filter_passes`.
        """
        innovations, log_variances, states = self.filter_passes(z[None], run, nudge)
        return innovations[0], log_variances[0], states[0]

    def filter_passes(
        self, z: Array, run: int, nudge: Perturbation | None = None
    ) -> tuple[Array, Array, Array]:
        """Innovations (W, E, ny), logarithms of their variances (W, E, ny) and states of one run.

        At coordinates (W, D).  Zero where there is no value; the states (W, E, nx + ne) are
        deflections and their rates element by element, body rates, and excess forces.  A
        perturbation changes what was read, or adds forces.
        """
        passes = []
        order: list[int] = []
        for sets, model in self._models(z, run, self.space.recordings[run], nudge):
            found = kalman.filter_pass(*model)
            states = found.states
            if model[-1] is None:
                forces = np.zeros((*states.shape[:2], len(self.space.car.elements)))
                states = np.concatenate([states, forces], axis=2)
            passes.append((found.innovations, found.log_variances, states))
            order += sets
        if len(passes) == 1:
            return passes[0]
        back = np.argsort(order)
        innovations, log_variances, states = (
            np.concatenate(parts)[back] for parts in zip(*passes, strict=True)
        )
        return innovations, log_variances, states

    def as_declared(
        self, z: Array, run: int, recording: PreparedRecording | None = None
    ) -> NominalReadings:
        """Return what sensors as declared would have read in a run, at coordinates (D,).

        With ``recording``, from its readings in place of the run's own.
        """
        recording = self.space.recordings[run] if recording is None else recording
        if not self.sensor_corrections:
            return NominalReadings(recording.moments, recording.reading, np.zeros((0, 0)))
        nominal = self.sensor_corrections[run].corrected(
            recording, self.space.effects(z), self.space.input_biases(z[None], run)[0]
        )
        return self._with_known_changes(nominal, run)

    def _with_known_changes(self, nominal: NominalReadings, run: int) -> NominalReadings:
        """Add what is known to change the readings of a run."""
        if not self.perturbations:
            return nominal
        known = self.perturbations[run]
        return nominal._replace(
            moments=nominal.moments + known.moments, reading=nominal.reading + known.reading
        )

    def known_force(self, run: int) -> Array:
        """Known forces (E, ne) on the body at the suspension elements in one run, N."""
        if self.perturbations:
            return self.perturbations[run].force
        return np.zeros((len(self.space.recordings[run].step), len(self.space.car.elements)))


def _used(
    weights: Array, recordings: Sequence[PreparedRecording]
) -> Iterator[tuple[Array, PreparedRecording]]:
    """Pair recordings with their weights (W,), but those that have none."""
    return ((w, recording) for w, recording in zip(weights.T, recordings, strict=True) if np.any(w))


def _derivatives(values: Array, count: int) -> tuple[Array, Array]:
    """Slopes (P, K) and negative curvatures (P, K, K) by errors, from values (M, P)."""
    middle, ahead, behind = values[0], values[1 : count + 1], values[count + 1 : 2 * count + 1]
    curvatures = np.zeros((len(middle), count, count))
    both = iter(values[2 * count + 1 :])
    for i in range(count):
        curvatures[:, i, i] = 2.0 * middle - ahead[i] - behind[i]
        for j in range(i):
            mixed = next(both) - ahead[i] - ahead[j] + middle
            curvatures[:, i, j] = curvatures[:, j, i] = -mixed
    return 0.5 * (ahead - behind).T, curvatures


@contextmanager
def shared_work(posterior: Posterior) -> Iterator[Posterior]:
    """Give a posterior threads for as long as the context lasts, and BLAS none beside its own.

    A thread of BLAS waits for its next small product by spinning, on a core that a filter could
    use.
    """
    with threads() as pool, _BLAS.alone():
        yield replace(posterior, pool=pool)


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
