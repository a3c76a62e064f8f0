"""Score tests: whether the innovations support a candidate effect, or any effect at all.

The sensitivity g_j (N,) of a candidate is the change of the predictions by its values, in standard
deviations of the innovations ν, passed through the filter at fixed gain (:mod:`.denoised_model`).
Changes that the model can reproduce with its own coordinates are projected out in the metric of its
posterior.  With M the sensitivities along these coordinates, P their posterior precision and ∇ the
remaining gradient of the log-posterior,

    U_j = g_jᵀν − g_jᵀMᵀP⁻¹∇,    I_jk = g_jᵀg_k − g_jᵀMᵀP⁻¹M g_k,    s_j = U_j / √I_jj.

A given value with a small standard deviation therefore reproduces little.  Innovations are
martingale differences, and sensitivities depend on past ones only: under the model, s_j is standard
normal to first order.

Whether any effect is missing is tested with the largest squared score (max-score test).  It is
compared with its distribution under the model, drawn with the correlations of the scores (Westfall
& Young 1993).  A global χ² test of the residuals would detect only far larger effects than tests
along the directions of the candidates.

Candidates for an external force are steps that begin at some instant of one run and never end.  The
innovations are linear in a force, so a force pulse is the difference of two steps, and a pulse on
both axles is the mean of one on each.  Hundreds of steps form thousands of pairs; the p-value of
all of them is that of the largest squared score over all pairs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.denoised_model import DenoisedModel
from bayes_asv.diagnosis.thresholds import MIN_INFORMATION_SHARE
from bayes_asv.filters.force_laws import OUTSIDE
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.effects import AXLES
from bayes_asv.models.outputs import relative_offset
from bayes_asv.posterior.effect_fit import Candidate
from bayes_asv.posterior.effects import force_history
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, transfer_coordinates
from bayes_asv.posterior.likelihood import Perturbation, shared_work
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.quantization import spurious_drift

__all__ = [
    "NuisanceProjection",
    "ScoreTest",
    "family_p_value",
    "max_score_p_value",
    "nuisance_projection",
    "one_sided_squares",
    "pulse_p_value",
    "score_test",
    "standardized",
    "with_best_pulses",
]

Array = NDArray[np.float64]

_NO_INFORMATION = 1e-8  # information below which a score is set to zero


@dataclass(frozen=True)
class NuisanceProjection:
    """Directions that a model can reproduce, and the projection orthogonal to them, at its mode.

    Parameters
    ----------
    sensitivities : (G, N) array
        Changes of the predictions along the model's own coordinates and along tolerances, in
        standard deviations.
    precision : (G, G) array
        Posterior precision of these coordinates.
    gradient : (G,) array
        Gradient of the log-posterior along them.
    innovations : (N,) array
        Normalised innovations.
    """

    sensitivities: Array
    precision: Array
    gradient: Array
    innovations: Array

    def project_out(self, sensitivities: Array) -> tuple[Array, Array]:
        """Return gradient (K,) and information (K, K) along sensitivities (K, N).

        The remaining gradient at the mode is taken into account: the mode is found to within a few
        thousandths of a nat, which is not negligible for a sensitivity that the model can almost
        reproduce.
        """
        cross = self.sensitivities @ sensitivities.T
        solved = np.linalg.solve(self.precision, np.column_stack([self.gradient, cross]))
        gradient = sensitivities @ self.innovations - cross.T @ solved[:, 0]
        return gradient, sensitivities @ sensitivities.T - cross.T @ solved[:, 1:]


def nuisance_projection(
    derivatives: ScoreAndInformation, z: Array, tolerances: Array, offsets: Array | None = None
) -> NuisanceProjection:
    """Return the projection for changes that a model's coordinates and tolerances can reproduce.

    Parameters
    ----------
    derivatives : ScoreAndInformation
        The model's innovations and their derivatives along its coordinates, on denoised inputs.
    z : (D,) array
        Its mode.
    tolerances : (G, N) array
        Sensitivities along standard normal coordinates that the model does not contain.
    offsets : (G,) array, optional
        Values of these coordinates that the model's innovations include; zero by default.
    """
    sensitivities = np.concatenate([derivatives.means, tolerances])
    precision = sensitivities @ sensitivities.T + np.eye(len(sensitivities))
    own_count = len(derivatives.means)
    precision[:own_count, :own_count] = derivatives.precision()
    centre = np.zeros(len(tolerances)) if offsets is None else offsets
    along_tolerances = tolerances @ derivatives.nu - centre
    gradient = np.concatenate([derivatives.gradient(z), along_tolerances])
    return NuisanceProjection(sensitivities, precision, gradient, derivatives.nu)


@dataclass(frozen=True)
class ScoreTest:
    """Gradient and information along K candidates, from the N innovations of a model.

    Parameters
    ----------
    candidates : tuple of Candidate
        The candidates.
    sensitivities : (K, N) array
        Changes of the predictions by each of them, in standard deviations.
    gradient : (K,) array
        Gradient U of the log-likelihood, with nuisance directions projected out.
    information : (K, K) array
        Information I, with nuisance directions projected out.
    derivatives : ScoreAndInformation
        The innovations and their derivatives along the model's coordinates, on the same denoised
        inputs.
    quantization_drifts : (G, N) array
        Sensitivities along spurious drifts of coarse converters, with standard normal coordinates;
        these are nuisance directions as well.
    """

    candidates: tuple[Candidate, ...]
    sensitivities: Array
    gradient: Array
    information: Array
    derivatives: ScoreAndInformation
    quantization_drifts: Array

    @property
    def effect_count(self) -> int:
        """Number of effects, counted once for each place but not for each run."""
        return len({str(c.placed) for c in self.candidates})

    @property
    def standardized_scores(self) -> Array:
        """Scores s (K,), each standard normal if nothing is missing; 0 without information."""
        return standardized(self.gradient, np.diag(self.information))


def standardized(gradient: Array, information: Array) -> Array:
    """Standardise gradients (K,) by their own information (K,); 0 without information."""
    sd = np.sqrt(np.maximum(information, _NO_INFORMATION))
    return np.where(information > _NO_INFORMATION, gradient / sd, 0.0)


def score_test(denoised: DenoisedModel, candidates: list[Candidate]) -> ScoreTest:
    """Compute gradient and information along candidates at a model's mode."""
    model, dataset = denoised.model, denoised.dataset
    recordings = model.space.recordings
    z = model.mode.z

    def responses(candidate: Candidate, runs: list[int]) -> Iterator[Array]:
        placed, values = candidate.placed, candidate.values
        if placed.effect.code == OUTSIDE:  # motion does not change it: nothing to simulate
            for run in runs:
                force = force_history(recordings[run], {placed: values}, run)
                yield denoised.filters[run].response(Perturbation.of_forces(recordings[run], force))
            return
        posterior = dataset.posterior((*model.placed_effects, placed))
        extended = transfer_coordinates(model.space, z, posterior.space, placed, values)
        for run in runs:
            yield denoised.filters[run].sensitivity(posterior, extended)

    def sensitivity(candidate: Candidate) -> Array:
        runs = [run for run in range(len(recordings)) if candidate.placed.run in (None, run)]
        joined = denoised.concatenate(dict(zip(runs, responses(candidate, runs), strict=True)))
        # a candidate whose simulation diverges has no score
        return joined if np.all(np.isfinite(joined)) else np.zeros_like(joined)

    with shared_work(model.posterior) as shared:
        assert shared.pool is not None
        sensitivities = np.array(list(shared.pool.map(sensitivity, candidates)))
    sensitivities = sensitivities.reshape(len(candidates), -1)
    drifts = _quantization_drifts(dataset, model, candidates, sensitivities)
    projection = nuisance_projection(denoised.derivatives, z, drifts)
    gradient, information = projection.project_out(sensitivities)
    return ScoreTest(
        tuple(candidates), sensitivities, gradient, information, denoised.derivatives, drifts
    )


