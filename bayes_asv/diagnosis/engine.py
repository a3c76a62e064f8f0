"""An engine that shakes the frame: known by its tones, and cut out with them.

Its speed wanders and its phase is nobody's to know, so it is no force that a simulation could
repeat on another drive.  What can be said is its frequency and how strongly it shakes; the
motion in its bands is then left out of measurement and simulation alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.memory import memory
from bayes_asv.inference.freerun import free_run
from bayes_asv.inference.stage import Setting, Stage, setting
from bayes_asv.inference.timeline import Timeline
from bayes_asv.inference.tones import Notch, find_tones, main_tones, notched
from bayes_asv.kernels.innovations import VALUE

__all__ = ["Engine", "without_engine"]

Array = NDArray[np.float64]

_ALARM = 0.05  # false tones a spectrum, where innovations remember anyway
_REMEMBERS = 1e-3  # p-value above which innovations have no memory to explain
_LEFT = 0.5  # of the memory that may be left without the tones


@dataclass(frozen=True)
class Engine:
    """Tones that were cut out.

    Parameters
    ----------
    frequency : float
        Of the strongest tone, Hz.
    amplitude : float
        Force on the chassis at that frequency, N.
    tones : tuple of float
        All of them, Hz.
    """

    frequency: float
    amplitude: float
    tones: tuple[float, ...]


def without_engine(
    where: Setting,
    base: Stage,
    held: tuple[Timeline, ...],
    fit: Callable[[Setting], Stage],
) -> tuple[Setting, Stage, Engine | None, tuple[Timeline, ...]]:
    """Cut tones out where they are what the half car cannot explain.

    Returns the setting, the fit of the half car there, the engine, and the held-out runs without
    its tones; all as they came when there is no engine.
    """
    before, p = memory(base)
    if p > _REMEMBERS:
        return where, base, None, held
    tones = _tones(where, base)
    if not tones:
        return where, base, None, held
    lines = tuple(notched(line, where.vehicle, tones) for line in where.lines)
    quiet = setting(where.vehicle, lines)
    stage = fit(quiet)
    if memory(stage)[0] > _LEFT * before:
        return where, base, None, held
    engine = Engine(tones[0].frequency, _amplitude(where, base, tones[0]), main_tones(tones))
    silent = []
    for line in held:
        alone = setting(where.vehicle, (line,))
        own = _tones(alone, fit(alone))
        silent.append(notched(line, where.vehicle, _joined((tones, own))))
    return quiet, stage, engine, tuple(silent)


def _tones(where: Setting, base: Stage) -> tuple[Notch, ...]:
    """Tones of all runs; one engine sounds in each of them."""
    return _joined(
        find_tones(
            line.paired(base.target.scored(base.mode.z, run)[0]), 1.0 / line.reading_step, _ALARM
        )
        for run, line in enumerate(where.lines)
    )


def _joined(runs: Iterable[tuple[Notch, ...]]) -> tuple[Notch, ...]:
    """All notches, those left out that lie within another."""
    out: list[Notch] = []
    for notches in runs:
        for notch in notches:
            if all(abs(notch.frequency - o.frequency) > 0.5 * o.half_width for o in out):
                out.append(notch)
    return tuple(out)


def _amplitude(where: Setting, base: Stage, tone: Notch) -> float:
    """Amplitude of the force at the chassis in the band of a tone, N."""
    from scipy.signal import butter, sosfiltfilt

    power, n = 0.0, 0
    mass = float(base.space.cars(base.mode.z[None])[0][3])
    wdf = float(base.space.cars(base.mode.z[None])[0][5])
    for run, line in enumerate(where.lines):
        output, _, _ = free_run(base.target, base.mode.z, run)
        left = np.nan_to_num(
            line.paired(np.where(line.kind == VALUE, line.reading - output, np.nan))
        )
        rate = 1.0 / line.reading_step
        edges = [tone.frequency - tone.half_width, tone.frequency + tone.half_width]
        band = butter(2, np.clip(edges, 0.5, 0.49 * rate), "bandpass", fs=rate, output="sos")
        inside = sosfiltfilt(band, left, axis=0)
        # Heave of the centre of mass: what a net force does, wherever it acts.
        heave = wdf * inside[:, 0] + (1.0 - wdf) * inside[:, 1]
        power += float(np.sum(heave**2))
        n += len(heave)
    corner = where.vehicle.sensor("front_chassis").bandwidth
    passed = 1.0 if corner is None else 1.0 / np.hypot(1.0, tone.frequency / corner)
    return float(mass * np.sqrt(2.0 * power / n) / passed)
