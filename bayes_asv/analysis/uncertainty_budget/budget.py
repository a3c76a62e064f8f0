"""The error budget of an answer, by linear algebra alone.

With P the precision of what was given and F the information of the data, the posterior's
covariance is Σ = (P + F)⁻¹, and an answer is gᵀθ.  Its variance gᵀΣg is a sum of independent
errors: that of a value given with deviation s contributes (gᵀΣe)²/s², the data gᵀΣFΣg, because
Σ(P + F)Σ = Σ.  These shares add up to one, whatever the order; and a source's share is by how
many percent the variance falls when the source's variance falls by one percent (Euler's
theorem for homogeneous functions).  It is the uncertainty budget of the GUM (JCGM 100:2008,
section 5) for a least-squares answer.  Shares are no forecast of what a *much* better value
would do: for that the covariance is computed again.

A covariance of the innovations is linear in the variances of its noises, and their derivatives
by the car depend on those only through the filter's gain.  So the information that a recording
*would* hold with a better sensor follows from the recording as it is.
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


_STEP = 1e-5  # relative: one-sided differences are good to about as much


def _terms(car: CarModel) -> tuple[str, ...]:
    """Independent unknowns of a car, in the order of its parameters."""
    return tuple(dict.fromkeys(term[0] for p in car.parameters for term in p.terms))


def _fractions(car: CarModel) -> tuple[str, ...]:
    return tuple(p.name for p in car.parameters if p.kind == "fraction")


def parameters(posterior: Posterior) -> tuple[str, ...]:
    """Names of what an answer may depend on: unknowns of the car, and gains that are uncertain."""
    gains = (c.name for c in posterior.space.coordinates if c.kind == "gain")
    return (*_terms(posterior.space.car), *gains)


def in_logs(posterior: Posterior, z: Array) -> tuple[Posterior, Array]:
    """Return the same posterior with relative changes of the car's unknowns for coordinates.

    Parameters
    ----------
    posterior : Posterior
        In whitened coordinates, where a value given as exact has none.
    z : (D,) array
        Where the changes are to be zero.

    Returns
    -------
    posterior : Posterior
        Its first coordinates are changes of the logarithms of the car's unknowns, then relative
        changes of its fractions, then logarithms of gains; the others are as they were.  Its prior
        means nothing.
    z : (D',) array
        The same point there.
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
    turned = CarPrior(
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
    moved_space = replace(space, coordinates=tuple(coordinates), prior=turned)
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
    found = posterior.innovations(points, run).reshape(count + 1, -1)
    return np.asarray((found[1:] - found[0]).T / _STEP)


def moved(posterior: Posterior, z: Array, away: Array) -> Array:
    """Move a point of :func:`in_logs` by relative changes (P,) of :func:`parameters`."""
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
    """Relative prior standard deviation (P,) of each parameter, zero where it is exact.

    Parameters
    ----------
    posterior, z : Posterior, (D,) array
        In whitened coordinates, at the mode.
    """
    space = posterior.space
    sd = {term[0]: term[2] for p in space.car.parameters for term in p.terms}
    values = space.values(z[None])
    for name in _fractions(space.car):
        sd[name] /= float(values[name][0])
    sd |= {c.name: c.scale for c in space.coordinates if c.kind == "gain"}
    return np.array([sd[name] for name in parameters(posterior)])


def answer_slopes(posterior: Posterior) -> dict[str, Array]:
    """Return derivatives (P,) of the logarithm of each answer by those of :func:`parameters`."""
    car = posterior.space.car
    known = parameters(posterior)
    by_name = {p.name: p for p in car.parameters}
    answers = {name: {name: 1.0} for name in car.estimated} | dict(car.ratios)
    out = {}
    for answer, parts in answers.items():
        g = np.zeros(len(known))
        for name, weight in parts.items():
            for term, coefficient, _ in by_name[name].terms:
                g[known.index(term)] += weight * coefficient
        out[answer] = g
    return out


Flags = NDArray[np.bool_]
Scaled = Callable[[Posterior, Array, float], tuple[Posterior, Array]]


@dataclass(frozen=True)
class Source:
    """One noise of every run.

    Parameters
    ----------
    name : str
        ``noise <channel>``, ``steps <channel>``, ``between samples`` or ``start``.
    better : float or None
        Factor on its variance for the question what a better one would give; None where
        nobody can better it.
    scaled : callable
        From a posterior, coordinates and a factor to the same with that variance multiplied.
    """

    name: str
    better: float | None
    scaled: Scaled


def sources(posterior: Posterior) -> list[Source]:
    """List every noise that a posterior knows of.

    Parameters
    ----------
    posterior : Posterior
        In any coordinates.

    Returns
    -------
    list of Source
        Multiplying all of them by one factor divides the information by it.
    """
    recordings = posterior.space.recordings
    found = []
    names = list(
        dict.fromkeys(channel.name for recording in recordings for channel in recording.channels)
    )
    for name in names:
        levels = [
            c.name for c in posterior.space.coordinates if c.kind == "noise" and c.channel == name
        ]
        if not levels:
            continue  # with white residuals an input has no noise
        found.append(Source(f"noise {name}", 0.25, _noise(levels)))
        if any(
            recording.quantization_steps[c] > 0.0
            for recording in recordings
            for c in _numbers(recording, name)
        ):
            found.append(Source(f"steps {name}", 0.0, _lines(_steps(name))))
    if any(
        np.any(recording.process_noise[:, len(recording.wheels) :] > 0.0)
        for recording in recordings
    ):
        found.append(Source("between samples", 0.0, _lines(_between)))
    found.append(Source("start", None, _lines(_start)))
    return found


def _noise(names: list[str]) -> Scaled:
    def scaled(posterior: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        out = z.copy()
        for name in names:
            k = posterior.space.index[name]
            out[k] += 0.5 * math.log(factor) / posterior.space.coordinates[k].scale
        return posterior, out

    return scaled


def _lines(change: Callable[[PreparedRecording, float], PreparedRecording]) -> Scaled:
    def scaled(posterior: Posterior, z: Array, factor: float) -> tuple[Posterior, Array]:
        recordings = tuple(change(recording, factor) for recording in posterior.space.recordings)
        return replace(posterior, space=replace(posterior.space, recordings=recordings)), z

    return scaled


def _numbers(recording: PreparedRecording, name: str) -> list[int]:
    return [c for c, channel in enumerate(recording.channels) if channel.name == name]


def _steps(name: str) -> Callable[[PreparedRecording, float], PreparedRecording]:
    def change(recording: PreparedRecording, factor: float) -> PreparedRecording:
        steps = recording.quantization_steps.copy()
        steps[_numbers(recording, name)] *= math.sqrt(factor)
        return replace(recording, quantization_steps=steps)

    return change


def _between(recording: PreparedRecording, factor: float) -> PreparedRecording:
    spread = recording.process_noise.copy()
    spread[:, len(recording.wheels) :] *= factor
    return replace(recording, process_noise=spread)


def _start(recording: PreparedRecording, factor: float) -> PreparedRecording:
    return replace(recording, initial_covariance=factor * recording.initial_covariance)


def lost_readings(recording: PreparedRecording) -> Flags:
    """Find output readings that were clipped, or missing beside one that was there.

    Parameters
    ----------
    recording : PreparedRecording
        One recording.

    Returns
    -------
    (E, ny) bool array
        By instant and output.  Rows that are missing as a whole are not counted.
    """
    lost: Flags = (recording.kind != MISSING) & (recording.kind != VALUE)
    for y in range(recording.group_instants.shape[1]):
        beside = recording.group_instants[recording.group_instants[:, y] < 0].max(axis=1)
        lost[beside, y] = True
    return lost


def impute_lost_readings(posterior: Posterior, z: Array) -> Posterior:
    """Return the posterior with every lost chassis reading read as the car would have moved.

    Parameters
    ----------
    posterior, z : Posterior, (D,) array
        In any coordinates, at the mode.

    Returns
    -------
    Posterior
        Only its information means anything: the new readings are simulated.
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
