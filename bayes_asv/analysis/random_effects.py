"""Do the runs of one car differ, and by how much: a random-effects model of several runs.

Every run r speaks of the car's coordinates θ through a Gaussian likelihood, its *site*
exp(h_rᵀθ − ½ θᵀH_r θ).  The given values (mass, springs, weight share) are shared by all runs,
so an error in them is common and no disagreement; c_f, c_r and i may differ::

    θ_r = θ + B u_r,    u_r ~ N(0, diag τ²),    θ ~ N(0, I)

with u_r in logarithms and B the way from those to the coordinates.  Given τ all is Gaussian,
so only the three deviations τ are integrated numerically, over a grid.  This is the
normal–normal model of meta-analysis (DerSimonian & Laird 1986; Röver 2020) with three outcomes
and shared nuisance parameters.
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
"""Median of the half-Cauchy prior of every τ (logarithms): 3 % from run to run.

Warm oil, fuel and a driver who sits elsewhere move a rate by a few per cent; a worn damper or a
nonlinear one over another road by tens, which the Cauchy tail leaves room for (Gelman 2006).
"""
LARGEST_SPREAD = 1.0
"""A τ beyond this, a factor e at one deviation, is no longer the same car."""

SAME = 0.5
"""Prior probability that a quantity is the same in all runs, for each by itself: a front damper
that was turned is no reason to doubt the rear one."""

_NO_EFFECT = 0.03  # share of the smallest own deviation below which a spread changes nothing
_SHARPEST = 1e-16  # variance, in those of the prior: nothing is known better
_SILENT = 0.1  # a direction of which a run says less than a tenth of what the prior says
_COARSE, _FINE = 11, 21  # nodes a deviation, first and final grid
_EDGE = 1e-4  # share of the mass that the final grid may leave out at either end


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
        """Return the same likelihood with the coordinates counted from ``centre``."""
        return RunLikelihood(self.precision, self.linear - self.precision @ centre)


class HomogeneityTest(NamedTuple):
    """A likelihood-ratio test of equal runs.

    Parameters
    ----------
    q : float
        Twice the gain in log-likelihood when runs may differ.
    freedom : int
        Contrasts that the data see; q is χ² with so many when the runs are alike.
    """

    q: float
    freedom: int

    @property
    def p(self) -> float:
        """Probability of so large a gain among equal runs; nan when nothing can be compared."""
        if self.freedom == 0:
            return math.nan
        return float(gammaincc(0.5 * self.freedom, 0.5 * max(self.q, 0.0)))


def likelihood_of_run(mean: Array, covariance: Array) -> RunLikelihood:
    """Take the standard normal prior out of a Gaussian posterior.

    Parameters
    ----------
    mean, covariance : (n,) and (n, n) arrays
        Posterior of one run alone.

    Returns
    -------
    RunLikelihood
        Nothing is left in directions that the run is silent about.
    """
    eigen, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    told = 1.0 / np.maximum(eigen, _SHARPEST) - 1.0
    speaks = told > _SILENT
    told = np.where(speaks, told, 0.0)
    # A site's own mean is the posterior's, scaled back from the pull of the prior.
    linear = np.where(speaks, (vectors.T @ mean) * (1.0 + told), 0.0)
    return RunLikelihood((vectors * told) @ vectors.T, vectors @ linear)


def homogeneity_test(
    run_likelihoods: Sequence[RunLikelihood], way: Array, which: Sequence[int] | None = None
) -> HomogeneityTest:
    """Test whether runs share their values.

    Parameters
    ----------
    run_likelihoods : sequence of RunLikelihood
        One a run.
    way : (n, 3) array
        B; a column of zeros for a quantity that is given as exact.
    which : sequence of int, optional
        Columns of B that are tested, with the others free to differ; all of them by default.

    Returns
    -------
    Contrast
        The common value of a free quantity has a flat prior here: that the data disagree with
        a prior is not that runs disagree with each other.
    """
    seen = [k for k in range(way.shape[1]) if np.any(way[:, k] != 0.0)]
    tested = [k for k in (seen if which is None else which) if k in seen]
    others = [k for k in seen if k not in tested]
    if len(run_likelihoods) < 2 or not tested:
        return HomogeneityTest(0.0, 0)
    turned, _ = np.linalg.qr(way[:, seen])
    prior = np.eye(len(way)) - turned @ turned.T
    together = prior + sum(run_likelihood.precision for run_likelihood in run_likelihoods)
    centre = np.linalg.pinv(together, hermitian=True) @ sum(
        run_likelihood.linear for run_likelihood in run_likelihoods
    )
    near = [run_likelihood.around(centre) for run_likelihood in run_likelihoods]
    pull = -prior @ centre
    full, full_rank = _highest(near, prior, pull, way[:, seen])
    held, held_rank = _highest(near, prior, pull, way[:, others])
    return HomogeneityTest(2.0 * (full - held), full_rank - held_rank)


def _highest(
    run_likelihoods: Sequence[RunLikelihood], prior: Array, pull: Array, free: Array
) -> tuple[float, int]:
    """Largest log-likelihood with columns free in every run, and the rank of what was fitted."""
    precision, linear = prior.copy(), pull.copy()
    value, rank = 0.0, 0
    # In units of the coordinates, in which a prior deviation is one.
    unit = free / np.maximum(np.linalg.norm(free, axis=0), 1e-300)
    for H, h in run_likelihoods:
        inverse, found = pseudo_inverse(unit.T @ H @ unit)
        own = unit.T @ h
        cross = H @ unit @ inverse
        precision += H - cross @ unit.T @ H
        linear += h - cross @ own
        value += 0.5 * float(own @ inverse @ own)
        rank += found
    inverse, found = pseudo_inverse(precision)
    return value + 0.5 * float(linear @ inverse @ linear), rank + found


def pseudo_inverse(matrix: Array) -> tuple[Array, int]:
    """Inverse of a positive semidefinite matrix where it says anything, and its rank."""
    if not matrix.size:
        return matrix, 0
    eigen, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    # Differences of large precisions leave rounding behind.
    speaks = eigen > max(0.5 * _SILENT, 1e-9 * float(eigen[-1]))
    inverse = np.where(speaks, 1.0 / np.where(speaks, eigen, 1.0), 0.0)
    return (vectors * inverse) @ vectors.T, int(np.count_nonzero(speaks))


def estimates_of_runs(
    run_likelihood: RunLikelihood, way: Array, centre: Array
) -> tuple[Array, Array]:
    """Ask one run alone for its values when what runs share is held.

    Parameters
    ----------
    run_likelihood : RunLikelihood
        The run.
    way : (n, 3) array
        B.
    centre : (n,) array
        Coordinates at which the given values are held.

    Returns
    -------
    shift, sd : (3,) arrays
        Logarithm of each value against that at ``centre``, and its deviation; nan and infinite
        where the run says nothing.
    """
    shift, sd = np.full(way.shape[1], np.nan), np.full(way.shape[1], np.inf)
    seen = [k for k in range(way.shape[1]) if np.any(way[:, k] != 0.0)]
    B = way[:, seen]
    size = np.linalg.norm(B, axis=0)
    unit = B / size
    inverse, rank = pseudo_inverse(unit.T @ run_likelihood.precision @ unit)
    if rank == len(seen):
        shift[seen] = inverse @ (unit.T @ run_likelihood.around(centre).linear) / size
        sd[seen] = np.sqrt(np.diag(inverse)) / size
    return shift, sd


@dataclass(frozen=True)
class RandomEffectsPosterior:
    """Draws of the random-effects model.

    Parameters
    ----------
    centre : (S, n) array
        Coordinates θ of the mean car.
    spread : (S, 3) array
        Deviations τ from run to run, in logarithms; zero where all runs share a value.
    next_run : (S, n) array
        Coordinates of a run to come.
    log_density : (S,) array
        Logarithm of the posterior density of (θ, log τ), not normalised; where τ is zero, of its
        probability.
    """

    centre: Array
    spread: Array
    next_run: Array
    log_density: Array


def fit_random_effects(
    run_likelihoods: Sequence[RunLikelihood], way: Array, count: int, seed: int
) -> RandomEffectsPosterior:
    """Posterior of the mean car and of the spread of runs about it.

    Parameters
    ----------
    run_likelihoods : sequence of RunLikelihood
        One a run.
    way : (n, 3) array
        B.
    count : int
        Number of draws.
    seed : int
        Same seed, same draws.

    Returns
    -------
    RandomEffectsPosterior
        The deviation of a quantity that is given as exact is zero.
    """
    rng = np.random.default_rng([seed, 5])
    n, free = way.shape
    total = np.eye(n) + sum(run_likelihood.precision for run_likelihood in run_likelihoods)
    middle = np.linalg.solve(
        total, np.asarray(sum(run_likelihood.linear for run_likelihood in run_likelihoods))
    )
    near = [run_likelihood.around(middle) for run_likelihood in run_likelihoods]
    axes = _first_axes(run_likelihoods, way, middle)
    weight = _on_grid(axes, near, way, middle)[1]
    axes = [
        _narrowed(axis, mass) for axis, mass in zip(axes, _marginals(axes, weight), strict=True)
    ]
    nodes, weight = _on_grid(axes, near, way, middle)
    pick = np.searchsorted(np.cumsum(weight), (rng.random() + np.arange(count)) / count)
    pick = rng.permutation(np.minimum(pick, len(weight) - 1))
    width = np.array([_width(axis) for axis in axes])
    spread = np.exp(nodes[pick] + width * (rng.random((count, free)) - 0.5))
    mean, root, log_evidence = _given_spread(spread, near, way, middle)
    shift = rng.standard_normal((count, n))
    offset = np.linalg.solve(np.swapaxes(root, 1, 2), shift[:, :, None])[:, :, 0]
    centre = middle + mean + offset
    log_det = np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    density = log_evidence + _log_prior(spread, way) + log_det - 0.5 * np.sum(shift**2, axis=1)
    fresh = centre + (rng.standard_normal((count, free)) * spread) @ way.T
    return RandomEffectsPosterior(centre, spread, fresh, density)


def _first_axes(run_likelihoods: Sequence[RunLikelihood], way: Array, middle: Array) -> list[Array]:
    """Nodes of log τ for each quantity: none at all, then from no effect to the largest."""
    own = np.array(
        [estimates_of_runs(run_likelihood, way, middle)[1] for run_likelihood in run_likelihoods]
    )
    least = np.where(np.isfinite(own), own, SPREAD_SCALE).min(axis=0) * _NO_EFFECT
    top = math.log(LARGEST_SPREAD)
    return [
        np.append(-np.inf, np.linspace(math.log(min(low, 0.01)), top, _COARSE) if there else [])
        for low, there in zip(least, np.any(way != 0.0, axis=0), strict=True)
    ]


def _log_prior(spread: Array, way: Array) -> Array:
    """Log prior (G,) of spreads (G, 3): the chance of none, or the density of log τ."""
    some = spread > 0.0
    safe = np.where(some, spread, 1.0) / SPREAD_SCALE
    slab = np.log(safe) - np.log1p(safe**2) + math.log(2.0 / math.pi * (1.0 - SAME))
    none = np.where(np.any(way != 0.0, axis=0), math.log(SAME), 0.0)
    return np.asarray(np.sum(np.where(some, slab, none), axis=1))


def _on_grid(
    axes: list[Array], run_likelihoods: Sequence[RunLikelihood], way: Array, middle: Array
) -> tuple[Array, Array]:
    """Nodes (G, 3) of log τ and their posterior weights (G,)."""
    nodes = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    spread = np.exp(nodes)
    value = _log_prior(spread, way) + _given_spread(spread, run_likelihoods, way, middle)[2]
    for k, axis in enumerate(axes):
        value += np.where(spread[:, k] > 0.0, math.log(_width(axis) or 1.0), 0.0)
    weight = np.exp(value - value.max())
    return nodes, weight / weight.sum()


def _width(axis: Array) -> float:
    """Distance of the nodes that stand for a spread."""
    return float(axis[2] - axis[1]) if len(axis) > 2 else 0.0


def _marginals(axes: list[Array], weight: Array) -> list[Array]:
    """Posterior mass of every node of every axis."""
    box = weight.reshape([len(axis) for axis in axes])
    every = range(len(axes))
    return [box.sum(axis=tuple(j for j in every if j != k)) for k in every]


def _narrowed(axis: Array, mass: Array) -> Array:
    """Finer nodes over the part of an axis that holds nearly all the mass of a spread."""
    some = mass[1:]
    if len(axis) == 1 or not some.sum() > 0.0:
        return axis
    below = np.cumsum(some) / some.sum()
    first = max(int(np.searchsorted(below, _EDGE)) - 1, 0)
    last = min(int(np.searchsorted(below, 1.0 - _EDGE)) + 1, len(some) - 1)
    return np.append(-np.inf, np.linspace(axis[1 + first], axis[1 + last], _FINE))


def _given_spread(
    spread: Array, run_likelihoods: Sequence[RunLikelihood], way: Array, middle: Array
) -> tuple[Array, Array, Array]:
    """Mean car given each of G spreads: mean (G, n), root of its precision, log evidence (G,).

    The runs' own shifts are integrated out: a site becomes one with the precision
    H − H B W Bᵀ H, where W = D (I + D BᵀHB D)⁻¹ D and D = diag τ.
    """
    count, free = spread.shape
    n = len(way)
    precision = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    linear = np.broadcast_to(-middle, (count, n)).copy()
    log_evidence = np.zeros(count)
    for H, h in run_likelihoods:
        HB, own = H @ way, way.T @ h
        inner = spread[:, :, None] * (way.T @ HB) * spread[:, None, :] + np.eye(free)
        root = np.linalg.cholesky(inner)
        half = np.linalg.solve(root, spread[:, :, None] * np.eye(free))  # W = halfᵀ half
        cross = half @ HB.T
        precision += H - np.swapaxes(cross, 1, 2) @ cross
        pulled = half @ own
        linear += h - np.einsum("gan,ga->gn", cross, pulled)
        log_evidence += 0.5 * np.sum(pulled**2, axis=1)
        log_evidence -= np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    root = np.linalg.cholesky(precision)
    half = np.linalg.solve(root, linear[:, :, None])
    mean = np.linalg.solve(np.swapaxes(root, 1, 2), half)[:, :, 0]
    log_evidence += 0.5 * np.sum(half[:, :, 0] ** 2, axis=1)
    log_evidence -= np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    return mean, np.asarray(root), log_evidence
