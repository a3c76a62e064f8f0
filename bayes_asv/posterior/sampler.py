"""Draws from a posterior: importance sampling, or emcee ensembles where that fails.

If a posterior is nearly normal, draws from a Student t are weighted by the posterior and resampled.
The first proposal is shaped by the curvature at the mode, the next one by the weighted draws so
far.  Four streams of draws are independent of each other, and the Pareto shape of the largest
weights tells whether the weights can be trusted (Vehtari et al. 2024, Journal of Machine Learning
Research 25, 72).

If they cannot, four emcee ensembles start at different points and stay independent of each other,
so that R̂ compares independent chains (walkers of one ensemble are not independent).  Proposals are
drawn from a Student t fitted to the burn-in, mixed with differential evolution, which explores
where proposals of the first kind are seldom accepted.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass, replace

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.domain.progress import Progress
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

N_CHAINS = 4  # independent streams or ensembles
_TAILS = (0.05, 0.95)  # quantiles whose effective sample size is required
_BURN = ((8, 4), (12, 8))  # burn-in stages: steps, and last steps that shape the next proposal
WALKERS = 32  # least number of walkers of an ensemble
_BLOCK = 30  # steps between the first checks of convergence
MAX_STEPS = 800  # steps of an ensemble after which sampling gives up


@dataclass(frozen=True)
class PosteriorDraws:
    """Draws and their convergence diagnostics.

    Parameters
    ----------
    draws : (N_CHAINS, S·W, D) array
        Coordinates; the walkers of an ensemble are interleaved in time order.
    log_posterior : (N_CHAINS, S·W) array
        Log-posterior of the draws, not normalised.
    rhat_max, ess_bulk_min, ess_tail_min : float
        R̂ and effective sample sizes of the worst coordinate.
    converged : bool
        Whether R̂ < 1.01 and both effective sample sizes are at least 1000.
    acceptance : float
        Mean share of accepted proposals; nan for independent draws.
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
        """Keep every n-th draw, at most ``most`` in all."""
        every = -(-self.log_posterior.size // most)
        kept = slice(every - 1, None, every)
        return replace(self, draws=self.draws[:, kept], log_posterior=self.log_posterior[:, kept])


_FIRST_BATCH = 256  # draws of each stream from the first proposal, a power of two
_LARGEST_BATCH = 2048  # largest batch of each stream from the adapted proposal
# Share of effective draws in the first batch below which it cannot shape a proposal.
_MIN_EFFICIENCY = 0.1
_MAX_PARETO_SHAPE = 0.5  # Pareto shape of the weights above which their variance is infinite


def importance_resample(
    posterior: Density, mode: PosteriorMode, seed: int, progress: Progress | None = None
) -> PosteriorDraws | None:
    """Draw from adapted proposals, weight by the posterior, and resample.

    All draws are weighted by the mixture of the proposals (Veach & Guibas 1995).  The effective
    sample size of a mean is the variance over Σ w² (x − mean)²; for a tail probability, x is the
    indicator of the tail.

    Parameters
    ----------
    posterior, mode, seed, progress
        As for :func:`sample_mcmc`.

    Returns
    -------
    PosteriorDraws or None
        As many draws of equal weight as are effective; None if the weights cannot be trusted.
    """
    proposals: list[Proposal] = []
    counts: list[int] = []
    d = len(mode.z)
    streams = [np.random.default_rng([seed, 37, e]) for e in range(N_CHAINS)]
    z, logs = np.zeros((N_CHAINS, 0, d)), np.zeros((N_CHAINS, 0))
    proposal, count = Proposal.around(mode, INFLATION), _FIRST_BATCH
    with threads() as pool:
        while count <= _LARGEST_BATCH:
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
                if 1.0 / np.sum(weight**2) < _MIN_EFFICIENCY * len(flat):
                    return None
                importlib.import_module("arviz_stats.base")
            bulk, tail = effective_sizes(flat, weight)
            if progress is not None:
                progress(min(bulk / ESS_WANTED, tail / ESS_WANTED, 1.0), f"{bulk:.0f} draws")
            if min(bulk, tail) >= ESS_WANTED and _pareto_tail(log_ratio) <= _MAX_PARETO_SHAPE:
                resampled = _resample(z, logs, weight, int(min(bulk, tail)) // N_CHAINS, streams)
                rhat = convergence_diagnostics(resampled.draws[:, :, None])[0]
                if rhat < RHAT_WANTED:
                    return replace(resampled, rhat_max=rhat, ess_bulk_min=bulk, ess_tail_min=tail)
            # inflated: a proposal as narrow as the draws would miss the tails that they missed
            proposal, count = Proposal.through(flat, INFLATION, weight), 2 * count
    return None


def effective_sizes(z: Array, weight: Array) -> tuple[float, float]:
    """Smallest effective sample sizes of weighted draws (N, D): of a mean, and of a tail."""
    square = (z - weight @ z) ** 2
    bulk = float(np.min((weight @ square) / (weight**2 @ square)))
    tail = math.inf
    for x in z.T:
        order = np.argsort(x)
        cumulative, squares = np.cumsum(weight[order]), np.cumsum(weight[order] ** 2)
        for end in _TAILS:
            last = int(np.searchsorted(cumulative, end))
            p, inside = float(cumulative[last]), float(squares[last])
            error = inside * (1.0 - p) ** 2 + (float(squares[-1]) - inside) * p**2
            # without an error, one draw has all the weight
            tail = min(tail, p * (1.0 - p) / error if error > 0.0 else 1.0)
    return bulk, tail


def _pareto_tail(log_ratio: Array) -> float:
    """Pareto shape k of the largest weights; their moments below 1/k are finite."""
    from arviz_stats.base import array_stats

    # psislw takes log-likelihoods and forms the weights from their negatives
    return float(array_stats.psislw(-log_ratio)[1])


def _resample(
    z: Array, logs: Array, weight: Array, size: int, streams: list[np.random.Generator]
) -> PosteriorDraws:
    """Resample each stream to ``size`` draws of equal weight, in random order."""
    draws, chosen = [], []
    for points, log, w, stream in zip(z, logs, weight.reshape(logs.shape), streams, strict=True):
        cumulative = np.cumsum(w) / w.sum()
        places = (np.arange(size) + stream.random()) / size  # systematic: few duplicates
        at = stream.permutation(np.minimum(np.searchsorted(cumulative, places), len(w) - 1))
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
    """Sample a posterior with emcee ensembles until they agree.

    Parameters
    ----------
    posterior : Density
        The posterior.
    mode : PosteriorMode
        Its mode and curvature, for the initial walkers and the first proposals.
    seed : int
        Seed of the random numbers.
    progress : callable, optional
        Called with the share done (0 to 1) and a short text.
    most : int
        Largest number of steps.

    Returns
    -------
    PosteriorDraws
        ``converged`` is false if ``most`` steps were not enough.
    """
    d = len(mode.z)
    walkers = max(WALKERS, 2 * (d + 2))
    with threads() as pool:
        proposal = Proposal.around(mode, INFLATION)
        streams = [np.random.RandomState([seed, e]) for e in range(N_CHAINS)]
        places = [_initial_walkers(posterior, proposal, walkers, stream) for stream in streams]
        for stage, (burn, kept) in enumerate(_BURN):
            samplers = _samplers(posterior, proposal, walkers, [seed, N_CHAINS + stage])
            running = pool.map(_advance, samplers, places, [burn] * N_CHAINS)
            if stage == 0:
                importlib.import_module("arviz_stats.base")  # half a second, while they burn in
            ends = list(running)
            places = [end.coords for end in ends]
            # the burn-in replaces the curvature at the mode; the proposal is fixed while sampling
            burned_in = [s.get_chain(flat=True, discard=burn - kept) for s in samplers]
            proposal = Proposal.through(np.concatenate(burned_in), 1.1)
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
    """Sample the posterior of one or several runs, by importance sampling if possible.

    With several runs, only their shared coordinates are sampled; those of single runs are drawn
    afterwards (:mod:`bayes_asv.posterior.shared_posterior`).  The parameters are those of
    :func:`sample_mcmc`.
    """
    if len(posterior.space.recordings) == 1:
        return _sample(posterior, mode, seed, progress, most)
    shared = SharedPosterior(posterior, mode)
    sampled = _sample(shared, shared.mode, seed, progress, most)
    count, length, d = sampled.draws.shape
    rng = np.random.default_rng([seed, 31])
    z, change = shared.completed(sampled.draws.reshape(-1, d), rng)
    return replace(
        sampled,
        draws=z.reshape(count, length, -1),
        log_posterior=sampled.log_posterior + change.reshape(count, length),
    )


def _sample(
    posterior: Density, mode: PosteriorMode, seed: int, progress: Progress | None, most: int
) -> PosteriorDraws:
    resampled = importance_resample(posterior, mode, seed, progress)
    return sample_mcmc(posterior, mode, seed, progress, most) if resampled is None else resampled


def independent_draws(posterior: Density, draws: Array) -> PosteriorDraws:
    """Wrap independent draws (N_CHAINS, S, D) as converged."""
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
        Draws, by ensemble, step, walker and coordinate.

    Returns
    -------
    rhat, bulk, tail : float
        R̂ is rank-normalised and split, with each ensemble as one chain.  Effective sample sizes
        treat walkers as chains, so that every disagreement between them reduces the sizes (Vehtari
        et al. 2021).
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
    """Create one sampler for each ensemble, each with its own stream of random numbers."""
    d = len(proposal.middle)
    moves = [(emcee.moves.MHMove(proposal, ndim=d), 0.9), (emcee.moves.DEMove(), 0.1)]
    out = []
    for ensemble in range(N_CHAINS):
        sampler = emcee.EnsembleSampler(
            walkers, d, posterior.log_posterior, moves=moves, vectorize=True
        )
        # without emcee's wrapper, which prints a traceback when Ctrl-C interrupts a likelihood
        sampler.log_prob_fn = posterior.log_posterior
        sampler.random_state = np.random.RandomState([*seed, ensemble]).get_state()
        out.append(sampler)
    return out


def _initial_walkers(
    posterior: Density, proposal: Proposal, walkers: int, random: np.random.RandomState
) -> Array:
    """Draw the initial walkers from the proposal, where the posterior is finite."""
    for _ in range(100):
        z = proposal.draw(4 * walkers, random)
        z = z[np.isfinite(posterior.log_posterior(z))]
        if len(z) >= walkers:
            return z[:walkers]
    return np.asarray(proposal.middle + 1e-6 * random.normal(size=(walkers, len(z.T))))
