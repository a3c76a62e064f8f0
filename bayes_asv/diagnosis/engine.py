"""Excitation by an engine: detection of its tones, their removal, and estimation of its force.

The speed of an engine wanders and its phase is unknown, so a simulation cannot repeat its force on
another drive.  Its tones are removed from measurement and simulation alike.

In the band of a tone, the body's accelerations minus a simulation from the wheels are a force times
the car's response, plus noise.  Where the engine sits is unknown: forces at all axles are estimated
together, by generalised least squares, and their sum is reported.  Where the accelerometers do not
tell the axles apart, the force is assumed to be the same at all of them.  The noise is estimated in
the bands on either side.
Deflections and angular rates hardly respond at these frequencies: without a measured acceleration,
no engine is searched for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert, sosfilt, sosfiltfilt, sosfreqz
from scipy.stats import t

from bayes_asv.diagnosis.residual_tests import whiteness_test
from bayes_asv.diagnosis.thresholds import MISSPECIFICATION_LEVEL, PRIOR_NONE
from bayes_asv.diagnosis.tone_detection import DetectedTones, detect_tones
from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.effects import EFFECTS
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, make_dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.removed_band import frequency_response
from bayes_asv.preprocessing.tone_removal import (
    IDLE_FREQUENCY,
    Notch,
    band_pass_filter,
    engine_tones,
    main_tones,
    notch_filter,
    notched,
    own_modes,
)

__all__ = [
    "Engine",
    "IntervalEstimate",
    "engine_probability",
    "estimate_engine_force",
    "remove_engine_tones",
]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Prior odds of an engine against no missing effect: it is as probable as each listed effect.
_EFFECT_COUNT = sum(not effect.on_request for effect in EFFECTS.values())
_PRIOR_ODDS = (1.0 - PRIOR_NONE) / PRIOR_NONE / (_EFFECT_COUNT + 1)
_FALSE_TONES = 0.05  # accepted number of false tones if the innovations are autocorrelated
_FALSE_TONES_IF_WHITE = 5e-3  # accepted number of false tones if they are white
_MAX_AUTOCORRELATION = 0.5  # share of the autocorrelation that may remain without the tones
_ROUNDS = 2  # number of passes that remove the remainder of a tone beside its notch
_BESIDE = 2.0  # distance up to which a tone counts as such a remainder, half-widths of the notch
_SAME_RATE = 1e-3  # relative difference of the clocks of two recordings of one logger
# Half-widths of its notch in which a tone is measured, and distances of the noise bands, of which
# the nearest one on each side without another tone is used.  Within one half-width, forces of 4 to
# 15 N were underestimated by 2 to 9 %, since the tone wanders out of it.
_MEASURED_WIDTH, _BAND_DISTANCES = 2.0, (4.5, 6.5, 8.5)
_MIN_NOISE = 1e-12  # lower bound of the noise power, m²/s⁴
_LOWEST_BAND = 3.0  # lowest frequency of a noise band, Hz; the car moves below it
_POWER_LOST = 0.06  # standard deviation of the share of power that wanders out of the band
# Least singular value of the responses to forces at the axles, over the largest: below it, a sum of
# the forces would have more than twenty times the noise of one of them.
_LEAST_DIFFERENCE = 0.05
_BLOCK = 0.5  # jackknife block, s: longer than the coherence time of an engine's phase


class IntervalEstimate(NamedTuple):
    """An estimate with its equal-tailed 95 % interval.

    Parameters
    ----------
    value, low, high : float
        Estimate and ends of the interval, in the same unit.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Engine:
    """Engine tones that were removed.

    Parameters
    ----------
    frequency : IntervalEstimate
        Frequency of the strongest tone, Hz.
    amplitude : IntervalEstimate
        Amplitude of the net force on the chassis at that frequency, N.
    tones : tuple of float
        All tones, Hz.
    probability : float
        Probability that the engine excites the frame.
    """

    frequency: IntervalEstimate
    amplitude: IntervalEstimate
    tones: tuple[float, ...]
    probability: float