def _quantization_drifts(
    dataset: Dataset, model: FittedModel, candidates: list[Candidate], sensitivities: Array
) -> Array:
    """Sensitivities (G, N) along spurious offset drifts of coarse converters, run by run."""
    counts = [_reading_count(model, run) for run in range(len(dataset.recordings))]
    ends = np.cumsum(counts)
    out = []
    for k, candidate in enumerate(candidates):
        if candidate.placed.effect.fault != "drift":
            continue
        one = candidate.values[candidate.placed.effect.parameters[0].name]
        for recording, end, count in zip(dataset.recordings, ends, counts, strict=True):
            slope = _spurious_slope(recording, candidate.placed.where)
            if slope > 0.0:
                drift = np.zeros(sensitivities.shape[1])
                drift[end - count : end] = sensitivities[k, end - count : end] * slope / one
                out.append(drift)
    return np.array(out).reshape(len(out), sensitivities.shape[1])


def _spurious_slope(recording: PreparedRecording, name: str) -> float:
    """Slope of the spurious drift of a channel in a run, in units of the effect's.

    The drift of an input is equivalent to one of the accelerations that follow it; the latter
    represent both.
    """
    names = [channel.name for channel in recording.channels]
    if name not in names:
        return 0.0
    c = names.index(name)
    slope = spurious_drift(recording, c) / relative_offset(recording.channels[c].quantity)
    follows = np.round(recording.rigid_gain, 12)  # remove rounding errors of an inverse
    if c in recording.inputs:
        return 0.0 if np.any(follows[:, recording.inputs.index(c)]) else slope
    for gain, wheel in zip(follows[recording.outputs.index(c)], recording.inputs, strict=True):
        slope = float(np.hypot(slope, gain * spurious_drift(recording, wheel)))
    return slope


