"""What a wheel did, as its samples come in: a spline that waits for a few samples more.

The same curve as :mod:`bayes_asv.preprocessing.wheel_spline` draws through a whole recording, but
for the samples that it does not wait for.  What it gives does not depend on how the samples were
cut into chunks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.discretization import ORDER
from bayes_asv.filters.running_spline import eliminate, missed, pieces, step_moments

__all__ = ["AHEAD", "WheelCurve"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

AHEAD = 4
"""Samples beyond the begin of an interval that are waited for.

The curve itself would do with two, since a spline forgets by 0.27 a sample; how sharp the signal
is around an interval shows two later."""

_JUMP_SHARE = 0.15  # as in inference.wheels: what a spline errs for what it errs without a sample
_NOISE_MARGIN = 6.0  # variances of the noise's own misses that are not taken for an edge
_SAME_INSTANT = 1e-9  # s
_LONGEST_CLIP = 4  # samples at a rail that are waited through


class WheelCurve:
    """One wheel's acceleration between its samples, growing.

    Parameters
    ----------
    noise : float
        Variance of what a cubic through four neighbours misses for noise alone, m²/s⁴.
    gap : float
        Longest time between two samples that a curve may span, s.
    """

    def __init__(self, noise: float, gap: float) -> None:
        self._noise = noise
        self._gap = gap
        self._waiting: list[tuple[float, float, float]] = []  # time, value, side of the rail
        self._time = np.empty(0)
        self._value = np.empty(0)
        self._reach = np.empty(0)  # how far beyond its rail a clipped sample may have been
        self._opens = np.empty(0, bool)
        self._upper = np.empty(0)
        self._right = np.empty(0)
        self._missed = np.empty(0)
        self._curve = np.empty((0, 4))
        self._deviation = np.empty(0)
        self._settled = 0
        self._newest = -np.inf
        self._complete = False

    @property
    def horizon(self) -> float:
        """Time (s) up to which the curve will not change any more."""
        if not len(self._time):
            return self._newest if not self._waiting else -np.inf
        if self._complete or self._dark:
            return self._newest
        return float(self._time[self._settled])

    @property
    def _dark(self) -> bool:
        """Whether so long nothing came that no curve will lead on from here."""
        if self._waiting or not len(self._time):
            return False
        return self._newest - float(self._time[-1]) > self._gap

    def push(self, time: Array, value: Array, low: Flags, high: Flags) -> None:
        """Take samples.

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
        there = np.isfinite(value)
        side = np.where(high, 1.0, np.where(low, -1.0, 0.0))[there]
        if self._waiting or side.any():
            self._admit(time[there], value[there], side)
        else:
            self._append(time[there], value[there], np.zeros(int(there.sum())))
        if self._waiting and self._newest - self._waiting[-1][0] > self._gap:
            self._release(len(self._waiting))
        self._settle(len(self._time) - (1 if self._dark else AHEAD))

    def finish(self) -> None:
        """No sample will follow: settle with what is there."""
        if self._waiting:
            self._release(len(self._waiting))
        self._complete = True
        self._settle(len(self._time) - 1)

    def lit(self, instants: Array) -> Flags:
        """Whether the wheel's motion is known at instants (E,), s, not beyond the horizon."""
        if len(self._time) < 2:
            return np.zeros(len(instants), bool)
        at = np.searchsorted(self._time, instants + _SAME_INSTANT, side="right") - 1
        inside = (at >= 0) & (instants <= self._time[-1] + _SAME_INSTANT)
        at = np.clip(at, 0, len(self._time) - 1)
        closed = np.append(self._opens[1:], True)[at]
        return np.asarray(inside & (~closed | (np.abs(instants - self._time[at]) < _SAME_INSTANT)))

    def integrate(self, instants: Array, before: float) -> tuple[Array, Array, Flags]:
        """Moments of the acceleration over steps that end at instants.

        Parameters
        ----------
        instants : (E,) array
            In order, :meth:`lit`, not beyond :attr:`horizon`, s.
        before : float
            Where the first step begins, s.

        Returns
        -------
        moments : (E, ORDER) array
            ∫₀ʰ (h−s)ʲ/j! û ds.
        spread : (E, 2) array
            As ``step_moments`` fills it.
        known : (E,) bool array
            Whether a curve covers the whole step.
        """
        n = len(instants)
        moments, spread, known = np.zeros((n, ORDER)), np.zeros((n, 2)), np.ones(n, bool)
        closed = np.append(self._opens[1:], True)
        step_moments(
            instants, before, self._time, self._curve, self._deviation, closed,
            moments, spread, known,
        )  # fmt: skip
        return moments, spread, known

    def forget(self, before: float) -> None:
        """Drop samples that no step from ``before`` (s) on needs."""
        keep = int(np.searchsorted(self._time, before)) - 8
        keep = min(keep, self._settled - 8)
        if keep < 256:
            return
        for name in (
            "_time", "_value", "_reach", "_opens", "_upper", "_right", "_missed", "_curve",
            "_deviation",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name)[keep:].copy())
        self._settled -= keep

    def _admit(self, time: Array, value: Array, side: Array) -> None:
        """Take samples one by one, holding back what is clipped until its neighbours are known."""
        for t, v, s in zip(time.tolist(), value.tolist(), side.tolist(), strict=True):
            self._waiting.append((t, v, s))
            plain = 0
            for _, _, other in reversed(self._waiting):
                if other != 0.0:
                    break
                plain += 1
            if plain == len(self._waiting) or plain >= 2 or len(self._waiting) > _LONGEST_CLIP + 2:
                self._release(len(self._waiting))

    def _release(self, count: int) -> None:
        """Let waiting samples in, clipped ones where their neighbours point."""
        held = self._waiting[:count]
        del self._waiting[:count]
        time, value, side = (np.array(column) for column in zip(*held, strict=True))
        reach = np.zeros(count)
        clipped = side != 0.0
        if clipped.any():
            near = slice(max(len(self._time) - 2, 0), len(self._time))
            t = np.concatenate([self._time[near], time[~clipped]])
            v = np.concatenate([self._value[near], value[~clipped]])
            guess = _through(t, v, time[clipped]) if len(t) else value[clipped]
            beyond = side[clipped] * (guess - value[clipped])
            # A cubic over a wide gap can point anywhere: never further than the rail itself.
            beyond = np.clip(beyond, 0.0, np.abs(value[clipped]))
            value[clipped] += side[clipped] * beyond
            reach[clipped] = np.maximum(beyond, 0.1 * np.abs(value[clipped]))
        self._append(time, value, reach)

    def _append(self, time: Array, value: Array, reach: Array) -> None:
        n = len(time)
        if not n:
            return
        old = len(self._time)
        last = self._time[-1] if old else -np.inf
        opens = np.diff(time, prepend=last) > self._gap
        self._time = np.concatenate([self._time, time])
        self._value = np.concatenate([self._value, value])
        self._reach = np.concatenate([self._reach, reach])
        self._opens = np.concatenate([self._opens, opens])
        room = np.zeros(n)
        self._upper = np.concatenate([self._upper, room])
        self._right = np.concatenate([self._right, room])
        self._missed = np.concatenate([self._missed, room])
        self._deviation = np.concatenate([self._deviation, room])
        self._curve = np.concatenate([self._curve, np.zeros((n, 4))])
        eliminate(
            max(old - 1, 0), self._time, self._value, self._opens, self._upper, self._right
        )  # fmt: skip

    def _settle(self, upto: int) -> None:
        """Draw the curve over intervals that enough samples follow, or a gap."""
        opened = np.flatnonzero(self._opens)
        upto = max(upto, int(opened[-1]) if len(opened) else 0)
        first = self._settled
        if upto <= first:
            return
        missed(
            max(first - 1, 0), min(upto + 2, len(self._time)), self._time, self._value, self._opens,
            self._missed,
        )  # fmt: skip
        pieces(
            first, upto, AHEAD, self._time, self._value, self._opens, self._upper, self._right,
            self._curve,
        )  # fmt: skip
        rest = np.maximum(
            self._missed[max(first - 1, 0) : upto + 2] - _NOISE_MARGIN * self._noise, 0
        )
        padded = np.concatenate([np.zeros(1 if first == 0 else 0), rest, np.zeros(3)])
        n = upto - first
        local = 0.25 * (padded[:n] + padded[1 : n + 1] + padded[2 : n + 2] + padded[3 : n + 3])
        reach = 0.5 * (self._reach[first:upto] + self._reach[first + 1 : upto + 1])
        self._deviation[first:upto] = np.maximum(_JUMP_SHARE * np.sqrt(local), reach)
        self._settled = upto


def _through(time: Array, value: Array, at: Array) -> Array:
    """Polynomial through a few samples (Lagrange) at other times."""
    out = np.zeros(len(at))
    for j in range(len(time)):
        weight = np.ones(len(at))
        for other in range(len(time)):
            if other != j:
                weight *= (at - time[other]) / (time[j] - time[other])
        out += weight * value[j]
    return out
