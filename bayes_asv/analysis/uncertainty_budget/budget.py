"""Linear algebra of the uncertainty budget of a parameter of interest.

With P the prior precision and F the information of the data, the posterior covariance is
Σ = (P + F)⁻¹, and a parameter of interest is gᵀθ.  Its variance gᵀΣg is a sum of independent
errors: a value given with standard deviation s contributes (gᵀΣe)²/s², and the data gᵀΣFΣg, because
Σ(P + F)Σ = Σ.  These shares add up to one in any order; and the share of a source is the percentage
by which the variance falls if the variance of that source falls by one per cent (Euler's theorem
for homogeneous functions).  It is the uncertainty budget of the GUM (JCGM 100:2008, section 5) for
a least-squares estimate.  Shares do not predict the effect of a *much* better value: for that, the
covariance is computed again.

The covariance of the innovations is linear in the variances of its noises, and the derivatives of
innovations by the car depend on these only through the filter gain.  Thus the information that a
recording *would* contain with a better sensor can be computed from the recording itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.kalman import MISSING, VALUE
from bayes_asv.models.car_model import CarModel
from bayes_asv.posterior.car_prior import CarPrior
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.parameters import Coordinate
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "Budget",
    "Remedy",
    "Source",
    "answer_slopes",
    "impute_lost_readings",
    "in_logs",
    "information",
    "jacobian",
    "lost_readings",
    "moved",
    "parameters",
    "prior_sd",
    "sources",
]

Array = NDArray[np.float64]

_ENDLESS = 1e12  # factor on information that makes a value practically exact
_WANTED = 0.25  # wanted variance, relative to the present one: half the standard deviation
_CLOSE = 1e-4  # tolerance of the bisection, in the logarithm of the factor
_ROUNDING = 1e-13  # eigenvalue below which it is rounding error, relative to the largest one


@dataclass(frozen=True)
class Remedy:
    """An improvement that halves a standard deviation.

    Parameters
    ----------
    sources : tuple of int
        Indices of parameters that have to be known better; −1 for more data.
    times : float
        Factor on the information of each; standard deviations fall by its square root.
    """

    sources: tuple[int, ...]
    times: float


@dataclass(frozen=True)
class Budget:
    """Prior and information of D parameters.

    Parameters
    ----------
    sd : (D,) array
        Prior standard deviations; zero for exact parameters.
    information : (D, D) array
        Information of the data, F.
    """

    sd: Array
    information: Array

    def covariance(self, times: dict[int, float] | None = None, data: float = 1.0) -> Array:
        """Posterior covariance (D, D), with zeros for exact parameters.

        Parameters
        ----------
        times : dict of int to float, optional
            Factors on the prior information of parameters, by index.
        data : float
            Factor on the information of the data.
        """
        free = self.sd > 0.0
        precision = self.sd[free] ** -2.0
        for k, factor in (times or {}).items():
            if free[k]:
                precision[np.count_nonzero(free[:k])] *= factor
        # scaled by the prior standard deviations, for numerical accuracy
        root = precision**-0.5
        scaled = root[:, None] * self.information[np.ix_(free, free)] * root
        strength, directions = np.linalg.eigh(scaled)
        # remove rounding errors in directions without information, which must not be multiplied
        strength[strength < _ROUNDING * strength[-1]] = 0.0
        inverse = (directions / (1.0 + data * strength)) @ directions.T
        out = np.zeros((len(self.sd), len(self.sd)))
        out[np.ix_(free, free)] = root[:, None] * inverse * root
        return out

    def variance(
        self, answer: Array, times: dict[int, float] | None = None, data: float = 1.0
    ) -> float:
        """Variance of a parameter of interest gᵀθ; arguments as for :meth:`covariance`."""
        return float(answer @ self.covariance(times, data) @ answer)

    def shares(self, answer: Array) -> tuple[Array, float]:
        """Shares of the priors (D,) and of the data in the variance of gᵀθ."""
        covariance = self.covariance()
        toward = covariance @ answer
        whole = float(answer @ toward)
        free = self.sd > 0.0
        out = np.zeros(len(self.sd))
        out[free] = (toward[free] / self.sd[free]) ** 2 / whole
        return out, float(toward @ self.information @ toward) / whole

    def elasticity(self, answer: Array, slope: Array) -> float:
        """Share of one noise in the variance of gᵀθ.

        Parameters
        ----------
        answer : (D,) array
            Gradient of the parameter of interest, g.
        slope : (D, D) array
            Derivative of F by the logarithm of the noise variance.
        """
        toward = self.covariance() @ answer
        return float(-(toward @ slope @ toward) / (answer @ toward))

    def halving(self, answer: Array, sources: Sequence[int]) -> list[Remedy]:
        """Find improvements that halve the standard deviation of gᵀθ, the smallest factor first.

        Parameters
        ----------
        answer : (D,) array
            Gradient of the parameter of interest, g.
        sources : sequence of int
            Indices of parameters that can be improved; −1 for more data.

        Returns
        -------
        list of Remedy
            Every single source that is sufficient; if none is, every pair, and so on.  Empty if all
            of them together are not sufficient.
        """
        wanted = _WANTED * self.variance(answer)
        for size in range(1, len(sources) + 1):
            remedies = [
                Remedy(group, self._times(answer, group, wanted))
                for group in combinations(sources, size)
                if self._improved(answer, group, _ENDLESS) < wanted
            ]
            if remedies:
                return sorted(remedies, key=lambda remedy: remedy.times)
        return []

    def _improved(self, answer: Array, group: Sequence[int], factor: float) -> float:
        data_factor = factor if -1 in group else 1.0
        return self.variance(answer, {k: factor for k in group if k >= 0}, data_factor)

    def _times(self, answer: Array, group: Sequence[int], wanted: float) -> float:
        """Find the factor by bisection; the variance decreases monotonically with it."""
        low, high = 0.0, float(np.log(_ENDLESS))
        while high - low > _CLOSE:
            middle = 0.5 * (low + high)
            if self._improved(answer, group, float(np.exp(middle))) > wanted:
                low = middle
            else:
                high = middle
        return float(np.exp(high))


_STEP = 1e-5  # relative step of one-sided differences, and about their relative error


def _terms(car: CarModel) -> tuple[str, ...]:
    """Independent unknowns of a car, in the order of its parameters."""
    return tuple(dict.fromkeys(term[0] for p in car.parameters for term in p.terms))


def _fractions(car: CarModel) -> tuple[str, ...]:
    return tuple(p.name for p in car.parameters if p.kind == "fraction")


def parameters(posterior: Posterior) -> tuple[str, ...]:
    """Names of the parameters: unknowns of the car, and uncertain gains."""
    gains = (c.name for c in posterior.space.coordinates if c.kind == "gain")
    return (*_terms(posterior.space.car), *gains)


def in_logs(posterior: Posterior, z: Array) -> tuple[Posterior, Array]:
    """Change the coordinates of a posterior to relative changes of the car's unknowns.

    Parameters
    ----------
    posterior : Posterior
        Posterior in whitened coordinates, which exclude exact values.
    z : (D,) array
        Point at which the changes are zero.

    Returns
    -------
    posterior : Posterior
        Its first coordinates are changes of the logarithms of the car's unknowns, then relative
        changes of its fractions, then logarithms of gains; the others are unchanged.  Its prior is
        not meaningful.
    z : (D',) array
        The same point in these coordinates.
    """
    space = posterior.space
    car, prior = space.car, space.prior
    values = {name: float(x[0]) for name, x in space.values(z[None]).items()}
    fractions = _fractions(car)
    terms = [name for name in _terms(car) if name not in fractions]
    root = np.zeros((len(prior.log_parameters), len(terms)))
    by_name = {p.name: p for p in car.parameters}
    for a, name in enumerate(prior.log_parameters):
        for term, coefficient, _ in by_name[name].terms:
            root[a, terms.index(term)] += coefficient
    log_prior = CarPrior(
        car, prior.log_parameters, np.log([values[name] for name in prior.log_parameters]), root,
        np.eye(len(terms)), np.zeros((len(terms), 0)),
    )  # fmt: skip
    coordinates = [Coordinate("car", f"car-{k}") for k in range(len(terms))]
    coordinates += [Coordinate("fraction", n, values[n], values[n]) for n in fractions]
    start = [0.0] * len(coordinates)
    for k, one in enumerate(space.coordinates):
        if one.kind in ("car", "fraction"):
            continue
        gain = one.kind == "gain"
        coordinates.append(replace(one, scale=1.0) if gain else one)
        start.append(float(z[k]) * (one.scale if gain else 1.0))
    moved_space = replace(space, coordinates=tuple(coordinates), prior=log_prior)
    return replace(posterior, space=moved_space), np.array(start)


def jacobian(posterior: Posterior, z: Array, run: int) -> Array:
    """Relative derivatives of one run's normalised innovations.

    Parameters
    ----------
    posterior, z : Posterior, (D,) array
        From :func:`in_logs`.
    run : int
        Which run.

    Returns
    -------
    (ny E, P) array
        ∂ν/∂log θ in the order of :func:`parameters`.
    """
    count = len(parameters(posterior))
    points = np.stack([z, *(moved(posterior, z, away) for away in _STEP * np.eye(count))])
    innovations = posterior.innovations(points, run).reshape(count + 1, -1)
    return np.asarray((innovations[1:] - innovations[0]).T / _STEP)


def moved(posterior: Posterior, z: Array, away: Array) -> Array:
    """Shift a point of :func:`in_logs` by relative changes (P,) of :func:`parameters`."""
    car = posterior.space.car
    fractions = _fractions(car)
    terms = [name for name in _terms(car) if name not in fractions]
    order = (*terms, *fractions, *parameters(posterior)[len(_terms(car)) :])
    out = z.copy()
    for name, change in zip(parameters(posterior), away, strict=True):
        out[order.index(name)] += change
    return out


def information(slopes: Sequence[Array]) -> Array:
    """Information (P, P) of all runs from their Jacobians."""
    return np.asarray(np.sum([j.T @ j for j in slopes], axis=0))


def prior_sd(posterior: Posterior, z: Array) -> Array:
    """Relative prior standard deviation (P,) of each parameter; zero if it is exact.

    Parameters
    ----------
    posterior, z : Posterior, (D,) array
        Posterior in whitened coordinates, and its mode.
    """
    space = posterior.space
    sd = {term[0]: term[2] for p in space.car.parameters for term in p.terms}
    values = space.values(z[None])
    for name in _fractions(space.car):
        sd[name] /= float(values[name][0])
    sd |= {c.name: c.scale for c in space.coordinates if c.kind == "gain"}
    return np.array([sd[name] for name in parameters(posterior)])


def answer_slopes(posterior: Posterior) -> dict[str, Array]:
    """Differentiate the logarithms of parameters of interest by :func:`parameters`' (P,)."""
    car = posterior.space.car
    names = parameters(posterior)
    by_name = {p.name: p for p in car.parameters}
    estimands = {name: {name: 1.0} for name in car.estimated} | dict(car.ratios)
    out = {}
    for estimand, parts in estimands.items():
        g = np.zeros(len(names))
        for name, weight in parts.items():
            for term, coefficient, _ in by_name[name].terms:
                g[names.index(term)] += weight * coefficient
        out[estimand] = g
    return out


Flags = NDArray[np.bool_]
Scaled = Callable[[Posterior, Array, float], tuple[Posterior, Array]]


@dataclass(frozen=True)
class Source:
    """One source of noise in all runs.

    Parameters
    ----------
    name : str
        ``noise <channel>``, ``steps <channel>``, ``between samples`` or ``start``.
    better : float or None
        Factor on its variance that represents an improvement; None if it cannot be improved.
    scaled : callable
        Function of posterior, coordinates and a factor that multiplies the variance by it.
    """

    name: str
    better: float | None
    scaled: Scaled


def sources(posterior: Posterior) -> list[Source]:
    """List all sources of noise of a posterior.

    Parameters
    ----------
    posterior : Posterior
        Posterior in any coordinates.

    Returns
    -------
    list of Source
        Multiplying all of them by one factor divides the information by it.
    """
    recordings = posterior.space.recordings
    noise_sources = []
    names = list(
        dict.fromkeys(channel.name for recording in recordings for channel in recording.channels)
    )
    for name in names:
        levels = [
            c.name for c in posterior.space.coordinates if c.kind == "noise" and c.channel == name
        ]
        if not levels:
            continue  # inputs without noise
        noise_sources.append(Source(f"noise {name}", 0.25, _scale_noise(levels)))
        if any(
            recording.quantization_steps[c] > 0.0
            for recording in recordings
            for c in _channel_indices(recording, name)
        ):
            noise_sources.append(
                Source(f"steps {name}", 0.0, _scale_recordings(_scale_steps(name)))
            )
    if any(
        np.any(recording.process_noise[:, len(recording.wheels) :] > 0.0)
        for recording in recordings
    ):
        noise_sources.append(
            Source("between samples", 0.0, _scale_recordings(_scale_interpolation_error))
        )
    noise_sources.append(Source("start", None, _scale_recordings(_scale_initial_covariance)))
    return noise_sources


def _scale_noise(names: list[str]) -> Scaled:
    def scaled(posterior: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        out = z.copy()
        for name in names:
            k = posterior.space.index[name]
            out[k] += 0.5 * math.log(factor) / posterior.space.coordinates[k].scale
        return posterior, out

    return scaled


def _scale_recordings(change: Callable[[PreparedRecording, float], PreparedRecording]) -> Scaled:
    def scaled(posterior: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        recordings = tuple(change(recording, factor) for recording in posterior.space.recordings)
        return replace(posterior, space=replace(posterior.space, recordings=recordings)), z

    return scaled


def _channel_indices(recording: PreparedRecording, name: str) -> list[int]:
    return [c for c, channel in enumerate(recording.channels) if channel.name == name]


def _scale_steps(name: str) -> Callable[[PreparedRecording, float], PreparedRecording]:
    def change(recording: PreparedRecording, factor: float) -> PreparedRecording:
        steps = recording.quantization_steps.copy()
        steps[_channel_indices(recording, name)] *= math.sqrt(factor)
        return replace(recording, quantization_steps=steps)

    return change


def _scale_interpolation_error(recording: PreparedRecording, factor: float) -> PreparedRecording:
    spread = recording.process_noise.copy()
    spread[:, len(recording.wheels) :] *= factor
    return replace(recording, process_noise=spread)


def _scale_initial_covariance(recording: PreparedRecording, factor: float) -> PreparedRecording:
    return replace(recording, initial_covariance=factor * recording.initial_covariance)


def lost_readings(recording: PreparedRecording) -> Flags:
    """Find output readings that were clipped, or missing while another output was read.

    Parameters
    ----------
    recording : PreparedRecording
        One recording.

    Returns
    -------
    (E, ny) bool array
        Lost readings by instant and output.  Completely missing rows are not included.
    """
    lost: Flags = (recording.kind != MISSING) & (recording.kind != VALUE)
    for y in range(recording.group_instants.shape[1]):
        with_missing = recording.group_instants[recording.group_instants[:, y] < 0].max(axis=1)
        lost[with_missing, y] = True
    return lost


def impute_lost_readings(posterior: Posterior, z: Array) -> Posterior:
    """Replace every lost chassis reading by a simulated one.

    Parameters
    ----------
    posterior, z : Posterior, (D,) array
        Posterior in any coordinates, and its mode.

    Returns
    -------
    Posterior
        Only its information is meaningful, since the new readings are simulated.
    """
    recordings = []
    for run, recording in enumerate(posterior.space.recordings):
        lost = lost_readings(recording)
        output = free_run(posterior, z, run).output
        recordings.append(
            replace(
                recording,
                kind=np.where(lost, np.int8(VALUE), recording.kind),
                reading=np.where(lost, output, recording.reading),
            )
        )
    return replace(posterior, space=replace(posterior.space, recordings=tuple(recordings)))