def remove_engine_tones(
    dataset: Dataset,
    model: FittedModel,
    holdout: tuple[PreparedRecording, ...],
    fit: Callable[[Dataset], FittedModel],
    fit_holdout: Callable[[Dataset], FittedModel],
    min_energy: float = 0.0,
) -> tuple[Dataset, FittedModel, Engine | None, tuple[PreparedRecording, ...]]:
    """Remove an engine's tones from recordings if a model cannot explain them.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Recordings, and a model at its mode.
    holdout : tuple of PreparedRecording
        Held-out runs.
    fit, fit_holdout : callable
        Fit the model to these recordings without the tones, and to held-out ones.
    min_energy : float
        Energy of the innovations that the tones must exceed, since a missing effect may cause it.

    Returns
    -------
    Dataset, FittedModel, Engine or None, tuple of PreparedRecording
        Recordings without the tones, the model fitted to them, the engine, and the held-out runs
        without the tones; all unchanged if there is no engine.
    """
    before, p = whiteness_test(model)
    autocorrelated = p < MISSPECIFICATION_LEVEL
    false_tones = _FALSE_TONES if autocorrelated else _FALSE_TONES_IF_WHITE
    tones, log_p = _detect_in_runs(dataset, model, false_tones)
    if not tones or _tone_energy(dataset, model, tones) < min_energy:
        return dataset, model, None, holdout
    removed, refit = _remove_tones(dataset, tones, fit)
    for _ in range(_ROUNDS):
        remainder = _remaining_tones(tones, removed, refit)
        if not remainder:
            break
        tones += remainder
        removed, refit = _remove_tones(dataset, tones, fit)
    if autocorrelated and whiteness_test(refit)[0] > _MAX_AUTOCORRELATION * before:
        return dataset, model, None, holdout
    estimates = estimate_engine_force(dataset, model, tones)
    engine = Engine(*estimates, main_tones(tones), engine_probability(log_p))
    holdout_removed = []
    for recording in holdout:
        single = make_dataset(dataset.vehicle, (recording,))
        own_tones = _detect_in_runs(single, fit_holdout(single), false_tones)
        holdout_removed.append(notched(recording, _merge_notches(tones, own_tones.tones)))
    return removed, refit, engine, tuple(holdout_removed)


def engine_probability(log_p: float) -> float:
    """Probability of an engine, from the log p-value of its strongest tone.

    The prior odds are those of one listed effect.  A p-value reduces the odds of "nothing" by no
    more than the factor −e p log p (Sellke, Bayarri & Berger 2001, Am. Stat. 55:62, eq. 3), which
    is used as the Bayes factor.
    """
    if log_p >= -1.0:
        return _PRIOR_ODDS / (1.0 + _PRIOR_ODDS)
    odds = _PRIOR_ODDS * math.exp(min(-1.0 - log_p - math.log(-log_p), 500.0))
    return odds / (1.0 + odds)


def _remove_tones(
    dataset: Dataset, tones: tuple[Notch, ...], fit: Callable[[Dataset], FittedModel]
) -> tuple[Dataset, FittedModel]:
    """Remove tones from all recordings, and fit the model to the rest."""
    recordings = tuple(notched(recording, tones) for recording in dataset.recordings)
    removed = make_dataset(dataset.vehicle, recordings)
    return removed, fit(removed)


def _remaining_tones(
    tones: Sequence[Notch], removed: Dataset, refit: FittedModel
) -> tuple[Notch, ...]:
    """Find remainders of wandering tones beside their notches, persistent or not."""
    rest = _detect_in_runs(removed, refit, _FALSE_TONES, engine=False).tones
    return tuple(
        n for n in rest
        if any(abs(n.frequency - t.frequency) < _BESIDE * t.half_width for t in tones)
    )  # fmt: skip


def _tone_energy(dataset: Dataset, model: FittedModel, tones: Sequence[Notch]) -> float:
    """Energy of the innovations that notches remove, beyond that of white innovations."""
    lost = 0.0
    for run, recording in enumerate(dataset.recordings):
        nu = np.nan_to_num(_accelerations(dataset, model, run))
        sections = notch_filter(tones, 1.0 / recording.reading_step)
        _, response = sosfreqz(sections, 2048)
        passed = float(np.mean(np.abs(response) ** 2))
        lost += float(np.sum(nu**2) - np.sum(sosfilt(sections, nu, axis=0) ** 2) / passed)
    return lost


