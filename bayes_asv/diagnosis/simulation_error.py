"""The gap between measured and simulated chassis accelerations, and what noise alone would leave.

A model is carried to a recording with everything frozen but its biases and its initial state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from bayes_asv.filters.kalman import VALUE
from bayes_asv.filters.noise_simulation import normals_needed, simulate_noise
from bayes_asv.models.effects import Site
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, foretold_at
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["Gap", "Left", "before_and_after", "closed", "grew", "left_over"]

Array = NDArray[np.float64]

_RECORDS = 24  # of noise
_NOISE_ROUNDS = 4
_BLOCK = 0.25  # s, of the bootstrap: longer than the body's motion remembers
_BOOTSTRAP = 4999


@dataclass(frozen=True)
class Left:
    """Measured less simulated, run by run.

    Parameters
    ----------
    residual : tuple of (R, 2) arrays
        m/s², nan where there is no value.
    times : tuple of (R,) arrays
        When, s.
    floor : tuple of float
        Root-mean-square that sensor noise alone would leave in each run, m/s².
    """

    residual: tuple[Array, ...]
    times: tuple[Array, ...]
    floor: tuple[float, ...]

    @property
    def rms(self) -> float:
        """Root-mean-square over all runs and both channels."""
        return float(np.sqrt(np.nanmean(np.concatenate([r.ravel() for r in self.residual]) ** 2)))

    @property
    def noise(self) -> float:
        """Root-mean-square that noise alone would leave over all runs."""
        weight = np.array([np.count_nonzero(np.isfinite(r)) for r in self.residual])
        return float(np.sqrt(weight @ np.array(self.floor) ** 2 / weight.sum()))


@dataclass(frozen=True)
class Gap:
    """A gap before and after effects were added.

    Parameters
    ----------
    before, after, floor : float
        Root-mean-squares, m/s².
    worse : bool
        After is larger than before by more than its bootstrap interval allows.
    """

    before: float
    after: float
    floor: float
    worse: bool

    @property
    def closed(self) -> float | None:
        """Share of the gap above the floor that was closed; None when there was none."""
        return closed(self.before, self.after, self.floor)


def closed(before: float, after: float, floor: float) -> float | None:
    """Share of a gap above the floor that was closed."""
    there = before**2 - floor**2
    return 1.0 - (after**2 - floor**2) / there if there > 0.0 else None


def _frozen(where: Dataset, stage: FittedModel, own: bool) -> tuple[Posterior, Array]:
    """Carry a stage's car and effects to recordings; what acted in one run only stays there."""
    sites: tuple[Site, ...] = tuple(s for s in stage.sites if own or s.run is None)
    target = where.target(sites)
    z = stage.carried_to(target.space)
    if any(s.effect.acts == "reading" for s in sites):  # what a sensor does follows from its signal
        target = foretold_at(where, target, z).target(sites)
    return target, _own_noise(target, z)


def _own_noise(target: Posterior, z: Array) -> Array:
    """Estimate noise levels again, everything else as it is."""
    lasting = target.space.lasting_dimension
    z = z.copy()
    z[lasting:] = 0.0
    for _ in range(_NOISE_ROUNDS):
        here = slopes(target, z, first=lasting)
        step = np.linalg.solve(here.precision()[lasting:, lasting:], here.gradient(z)[lasting:])
        z[lasting:] += np.clip(step, -1.0, 1.0)
    return z


def left_over(where: Dataset, stage: FittedModel, seed: int, *, own: bool = False) -> Left:
    """Simulate recordings and take the difference, car and effects frozen.

    Parameters
    ----------
    where : Dataset
        Recordings; the model need not have seen them.
    stage : FittedModel
        The model.
    seed : int
        Of the noise that the floor is measured with.
    own : bool
        The recordings are those that the model was fitted to: a push that acts in one acts there.
    """
    target, z = _frozen(where, stage, own)
    residual, times, floor = [], [], []
    for run, line in enumerate(where.lines):
        output, _, _ = free_run(target, z, run)
        there = line.kind == VALUE
        left = np.where(there, line.reading - output, np.nan)
        residual.append(line.paired(left))
        times.append(line.instants[line.pairs.max(axis=1)])
        rng = np.random.default_rng([seed, run, 31])
        needed = normals_needed(len(line.wheels), line.kind.shape[1])
        out = simulate_noise(
            target.space.state_space(z[None], run),
            target.space.noises(z[None], run),
            line.measurements._replace(spread=line.noise_spread),
            rng.standard_normal((len(line.step), _RECORDS, needed)),
        )
        floor.append(float(np.sqrt(np.mean(out.transpose(0, 2, 1)[there] ** 2))))
    return Left(tuple(residual), tuple(times), tuple(floor))


def grew(before: Left, after: Left, seed: int) -> bool:
    """Whether the gap grew beyond a block bootstrap's 95 % interval (Künsch 1989).

    Of so few blocks percentiles alone are too narrow; they are taken further out, as Student's t
    is wider than a normal (the expanded percentile interval: Hesterberg 2015, Am. Stat. 69:371).
    """
    blocks = []
    for one, two, time in zip(before.residual, after.residual, before.times, strict=True):
        if np.any(np.isfinite(one) & ~np.isfinite(two)):
            return True  # a simulation that ran away
        at = ((time - time[0]) / _BLOCK).astype(int)
        growth = np.nansum(two**2 - one**2, axis=1)
        blocks += [float(growth[at == k].sum()) for k in range(int(at.max()) + 1)]
    each = np.array(blocks)
    n = len(each)
    if n < 3:
        return bool(each.sum() > 0.0)
    level = norm.cdf(-math.sqrt(n / (n - 1)) * t.isf(0.025, n - 1))
    rng = np.random.default_rng([seed, 41])
    drawn = rng.choice(each, (_BOOTSTRAP, n)).sum(axis=1)
    return bool(np.quantile(drawn, level) > 0.0)


def before_and_after(
    where: Dataset, base: FittedModel, final: FittedModel, seed: int, *, own: bool = False
) -> Gap:
    """Gap of recordings before and after, cars and effects frozen.

    Noise has to cover for what a model gets wrong, so that the floor is that of the model under
    which it is least: a bandwidth that was none left 1.23 before and 1.35 after on a run that was
    held out, 1.32 of it believed to be noise.

    Parameters
    ----------
    base, final : FittedModel
        Without and with what was added.
    where, seed, own
        As :func:`left_over` takes them; the seed is that of the bootstrap as well.
    """
    one = left_over(where, base, seed, own=own)
    two = left_over(where, final, seed, own=own)
    return Gap(one.rms, two.rms, min(one.noise, two.noise), grew(one, two, seed))
