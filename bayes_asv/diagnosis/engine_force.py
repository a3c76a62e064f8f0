"""An engine that shakes the frame: known by its tones, and cut out with them.

Its speed wanders and its phase is nobody's to know, so it is no force that a simulation could
repeat on another drive.  What can be said is its frequency and how strongly it shakes; the
motion in its bands is then left out of measurement and simulation alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfilt, sosfreqz

from bayes_asv.diagnosis.engine_force_estimate import Measured, shaking
from bayes_asv.diagnosis.model_comparison import NONE
from bayes_asv.diagnosis.tone_detection import DetectedTones, humming
from bayes_asv.diagnosis.whiteness_test import memory
from bayes_asv.models.effects import EFFECTS
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, setting
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.tone_removal import Notch, main_tones, notch_filter, notched

__all__ = ["Engine", "probability", "without_engine"]

Array = NDArray[np.float64]

# Odds of an engine against nothing at all: it is as likely as each effect of the model.
_BEFOREHAND = (1.0 - NONE) / NONE / (len(EFFECTS) + 1)
_ALARM = 0.05  # false tones, where innovations remember anyway
_PLAIN = 5e-3  # false tones, where they do not
_REMEMBERS = 1e-3  # p-value above which innovations have no memory to explain
_LEFT = 0.5  # of the memory that may be left without the tones
_ROUNDS = 2  # of cutting again what was left beside a tone
_BESIDE = 2.0  # half-widths of a notch
_CLOCKS = 1e-3  # by which clocks of the same logger may differ
_SLOWEST = 10.0  # Hz: 600 turns a minute; below it a car has lines of its own on an even road


@dataclass(frozen=True)
class Engine:
    """Tones that were cut out.

    Parameters
    ----------
    frequency : Measured
        Of the strongest tone, Hz.
    amplitude : Measured
        Of the net force on the chassis at that frequency, N.
    tones : tuple of float
        All of them, Hz.
    probability : float
        That it is there.
    """

    frequency: Measured
    amplitude: Measured
    tones: tuple[float, ...]
    probability: float


def without_engine(
    where: Dataset,
    stage: FittedModel,
    held: tuple[PreparedRecording, ...],
    fit: Callable[[Dataset], FittedModel],
    elsewhere: Callable[[Dataset], FittedModel],
    least: float = 0.0,
) -> tuple[Dataset, FittedModel, Engine | None, tuple[PreparedRecording, ...]]:
    """Cut tones out where they are what a model cannot explain.

    What else may have made such lines, and so how much they have to hold, the caller knows.

    Parameters
    ----------
    where, stage : Dataset, FittedModel
        Recordings, and a model at its mode.
    held : tuple of PreparedRecording
        Runs that were held out.
    fit, elsewhere : callable
        Fits the model to these recordings cut, and to others.
    least : float
        Energy of innovations that tones have to hold.

    Returns
    -------
    Setting, Stage, Engine or None, tuple of PreparedRecording
        The setting, the model there, the engine, and the held-out runs without its tones; all as
        they came when there is no engine.
    """
    before, p = memory(stage)
    alarm = _ALARM if p < _REMEMBERS else _PLAIN
    tones, log_p = _tones(where, stage, alarm)
    if not tones or _held(where, stage, tones) < least:
        return where, stage, None, held
    quiet, cut = _silenced(where, tones, fit)
    for _ in range(_ROUNDS):
        rest = _beside(tones, quiet, cut)
        if not rest:
            break
        tones += rest
        quiet, cut = _silenced(where, tones, fit)
    if p < _REMEMBERS and memory(cut)[0] > _LEFT * before:
        return where, stage, None, held
    measured = shaking(where, stage, tones)
    engine = Engine(*measured, main_tones(tones), probability(log_p))
    silent = []
    for line in held:
        alone = setting(where.vehicle, (line,))
        own = _tones(alone, elsewhere(alone), alarm)
        silent.append(notched(line, _with(tones, own.tones)))
    return quiet, cut, engine, tuple(silent)


def probability(log_p: float) -> float:
    """Probability of an engine whose strongest tone has a p-value.

    An engine is one of the things that may be missing, beforehand as likely as each other; the
    p-value counts for as much as it can against nothing at all: the odds of nothing are no less
    than -e p log p of what they were (Sellke, Bayarri & Berger 2001, Am. Stat. 55:62, eq. 3).
    """
    if log_p >= -1.0:
        return _BEFOREHAND / (1.0 + _BEFOREHAND)
    odds = _BEFOREHAND * math.exp(min(-1.0 - log_p - math.log(-log_p), 500.0))
    return odds / (1.0 + odds)


def _silenced(
    where: Dataset, tones: tuple[Notch, ...], fit: Callable[[Dataset], FittedModel]
) -> tuple[Dataset, FittedModel]:
    """Cut tones out of all recordings, and fit the model to what is left."""
    lines = tuple(notched(line, tones) for line in where.lines)
    quiet = setting(where.vehicle, lines)
    return quiet, fit(quiet)


def _beside(tones: Sequence[Notch], quiet: Dataset, cut: FittedModel) -> tuple[Notch, ...]:
    """Find what a strong tone that wandered left beside its notch, if only for a moment."""
    found = _tones(quiet, cut, _ALARM, engine=False).tones
    return tuple(
        n for n in found
        if any(abs(n.frequency - t.frequency) < _BESIDE * t.half_width for t in tones)
    )  # fmt: skip


def _held(where: Dataset, stage: FittedModel, tones: Sequence[Notch]) -> float:
    """Energy of innovations that goes with the tones, beyond what white ones lose."""
    lost = 0.0
    for run, line in enumerate(where.lines):
        nu = np.nan_to_num(line.paired(stage.target.scored(stage.mode.z, run)[0]))
        sections = notch_filter(tones, 1.0 / line.reading_step)
        _, response = sosfreqz(sections, 2048)
        share = float(np.mean(np.abs(response) ** 2))
        lost += float(np.sum(nu**2) - np.sum(sosfilt(sections, nu, axis=0) ** 2) / share)
    return lost


def _tones(
    where: Dataset, stage: FittedModel, alarm: float, *, engine: bool = True
) -> DetectedTones:
    """Tones of all runs; one engine sounds in each of them."""
    alike: list[tuple[float, list[Array]]] = []  # runs by their rate
    for run, line in enumerate(where.lines):
        nu = line.paired(stage.target.scored(stage.mode.z, run)[0])
        rate = 1.0 / line.reading_step
        for other, runs in alike:
            if abs(rate / other - 1.0) < _CLOCKS:
                runs.append(nu)
                break
        else:
            alike.append((rate, [nu]))
    heard = [humming(r, rate, _SLOWEST, alarm / len(alike), engine=engine) for rate, r in alike]
    out: tuple[Notch, ...] = ()
    for hum in sorted(heard, key=lambda hum: hum.log_p):
        out = _with(out, hum.tones)
    return DetectedTones(
        out, min(hum.log_p for hum in heard) + math.log(len(alike)) if out else 0.0
    )


def _with(notches: tuple[Notch, ...], more: Iterable[Notch]) -> tuple[Notch, ...]:
    """Add notches that do not lie within those that are there."""
    return notches + tuple(
        n for n in more
        if all(abs(n.frequency - o.frequency) > 0.5 * o.half_width for o in notches)
    )  # fmt: skip