def _detect_in_runs(
    dataset: Dataset, model: FittedModel, false_tones: float, *, engine: bool = True
) -> DetectedTones:
    """Detect the tones of all runs, which one engine excites."""
    by_rate: list[tuple[float, list[Array]]] = []
    for run, recording in enumerate(dataset.recordings):
        if not recording.accelerations:
            continue
        nu = _accelerations(dataset, model, run)
        rate = 1.0 / recording.reading_step
        for other, runs in by_rate:
            if abs(rate / other - 1.0) < _SAME_RATE and nu.shape[1] == runs[0].shape[1]:
                runs.append(nu)
                break
        else:
            by_rate.append((rate, [nu]))
    modes = own_modes(model.space.car, dataset.vehicle.unsprung)
    detected = []
    for rate, runs in by_rate:
        detection = detect_tones(
            runs, rate, IDLE_FREQUENCY, false_tones / len(by_rate), engine=engine
        )
        if engine:
            tones = engine_tones(detection.tones, runs, rate, modes)
            # the probability is that of the strongest tone: without that tone, no engine
            detection = (
                detection._replace(tones=tones)
                if tones[:1] == detection.tones[:1]
                else DetectedTones()
            )
        detected.append(detection)
    tones_of_all: tuple[Notch, ...] = ()
    for detection in sorted(detected, key=lambda one: one.log_p):
        tones_of_all = _merge_notches(tones_of_all, detection.tones)
    if not tones_of_all:
        return DetectedTones()
    return DetectedTones(
        tones_of_all, min(detection.log_p for detection in detected) + math.log(len(by_rate))
    )


def _accelerations(dataset: Dataset, model: FittedModel, run: int) -> Array:
    """Normalised innovations (R, n) of one run's accelerations; nan for a missing reading."""
    recording = dataset.recordings[run]
    nu = recording.paired(model.posterior.innovations_and_variances(model.mode.z, run)[0])
    return nu[:, list(recording.accelerations)]


def _merge_notches(notches: tuple[Notch, ...], more: Iterable[Notch]) -> tuple[Notch, ...]:
    """Append notches that do not lie within those before."""
    return notches + tuple(
        n for n in more
        if all(abs(n.frequency - o.frequency) > 0.5 * o.half_width for o in notches)
    )  # fmt: skip


class _ToneBand(NamedTuple):
    """Residual accelerations of one run in the band of a tone.

    Parameters
    ----------
    run : int
        Index of the recording.
    signal : (R, n) complex array
        Analytic signal, m/s².
    noise : (n, n) complex array
        Covariance of the noise alone.
    rate : float
        Groups of readings a second, Hz.
    """

    run: int
    signal: Complex
    noise: Complex
    rate: float


def estimate_engine_force(
    dataset: Dataset, model: FittedModel, tones: Sequence[Notch]
) -> tuple[IntervalEstimate, IntervalEstimate]:
    """Estimate frequency (Hz) of the strongest tone and amplitude (N) of the net force.

    Parameters
    ----------
    dataset, model : Dataset, FittedModel
        Recordings as read, at least one of them sampled fast enough, and a model at its mode.
    tones : sequence of Notch
        Tones, the strongest first; noise bands avoid the others.

    Returns
    -------
    IntervalEstimate, IntervalEstimate
        Intervals are by the jackknife over half seconds of all runs and Student's t (Efron &
        Tibshirani 1993, *An Introduction to the Bootstrap*, ch. 11).  That of the frequency is for
        its mean; the speed itself may wander.
    """
    blocks = [
        _block_sums(one, _responses(model, one.run, tones[0].frequency))
        for one in _tone_bands(dataset, model, tones)
    ]
    return _jackknife(np.concatenate(blocks), tones[0])


def _tone_bands(
    dataset: Dataset, model: FittedModel, tones: Sequence[Notch]
) -> Iterator[_ToneBand]:
    tone, others = tones[0], tones[1:]
    width = _MEASURED_WIDTH * tone.half_width
    for run, recording in enumerate(dataset.recordings):
        rate = 1.0 / recording.reading_step
        if tone.frequency >= 0.5 * rate or not recording.accelerations:
            continue
        output = free_run(model.posterior, model.mode.z, run).output
        residual_readings = np.where(recording.kind == VALUE, recording.reading - output, np.nan)
        residuals = np.nan_to_num(
            recording.paired(residual_readings)[:, list(recording.accelerations)]
        )
        signal = _analytic_signal(residuals, Notch(tone.frequency, width), rate)
        noise_signals = [
            _analytic_signal(residuals, Notch(f, width), rate)
            for f in _noise_bands(tone, others, rate)
        ]
        noise: Complex = np.eye(residuals.shape[1], dtype=np.complex128) * _MIN_NOISE
        for b in noise_signals or [signal]:  # without a noise band, the whole signal may be noise
            noise = np.asarray(noise + (b.T @ b.conj()) / (len(b) * max(len(noise_signals), 1)))
        yield _ToneBand(run, signal, noise, rate)