def _reading_count(model: FittedModel, run: int) -> int:
    recording = model.space.recordings[run]
    return int(np.count_nonzero(recording.kind == VALUE))


_DRAWS = 20_000  # draws of the max-score test
# Variance of a standardised score under the model: the measured innovations have up to 3 % more
# energy than the noise model predicts at 10 to 40 Hz, where force laws act (docs/method.md).
_SCORE_VARIANCE = 1.03
_PULSE_SHARE = 0.2  # share of the family-wise error that the pulses have
_PULSE_DRAWS = 2000  # largest number of draws of the test of pulses
_PULSE_BATCH = 100  # draws at a time
_EXCEEDANCES = 50  # number of draws above the observed score at which sequential drawing stops
_MIN_PULSE_P_VALUE = 1.0 / (1 + _PULSE_DRAWS)  # smallest value that pulse_p_value returns
_MIN_LENGTH = 2  # least duration of a pulse, in intervals between candidate steps
# Shares of the axles in a force, by place.
_AXLE_SHARES = {"front": (1.0, 0.0), "rear": (0.0, 1.0), "both": (0.5, 0.5)}


def one_sided_squares(scores: Array, test: ScoreTest) -> Array:
    """Squared scores (…, K); zero where a one-sided effect would have to be negative."""
    one_sided = np.array([c.one_sided for c in test.candidates])
    return np.where(one_sided & (scores < 0.0), 0.0, scores**2)


def family_p_value(test: ScoreTest, seed: int) -> float:
    """p-value of the largest squared score over all candidates.

    Pulses are a very large number of tests.  They have a fifth of the family-wise error to
    themselves (weighted Bonferroni), so that they do not reduce the power for other candidates.

    Parameters
    ----------
    test : ScoreTest
        Scores of all candidates, including force steps.
    seed : int
        Seed of the draws.
    """
    test = replace(test, gradient=test.gradient / math.sqrt(_SCORE_VARIANCE))
    other = np.flatnonzero([not c.is_step for c in test.candidates])
    one_sided = np.array([test.candidates[k].one_sided for k in other])
    raw = np.sum(test.sensitivities[other] ** 2, axis=1)
    information = test.information[np.ix_(other, other)]
    p, _ = max_score_p_value(test.gradient[other], information, raw, one_sided, seed)
    p_other = p / (1.0 - _PULSE_SHARE)
    if p_other <= _MIN_PULSE_P_VALUE / _PULSE_SHARE:  # no pulse can be more significant
        return p_other
    return min(p_other, pulse_p_value(test, seed) / _PULSE_SHARE, 1.0)


