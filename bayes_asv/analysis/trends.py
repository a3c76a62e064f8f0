"""Trend of a damping rate over the recordings of a season: whether and when it changed.

**Likelihood of a recording.**  Recording r has a Gaussian likelihood exp(h_rᵀθ_r − ½ θ_rᵀH_rθ_r)
with θ_r = θ + B u_r (:mod:`bayes_asv.analysis.random_effects`): θ contains the errors of the given
values, which all recordings share, and u_r the logarithms of the estimated parameters, with a flat
prior in every recording.  Given θ, it measures u_r by

    y_r = (BᵀH_rB)⁻¹ Bᵀ(h_r − H_rθ),    s_r² = diag (BᵀH_rB)⁻¹.

θ is fixed at its posterior mean given all recordings.  Its remaining error (posterior covariance
P⁻¹) shifts the recordings by −A_r(θ − E θ), A_r = (BᵀH_rB)⁻¹BᵀH_r.  The part that is common to all
of them, such as that of a wrong mass, is not a change; the level, whose prior is flat, absorbs it.
The rest, which differs from drive to drive, is added to s_r².

**Season.**  With the level x of the logarithm of one damping rate and a scatter between runs (oil
temperature, fuel, driver, road)::

    y_r = x(t_r) + e_r + ε_r,    e_r ~ N(0, σ²),    ε_r ~ N(0, s_r²),    σ ~ half-Cauchy(0.03)

    no change      x(t) = x₀                                                  probability ½
    gradual        x(t) = x₀ + β (t − t₁)/(t_R − t₁),   β ~ N(0, 0.2²)        probability ¼
    k changes      x(t) = x_j in stretch j = 0 … k,  x_j ~ N(μ, ½ 0.2²)       probability ¼ 2⁻ᵏ

with k = 1 … 5 (the probabilities of several k are scaled to add up to ¼), flat priors of x₀ and μ,
and all sets of k changes equally probable in which every stretch has at least two recordings: one
recording that differs from its neighbours is scatter.  Two levels then differ by N(0, 0.2²), as β.
No change falls between recordings of the same time.

Given σ and μ the stretches are independent, so the sum over all sets of changes is a recursion over
their last stretch (Barry & Hartigan 1993; Fearnhead 2006); σ and μ are integrated on a grid.
Change points, levels and scatter are then drawn from the exact posterior on the grid.

**Test.**  The p-value is the probability, in a season without a change and with the same dates, s_r
and scatter, of at least as much evidence for a gradual change or for one sudden change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.random_effects import (
    SPREAD_SCALE,
    RunLikelihood,
    estimates_of_runs,
    likelihood_of_run,
)
from bayes_asv.models.car_model import CarModel
from bayes_asv.posterior.car_prior import car_prior

__all__ = ["FEWEST", "Change", "Coordinates", "Trend", "find_trend", "values_of_runs"]

Array = NDArray[np.float64]

NO_CHANGE: Final = 0.5
GRADUAL: Final = 0.25
MOST_CHANGES: Final = 5
CHANGE_SD: Final = 0.2
"""Prior standard deviation of a change of the log level: worn seals, lost gas, new oil and a few
clicks of the adjuster change a damping rate by 5 to 50 %."""
FEWEST: Final = 4
"""Least number of recordings of a season: two before a change and two after it."""

_SHORTEST = 2  # least number of recordings between two changes
_SHARE_IN_WINDOW = 0.95  # posterior probability that a change is within its reported window
_DRAWS = 2000  # draws of the posterior
_SIMULATED = 999  # simulated seasons without a change, for the p-value
_STEP = 0.5  # spacing of the nodes of μ, in prior standard deviations of a level
_REACH = 3.5  # range of the nodes of μ beyond the values, in prior standard deviations of a level
_NODES = (12, 48)  # least and largest number of nodes of σ


class Change(NamedTuple):
    """A sudden change of the level.

    Parameters
    ----------
    first, last : int
        The change is after recording `first` and no later than recording `last`: the narrowest
        window with 95 % of the posterior of its place, given the most probable number of changes.
    ratio, low, high : float
        Level after over level before, median and 95 % interval, given a change in the window.
    probability : float
        Probability of a change in this direction in the window, over all hypotheses.
    """

    first: int
    last: int
    ratio: float
    low: float
    high: float
    probability: float


@dataclass(frozen=True)
class Trend:
    """Posterior of the level over a season of R recordings.

    Parameters
    ----------
    no_change, gradual : float
        Posterior probabilities.
    sudden : (5,) array
        Posterior probabilities of one to five changes.
    p_value : float
        p-value of the test that nothing changed.
    drift : (3,) tuple of float
        Last level over first if the change is gradual: median and ends of the 95 % interval.
    changes : tuple of Change
        Sudden changes that are more probable than not, in order of time.
    scatter : (3,) tuple of float
        σ: median and ends of the 95 % interval.
    level : (3, R) array
        Logarithm of the level at each recording, averaged over the hypotheses: mean and ends of the
        95 % interval.
    """

    no_change: float
    gradual: float
    sudden: Array
    p_value: float
    drift: tuple[float, float, float]
    changes: tuple[Change, ...]
    scatter: tuple[float, float, float]
    level: Array

    @property
    def kind(self) -> str:
        """Most probable of ``no change``, ``gradual`` and ``sudden``."""
        shares = {
            "no change": self.no_change, "gradual": self.gradual, "sudden": self.sudden.sum(),
        }  # fmt: skip
        return max(shares, key=lambda name: shares[name])


class Coordinates:
    """Standard normal coordinates θ of a car, for use without a recording.

    They are the directions of its parameters on which the state-space model depends, and its
    fractions.

    Parameters
    ----------
    car : CarModel
        The car.
    """

    def __init__(self, car: CarModel):
        self._prior = car_prior(car, ())
        self._fractions = [
            p for p in car.parameters if p.kind == "fraction" and p.terms[0][2] > 0.0
        ]
        columns = []
        for name in car.estimated:
            moved = np.array([float(name == log) for log in self._prior.log_parameters])
            zeta = np.linalg.pinv(self._prior.root) @ moved
            columns.append([*(zeta @ self._prior.identified), *np.zeros(len(self._fractions))])
        self.directions: Array = np.array(columns).T
        """B (n, p): derivatives of the coordinates by the logarithms of estimated parameters."""
        rows = [self._prior.root[self._prior.log_parameters.index(n)] for n in car.estimated]
        self.slopes: Array = np.column_stack(
            [np.array(rows) @ self._prior.identified, np.zeros((len(rows), len(self._fractions)))]
        )
        """Derivatives (p, n) of those logarithms by the coordinates."""

    def likelihood(self, draws: Mapping[str, Array]) -> RunLikelihood:
        """Convert the posterior of one recording to a likelihood.

        Parameters
        ----------
        draws : mapping of str to (N,) array
            Draws of the car's parameters that vary, SI units.
        """
        prior = self._prior
        count = len(next(iter(draws.values())))
        moved = np.zeros((count, len(prior.log_parameters)))
        for k, name in enumerate(prior.log_parameters):
            if name in draws and prior.log_sd[k] > 0.0:
                moved[:, k] = np.log(draws[name]) - prior.log_mean[k]
        z = moved @ np.linalg.pinv(prior.root).T @ prior.identified
        others = [(draws[p.name] - p.nominal) / p.terms[0][2] for p in self._fractions]
        z = np.column_stack([z, *others])
        return likelihood_of_run(z.mean(axis=0), np.cov(z, rowvar=False).reshape(2 * z.shape[1:]))


def values_of_runs(runs: Sequence[RunLikelihood], directions: Array) -> tuple[Array, Array, Array]:
    """Estimate the parameters in every run, with common errors of the given values removed.

    Parameters
    ----------
    runs : sequence of RunLikelihood
        R likelihoods over the car's n coordinates.
    directions : (n, p) array
        B; a column of zeros for a parameter that is given as exact.

    Returns
    -------
    value, sd : (R, p) arrays
        y and s; nan and infinite if a run has no information.
    centre : (n,) array
        Coordinates θ to which the values are relative.
    """
    n = len(directions)
    precision, linear = np.eye(n), np.zeros(n)
    loadings: list[Array] = []
    for H, h in runs:
        inverse = np.linalg.pinv(directions.T @ H @ directions, rcond=1e-12, hermitian=True)
        loading = inverse @ directions.T @ H
        precision += H - H @ directions @ loading
        linear += h - loading.T @ (directions.T @ h)
        loadings.append(loading)
    centre = np.asarray(np.linalg.solve(precision, linear), dtype=float)
    estimates = [estimates_of_runs(run, directions, centre) for run in runs]
    value = np.stack([shift for shift, _ in estimates])
    sd = np.stack([sd_of_run for _, sd_of_run in estimates])
    known = np.isfinite(value).all(axis=1)
    if known.any():
        differences: Array = np.stack(loadings)
        differences = differences - differences[known].mean(axis=0)
        shared = np.einsum("rpn,nm,rpm->rp", differences, np.linalg.inv(precision), differences)
        sd = np.asarray(np.sqrt(sd**2 + np.maximum(shared, 0.0)))
    return value, sd, centre


def find_trend(time: Array, value: Array, sd: Array, seed: int = 0) -> Trend | None:
    """Find the trend of one damping rate.

    Parameters
    ----------
    time : (R,) array
        Times of the recordings in order, in any unit.
    value, sd : (R,) arrays
        Logarithm of the rate in each recording, and its standard deviation.
    seed : int
        Seed of the draws.

    Returns
    -------
    Trend or None
        None for fewer than four recordings, or if all have the same time.
    """
    if len(time) < FEWEST or not time[-1] > time[0]:
        return None
    middle = float(np.median(value))
    season = _Season(time, value - middle, sd)
    return season.trend(np.random.default_rng([seed, 8]), middle)


class _Season:
    """Evidence of the hypotheses on a grid of the scatter σ (G nodes) and of μ (M nodes)."""

    def __init__(self, time: Array, value: Array, sd: Array):
        self.y, self.s = value, sd
        self.n = len(value)
        self.ramp = (time - time[0]) / (time[-1] - time[0])
        self.omega = CHANGE_SD / math.sqrt(2.0)
        place = np.arange(self.n + 1)
        self.free = np.array([True, *(np.diff(time) > 0.0), True])  # a change may be before run j
        long = place[None, :] - place[:, None] >= _SHORTEST
        self.allowed = long & self.free[:, None] & self.free[None, :]
        self.sigma, self.log_mass = _scatter_grid(value, sd)
        reach = _REACH * self.omega
        span = value.max() - value.min() + 2.0 * reach
        self.mu = value.min() - reach + np.linspace(0.0, span, 1 + math.ceil(span / self._step))
        self.log_prior = self._log_priors()

    @property
    def _step(self) -> float:
        return _STEP * self.omega

    def _log_priors(self) -> Array:
        """Log prior probability of k = 1 … 5 changes, divided by the number of their placements."""
        nothing = np.where(self.allowed, 0.0, -np.inf)[None]
        ways = np.array([a[0, self.n] for a in _recursion(nothing, MOST_CHANGES)[1:]])
        prior = 0.5 ** np.arange(1.0, MOST_CHANGES + 1.0)
        prior *= (1.0 - NO_CHANGE - GRADUAL) / prior.sum()
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(ways), np.log(prior) - ways, -np.inf)

    def stretches(self, sigma: float) -> Array:
        """Log marginal likelihood (M, n + 1, n + 1) of runs i … j − 1 at one level, given μ."""
        w = 1.0 / (self.s**2 + sigma**2)
        parts = np.stack([w, w * self.y, w * self.y**2, 0.5 * np.log(w)])
        sums = np.concatenate([np.zeros((4, 1)), np.cumsum(parts, axis=1)], axis=1)
        W, S, Q, L = sums[:, None, :] - sums[:, :, None]
        W = np.where(self.allowed, W, 1.0)
        spread = np.maximum(Q - S**2 / W, 0.0)
        widened = 1.0 + self.omega**2 * W
        known = L - 0.5 * spread - 0.5 * np.log(widened)
        off = S / W - self.mu[:, None, None]
        return np.where(self.allowed, known - 0.5 * W / widened * off**2, -np.inf)

    def simple(self, y: Array) -> tuple[Array, Array, Array]:
        """Log evidence of no change, a gradual and one sudden change for seasons y (m, n), (G, m).

        Prior probabilities of the hypotheses are not included; the last is averaged over places.
        """
        none, gradual, sudden = [], [], []
        gaps = [j for j in range(_SHORTEST, self.n - _SHORTEST + 1) if self.free[j]]
        steps = np.arange(self.n) >= np.array(gaps, dtype=int)[:, None]
        designs = np.vstack([self.ramp, steps])  # a gradual change, then a step at each place
        for sigma in self.sigma:
            w = 1.0 / (self.s**2 + sigma**2)
            W = w.sum()
            mean = y @ w / W
            residuals = y - mean[:, None]
            constant = (
                0.5 * np.log(w).sum() - 0.5 * (residuals**2) @ w + 0.5 * math.log(2 * math.pi / W)
            )
            centred = designs - (designs @ w / W)[:, None]
            G = (centred**2) @ w
            gain = 0.5 * ((residuals * w) @ centred.T) ** 2 / (G + CHANGE_SD**-2)
            gain -= 0.5 * np.log1p(CHANGE_SD**2 * G)
            none.append(constant)
            gradual.append(constant + gain[:, 0])
            if gaps:
                sudden.append(constant + _log_sum(gain[:, 1:], axis=1) - math.log(len(gaps)))
            else:
                sudden.append(np.full(len(y), -np.inf))
        return np.array(none), np.array(gradual), np.array(sudden)

    def trend(self, rng: np.random.Generator, middle: float) -> Trend:
        """Compute the probabilities of the hypotheses, and draw from the posterior."""
        none, gradual, _ = (one[:, 0] for one in self.simple(self.y[None]))
        tables = [_recursion(self.stretches(sigma), MOST_CHANGES) for sigma in self.sigma]
        ends = np.array([[a[:, self.n] for a in table[1:]] for table in tables])  # (G, 5, M)
        sudden = ends + self.log_prior[None, :, None] + math.log(self._spacing)
        log_weight = np.concatenate(
            [none[:, None] + math.log(NO_CHANGE), gradual[:, None] + math.log(GRADUAL),
             sudden.reshape(len(self.sigma), -1)], axis=1,
        ) + self.log_mass[:, None]  # fmt: skip
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        shares = weight.sum(axis=0)
        by_count = shares[2:].reshape(MOST_CHANGES, -1).sum(axis=1)
        points = (rng.random() + np.arange(_DRAWS)) / _DRAWS
        picked = np.searchsorted(np.cumsum(weight.ravel()), points).clip(max=weight.size - 1)
        node, column = np.divmod(picked, weight.shape[1])
        level = np.empty((_DRAWS, self.n))
        places: list[tuple[int, ...]] = [()] * _DRAWS
        for g in np.unique(node):
            drawn_here = np.flatnonzero(node == g)
            table = self.stretches(self.sigma[g]) if (column[drawn_here] > 1).any() else None
            for d in drawn_here:
                if column[d] < 2:
                    continue
                k, m = divmod(int(column[d]) - 2, len(self.mu))
                assert table is not None
                places[d] = self._places(rng, tables[g], table, k + 1, m)
                level[d] = self._levels(rng, self.sigma[g], places[d], self.mu[m])
            for which in (0, 1):
                of_hypothesis = drawn_here[column[drawn_here] == which]
                level[of_hypothesis] = self._line(
                    rng, self.sigma[g], len(of_hypothesis), gradual=which == 1
                )
        counts = np.array([len(p) for p in places])
        return Trend(
            no_change=float(shares[0]),
            gradual=float(shares[1]),
            sudden=by_count,
            p_value=self._p_value(rng, none),
            drift=_interval(np.exp(self._drifts(rng, gradual))),
            changes=self._changes(places, counts, level, 1 + int(np.argmax(by_count))),
            scatter=_interval(self.sigma[node]),
            level=middle + np.vstack([level.mean(axis=0), np.quantile(level, [0.025, 0.975], 0)]),
        )

    @property
    def _spacing(self) -> float:
        return float(self.mu[1] - self.mu[0])

    def _places(
        self, rng: np.random.Generator, table: list[Array], stretches: Array, count: int, m: int
    ) -> tuple[int, ...]:
        """Draw the first runs after each of `count` changes, last to first, given σ and μ."""
        places, end = [], self.n
        for k in range(count, 0, -1):
            value = table[k - 1][m, :end] + stretches[m, :end, end]
            weight = np.cumsum(np.exp(value - value.max()))
            end = int(np.searchsorted(weight, rng.random() * weight[-1], side="right"))
            places.append(end)
        return tuple(reversed(places))

    def _levels(
        self, rng: np.random.Generator, sigma: float, places: tuple[int, ...], mu: float
    ) -> Array:
        """Draw the level (n,) of every run given the changes."""
        w = 1.0 / (self.s**2 + sigma**2)
        starts = [0, *places]
        known = np.add.reduceat(w, starts) + self.omega**-2
        mean = (np.add.reduceat(w * self.y, starts) + mu * self.omega**-2) / known
        drawn = mean + rng.standard_normal(len(starts)) / np.sqrt(known)
        return np.repeat(drawn, np.diff([*starts, self.n]))

    def _line(self, rng: np.random.Generator, sigma: float, count: int, *, gradual: bool) -> Array:
        """Draw constant levels (count, n), or levels on a straight line."""
        w = 1.0 / (self.s**2 + sigma**2)
        X = np.stack([np.ones(self.n), self.ramp])[: 2 if gradual else 1]
        precision = (X * w) @ X.T + np.diag([0.0, CHANGE_SD**-2][: len(X)])
        mean = np.linalg.solve(precision, (X * w) @ self.y)
        root = np.linalg.cholesky(precision)
        noise = np.linalg.solve(root.T, rng.standard_normal((len(X), count)))
        return np.asarray((mean[:, None] + noise).T @ X)

    def _drifts(self, rng: np.random.Generator, gradual: Array) -> Array:
        """Draw the change (S,) over the season if it is gradual."""
        weight = np.exp(gradual + self.log_mass - (gradual + self.log_mass).max())
        node = rng.choice(len(weight), _DRAWS, p=weight / weight.sum())
        lines = [
            self._line(rng, self.sigma[g], int(np.sum(node == g)), gradual=True)
            for g in np.unique(node)
        ]
        drawn = np.concatenate(lines)
        return drawn[:, -1] - drawn[:, 0]

    def _p_value(self, rng: np.random.Generator, none: Array) -> float:
        """Compute the p-value from simulated seasons without a change but with this scatter."""
        weight = np.exp(none + self.log_mass - (none + self.log_mass).max())
        sigma = self.sigma[rng.choice(len(weight), _SIMULATED, p=weight / weight.sum())]
        noise = rng.standard_normal((_SIMULATED, self.n))
        simulated = noise * np.sqrt(self.s**2 + sigma[:, None] ** 2)
        null, gradual, sudden = self.simple(np.vstack([self.y, simulated]))
        mass = self.log_mass[:, None]
        ratio = _log_sum(np.concatenate([gradual + mass, sudden + mass]), 0) - _log_sum(
            null + mass, 0
        )
        return float((1 + np.sum(ratio[1:] >= ratio[0])) / (1 + _SIMULATED))

    def _changes(
        self, places: list[tuple[int, ...]], counts: NDArray[np.intp], level: Array, usual: int
    ) -> tuple[Change, ...]:
        """Summarise the probable changes, given the most probable number of changes."""
        placed = [np.array(places[d]) for d in np.flatnonzero(counts == usual)]
        if not placed:
            return ()
        windows: list[tuple[int, int]] = []
        for column in np.stack(placed).T:
            low, high = _narrowest(np.sort(column))
            if windows and low <= windows[-1][1]:  # two changes that cannot be distinguished
                low = windows.pop()[0]
            windows.append((low, high))
        changes = []
        for low, high in windows:
            inside = np.array(
                [any(low <= p <= high for p in places_of_draw) for places_of_draw in places]
            )
            change = level[:, high] - level[:, low - 1]
            down = float(np.median(change[inside])) < 0.0
            same = inside & (change < 0.0 if down else change > 0.0)
            if np.mean(same) > 0.5:
                ratio = _interval(np.exp(change[same]))
                changes.append(Change(low - 1, high, *ratio, float(np.mean(same))))
        return tuple(changes)


def _recursion(stretches: Array, most: int) -> list[Array]:
    """Log likelihood (M, n + 1) of runs 0 … j − 1 in stretches with k = 0 … `most` changes.

    Parameters
    ----------
    stretches : (M, n + 1, n + 1) array
        Log likelihood of runs i … j − 1 in one stretch.
    most : int
        Largest k.
    """
    # The sums are products of matrices of likelihoods, relative to those of the best stretches
    # before i and before j, so that only negligible terms underflow.
    one = stretches[len(stretches) // 2]
    best = prefix = one[0]
    for _ in range(most):
        prefix = np.max(prefix[:, None] + one, axis=0)
        best = np.maximum(best, prefix)
    best = np.where(np.isfinite(best), best, 0.0)
    relative = np.exp(np.minimum(stretches + best[:, None] - best, 600.0 / (1 + most)))
    products = [relative[:, :1, :]]
    products[0][:, 0, 0] = 0.0
    for _ in range(most):
        products.append(products[-1] @ relative)
    with np.errstate(divide="ignore"):
        return [np.log(one[:, 0, :]) + best - best[0] for one in products]


def _scatter_grid(value: Array, sd: Array) -> tuple[Array, Array]:
    """Nodes (G,) of σ and the logarithms of their prior masses.

    The spacing of the nodes is about the width of the posterior: the standard deviation of log σ
    from R values is 1/√(2R) if their scatter exceeds their errors.  They extend from well below the
    scatter of successive differences, which changes do not increase, to well above that of all
    values.
    """
    width = 1.0 / math.sqrt(2.0 * len(value))
    median_sd = float(np.median(sd))
    successive = float(np.median(np.diff(value) ** 2)) / (2.0 * 0.455) - median_sd**2
    low = math.sqrt(max(successive, 0.0)) * math.exp(-6.0 * width)
    low = max(low, 0.1 * median_sd, 1e-6)
    high = max(float(np.std(value)), median_sd, 2.0 * low) * math.exp(4.0 * width)
    count = math.ceil(math.log(high / low) / (1.2 * width))
    edges = np.geomspace(low, high, 1 + min(max(count, _NODES[0]), _NODES[1]))
    below = 2.0 / math.pi * np.arctan(edges / SPREAD_SCALE)
    below[0], below[-1] = 0.0, 1.0
    with np.errstate(divide="ignore"):
        return np.sqrt(edges[1:] * edges[:-1]), np.log(np.diff(below))


def _narrowest(places: NDArray[np.intp]) -> tuple[int, int]:
    """Narrowest window that contains 95 % of sorted places."""
    inside = max(math.ceil(_SHARE_IN_WINDOW * len(places)), 1)
    widths = places[inside - 1 :] - places[: len(places) - inside + 1]
    first = int(np.argmin(widths))
    return int(places[first]), int(places[first + inside - 1])


def _interval(draws: Array) -> tuple[float, float, float]:
    """Median and ends of the equal-tailed 95 % interval."""
    low, median, high = np.quantile(draws, [0.025, 0.5, 0.975])
    return float(median), float(low), float(high)


def _log_sum(values: Array, axis: int) -> Array:
    """Logarithm of the sum of exponentials; −∞ if all values are."""
    top = values.max(axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.exp(values - top).sum(axis=axis)) + np.squeeze(top, axis))
