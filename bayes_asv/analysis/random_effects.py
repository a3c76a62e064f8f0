"""Random-effects model of several runs of one car: whether they differ, and by how much.

Every run r has a Gaussian likelihood exp(h_rᵀθ − ½ θᵀH_r θ) over the car's coordinates θ.  The
given values (mass, springs, weight fraction) are shared by all runs, so an error in them is common
to all and no difference between runs; c_f, c_r and i may differ::

    θ_r = θ + B u_r,    u_r ~ N(0, diag τ²),    θ ~ N(0, I)

with u_r in logarithms and B = ∂θ/∂u.  Given τ the model is Gaussian, so only the three standard
deviations τ are integrated numerically, over a grid.  This is the normal–normal model of
meta-analysis (DerSimonian & Laird 1986; Röver 2020) with three outcomes and shared nuisance
parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

__all__ = [
    "LARGEST_SPREAD",
    "MIN_INFORMATION",
    "SAME",
    "SPREAD_SCALE",
    "HomogeneityTest",
    "RandomEffectsPosterior",
    "RunLikelihood",
    "estimates_of_runs",
    "fit_random_effects",
    "homogeneity_test",
    "likelihood_of_run",
    "pseudo_inverse",
]  # fmt: skip

Array = NDArray[np.float64]

SPREAD_SCALE = 0.03
"""Median of the half-Cauchy prior of every τ (logarithms): 3 % between runs.

Oil temperature, fuel and the position of the driver change a rate by a few per cent; wear, or a
nonlinear damper on another road, by tens of per cent, which the Cauchy tail allows (Gelman 2006).
"""
LARGEST_SPREAD = 1.0
"""Upper bound of τ, a factor e at one standard deviation: beyond it, it is not the same car."""

SAME = 0.5
"""Prior probability that a parameter is the same in all runs, independently for each one: an
adjusted front damper implies nothing about the rear one."""

# Spread, relative to the smallest standard deviation of a run, below which it has no effect.
_NO_EFFECT = 0.03
_MIN_VARIANCE = 1e-16  # lower bound of a posterior variance, in prior variances
MIN_INFORMATION = 0.1
"""Information about a direction, relative to the prior's, below which it counts as none."""
_COARSE, _FINE = 11, 21  # nodes for each τ on the first and on the final grid
_EDGE = 1e-4  # probability mass that the final grid may omit at either end


class RunLikelihood(NamedTuple):
    """Gaussian likelihood of one run over the car's n coordinates.

    Parameters
    ----------
    precision : (n, n) array
        H, positive semidefinite.
    linear : (n,) array
        h.
    """

    precision: Array
    linear: Array

    def around(self, centre: Array) -> RunLikelihood:
        """Return the same likelihood in coordinates relative to ``centre``."""
        return RunLikelihood(self.precision, self.linear - self.precision @ centre)


class HomogeneityTest(NamedTuple):
    """A likelihood-ratio test of equal runs.

    Parameters
    ----------
    q : float
        Twice the gain in log-likelihood if runs may differ.
    freedom : int
        Degrees of freedom: number of contrasts that the data determine.  Under equal runs, q is χ²
        distributed.
    """

    q: float
    freedom: int

    @property
    def p(self) -> float:
        """p-value: probability of at least this gain for equal runs; nan without a contrast."""
        if self.freedom == 0:
            return math.nan
        return float(gammaincc(0.5 * self.freedom, 0.5 * max(self.q, 0.0)))


def likelihood_of_run(mean: Array, covariance: Array) -> RunLikelihood:
    """Divide a Gaussian posterior by the standard normal prior.

    Parameters
    ----------
    mean, covariance : (n,) and (n, n) arrays
        Posterior of one run alone.

    Returns
    -------
    RunLikelihood
        Its precision is zero in directions about which the run has almost no information.
    """
    eigen, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    information = 1.0 / np.maximum(eigen, _MIN_VARIANCE) - 1.0
    is_informative = information > MIN_INFORMATION
    information = np.where(is_informative, information, 0.0)
    # the mean of the likelihood is that of the posterior, without the shrinkage by the prior
    linear = np.where(is_informative, (vectors.T @ mean) * (1.0 + information), 0.0)
    return RunLikelihood((vectors * information) @ vectors.T, vectors @ linear)


