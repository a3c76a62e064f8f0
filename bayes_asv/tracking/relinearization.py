"""Relinearisation of the online filter over a window of recent steps.

An unscented filter linearises at its estimate when a reading arrives.  While the parameters are
almost unknown that estimate is far off, and the resulting errors cannot be corrected later.  The
filter therefore keeps the window of steps since then.  With more information, the window is
filtered again with a fixed reference at the estimate and sigma points spread by the current
uncertainty, and this is iterated until the estimate converges (posterior linearisation;
García-Fernández et al. 2015).  Motion and biases at the start of the window are unknowns too,
because a state that is inferred from the first readings depends on the parameters.  Each iteration
is a Gauss–Newton step on the log-posterior of the window, shortened if it would decrease it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import recentre
from bayes_asv.filters.ukf import run
from bayes_asv.filters.ukf_state import FilterSettings, State, Steps
from bayes_asv.tracking.filter_model import FilterModel

__all__ = ["Window", "concatenate_steps", "relinearize", "slice_steps"]

Array = NDArray[np.float64]

_MAX_ROUNDS = 10  # largest number of iterations
_CONVERGED = 0.05  # change of the estimate below which it has converged, standard deviations
_MAX_MOVE = 1.5  # largest change of a parameter in one iteration, prior standard deviations
_SHORTEN = 0.4  # factor by which a step is shortened
_MIN_LENGTH = 0.02  # shortest step, relative to the Gauss–Newton step
_TOLERANCE = 0.02  # tolerance of −2 log p


@dataclass(frozen=True)
class Window:
    """Recent steps, and the state at their start.

    Parameters
    ----------
    start : State
        State before the first step, the reference being at the estimate.
    steps : Steps
        All steps since.
    """

    start: State
    steps: Steps


def slice_steps(steps: Steps, first: int, last: int) -> Steps:
    """Return the steps ``first`` to ``last − 1``."""
    return Steps(*(values[first:last] for values in steps))  # type: ignore[arg-type]


def concatenate_steps(parts: list[Steps]) -> Steps:
    """Join steps in their order."""
    if len(parts) == 1:
        return parts[0]
    return Steps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


@dataclass(frozen=True)
class _JointPrior:
    """Prior of q = (θ, u) at the start of a window: parameters and initial motion and biases.

    q has mean ``mean`` and covariance Dᵀ D; the state there is x + slopeᵀ (q − mean) + η with
    η ~ N(0, Π).
    """

    model: FilterModel
    mean: Array
    D: Array
    x: Array
    slope: Array
    Pi: Array
    statistics: Array
    force_history: Array

    @classmethod
    def of(cls, start: State, statistics: Array, model: FilterModel) -> _JointPrior:
        p, ny = len(start.mu), model.sizes.outputs
        chosen = model.initial
        initial = len(chosen)
        factor = np.linalg.cholesky(start.Pi[np.ix_(chosen, chosen)])
        by_u = np.linalg.solve(factor, start.Pi[chosen]).T  # regression of the state on u
        D = np.eye(p + initial)
        D[:p, :p] = start.D
        statistics = statistics.copy()
        fast = model.at.fast_factor
        statistics[fast : fast + ny] = 1.0  # the slow factor applies to the whole window
        statistics[model.at.last_step] = start.statistics[model.at.last_step]
        return cls(
            model=model,
            mean=np.concatenate([start.mu, np.zeros(initial)]),
            D=D,
            x=start.x,
            slope=np.vstack([np.linalg.solve(start.D, start.J), by_u.T]),
            Pi=start.Pi - by_u @ by_u.T,
            statistics=statistics,
            force_history=start.force_history,
        )

    def state_at(self, reference: Array, D: Array) -> State:
        """Express the prior with another reference and with directions D."""
        statistics = self.statistics.copy()
        statistics[self.model.at.deviance] = 0.0
        to_d = np.linalg.inv(D.T)
        return State(
            mu=reference.copy(),
            D=np.ascontiguousarray(D),
            x=self.x + self.slope.T @ (reference - self.mean),
            J=np.ascontiguousarray(D @ self.slope),
            m=to_d @ (self.mean - reference),
            F=np.ascontiguousarray(np.triu(self.D @ to_d.T)),
            Pi=self.Pi.copy(),
            statistics=statistics,
            snapshots=np.zeros((2, 0, 0)),
            autocovariance=np.zeros((self.model.sizes.outputs, 2, 1)),
            force_history=self.force_history.copy(),
        )

    def deviance(self, q: Array) -> float:
        """−2 log prior density at q, up to a constant."""
        z = np.linalg.solve(self.D.T, q - self.mean)
        return float(z @ z)


def _pass(
    prior: _JointPrior,
    window: Window,
    model: FilterModel,
    settings: FilterSettings,
    reference: Array,
    D: Array,
) -> tuple[State, float]:
    """Filter a window with a fixed reference; return its final state and −2 log posterior."""
    state = prior.state_at(reference, D)
    out = np.empty((0, model.into.width))
    run(model.sizes, 0, True, state, model.arrays, settings, window.steps, out)
    deviance = float(state.statistics[model.at.deviance]) + prior.deviance(reference)
    return state, deviance if np.isfinite(deviance) else np.inf


def _estimate(state: State) -> tuple[Array, Array]:
    """Mean of q and its covariance factor at the end of a pass."""
    return state.mu + state.D.T @ state.m, np.triu(state.F @ state.D)


def relinearize(
    window: Window, current: State, model: FilterModel, settings: FilterSettings
) -> tuple[State, float]:
    """Filter a window repeatedly at its own estimate until that converges.

    Parameters
    ----------
    window : Window
        Steps, and the state at their start.
    current : State
        State of the filter at the end of the window: the search starts at its parameters, and the
        result inherits its statistics.
    model, settings : FilterModel and FilterSettings
        Those of the filter.

    Returns
    -------
    state : State
        State at the end of the window, the reference being at the estimate.
    moved : float
        Largest change of a parameter from ``current``, in standard deviations of ``current``.
    """
    p = len(current.mu)
    prior = _JointPrior.of(window.start, current.statistics, model)
    initial = len(model.initial)
    D = np.eye(p + initial)
    D[:p, :p] = current.D
    reference = np.concatenate([current.mu, np.zeros(initial)])
    state, deviance = _pass(prior, window, model, settings, reference, D)
    for _ in range(_MAX_ROUNDS):
        target, D = _estimate(state)
        move = target - reference
        if np.max(np.abs(np.linalg.solve(D.T, move))) < _CONVERGED:
            break
        length = min(1.0, _MAX_MOVE / max(float(np.max(np.abs(move[:p]))), 1e-300))
        while True:
            trial, trial_deviance = _pass(
                prior, window, model, settings, reference + length * move, D
            )
            if trial_deviance <= deviance + _TOLERANCE or length < _MIN_LENGTH:
                break
            length *= _SHORTEN
        if trial_deviance > deviance + _TOLERANCE:
            break
        converged = length == 1.0 and abs(trial_deviance - deviance) < _TOLERANCE
        reference, state, deviance = reference + length * move, trial, trial_deviance
        if converged:
            break
    recentre(len(state.x), state.mu, state.D, state.x, state.J, state.m, state.F)
    moved = np.linalg.solve(current.D.T, state.mu[:p] - current.mu)
    J = state.J
    statistics = current.statistics.copy()
    statistics[model.at.information_gain] = 0.0
    statistics[model.at.last_step] = state.statistics[model.at.last_step]
    result = State(
        mu=state.mu[:p].copy(),
        D=np.ascontiguousarray(state.D[:p, :p]),
        x=state.x,
        J=np.ascontiguousarray(J[:p]),
        m=np.zeros(p),
        F=np.eye(p),
        Pi=state.Pi + J[p:].T @ J[p:],
        statistics=statistics,
        snapshots=current.snapshots.copy(),
        autocovariance=current.autocovariance.copy(),
        force_history=state.force_history,
    )
    return result, float(np.max(np.abs(moved)))
