"""Independent emcee ensembles, run until they agree.

Four ensembles start apart and never exchange anything, so that R̂ between them means what it
says (walkers of one ensemble are not independent chains).  Proposals are drawn from a
Student t around the mode, mixed with differential evolution: where the posterior is nearly
normal almost every step is a fresh draw, and where it is not the second move still explores.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import emcee
import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from bayes_asv.inference.likelihood import Target
from bayes_asv.inference.mode import Mode

__all__ = ["ENSEMBLES", "Ensembles", "run_ensembles"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

ENSEMBLES = 4
ESS_WANTED = 1000.0
RHAT_WANTED = 1.01
_TAILS = (0.05, 0.95)
_FREEDOM = 20.0  # of the Student t: a little wider in the tails than a normal
_BURN = 16
_BLOCK = 20
_MOST = 6000  # steps


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


class _StudentProposal:
    """Independence proposal from a multivariate t; callable as emcee's MHMove wants it."""

    def __init__(self, centre: Array, covariance: Array) -> None:
        self.centre = centre
        self.root = np.linalg.cholesky(covariance)
        self.inverse = np.linalg.inv(self.root)

    def _log_density(self, x: Array) -> Array:
        u = (x - self.centre) @ self.inverse.T
        d = x.shape[1]
        return np.asarray(-0.5 * (_FREEDOM + d) * np.log1p(np.sum(u**2, axis=1) / _FREEDOM))

    def draw(self, count: int, random: np.random.RandomState) -> Array:
        """Draw (count, D) points."""
        d = len(self.centre)
        scale = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, size=(count, 1)))
        return np.asarray(self.centre + (random.normal(size=(count, d)) * scale) @ self.root.T)

    def __call__(self, x: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        q = self.draw(len(x), random)
        return q, self._log_density(x) - self._log_density(q)


def run_ensembles(
    target: Target, mode: Mode, seed: int, progress: Progress | None = None, most: int = _MOST
) -> Ensembles:
    """Sample the posterior.

    Parameters
    ----------
    target : Target
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
    walkers = max(32, 2 * (d + 2))
    states = [np.random.RandomState([seed, e]) for e in range(ENSEMBLES)]
    wide = _StudentProposal(mode.z, 1.2 * mode.covariance)
    with ThreadPoolExecutor(2) as pool:
        places = [_start(target, wide, walkers, state) for state in states]
        samplers = [_sampler(target, wide, walkers, state) for state in states]
        ends = list(pool.map(_advance, samplers, places, [_BURN] * ENSEMBLES))
        # What burn-in found replaces the curvature at the mode; fixed from here on.
        found = np.concatenate([s.get_chain(flat=True, discard=_BURN // 2) for s in samplers])
        centre = found.mean(axis=0)
        spread = np.cov(found.T).reshape(d, d) + 1e-3 * mode.covariance
        moved = _StudentProposal(centre, 1.1 * spread)
        states = [np.random.RandomState([seed, ENSEMBLES + e]) for e in range(ENSEMBLES)]
        samplers = [_sampler(target, moved, walkers, state) for state in states]
        places = [end.coords for end in ends]
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
            block = min(max(steps // 2, _BLOCK), most - steps)
    return Ensembles(
        draws=chains.reshape(ENSEMBLES, -1, d),
        log_posterior=np.stack([s.get_log_prob() for s in samplers]).reshape(ENSEMBLES, -1),
        rhat_max=rhat,
        ess_bulk_min=bulk,
        ess_tail_min=tail,
        converged=done,
        acceptance=float(np.mean([s.acceptance_fraction.mean() for s in samplers])),
    )


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


def _sampler(
    target: Target, proposal: _StudentProposal, walkers: int, random: np.random.RandomState
) -> emcee.EnsembleSampler:
    d = len(proposal.centre)
    sampler = emcee.EnsembleSampler(
        walkers,
        d,
        target.log_posterior,
        moves=[(emcee.moves.MHMove(proposal, ndim=d), 0.8), (emcee.moves.DEMove(), 0.2)],
        vectorize=True,
    )
    sampler.random_state = random.get_state()
    return sampler


def _start(
    target: Target, proposal: _StudentProposal, walkers: int, random: np.random.RandomState
) -> Array:
    """Walkers spread as the proposal, each where the posterior is finite."""
    for _ in range(100):
        z = proposal.draw(4 * walkers, random)
        z = z[np.isfinite(target.log_posterior(z))]
        if len(z) >= walkers:
            return z[:walkers]
    return np.asarray(
        proposal.centre
        + 1e-3 * random.normal(size=(walkers, len(proposal.centre))) @ proposal.root.T
    )