def max_score_p_value(
    gradient: Array,
    information: Array,
    raw_information: Array,
    one_sided: NDArray[np.bool_],
    seed: int,
) -> tuple[float, int]:
    """p-value of the largest squared score over K directions, and the index of its direction.

    Parameters
    ----------
    gradient : (K,) array
        Gradient of the log-likelihood along each direction.
    information : (K, K) array
        Its covariance under the model.
    raw_information : (K,) array
        Information before projection; directions that retain almost none of it are ignored.
    one_sided : (K,) bool array
        Whether only a positive score counts.
    seed : int
        Seed of the 20,000 draws.
    """
    own_information = np.diag(information)
    informative = own_information > MIN_INFORMATION_SHARE * np.maximum(raw_information, 1e-30)
    if not np.any(informative):
        return 1.0, 0
    sd = np.sqrt(own_information[informative])
    correlation = information[np.ix_(informative, informative)] / np.outer(sd, sd)
    eigenvalues, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    rng = np.random.default_rng([seed, 21])
    draws = rng.standard_normal((_DRAWS, len(root))) @ root.T
    largest = np.where(one_sided[informative] & (draws < 0.0), 0.0, draws**2).max(axis=1)
    scores = np.zeros(len(gradient))
    scores[informative] = gradient[informative] / sd
    squares = np.where(one_sided & (scores < 0.0), 0.0, scores**2)
    k = int(np.argmax(squares))
    p = (1 + np.count_nonzero(largest >= squares[k])) / (1 + _DRAWS)
    return float(p), k


@dataclass(frozen=True)
class _PulseScan:
    """All force pulses at one place of one run.

    Parameters
    ----------
    where, run
        Axle or both axles, and index of the recording.
    mixing : (S, K) array
        Each step at this place as a linear combination of all candidates.
    information : (S + 1, S + 1) array
        Information of the pulse from each beginning (row) to each end (column), the last of which
        lies after the recording; 0 if there is no such pulse.
    """

    where: str
    run: int
    mixing: Array
    information: Array

    def max_squares(self, gradients: NDArray[np.floating]) -> Array:
        """Largest squared scores (B,) over all pulses, given gradients (B, K) of all candidates."""
        of_steps = _with_end(gradients @ self.mixing.T.astype(gradients.dtype))
        largest = np.zeros(len(of_steps), of_steps.dtype)
        for begin, information in enumerate(self.information[:-_MIN_LENGTH]):
            later = slice(begin + _MIN_LENGTH, None)
            weights = np.zeros_like(information[later], of_steps.dtype)
            np.divide(1.0, information[later], out=weights, where=information[later] > 0.0)
            squares = (of_steps[:, begin, None] - of_steps[:, later]) ** 2
            squares *= weights
            np.maximum(largest, squares.max(axis=1), out=largest)
        return largest

    def best(self, gradient: Array) -> tuple[int, int]:
        """Beginning and end of the pulse with the largest squared score."""
        of_steps = _with_end((self.mixing @ gradient)[None])[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = (of_steps[:, None] - of_steps[None]) ** 2 / self.information
        squares[self.information <= 0.0] = -1.0
        begin, end = np.unravel_index(int(np.argmax(squares)), squares.shape)
        return int(begin), int(end)


def pulse_p_value(test: ScoreTest, seed: int) -> float:
    """p-value of the force pulse with the largest squared score.

    It is drawn sequentially, until 50 draws are as large as the observed score, at most 2000 in
    all; if the 50th of them is draw n, the p-value is 50/n (Besag & Clifford 1991).

    Parameters
    ----------
    test : ScoreTest
        Scores of candidates, including force steps.
    seed : int
        Seed of the draws.
    """
    scans = list(_pulse_scans(test))
    if not scans:
        return 1.0
    steps = np.flatnonzero([c.is_step for c in test.candidates])
    eigenvalues, vectors = np.linalg.eigh(test.information[np.ix_(steps, steps)])
    root = (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))).astype(np.float32)
    observed = max(float(scan.max_squares(test.gradient[None])[0]) for scan in scans)
    rng = np.random.default_rng([seed, 23])
    drawn = np.zeros((_PULSE_BATCH, len(test.gradient)), np.float32)
    exceeding = np.zeros(0, np.intp)
    for first in range(0, _PULSE_DRAWS, _PULSE_BATCH):
        normals = rng.standard_normal((_PULSE_BATCH, len(steps)), np.float32)
        drawn[:, steps] = normals @ root.T
        largest = np.max([scan.max_squares(drawn) for scan in scans], axis=0)
        exceeding = np.append(exceeding, 1 + first + np.flatnonzero(largest >= observed))
        if len(exceeding) >= _EXCEEDANCES:
            return _EXCEEDANCES / float(exceeding[_EXCEEDANCES - 1])
    return (1 + len(exceeding)) / (1 + _PULSE_DRAWS)