def _noise_bands(tone: Notch, others: Sequence[Notch], rate: float) -> list[float]:
    """Centres (Hz) of the nearest bands without a tone, one on each side."""
    width = _MEASURED_WIDTH * tone.half_width
    out = []
    for side in (-1.0, 1.0):
        for distance in _BAND_DISTANCES:
            f = tone.frequency + side * distance * tone.half_width
            valid = f - width > _LOWEST_BAND and f + width < 0.5 * rate
            if valid and all(abs(f - o.frequency) > width + o.half_width for o in others):
                out.append(f)
                break
    return out


def _analytic_signal(signal: Array, tone: Notch, rate: float) -> Complex:
    return np.asarray(hilbert(sosfiltfilt(band_pass_filter(tone, rate), signal, axis=0), axis=0))


def _responses(model: FittedModel, run: int, frequency: float) -> Complex:
    """Responses (n, K) of the acceleration readings to unit forces, with given wheel motion.

    The K forces act at the axles; where the readings do not tell these apart, one is shared by all.
    """
    recording, car = model.space.recordings[run], model.space.car
    accelerations = list(recording.accelerations)
    system = model.space.state_space(model.mode.z[None], run)
    by_forces = (
        frequency_response(system._replace(B=system.E), np.array([frequency]))[0] + system.G[0]
    )
    shares = np.stack([car.shares(axle) for axle in car.axles], axis=1)
    response = (by_forces @ shares)[accelerations]
    poles = recording.poles[list(recording.outputs)][accelerations]
    s = 2j * math.pi * frequency
    return _distinct(response / (1.0 + s / np.where(poles > 0.0, poles, np.inf))[:, None])


def _distinct(responses: Complex) -> Complex:
    """Responses (n, K) as they are, or their mean (n, 1) where they are too much alike."""
    least = _LEAST_DIFFERENCE * float(np.linalg.norm(responses, 2))
    if np.linalg.matrix_rank(responses, least) < responses.shape[1]:
        responses = responses.mean(axis=1, keepdims=True)
    return responses


def _net_force_weights(one: _ToneBand, h: Complex) -> tuple[Complex, float]:
    """Weights (n,) of the channels in the sum of the forces, and its variance (N²).

    It is the sum of the generalised least-squares estimates of all forces.
    """
    weighted = np.linalg.solve(one.noise, h).conj().T
    inverse = np.linalg.inv(weighted @ h)
    return np.asarray((inverse @ weighted).sum(axis=0)), float(inverse.sum().real)


def _block_sums(one: _ToneBand, h: Complex) -> Array:
    """Sum time (s), power beyond noise (N² s), weight and weighted Hz over half seconds (B, 4)."""
    weights, variance = _net_force_weights(one, h)
    force = one.signal @ weights
    count = max(int(len(force) / (_BLOCK * one.rate)), 1)
    out = []
    for part in np.array_split(force, count):
        power = float(np.sum(np.abs(part) ** 2) - variance * len(part))
        rotation = np.sum(part[1:] * part[:-1].conj())  # phase advance between readings
        hertz = float(np.angle(rotation)) * one.rate / (2.0 * math.pi)
        out.append([len(part), power, abs(rotation), abs(rotation) * hertz])
    return np.array(out) / one.rate


def _jackknife(blocks: Array, tone: Notch) -> tuple[IntervalEstimate, IntervalEstimate]:
    """Frequency and amplitude from all blocks (B, 4), with intervals."""
    total, n = blocks.sum(axis=0), len(blocks)

    def estimate(sums: Array) -> Array:
        return np.stack([sums[..., 3] / sums[..., 2], sums[..., 1] / sums[..., 0]])

    value = estimate(total)
    if n > 2:
        without = estimate(total - blocks)
        variance = (n - 1.0) / n * np.sum((without - without.mean(axis=1)[:, None]) ** 2, axis=1)
        half_width = float(t.isf(0.025, n - 1)) * np.sqrt(variance)
    else:
        half_width = np.array([tone.half_width, value[1]])
    (frequency, power), (df, dp) = value, half_width
    dp = math.hypot(dp, NORMAL_975 * _POWER_LOST * power)
    force = [math.sqrt(max(p, 0.0)) for p in (power, power - dp, power + dp)]
    return IntervalEstimate(frequency, frequency - df, frequency + df), IntervalEstimate(*force)