def homogeneity_test(
    run_likelihoods: Sequence[RunLikelihood], directions: Array, which: Sequence[int] | None = None
) -> HomogeneityTest:
    """Test whether runs have the same parameters.

    Parameters
    ----------
    run_likelihoods : sequence of RunLikelihood
        One a run.
    directions : (n, 3) array
        B; a column of zeros for a parameter that is given as exact.
    which : sequence of int, optional
        Columns of B that are tested, with the others free to differ; all of them by default.

    Returns
    -------
    HomogeneityTest
        The common value of a free parameter has a flat prior here: a conflict between data and
        prior is not a difference between runs.
    """
    identified = [k for k in range(directions.shape[1]) if np.any(directions[:, k] != 0.0)]
    tested = [k for k in (identified if which is None else which) if k in identified]
    others = [k for k in identified if k not in tested]
    if len(run_likelihoods) < 2 or not tested:
        return HomogeneityTest(0.0, 0)
    basis, _ = np.linalg.qr(directions[:, identified])
    prior = np.eye(len(directions)) - basis @ basis.T
    total = prior + sum(run_likelihood.precision for run_likelihood in run_likelihoods)
    centre = np.linalg.pinv(total, hermitian=True) @ sum(
        run_likelihood.linear for run_likelihood in run_likelihoods
    )
    relative = [run_likelihood.around(centre) for run_likelihood in run_likelihoods]
    linear_prior = -prior @ centre
    full, full_rank = _max_log_likelihood(relative, prior, linear_prior, directions[:, identified])
    restricted, restricted_rank = _max_log_likelihood(
        relative, prior, linear_prior, directions[:, others]
    )
    return HomogeneityTest(2.0 * (full - restricted), full_rank - restricted_rank)


def _max_log_likelihood(
    run_likelihoods: Sequence[RunLikelihood], prior: Array, linear_prior: Array, free: Array
) -> tuple[float, int]:
    """Maximum log-likelihood with columns free in every run, and the rank of the fit."""
    precision, linear = prior.copy(), linear_prior.copy()
    value, rank = 0.0, 0
    # in units of the coordinates, in which a prior standard deviation is one
    unit = free / np.maximum(np.linalg.norm(free, axis=0), 1e-300)
    for H, h in run_likelihoods:
        inverse, added_rank = pseudo_inverse(unit.T @ H @ unit)
        score = unit.T @ h
        cross = H @ unit @ inverse
        precision += H - cross @ unit.T @ H
        linear += h - cross @ score
        value += 0.5 * float(score @ inverse @ score)
        rank += added_rank
    inverse, added_rank = pseudo_inverse(precision)
    return value + 0.5 * float(linear @ inverse @ linear), rank + added_rank


def pseudo_inverse(matrix: Array) -> tuple[Array, int]:
    """Pseudo-inverse on the numerical range of a positive semidefinite matrix, and the rank."""
    if not matrix.size:
        return matrix, 0
    eigen, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    # differences of large precisions have rounding errors
    is_informative = eigen > max(0.5 * MIN_INFORMATION, 1e-9 * float(eigen[-1]))
    inverse = np.where(is_informative, 1.0 / np.where(is_informative, eigen, 1.0), 0.0)
    return (vectors * inverse) @ vectors.T, int(np.count_nonzero(is_informative))


