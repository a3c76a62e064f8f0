"""Spline of a wheel's acceleration that is extended as samples arrive, with a fixed lookahead.

Except for the influence of samples beyond the lookahead, the spline is that of
:mod:`bayes_asv.preprocessing.wheel_spline`.  The size of chunks has no effect.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.prediction import ORDER
from bayes_asv.filters.running_spline import (
    forward_elimination,
    interpolation_errors,
    spline_coefficients,
    step_moments,
)
from bayes_asv.preprocessing.wheel_spline import JUMP_SHARE, NOISE_MARGIN

__all__ = ["LOOKAHEAD", "StreamingSpline"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOOKAHEAD = 4
"""Number of samples after the start of an interval that its spline waits for.

The spline itself needs two, since the influence of a sample decays by 0.27 per sample; the
interpolation errors around the interval need two more.
"""

_SAME_INSTANT = 1e-9  # difference of times below which they are the same instant, s
_MAX_CLIPPED = 4  # largest number of consecutive clipped samples that wait for their neighbours


class StreamingSpline:
    """One wheel's acceleration between its samples.

    Parameters
    ----------
    noise : float
        Variance of the interpolation error (cubic through four neighbours) due to noise, m²/s⁴.
    max_gap : float
        Longest interval between two samples that the spline may span, s.
    """

    def __init__(self, noise: float, max_gap: float) -> None:
        self._noise = noise
        self._max_gap = max_gap
        # clipped samples and their successors: time, value, side of the rail (±1, or 0 unclipped)
        self._held: list[tuple[float, float, float]] = []
        self._time = np.empty(0)
        self._value = np.empty(0)
        self._excursion = np.empty(0)  # how far beyond its rail a clipped sample may be
        self._starts = np.empty(0, bool)
        self._superdiagonal = np.empty(0)
        self._rhs = np.empty(0)
        self._errors = np.empty(0)
        self._coefficients = np.empty((0, 4))
        self._sd = np.empty(0)
        self._final = 0  # intervals whose coefficients will not change
        self._newest = -np.inf
        self._finished = False

    @property
    def horizon(self) -> float:
        """Time (s) up to which the spline is final."""
        if not len(self._time):
            return self._newest if not self._held else -np.inf
        if self._finished or self._lost:
            return self._newest
        return float(self._time[self._final])

    @property
    def _lost(self) -> bool:
        """Whether the last sample is so old that the spline ends there."""
        if self._held or not len(self._time):
            return False
        return self._newest - float(self._time[-1]) > self._max_gap

    def push(self, time: Array, value: Array, low: Flags, high: Flags) -> None:
        """Add samples.

        Parameters
        ----------
        time : (n,) array
            True times, s, increasing.
        value : (n,) array
            Accelerations, m/s²; NaN where missing.
        low, high : (n,) bool arrays
            Samples at the lower or upper rail.
        """
        if not len(time):
            return
        self._newest = float(time[-1])
        present = np.isfinite(value)
        side = np.where(high, 1.0, np.where(low, -1.0, 0.0))[present]
        if self._held or side.any():
            self._hold(time[present], value[present], side)
        else:
            self._append(time[present], value[present], np.zeros(int(present.sum())))
        if self._held and self._newest - self._held[-1][0] > self._max_gap:
            self._release(len(self._held))
        self._finalise(len(self._time) - (1 if self._lost else LOOKAHEAD))

    def finish(self) -> None:
        """Finalise all intervals: no sample will follow."""
        if self._held:
            self._release(len(self._held))
        self._finished = True
        self._finalise(len(self._time) - 1)

    def covers(self, instants: Array) -> Flags:
        """Whether the acceleration is known at instants (E,), s, not beyond the horizon."""
        if len(self._time) < 2:
            return np.zeros(len(instants), bool)
        at = np.searchsorted(self._time, instants + _SAME_INSTANT, side="right") - 1
        inside = (at >= 0) & (instants <= self._time[-1] + _SAME_INSTANT)
        at = np.clip(at, 0, len(self._time) - 1)
        gap = np.append(self._starts[1:], True)[at]
        return np.asarray(inside & (~gap | (np.abs(instants - self._time[at]) < _SAME_INSTANT)))

    def integrate(self, instants: Array, before: float) -> tuple[Array, Array, Flags, Array]:
        """Moments of the acceleration over steps that end at instants.

        Parameters
        ----------
        instants : (E,) array
            Increasing, covered (:meth:`covers`), not beyond :attr:`horizon`, s.
        before : float
            Start of the first step, s.

        Returns
        -------
        moments : (E, ORDER) array
            ∫₀ʰ (h−s)ʲ/j! û ds.
        spread : (E, 2) array
            As ``step_moments`` fills it.
        covered : (E,) bool array
            Whether the spline covers the whole step.
        ends : (E, 2) array
            Acceleration at its beginning and at its end, m/s².
        """
        n = len(instants)
        moments, spread, covered = np.zeros((n, ORDER)), np.zeros((n, 2)), np.ones(n, bool)
        ends = np.zeros((n, 2))
        gaps = np.append(self._starts[1:], True)
        step_moments(
            instants, before, self._time, self._coefficients, self._sd, gaps, moments, spread,
            covered, ends,
        )  # fmt: skip
        return moments, spread, covered, ends

    def discard(self, before: float) -> None:
        """Discard samples that no step starting at ``before`` (s) or later needs."""
        unused = int(np.searchsorted(self._time, before)) - 8
        unused = min(unused, self._final - 8)
        if unused < 256:
            return
        for name in (
            "_time", "_value", "_excursion", "_starts", "_superdiagonal", "_rhs", "_errors",
            "_coefficients", "_sd",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[unused:].copy())
        self._final -= unused

    def _hold(self, time: Array, value: Array, side: Array) -> None:
        """Add samples one by one; clipped ones are held until their neighbours are known."""
        for t, v, s in zip(time.tolist(), value.tolist(), side.tolist(), strict=True):
            self._held.append((t, v, s))
            unclipped = 0
            for _, _, other in reversed(self._held):
                if other != 0.0:
                    break
                unclipped += 1
            if unclipped == len(self._held) or unclipped >= 2 or len(self._held) > _MAX_CLIPPED + 2:
                self._release(len(self._held))

    def _release(self, count: int) -> None:
        """Append held samples; clipped ones are extrapolated from their neighbours."""
        held = self._held[:count]
        del self._held[:count]
        time, value, side = (np.array(column) for column in zip(*held, strict=True))
        excursion = np.zeros(count)
        clipped = side != 0.0
        if clipped.any():
            last_two = slice(max(len(self._time) - 2, 0), len(self._time))
            t = np.concatenate([self._time[last_two], time[~clipped]])
            v = np.concatenate([self._value[last_two], value[~clipped]])
            guess = _lagrange(t, v, time[clipped]) if len(t) else value[clipped]
            excursion_beyond = side[clipped] * (guess - value[clipped])
            # a cubic over a wide gap is unreliable: limit the excursion to the value of the rail
            excursion_beyond = np.clip(excursion_beyond, 0.0, np.abs(value[clipped]))
            value[clipped] += side[clipped] * excursion_beyond
            excursion[clipped] = np.maximum(excursion_beyond, 0.1 * np.abs(value[clipped]))
        self._append(time, value, excursion)

    def _append(self, time: Array, value: Array, excursion: Array) -> None:
        n = len(time)
        if not n:
            return
        old = len(self._time)
        last = self._time[-1] if old else -np.inf
        starts = np.diff(time, prepend=last) > self._max_gap
        self._time = np.concatenate([self._time, time])
        self._value = np.concatenate([self._value, value])
        self._excursion = np.concatenate([self._excursion, excursion])
        self._starts = np.concatenate([self._starts, starts])
        zeros = np.zeros(n)
        self._superdiagonal = np.concatenate([self._superdiagonal, zeros])
        self._rhs = np.concatenate([self._rhs, zeros])
        self._errors = np.concatenate([self._errors, zeros])
        self._sd = np.concatenate([self._sd, zeros])
        self._coefficients = np.concatenate([self._coefficients, np.zeros((n, 4))])
        forward_elimination(
            max(old - 1, 0), self._time, self._value, self._starts, self._superdiagonal, self._rhs
        )

    def _finalise(self, end: int) -> None:
        """Compute the spline of intervals up to ``end``, or up to the last gap if that is later."""
        starts = np.flatnonzero(self._starts)
        end = max(end, int(starts[-1]) if len(starts) else 0)
        first = self._final
        if end <= first:
            return
        interpolation_errors(
            max(first - 1, 0), min(end + 2, len(self._time)), self._time, self._value,
            self._starts, self._errors,
        )  # fmt: skip
        spline_coefficients(
            first, end, LOOKAHEAD, self._time, self._value, self._starts, self._superdiagonal,
            self._rhs, self._coefficients,
        )  # fmt: skip
        excess = np.maximum(
            self._errors[max(first - 1, 0) : end + 2] - NOISE_MARGIN * self._noise, 0
        )
        padded = np.concatenate([np.zeros(1 if first == 0 else 0), excess, np.zeros(3)])
        n = end - first
        local = 0.25 * (padded[:n] + padded[1 : n + 1] + padded[2 : n + 2] + padded[3 : n + 3])
        clipped = 0.5 * (self._excursion[first:end] + self._excursion[first + 1 : end + 1])
        self._sd[first:end] = np.maximum(JUMP_SHARE * np.sqrt(local), clipped)
        self._final = end


def _lagrange(time: Array, value: Array, at: Array) -> Array:
    """Evaluate the polynomial through a few samples at other times."""
    out = np.zeros(len(at))
    for j in range(len(time)):
        weight = np.ones(len(at))
        for other in range(len(time)):
            if other != j:
                weight *= (at - time[other]) / (time[j] - time[other])
        out += weight * value[j]
    return out
