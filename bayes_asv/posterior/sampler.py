"""Draws from a posterior: independent ones that are weighted, or emcee ensembles until they agree.

Where a posterior is nearly normal, draws from a Student t that was shaped twice, by the curvature
at the mode and then by the first draws, are weighted by the posterior and resampled.  Four streams
of draws never exchange anything, and the tail of the weights says whether they can be trusted
(Vehtari et al. 2024, Journal of Machine Learning Research 25, 72).

Where they cannot, four emcee ensembles start apart and never exchange anything, so that R̂ between
them means what it says (walkers of one ensemble are not independent chains).  Proposals are drawn
from a Student t shaped by what burn-in found, mixed with differential evolution, which explores
where the first kind is seldom accepted.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.posterior.convergence import ESS_WANTED, RHAT_WANTED
from bayes_asv.posterior.importance import INFLATION, Density, Proposal
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.newton import PosteriorMode
from bayes_asv.posterior.shared_posterior import SharedPosterior
from bayes_asv.posterior.threads import threads

__all__ = [
    "MAX_STEPS",
    "N_CHAINS",
    "WALKERS",
    "PosteriorDraws",
    "importance_resample",
    "independent_draws",
    "sample_mcmc",
    "sample_posterior",
]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

N_CHAINS = 4
_TAILS = (0.05, 0.95)
_BURN = ((8, 4), (12, 8))  # steps of each stage, and how many of the last shape the next
WALKERS = 32
_BLOCK = 30
MAX_STEPS = 800


@dataclass(frozen=True)
class PosteriorDraws:
    """Draws and how far they can be trusted.

    Parameters
    ----------
    draws : (N_CHAINS, S·W, D) array
        Coordinates, each ensemble's walkers interleaved in time order.
    log_posterior : (N_CHAINS, S·W) array
        Not normalised.
    rhat_max, ess_bulk_min, ess_tail_min : float
        Worst coordinate.
    converged : bool
        R̂ < 1.01 and both sizes at least 1000.
    acceptance : float
        Mean share of accepted proposals; nan of independent draws.
    sampler : str
        ``ensembles`` of emcee, ``weighted draws`` or ``normal approximation``.
    """

    draws: Array
    log_posterior: Array
    rhat_max: float
    ess_bulk_min: float
    ess_tail_min: float
    converged: bool
    acceptance: float
    sampler: str = "ensembles"

    def thinned(self, most: int) -> PosteriorDraws:
        """Keep every n-th draw, as many as there may be at most in all."""
        every = -(-self.log_posterior.size // most)
        kept = slice(every - 1, None, every)
        return replace(self, draws=self.draws[:, kept], log_posterior=self.log_posterior[:, kept])


_FIRST = 256  # draws of each stream from the curvature at the mode, a power of two
_LARGEST = 2048  # and the most that are drawn at a time from what they shaped
_USELESS = 0.1  # share of effective draws below which the first do not shape a proposal
_TRUSTED = 0.5  # of the Pareto tail of weights: beyond it their variance is infinite


def importance_resample(
    posterior: Density, mode: PosteriorMode, seed: int, progress: Progress | None = None
) -> PosteriorDraws | None:
    """Draw independently, and weigh by the posterior.

    All draws have the weights of one mixture of the proposals (Veach & Guibas 1995).  The effective
    size of a mean is its variance over Σ w² (x − mean)², and so is that of a tail, of which x says
    whether a draw is in it.

    Parameters
    ----------
    posterior, mode, seed, progress
        As for :func:`sample_mcmc`.

    Returns
    -------
    PosteriorDraws or None
        As many draws as are effective, each of equal weight; None where the weights cannot be
        trusted.
    """
    proposals: list[Proposal] = []
    counts: list[int] = []
    d = len(mode.z)
    streams = [np.random.default_rng([seed, 37, e]) for e in range(N_CHAINS)]
    z, logs = np.zeros((N_CHAINS, 0, d)), np.zeros((N_CHAINS, 0))
    proposal, count = Proposal.around(mode, INFLATION), _FIRST
    with threads() as pool:
        while count <= _LARGEST:
            new = [proposal.even(count, stream) for stream in streams]
            logs = np.hstack([logs, np.stack(list(pool.map(posterior.log_posterior, new)))])
            z = np.concatenate([z, np.stack(new)], axis=1)
            proposals, counts = [*proposals, proposal], [*counts, count]
            flat, share = z.reshape(-1, d), np.array(counts) / sum(counts)
            of_each = np.stack([p.log_density(flat) for p in proposals], axis=1)
            log_ratio = logs.ravel() - logsumexp(of_each, axis=1, b=share)
            if not np.isfinite(log_ratio.max()):
                return None
            weight = np.exp(log_ratio - log_ratio.max())
            weight /= weight.sum()
            if len(proposals) == 1:
                if 1.0 / np.sum(weight**2) < _USELESS * len(flat):
                    return None
                importlib.import_module("arviz_stats.base")
            bulk, tail = effective_sizes(flat, weight)
            if progress is not None:
                progress(min(bulk / ESS_WANTED, tail / ESS_WANTED, 1.0), f"{bulk:.0f} draws")
            if min(bulk, tail) >= ESS_WANTED and _pareto_tail(log_ratio) <= _TRUSTED:
                found = _resampled(z, logs, weight, int(min(bulk, tail)) // N_CHAINS, streams)
                rhat = convergence_diagnostics(found.draws[:, :, None])[0]
                if rhat < RHAT_WANTED:
                    return replace(found, rhat_max=rhat, ess_bulk_min=bulk, ess_tail_min=tail)
            # A proposal that is no wider than the posterior misses what its own draws missed.
            proposal, count = Proposal.through(flat, INFLATION, weight), 2 * count
    return None


def effective_sizes(z: Array, weight: Array) -> tuple[float, float]:
    """Effective sizes of weighted draws (N, D): of the means and of the tails, the least of all."""
    square = (z - weight @ z) ** 2
    bulk = float(np.min((weight @ square) / (weight**2 @ square)))
    tail = math.inf
    for x in z.T:
        order = np.argsort(x)
        reached, squares = np.cumsum(weight[order]), np.cumsum(weight[order] ** 2)
        for end in _TAILS:
            last = int(np.searchsorted(reached, end))
            p, inside = float(reached[last]), float(squares[last])
            error = inside * (1.0 - p) ** 2 + (float(squares[-1]) - inside) * p**2
            tail = min(tail, p * (1.0 - p) / error if error > 0.0 else 1.0)  # one draw is all of it
    return bulk, tail


def _pareto_tail(log_ratio: Array) -> float:
    """Shape of the tail of weights, of which moments below its inverse exist."""
    from arviz_stats.base import array_stats

    # It takes the logarithm of a likelihood, whose inverse are the weights.
    return float(array_stats.psislw(-log_ratio)[1])


def _resampled(
    z: Array, logs: Array, weight: Array, size: int, streams: list[np.random.Generator]
) -> PosteriorDraws:
    """Draw (N_CHAINS, size) draws of equal weight, each stream its own, in random order."""
    draws, chosen = [], []
    for points, log, w, stream in zip(z, logs, weight.reshape(logs.shape), streams, strict=True):
        reached = np.cumsum(w) / w.sum()
        places = (np.arange(size) + stream.random()) / size  # systematic: few draws come twice
        at = stream.permutation(np.minimum(np.searchsorted(reached, places), len(w) - 1))
        draws.append(points[at])
        chosen.append(log[at])
    return PosteriorDraws(
        np.stack(draws), np.stack(chosen), math.nan, math.nan, math.nan, converged=True,
        acceptance=math.nan, sampler="weighted draws",
    )  # fmt: skip


def sample_mcmc(
    posterior: Density,
    mode: PosteriorMode,
    seed: int,
    progress: Progress | None = None,
    most: int = MAX_STEPS,
) -> PosteriorDraws:
    """Sample the posterior.

    Parameters
    ----------
    posterior : Density
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
    PosteriorDraws
        ``converged`` is false when ``most`` steps were not enough.
    """
    d = len(mode.z)
    walkers = max(WALKERS, 2 * (d + 2))
    with threads() as pool:
        proposal = Proposal.around(mode, INFLATION)
        streams = [np.random.RandomState([seed, e]) for e in range(N_CHAINS)]
        places = [_start(posterior, proposal, walkers, stream) for stream in streams]
        for stage, (burn, used) in enumerate(_BURN):
            samplers = _samplers(posterior, proposal, walkers, [seed, N_CHAINS + stage])
            running = pool.map(_advance, samplers, places, [burn] * N_CHAINS)
            if stage == 0:
                importlib.import_module("arviz_stats.base")  # half a second, while they burn in
            ends = list(running)
            places = [end.coords for end in ends]
            # What burn-in found replaces the curvature at the mode; fixed while draws are kept.
            found = [s.get_chain(flat=True, discard=burn - used) for s in samplers]
            proposal = Proposal.through(np.concatenate(found), 1.1)
        samplers = _samplers(posterior, proposal, walkers, [seed, N_CHAINS + len(_BURN)])
        steps, block = 0, _BLOCK
        while True:
            places = [
                end.coords for end in pool.map(_advance, samplers, places, [block] * N_CHAINS)
            ]
            steps += block
            chains = np.stack([s.get_chain() for s in samplers])  # (E, S, W, D)
            rhat, bulk, tail = convergence_diagnostics(chains)
            done = rhat < RHAT_WANTED and min(bulk, tail) >= ESS_WANTED
            if progress is not None:
                share = min(bulk, tail) / ESS_WANTED
                progress(min(share, 1.0), f"R̂ {rhat:.3f}, effective draws {min(bulk, tail):.0f}")
            if done or steps >= most:
                break
            block = min(max(steps // 4, 16), most - steps)
    return PosteriorDraws(
        draws=chains.reshape(N_CHAINS, -1, d),
        log_posterior=np.stack([s.get_log_prob() for s in samplers]).reshape(N_CHAINS, -1),
        rhat_max=rhat,
        ess_bulk_min=bulk,
        ess_tail_min=tail,
        converged=done,
        acceptance=float(np.mean([s.acceptance_fraction.mean() for s in samplers])),
    )


def sample_posterior(
    posterior: Posterior,
    mode: PosteriorMode,
    seed: int,
    progress: Progress | None = None,
    most: int = MAX_STEPS,
) -> PosteriorDraws:
    """Sample the posterior of one run or of several, by weights where those can be trusted.

    Of several the draws are of the coordinates that all share; those of single runs are drawn
    for them afterwards (:mod:`bayes_asv.posterior.shared_posterior`).  Parameters are those of
    :func:`sample_mcmc`.
    """
    if len(posterior.space.recordings) == 1:
        return _sampled(posterior, mode, seed, progress, most)
    shared = SharedPosterior(posterior, mode)
    found = _sampled(shared, shared.mode, seed, progress, most)
    count, length, d = found.draws.shape
    rng = np.random.default_rng([seed, 31])
    z, change = shared.completed(found.draws.reshape(-1, d), rng)
    return replace(
        found,
        draws=z.reshape(count, length, -1),
        log_posterior=found.log_posterior + change.reshape(count, length),
    )


def _sampled(
    posterior: Density, mode: PosteriorMode, seed: int, progress: Progress | None, most: int
) -> PosteriorDraws:
    found = importance_resample(posterior, mode, seed, progress)
    return sample_mcmc(posterior, mode, seed, progress, most) if found is None else found


def independent_draws(posterior: Density, draws: Array) -> PosteriorDraws:
    """Take independent draws (N_CHAINS, S, D) for ensembles that have converged."""
    count, _, d = draws.shape
    rhat, bulk, tail = convergence_diagnostics(draws.reshape(count, -1, 1, d))
    log_posterior = posterior.log_posterior(draws.reshape(-1, d)).reshape(count, -1)
    return PosteriorDraws(
        draws, log_posterior, rhat, bulk, tail, converged=True, acceptance=math.nan,
        sampler="normal approximation",
    )  # fmt: skip


def convergence_diagnostics(chains: Array) -> tuple[float, float, float]:
    """Worst R̂ between ensembles and worst bulk and tail effective sizes.

    Parameters
    ----------
    chains : (E, S, W, D) array
        PosteriorDraws, steps, walkers, coordinates.

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
    posterior: Density, proposal: Proposal, walkers: int, seed: list[int]
) -> list[emcee.EnsembleSampler]:
    """Set up one sampler an ensemble, each with a stream of its own."""
    d = len(proposal.middle)
    moves = [(emcee.moves.MHMove(proposal, ndim=d), 0.9), (emcee.moves.DEMove(), 0.1)]
    out = []
    for ensemble in range(N_CHAINS):
        sampler = emcee.EnsembleSampler(
            walkers, d, posterior.log_posterior, moves=moves, vectorize=True
        )
        # without the wrapper that prints a traceback when Ctrl-C breaks off a likelihood
        sampler.log_prob_fn = posterior.log_posterior
        sampler.random_state = np.random.RandomState([*seed, ensemble]).get_state()
        out.append(sampler)
    return out


def _start(
    posterior: Density, proposal: Proposal, walkers: int, random: np.random.RandomState
) -> Array:
    """Walkers spread as the proposal, each where the posterior is finite."""
    for _ in range(100):
        z = proposal.draw(4 * walkers, random)
        z = z[np.isfinite(posterior.log_posterior(z))]
        if len(z) >= walkers:
            return z[:walkers]
    return np.asarray(proposal.middle + 1e-6 * random.normal(size=(walkers, len(z.T))))