def estimates_of_runs(
    run_likelihood: RunLikelihood, directions: Array, centre: Array
) -> tuple[Array, Array]:
    """Estimate the parameters from one run alone, with shared coordinates fixed.

    Parameters
    ----------
    run_likelihood : RunLikelihood
        The run.
    directions : (n, 3) array
        B.
    centre : (n,) array
        Coordinates at which the given values are fixed.

    Returns
    -------
    shift, sd : (3,) arrays
        Logarithm of each parameter relative to ``centre``, and its standard deviation; nan and
        infinite if the run has no information.
    """
    shift, sd = np.full(directions.shape[1], np.nan), np.full(directions.shape[1], np.inf)
    identified = [k for k in range(directions.shape[1]) if np.any(directions[:, k] != 0.0)]
    B = directions[:, identified]
    size = np.linalg.norm(B, axis=0)
    unit = B / size
    inverse, rank = pseudo_inverse(unit.T @ run_likelihood.precision @ unit)
    if rank == len(identified):
        shift[identified] = inverse @ (unit.T @ run_likelihood.around(centre).linear) / size
        sd[identified] = np.sqrt(np.diag(inverse)) / size
    return shift, sd


@dataclass(frozen=True)
class RandomEffectsPosterior:
    """Draws of the random-effects model.

    Parameters
    ----------
    centre : (S, n) array
        Coordinates θ of the mean car.
    spread : (S, 3) array
        Standard deviations τ between runs, in logarithms; zero if all runs share a value.
    next_run : (S, n) array
        Coordinates of a further run.
    log_density : (S,) array
        Log posterior density of (θ, log τ), not normalised; log probability for zero τ.
    """

    centre: Array
    spread: Array
    next_run: Array
    log_density: Array


def fit_random_effects(
    run_likelihoods: Sequence[RunLikelihood], directions: Array, count: int, seed: int
) -> RandomEffectsPosterior:
    """Draw from the posterior of the mean car and of the spread of runs about it.

    Parameters
    ----------
    run_likelihoods : sequence of RunLikelihood
        One a run.
    directions : (n, 3) array
        B.
    count : int
        Number of draws.
    seed : int
        Seed of the draws.

    Returns
    -------
    RandomEffectsPosterior
        The spread of a parameter that is given as exact is zero.
    """
    rng = np.random.default_rng([seed, 5])
    n, free = directions.shape
    total = np.eye(n) + sum(run_likelihood.precision for run_likelihood in run_likelihoods)
    reference = np.linalg.solve(
        total, np.asarray(sum(run_likelihood.linear for run_likelihood in run_likelihoods))
    )
    relative = [run_likelihood.around(reference) for run_likelihood in run_likelihoods]
    axes = _coarse_axes(run_likelihoods, directions, reference)
    weight = _grid_weights(axes, relative, directions, reference)[1]
    axes = [
        _refine_axis(axis, mass) for axis, mass in zip(axes, _marginals(axes, weight), strict=True)
    ]
    nodes, weight = _grid_weights(axes, relative, directions, reference)
    pick = np.searchsorted(np.cumsum(weight), (rng.random() + np.arange(count)) / count)
    pick = rng.permutation(np.minimum(pick, len(weight) - 1))
    width = np.array([_width(axis) for axis in axes])
    spread = np.exp(nodes[pick] + width * (rng.random((count, free)) - 0.5))
    mean, root, log_evidence = _given_spread(spread, relative, directions, reference)
    shift = rng.standard_normal((count, n))
    offset = np.linalg.solve(np.swapaxes(root, 1, 2), shift[:, :, None])[:, :, 0]
    centre = reference + mean + offset
    log_det = np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    density = (
        log_evidence + _log_prior(spread, directions) + log_det - 0.5 * np.sum(shift**2, axis=1)
    )
    next_run = centre + (rng.standard_normal((count, free)) * spread) @ directions.T
    return RandomEffectsPosterior(centre, spread, next_run, density)


def _coarse_axes(
    run_likelihoods: Sequence[RunLikelihood], directions: Array, middle: Array
) -> list[Array]:
    """Nodes of log τ for each parameter: −∞, then from a negligible spread to the largest."""
    sds = np.array(
        [
            estimates_of_runs(run_likelihood, directions, middle)[1]
            for run_likelihood in run_likelihoods
        ]
    )
    least = np.where(np.isfinite(sds), sds, SPREAD_SCALE).min(axis=0) * _NO_EFFECT
    top = math.log(LARGEST_SPREAD)
    return [
        np.append(-np.inf, np.linspace(math.log(min(low, 0.01)), top, _COARSE) if is_free else [])
        for low, is_free in zip(least, np.any(directions != 0.0, axis=0), strict=True)
    ]


