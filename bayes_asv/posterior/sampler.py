"""Draws from a posterior: independent emcee ensembles that run until they agree, or weighted draws.

Four ensembles start apart and never exchange anything, so that R̂ between them means what it
says (walkers of one ensemble are not independent chains).  Proposals are drawn from a
Student t shaped by what burn-in found, mixed with differential evolution: where the posterior
is nearly normal almost every step is a fresh draw, and where it is not the second move still
explores.

Weighted draws (importance sampling) are as good where a posterior is nearly normal, and faster: for
work that needs thousands of posteriors (calibration, planning) or a run at a time.  The weights
say themselves when they cannot be trusted.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import chi2, qmc

from bayes_asv.posterior.convergence import ESS_WANTED, RHAT_WANTED
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.newton import Mode
from bayes_asv.posterior.shared_posterior import SharedPosterior
from bayes_asv.posterior.threads import threads

__all__ = [
    "DEGREES_OF_FREEDOM",
    "ENSEMBLES",
    "MAX_STEPS",
    "WALKERS",
    "Ensembles",
    "Proposal",
    "WeightedDraws",
    "importance_sample",
    "independent_draws",
    "run_ensembles",
    "sample_runs",
]

DEGREES_OF_FREEDOM = 20.0  # of the Student t: a little wider in the tails than a normal


class Proposal:
    """Independence proposal: a multivariate t, bent to the skew of each coordinate.

    A point z is bent to y = (z − m)/s with one scale s left and another right of m; y is a
    Student t with the given covariance.  Callable as emcee's MHMove wants it.
    """

    def __init__(self, middle: Array, left: Array, right: Array, covariance: Array) -> None:
        self.middle, self.left, self.right = middle, left, right
        self.root = np.linalg.cholesky(covariance)
        self.inverse = np.linalg.inv(self.root)
        d = len(middle)
        self._log_constant = (
            math.lgamma(0.5 * (DEGREES_OF_FREEDOM + d))
            - math.lgamma(0.5 * DEGREES_OF_FREEDOM)
            - 0.5 * d * math.log(DEGREES_OF_FREEDOM * math.pi)
            - float(np.sum(np.log(np.diag(self.root))))
        )

    @classmethod
    def around(cls, mode: Mode, inflation: float) -> Proposal:
        """From the curvature at the mode."""
        one = mode.sd
        return cls(mode.z, one, one, inflation * mode.covariance / np.outer(one, one))

    @classmethod
    def through(cls, points: Array, inflation: float) -> Proposal:
        """From draws (N, D)."""
        # Scales from the tails: a walker in a tail that is never proposed again gets stuck.
        low, middle, high = np.quantile(points, [0.05, 0.5, 0.95], axis=0)
        left = np.maximum(middle - low, 1e-12) / 1.645
        right = np.maximum(high - middle, 1e-12) / 1.645
        skewed = (points - middle) / np.where(points < middle, left, right)
        d = points.shape[1]
        spread = skewed.T @ skewed / len(skewed) + 1e-6 * np.eye(d)
        return cls(middle, left, right, inflation * spread)

    def log_density(self, z: Array) -> Array:
        """Log density (N,) at points (N, D)."""
        scale = np.where(z < self.middle, self.left, self.right)
        u = ((z - self.middle) / scale) @ self.inverse.T
        power = 0.5 * (DEGREES_OF_FREEDOM + z.shape[1])
        radial = -power * np.log1p(np.sum(u**2, axis=1) / DEGREES_OF_FREEDOM)
        return np.asarray(self._log_constant + radial - np.sum(np.log(scale), axis=1))

    def draw(self, count: int, random: np.random.RandomState) -> Array:
        """Draw (count, D) points."""
        stretch = np.sqrt(
            DEGREES_OF_FREEDOM / random.chisquare(DEGREES_OF_FREEDOM, size=(count, 1))
        )
        return self.skewed(random.normal(size=(count, len(self.middle))) * stretch)

    def skewed(self, t: Array) -> Array:
        """Points (N, D) from standard Student t variables (N, D)."""
        y = t @ self.root.T
        return np.asarray(self.middle + y * np.where(y < 0.0, self.left, self.right))

    def __call__(self, z: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose (N, D) points and the logarithms (N,) of their Metropolis–Hastings factors."""
        q = self.draw(len(z), random)
        return q, self.log_density(z) - self.log_density(q)


Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

ENSEMBLES = 4
_TAILS = (0.05, 0.95)
_BURN = ((8, 4), (12, 8))  # steps of each stage, and how many of the last shape the next
WALKERS = 32
_BLOCK = 30
MAX_STEPS = 800


