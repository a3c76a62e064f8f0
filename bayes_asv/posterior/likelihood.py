"""Posterior density over a parameter space, evaluated for many points at a time."""

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
from bayes_asv.filters.kalman import (
    MISSING,
    NO_LAWS,
    FilterPass,
    Laws,
    Measurements,
    SensorNoise,
    StateSpace,
)
from bayes_asv.filters.linearised_filter import LinearisedFilter
from bayes_asv.posterior.effects import NominalReadings, SensorCorrections, law_table
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.posterior.threads import Threads, threads
from bayes_asv.preprocessing.prepared_recording import (
    ClockVariants,
    PreparedRecording,
    interpolation_weights,
)
from bayes_asv.preprocessing.removed_band import log_determinant

__all__ = [
    "WHITE", "ClockExpansion", "Perturbation", "Posterior", "ResidualAR", "shared_work",
]  # fmt: skip

Array = NDArray[np.float64]

_FARTHEST = 4.0  # posterior standard deviations to which the clock expansion is clipped
# Bound on the logarithm of the factor on the clock expansion; far from the mode it is unknown.
_LARGEST_LOG = 3.0
_MANY = 8  # number of points from which a batch is divided between threads


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
    """Known change of one run: of its input moments and its outputs, and forces on the body.

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

    @classmethod
    def of_readings(cls, recording: PreparedRecording, change: Array) -> Perturbation:
        """Return a change of the outputs (E, ny) alone."""
        still = np.zeros((len(change), len(recording.car.elements)))
        return cls(np.zeros_like(recording.moments), change, still)

    @classmethod
    def of_forces(cls, recording: PreparedRecording, force: Array) -> Perturbation:
        """Return forces (E, ne) alone, N."""
        return cls(np.zeros_like(recording.moments), np.zeros_like(recording.reading), force)


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
        Threads between which batches are divided; results do not depend on it.
    sensor_corrections : tuple of SensorCorrections
        One a run if the space has effects; the innovations are then assumed to be white.
    retimed_corrections : tuple of tuple of SensorCorrections
        Sensor corrections of each run's clock variants.
    expansions : tuple of ClockExpansion or None
        One a run, used in place of its clock variants; empty to use the variants.
    perturbations : tuple of Perturbation
        One a run: known changes of readings, and known forces; empty if there are none.
    """

    space: ParameterSpace
    residual_ars: tuple[ResidualAR, ...]
    pool: Threads | None = None
    sensor_corrections: tuple[SensorCorrections, ...] = ()
    retimed_corrections: tuple[tuple[SensorCorrections, ...], ...] = ()
    expansions: tuple[ClockExpansion | None, ...] = ()
    perturbations: tuple[Perturbation, ...] = ()

    def with_residual_ar(self, colours: tuple[ResidualAR, ...]) -> Posterior:
        """Return a copy with other residual autoregressions."""
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
                    [
                        w * self._log_likelihood(z, run, x)
                        for w, x in _nonzero_weights(weights, recordings)
                    ],
                    axis=0,
                )
        return np.where(np.isfinite(value), value, -np.inf)

    def expanded(self, z: Array, covariance: Array) -> Posterior:
        """Expand the log-likelihood in the clock errors at the mode: one filter pass per point.

        Parameters
        ----------
        z, covariance : (D,) and (D, D) arrays
            Mode and covariance; derivatives are taken along the principal axes of the latter.
        """
        runs = range(len(self.residual_ars))
        return replace(self, expansions=tuple(self._expansion(z, covariance, r) for r in runs))

    def _expansion(self, z: Array, covariance: Array, run: int) -> ClockExpansion | None:
        recording = self.space.recordings[run]
        variants = recording.clock_variants
        if variants is None:
            return None
        clocks = self.space.clock_coordinates(run)
        others = [k for k in self.space.coordinates_of_run(run) if k not in clocks]
        variance, axes = np.linalg.eigh(covariance[np.ix_(others, others)])
        axes_of_others = np.zeros((len(z), len(others)))
        axes_of_others[others] = axes * np.sqrt(np.maximum(variance, 0.0))
        offsets = np.vstack([np.zeros(len(others)), ClockVariants.points(len(others))])
        values = np.stack(
            [
                self._log_likelihood(z + offsets @ axes_of_others.T, run, x)
                for x in (recording, *variants.recordings)
            ]
        )
        slopes, curvatures = _derivatives(values, len(clocks))
        size = np.trace(np.linalg.solve(curvatures[0], curvatures), axis1=1, axis2=2)
        logs = np.log(np.maximum(size / len(clocks), np.exp(-_LARGEST_LOG)))
        growth = 0.5 * (logs[1 : len(others) + 1] - logs[len(others) + 1 : 2 * len(others) + 1])
        scale = np.exp(offsets @ growth)
        return ClockExpansion(
            z, np.asarray(np.linalg.pinv(axes_of_others), np.float64), growth,
            slopes / scale[:, None], curvatures / scale[:, None, None],
        )  # fmt: skip

    def _log_likelihood(self, z: Array, run: int, recording: PreparedRecording) -> Array:
        """Log-likelihood (W,) of one run, as prepared with given clock errors."""
        residual_ar = self.residual_ars[run]
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        if residual_ar.order > 0:
            value = kalman_ar.log_likelihood(
                system, noise, recording.measurements, recording.ends_group, *residual_ar
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
        self, z: Array, run: int, recording: PreparedRecording
    ) -> Iterator[tuple[list[int], tuple[StateSpace, SensorNoise, Measurements, Laws | None]]]:
        """Group points (W, D) by nominal readings; yield each group with its filter arguments."""
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        values = [self.space.effects(point) for point in z]
        tables = np.stack([law_table(self.space.car, v, run) for v in values])
        known = self._sensor_corrections(run, recording) if self.sensor_corrections else None
        if known is not None:
            biases = self.space.input_biases(z, run)
            on_outputs = biases @ recording.rigid_gain.T
            system = system._replace(biases=np.hstack([biases, on_outputs]))
        no_zeros = np.zeros(len(recording.inputs))  # the filter subtracts input biases
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
                    *self._measurements_and_laws(recording, run, nominal, tables[sets]),
                ),
            )

    def _sensor_corrections(self, run: int, recording: PreparedRecording) -> SensorCorrections:
        """Sensor corrections of a run, as prepared with given clock errors."""
        variants = self.space.recordings[run].clock_variants
        if variants is None or recording not in variants.recordings:
            return self.sensor_corrections[run]
        return self.retimed_corrections[run][variants.recordings.index(recording)]

    def _measurements_and_laws(
        self,
        recording: PreparedRecording,
        run: int,
        nominal: NominalReadings,
        tables: Array,
    ) -> tuple[Measurements, Laws | None]:
        """Measurements from nominal readings, and force laws; None if no force acts."""
        moments, reading, _ = self._with_known_changes(nominal, run)
        added = self.known_force(run)
        data = recording.measurements._replace(moments=moments, reading=reading)
        if tables.shape[1] == 0 and not np.any(added):
            return data, None
        pole = self.sensor_corrections[run].pole
        return data, Laws(tables, pole, nominal.wheel, recording.elapsed, added)

    def removed_band_correction(self, z: Array, run: int) -> Array:
        """½ log det (W,) of the bands removed from a run, at coordinates (W, D)."""
        removed_band = self.space.recordings[run].removed_band
        if removed_band is None:
            return np.zeros(len(z))
        return log_determinant(removed_band, self.space.noises(z, run))

    def by_run(self, z: Array, runs: Sequence[int] | None = None) -> Array:
        """Log-likelihood (R, W) of some runs, by default all, at coordinates (W, D).

        Large batches are divided between the threads of the pool.  Do not call this from a thread
        of the pool: it would wait for itself.
        """
        runs = range(len(self.residual_ars)) if runs is None else runs
        pieces = np.array_split(z, self.pool.count) if len(z) >= _MANY and self.pool else [z]
        work = self.pool.map if self.pool else map
        shares = [(piece, run) for run in runs for piece in pieces]
        values = list(work(lambda share: self.run_log_likelihood(*share), shares))
        return np.concatenate(values).reshape(len(runs), len(z))

    def log_likelihood(self, z: Array) -> Array:
        """Log-likelihood (W,) of all runs at coordinates (W, D); threads as :meth:`by_run`."""
        return np.asarray(self.by_run(z).sum(axis=0))

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,), not normalised, at coordinates (W, D); threads as :meth:`by_run`."""
        value = self.space.log_prior(z)
        ok = np.isfinite(value)
        if np.any(ok):
            value[ok] += self.log_likelihood(z[ok])
        return value

    def innovations(self, z: Array, run: int, colour: ResidualAR | None = None) -> Array:
        """Normalised innovations of one run, white if the model is complete.

        (E, ny) at coordinates (D,), (W, E, ny) at coordinates (W, D).  Up to
        :data:`bayes_asv.filters.vector_code.LANES` points take little longer than one.
        """
        points = np.atleast_2d(z)
        out = self._innovations(points, run, self.residual_ars[run] if colour is None else colour)
        return out[0] if z.ndim == 1 else out

    def _innovations(self, z: Array, run: int, residual_ar: ResidualAR) -> Array:
        """Normalised innovations (W, E, ny) of one run at coordinates (W, D)."""
        if self.space.placed_effects or self.perturbations:
            return self.filter_passes(z, run)[0]
        recording = self.space.recordings[run]
        variants = recording.clock_variants
        if variants is None:
            return self._innovations_of_recording(z, run, recording, residual_ar)
        weights = variants.weights(self.space.clock_errors(z, run))
        out = np.zeros((len(z), *recording.reading.shape))
        for weight, one in _nonzero_weights(weights, (recording, *variants.recordings)):
            nu = self._innovations_of_recording(z, run, one, residual_ar)
            for y in range(nu.shape[2]):  # the same readings, stamped at other instants
                has_reading, variant_has_reading = (
                    recording.kind[:, y] != MISSING,
                    one.kind[:, y] != MISSING,
                )
                out[:, has_reading, y] += weight[:, None] * nu[:, variant_has_reading, y]
        return out

    def _innovations_of_recording(
        self, z: Array, run: int, recording: PreparedRecording, residual_ar: ResidualAR
    ) -> Array:
        """Normalised innovations (W, E, ny) of a run, as prepared with given clock errors."""
        system, noise = self.space.state_space(z, run), self.space.noises(z, run)
        if residual_ar.order == 0:
            return kalman.filter_pass(system, noise, recording.measurements).innovations
        return kalman_ar.innovations(
            system, noise, recording.measurements, recording.ends_group, *residual_ar
        )

    def innovations_and_variances(self, z: Array, run: int) -> tuple[Array, Array, Array]:
        """Innovations (E, ny), their log variances (E, ny) and states (E, nx + ne) of one run.

        As :meth:`filter_passes`, for one point (D,).
        """
        innovations, log_variances, states = self.filter_passes(z[None], run)
        return innovations[0], log_variances[0], states[0]

    def filter_passes(self, z: Array, run: int) -> tuple[Array, Array, Array]:
        """Innovations (W, E, ny), their log variances (W, E, ny) and states of one run.

        Evaluated at coordinates (W, D); zero where there is no reading.  The states
        (W, E, nx + ne) are deflections and their rates element by element, body rates, and excess
        forces.
        """
        passes = []
        order: list[int] = []
        for sets, model in self._models(z, run, self.space.recordings[run]):
            filtered = kalman.filter_pass(*model)
            states = filtered.states
            if model[-1] is None:
                forces = np.zeros((*states.shape[:2], len(self.space.car.elements)))
                states = np.concatenate([states, forces], axis=2)
            passes.append((filtered.innovations, filtered.log_variances, states))
            order += sets
        if len(passes) == 1:
            return passes[0]
        back = np.argsort(order)
        innovations, log_variances, states = (
            np.concatenate(parts)[back] for parts in zip(*passes, strict=True)
        )
        return innovations, log_variances, states

    def linearised_filter(self, z: Array, run: int) -> tuple[FilterPass, LinearisedFilter]:
        """Filter one run at coordinates (D,), and linearise the filter along its path."""
        recording = self.space.recordings[run]
        ((_, (system, noise, data, laws)),) = self._models(z[None], run, recording)
        if laws is None:
            laws = NO_LAWS._replace(
                pole=self.sensor_corrections[run].pole,
                elapsed=recording.elapsed,
                added=self.known_force(run),
            )
        return kalman.linearise(system, noise, data, laws)

    def as_declared(
        self, z: Array, run: int, recording: PreparedRecording | None = None
    ) -> NominalReadings:
        """Return a run's readings, corrected for sensor effects and biases at coordinates (D,).

        ``recording`` replaces the run's own recording.
        """
        recording = self.space.recordings[run] if recording is None else recording
        if not self.sensor_corrections:
            return NominalReadings(recording.moments, recording.reading, np.zeros((0, 0)))
        nominal = self.sensor_corrections[run].corrected(
            recording, self.space.effects(z), self.space.input_biases(z[None], run)[0]
        )
        return self._with_known_changes(nominal, run)

    def _with_known_changes(self, nominal: NominalReadings, run: int) -> NominalReadings:
        """Add the known changes of a run's readings."""
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