def with_best_pulses(test: ScoreTest) -> ScoreTest:
    """Replace force steps by the best pulse at each place in each run."""
    kept = [k for k, c in enumerate(test.candidates) if not c.is_step]
    if len(kept) == len(test.candidates):
        return test
    candidates = [test.candidates[k] for k in kept]
    mixing = list(np.eye(len(test.candidates))[kept])
    for scan in _pulse_scans(test):
        begin, end = scan.best(test.gradient)
        ending = scan.mixing[end] if end < len(scan.mixing) else 0.0
        candidates.append(_pulse(test, scan, begin, end))
        mixing.append(scan.mixing[begin] - ending)
    mix = np.array(mixing)
    return replace(
        test,
        candidates=tuple(candidates),
        sensitivities=mix @ test.sensitivities,
        gradient=mix @ test.gradient,
        information=mix @ test.information @ mix.T,
    )


def _pulse(test: ScoreTest, scan: _PulseScan, begin: int, end: int) -> Candidate:
    """Return the pulse between two steps."""
    in_run = [c for c in test.candidates if c.is_step and c.placed.run == scan.run]
    steps = [c for c in in_run if c.placed.where == in_run[0].placed.where]
    first = steps[begin]
    grid = steps[1].values["start"] - steps[0].values["start"]
    duration = (end - begin) * grid
    placed = replace(first.placed, where=scan.where)
    return replace(
        first, placed=placed, values={**first.values, "duration": duration}, is_step=False
    )


def _pulse_scans(test: ScoreTest) -> Iterator[_PulseScan]:
    """Yield the pulses at every place in every run."""
    raw = np.sum(test.sensitivities**2, axis=1)
    for run in sorted(
        {c.placed.run for c in test.candidates if c.is_step and c.placed.run is not None}
    ):
        steps_of_axle = [
            [k for k, c in enumerate(test.candidates) if c.is_step and _acts_at(c, axle, run)]
            for axle in AXLES
        ]
        for where, shares in _AXLE_SHARES.items():
            count = min(
                len(steps) for steps, share in zip(steps_of_axle, shares, strict=True) if share
            )
            if count <= _MIN_LENGTH:  # there are no steps if a pulse is named already
                continue
            mixing = np.zeros((count, len(test.candidates)))
            for axle, share in enumerate(shares):
                if share:
                    mixing[np.arange(count), steps_of_axle[axle]] = share
            joint = np.zeros((len(mixing) + 1, len(mixing) + 1))
            joint[:-1, :-1] = mixing @ test.information @ mixing.T
            of_steps = np.diag(joint)
            information = of_steps[:, None] + of_steps[None] - 2.0 * joint
            length = _with_end((mixing @ raw)[None])[0]
            informative = information > MIN_INFORMATION_SHARE * (length[:, None] + length[None])
            later = np.triu(np.ones_like(joint, bool), _MIN_LENGTH)
            later[-1] = False
            valid = np.where(informative & later, information, 0.0)
            yield _PulseScan(where, run, mixing, valid)


def _acts_at(candidate: Candidate, axle: str, run: int) -> bool:
    return candidate.placed.where == axle and candidate.placed.run == run


def _with_end(of_steps: NDArray[np.floating]) -> Array:
    """Append a step after the end of the recording, which is zero: (B, S) to (B, S + 1)."""
    return np.concatenate([of_steps, np.zeros_like(of_steps[:, :1])], axis=1)