@dataclass(frozen=True)
class Ensembles:
    """Draws and how far they can be trusted.

    Parameters
    ----------
    draws : (ENSEMBLES, S·W, D) array
        Coordinates, each ensemble's walkers interleaved in time order.
    log_posterior : (ENSEMBLES, S·W) array
        Not normalised.
    rhat_max, ess_bulk_min, ess_tail_min : float
        Worst coordinate.
    converged : bool
        R̂ < 1.01 and both sizes at least 1000.
    acceptance : float
        Mean share of accepted proposals.
    """

    draws: Array
    log_posterior: Array
    rhat_max: float
    ess_bulk_min: float
    ess_tail_min: float
    converged: bool
    acceptance: float

    def thinned(self, most: int) -> Ensembles:
        """Keep every n-th draw, as many as there may be at most in all."""
        every = -(-self.log_posterior.size // most)
        kept = slice(every - 1, None, every)
        return replace(self, draws=self.draws[:, kept], log_posterior=self.log_posterior[:, kept])


class Density(Protocol):
    """Whatever gives a log density (W,) at points (W, D), finite or −inf."""

    def log_posterior(self, z: Array) -> Array:
        """Log density, not normalised."""
        ...


def run_ensembles(
    target: Density, mode: Mode, seed: int, progress: Progress | None = None, most: int = MAX_STEPS
) -> Ensembles:
    """Sample the posterior.

    Parameters
    ----------
    target : Density
        The posterior.
    mode : Mode
        Its mode and curvature: where ensembles start and what they propose at first.
    seed : int
        Same seed, same draws.
    progress : callable, optional
        Told the share done (0 to 1) and a few words.
    most : int
        Steps after which it gives up.

    Returns
    -------
    Ensembles
        ``converged`` is false when ``most`` steps were not enough.
    """
    d = len(mode.z)
    walkers = max(WALKERS, 2 * (d + 2))
    with threads() as pool:
        proposal = Proposal.around(mode, 1.2)
        streams = [np.random.RandomState([seed, e]) for e in range(ENSEMBLES)]
        places = [_start(target, proposal, walkers, stream) for stream in streams]
        for stage, (burn, used) in enumerate(_BURN):
            samplers = _samplers(target, proposal, walkers, [seed, ENSEMBLES + stage])
            running = pool.map(_advance, samplers, places, [burn] * ENSEMBLES)
            if stage == 0:
                importlib.import_module("arviz_stats.base")  # half a second, while they burn in
            ends = list(running)
            places = [end.coords for end in ends]
            # What burn-in found replaces the curvature at the mode; fixed while draws are kept.
            found = [s.get_chain(flat=True, discard=burn - used) for s in samplers]
            proposal = Proposal.through(np.concatenate(found), 1.1)
        samplers = _samplers(target, proposal, walkers, [seed, ENSEMBLES + len(_BURN)])
        steps, block = 0, _BLOCK
        while True:
            places = [
                end.coords for end in pool.map(_advance, samplers, places, [block] * ENSEMBLES)
            ]
            steps += block
            chains = np.stack([s.get_chain() for s in samplers])  # (E, S, W, D)
            rhat, bulk, tail = diagnose(chains)
            done = rhat < RHAT_WANTED and min(bulk, tail) >= ESS_WANTED
            if progress is not None:
                share = min(bulk, tail) / ESS_WANTED
                progress(min(share, 1.0), f"R̂ {rhat:.3f}, effective draws {min(bulk, tail):.0f}")
            if done or steps >= most:
                break
            block = min(max(steps // 4, 16), most - steps)
    return Ensembles(
        draws=chains.reshape(ENSEMBLES, -1, d),
        log_posterior=np.stack([s.get_log_prob() for s in samplers]).reshape(ENSEMBLES, -1),
        rhat_max=rhat,
        ess_bulk_min=bulk,
        ess_tail_min=tail,
        converged=done,
        acceptance=float(np.mean([s.acceptance_fraction.mean() for s in samplers])),
    )


def sample_runs(
    target: Posterior,
    mode: Mode,
    seed: int,
    progress: Progress | None = None,
    most: int = MAX_STEPS,
) -> Ensembles:
    """Sample the posterior of one run or of several.

    Of several the walkers move in the coordinates that all share; those of single runs are drawn
    for them afterwards (:mod:`bayes_asv.posterior.shared_posterior`).  Parameters are those of
    :func:`run_ensembles`.
    """
    if len(target.space.timelines) == 1:
        return run_ensembles(target, mode, seed, progress, most)
    shared = SharedPosterior(target, mode)
    found = run_ensembles(shared, shared.mode, seed, progress, most)
    count, length, d = found.draws.shape
    rng = np.random.default_rng([seed, 31])
    z, change = shared.completed(found.draws.reshape(-1, d), rng)
    return replace(
        found,
        draws=z.reshape(count, length, -1),
        log_posterior=found.log_posterior + change.reshape(count, length),
    )


def independent_draws(target: Density, draws: Array) -> Ensembles:
    """Take independent draws (ENSEMBLES, S, D) for ensembles that have converged."""
    count, _, d = draws.shape
    rhat, bulk, tail = diagnose(draws.reshape(count, -1, 1, d))
    log_posterior = target.log_posterior(draws.reshape(-1, d)).reshape(count, -1)
    return Ensembles(draws, log_posterior, rhat, bulk, tail, converged=True, acceptance=math.nan)


def diagnose(chains: Array) -> tuple[float, float, float]:
    """Worst R̂ between ensembles and worst bulk and tail effective sizes.

    Parameters
    ----------
    chains : (E, S, W, D) array
        Ensembles, steps, walkers, coordinates.

    Returns
    -------
    rhat, bulk, tail : float
        R̂ is rank-normalised and split, each ensemble one chain; sizes count walkers as
        chains, which charges them for every disagreement (Vehtari et al. 2021).
    """
    from arviz_stats.base import array_stats

    e, s, w, d = chains.shape
    rhat, bulk, tail = 1.0, math.inf, math.inf
    for k in range(d):
        x = chains[..., k]
        rhat = max(rhat, float(array_stats.rhat(x.reshape(e, s * w), method="rank")))
        each = x.transpose(0, 2, 1).reshape(e * w, s)
        bulk = min(bulk, float(array_stats.ess(each, method="bulk")))
        tail = min(tail, float(array_stats.ess(each, method="tail", prob=_TAILS)))
    return rhat, bulk, tail


def _advance(sampler: emcee.EnsembleSampler, place: Array, steps: int) -> emcee.State:
    return sampler.run_mcmc(place, steps)


def _samplers(
    target: Density, proposal: Proposal, walkers: int, seed: list[int]
) -> list[emcee.EnsembleSampler]:
    """Set up one sampler an ensemble, each with a stream of its own."""
    d = len(proposal.middle)
    moves = [(emcee.moves.MHMove(proposal, ndim=d), 0.9), (emcee.moves.DEMove(), 0.1)]
    out = []
    for ensemble in range(ENSEMBLES):
        sampler = emcee.EnsembleSampler(
            walkers, d, target.log_posterior, moves=moves, vectorize=True
        )
        sampler.random_state = np.random.RandomState([*seed, ensemble]).get_state()
        out.append(sampler)
    return out


def _start(
    target: Density, proposal: Proposal, walkers: int, random: np.random.RandomState
) -> Array:
    """Walkers spread as the proposal, each where the posterior is finite."""
    for _ in range(100):
        z = proposal.draw(4 * walkers, random)
        z = z[np.isfinite(target.log_posterior(z))]
        if len(z) >= walkers:
            return z[:walkers]
    return np.asarray(proposal.middle + 1e-6 * random.normal(size=(walkers, len(z.T))))


_INFLATION = 1.2  # of the curvature's covariance, so that no tail is left out


@dataclass(frozen=True)
class WeightedDraws:
    """Weighted draws of a posterior.

    Parameters
    ----------
    z : (S, D) array
        Coordinates.
    weight : (S,) array
        Weights, summing to one.
    log_evidence : float
        Logarithm of the integral of likelihood times prior.
    """

    z: Array
    weight: Array
    log_evidence: float

    @property
    def effective(self) -> float:
        """Effective number of draws, 1 / Σ w² (Kong 1992)."""
        return float(1.0 / np.sum(self.weight**2))

    def mean(self, value: Array) -> float:
        """Mean of a function of the draws (S,)."""
        return float(self.weight @ value)

    def below(self, value: Array, truth: float) -> float:
        """Posterior probability that a function of the draws (S,) lies below a truth."""
        share = self.weight @ (value < truth) + 0.5 * self.weight @ (value == truth)
        return min(1.0, float(share))  # weights sum to one but for rounding

    def quantile(self, value: Array, share: Array) -> Array:
        """Quantiles of a function of the draws (S,)."""
        order = np.argsort(value)
        reached = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return np.asarray(np.interp(share, reached, value[order]))

    def sd(self, value: Array) -> float:
        """Deviation of a function of the draws (S,)."""
        return float(np.sqrt(self.weight @ (value - self.mean(value)) ** 2))


def importance_sample(target: Density, mode: Mode, count: int, seed: int) -> WeightedDraws:
    """Draw evenly from a Student t at the mode and weigh by the posterior.

    Parameters
    ----------
    target : Density
        The posterior.
    mode : Mode
        Its mode and curvature.
    count : int
        Number of draws, a power of two: scrambled Sobol points, which fill space more evenly
        than chance does.
    seed : int
        Same seed, same draws.

    Returns
    -------
    Weighted
    """
    proposal = Proposal.around(mode, _INFLATION)
    d = len(mode.z)
    even = qmc.Sobol(d + 1, rng=np.random.default_rng(seed)).random(count)
    stretch = np.sqrt(DEGREES_OF_FREEDOM / chi2.ppf(even[:, d:], DEGREES_OF_FREEDOM))
    z = proposal.skewed(ndtri(even[:, :d]) * stretch)
    log_ratio = target.log_posterior(z) - proposal.log_density(z)
    top = float(np.max(log_ratio))
    weight = np.exp(log_ratio - top)
    total = float(weight.sum())
    return WeightedDraws(z, weight / total, top + float(np.log(total / count)))