def _log_prior(spread: Array, directions: Array) -> Array:
    """Log prior (G,) of spreads (G, 3): probability of zero, or density of log τ."""
    some = spread > 0.0
    safe = np.where(some, spread, 1.0) / SPREAD_SCALE
    slab = np.log(safe) - np.log1p(safe**2) + math.log(2.0 / math.pi * (1.0 - SAME))
    none = np.where(np.any(directions != 0.0, axis=0), math.log(SAME), 0.0)
    return np.asarray(np.sum(np.where(some, slab, none), axis=1))


def _grid_weights(
    axes: list[Array], run_likelihoods: Sequence[RunLikelihood], directions: Array, middle: Array
) -> tuple[Array, Array]:
    """Nodes (G, 3) of log τ and their posterior weights (G,)."""
    nodes = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    spread = np.exp(nodes)
    value = (
        _log_prior(spread, directions)
        + _given_spread(spread, run_likelihoods, directions, middle)[2]
    )
    for k, axis in enumerate(axes):
        value += np.where(spread[:, k] > 0.0, math.log(_width(axis) or 1.0), 0.0)
    weight = np.exp(value - value.max())
    return nodes, weight / weight.sum()


def _width(axis: Array) -> float:
    """Distance between the nodes of nonzero spread."""
    return float(axis[2] - axis[1]) if len(axis) > 2 else 0.0


def _marginals(axes: list[Array], weight: Array) -> list[Array]:
    """Posterior mass of every node of every axis."""
    box = weight.reshape([len(axis) for axis in axes])
    every = range(len(axes))
    return [box.sum(axis=tuple(j for j in every if j != k)) for k in every]


def _refine_axis(axis: Array, mass: Array) -> Array:
    """Finer nodes over the part of an axis with nearly all of the mass of nonzero spread."""
    some = mass[1:]
    if len(axis) == 1 or not some.sum() > 0.0:
        return axis
    below = np.cumsum(some) / some.sum()
    first = max(int(np.searchsorted(below, _EDGE)) - 1, 0)
    last = min(int(np.searchsorted(below, 1.0 - _EDGE)) + 1, len(some) - 1)
    return np.append(-np.inf, np.linspace(axis[1 + first], axis[1 + last], _FINE))


def _given_spread(
    spread: Array, run_likelihoods: Sequence[RunLikelihood], directions: Array, middle: Array
) -> tuple[Array, Array, Array]:
    """Mean car given each of G spreads: mean (G, n), root of its precision, log evidence (G,).

    The deviations u_r of the runs are integrated out: a run's likelihood then has the precision
    H − H B W Bᵀ H, where W = D (I + D BᵀHB D)⁻¹ D and D = diag τ.
    """
    count, free = spread.shape
    n = len(directions)
    precision = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    linear = np.broadcast_to(-middle, (count, n)).copy()
    log_evidence = np.zeros(count)
    for H, h in run_likelihoods:
        HB, score = H @ directions, directions.T @ h
        inner = spread[:, :, None] * (directions.T @ HB) * spread[:, None, :] + np.eye(free)
        root = np.linalg.cholesky(inner)
        half = np.linalg.solve(root, spread[:, :, None] * np.eye(free))  # W = halfᵀ half
        cross = half @ HB.T
        precision += H - np.swapaxes(cross, 1, 2) @ cross
        half_score = half @ score
        linear += h - np.einsum("gan,ga->gn", cross, half_score)
        log_evidence += 0.5 * np.sum(half_score**2, axis=1)
        log_evidence -= np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    root = np.linalg.cholesky(precision)
    half = np.linalg.solve(root, linear[:, :, None])
    mean = np.linalg.solve(np.swapaxes(root, 1, 2), half)[:, :, 0]
    log_evidence += 0.5 * np.sum(half[:, :, 0] ** 2, axis=1)
    log_evidence -= np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    return mean, np.asarray(root), log_evidence