def _nonzero_weights(
    weights: Array, recordings: Sequence[PreparedRecording]
) -> Iterator[tuple[Array, PreparedRecording]]:
    """Pair recordings with their weights (W,); skip zero weights."""
    return ((w, recording) for w, recording in zip(weights.T, recordings, strict=True) if np.any(w))


def _derivatives(values: Array, count: int) -> tuple[Array, Array]:
    """Slopes (P, K) and negative curvatures (P, K, K) by clock errors, from values (M, P)."""
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
    """Run a posterior with a thread pool, and BLAS with a single thread, inside the context.

    A BLAS thread that waits for its next small product spins on a core that a filter could use.
    """
    with threads() as pool, _BLAS.single_threaded():
        yield replace(posterior, pool=pool)


class _Blas:
    """Limit of BLAS to one thread, shared by all callers that ask for it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._callers = 0
        self._limit: Any = None

    @contextmanager
    def single_threaded(self) -> Iterator[None]:
        """Limit BLAS to one thread; the last caller to leave restores the previous limits."""
        with self._lock:
            self._callers += 1
            if self._callers == 1:
                self._limit = _libraries().limit(limits=1, user_api="blas")
        try:
            yield
        finally:
            with self._lock:
                self._callers -= 1
                if self._callers == 0:
                    self._limit.restore_original_limits()


_BLAS = _Blas()


@lru_cache(maxsize=1)
def _libraries() -> ThreadpoolController:
    """Find the libraries that have thread pools of their own; cached, since it takes 1 ms."""
    return ThreadpoolController()
