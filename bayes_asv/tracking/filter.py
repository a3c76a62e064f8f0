"""The online filter: its initial state, and the decisions between runs of the compiled recursion.

:func:`bayes_asv.filters.ukf.run` processes steps until it needs a decision.  It then returns one of
three events: the information gained about the parameters requires a relinearisation of the recent
window, a fault has lasted so long that the motion has to be reset, or the window is due for a
review.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import add_parameter_noise
from bayes_asv.filters.ukf import RELINEARIZE, RESET, REVIEW
from bayes_asv.filters.ukf import run as run_compiled
from bayes_asv.filters.ukf_state import DRIFT_LAGS, FilterSettings, State, Steps
from bayes_asv.filters.vector_code import LANES
from bayes_asv.tracking.filter_model import FilterModel
from bayes_asv.tracking.relinearization import Window, concatenate_steps, relinearize, slice_steps

__all__ = [
    "DEFAULT_SETTINGS", "ENGINES", "WHITE_SHARE_PRIOR", "Engine", "OnlineFilter", "initial_state",
    "parameter_covariance",
]  # fmt: skip

Array = NDArray[np.float64]

Engine = Callable[[int, bool, State, FilterModel, FilterSettings, Steps, Array], tuple[int, int]]

DEFAULT_SETTINGS = FilterSettings(
    gate=16.0,  # four standard deviations: one reading in 16,000 by chance
    prior_readings=40.0,  # a declared noise level has a relative standard deviation of 11 %
    slow_window=500.0,
    fast_window=32.0,
    fast_threshold=2.5,
    fault_threshold=9.0,
    fault_duration=0.25,
    drift_threshold=2.5,
    information_gain=2.0,
    review_interval=0.25,
)

WHITE_SHARE_PRIOR = (0.5, 12.0)
"""Prior mean and information of the share of white noise; uniform, as in ``estimate``."""

# Relinearisation ends when every parameter's relative standard deviation is below _KNOWN and
# the last _SETTLED_PASSES moved none by more than _SETTLED standard deviations.  A parameter that
# still moves after _MAX_PASSES is not constant, which relinearisation cannot correct.
_KNOWN = 0.05
_SETTLED = 0.1
_SETTLED_PASSES = 2
_MAX_PASSES = 5
_MAX_WINDOW = 8.0  # longest window, s
_MIN_GAIN = 0.02  # least information of a window about the parameters, nats
_MAX_FAULT_DURATION = 8.0  # longest fault before a reset, s
# Duration of a fault after which the car is assumed to have changed, s, after two resets, the
# second with half of this: a sensor that was hit or rattles recovers within a second, or never.
_LASTING_FAULT = 1.0
# Gap after which readings belong to another recording, s: the time in which an offset that drifts
# by 5 mm/s² per second (the tolerance of `sensor_drift`) changes by its prior sd, 0.7 m/s².
_LONG_GAP = 140.0


def initial_state(model: FilterModel) -> State:
    """Prior state before the first reading."""
    sizes, arrays = model.sizes, model.arrays
    p, ny, lasting = len(arrays.element), sizes.outputs, sizes.lasting
    statistics = np.zeros(model.at.length)
    statistics[model.at.fast_factor : model.at.fast_factor + ny] = 1.0
    first = model.at.white_share
    statistics[first : first + 2] = WHITE_SHARE_PRIOR
    autocovariance = np.zeros((ny, 2, 1 + DRIFT_LAGS))
    autocovariance[:, 1, 0] = 1.0
    mu, D = np.zeros(p), arrays.factor.copy()
    blocks = -(-(1 + 2 * p) // LANES) if sizes.forces else 0
    Pi = np.zeros((sizes.states, sizes.states))
    Pi[:lasting, :lasting] = arrays.start
    filtered = slice(sizes.elements + ny, 2 * (sizes.elements + ny))
    Pi[range(lasting, sizes.states), range(lasting, sizes.states)] = arrays.noise[filtered]
    return State(
        mu=mu,
        D=D,
        x=model.start_mean.copy(),
        J=np.zeros((p, sizes.states)),
        m=np.zeros(p),
        F=np.eye(p),
        Pi=Pi,
        statistics=statistics,
        snapshots=_snapshots(mu, D),
        autocovariance=autocovariance,
        force_history=np.zeros((blocks, 2, sizes.forces, LANES)),
    )


def parameter_covariance(state: State) -> Array:
    """Covariance (p, p) of the coordinates, the reference being at the estimate."""
    return np.asarray(state.D.T @ state.D)


def _snapshots(mu: Array, D: Array) -> Array:
    return np.stack([np.column_stack([mu, D])] * 2)


def _copy(state: State) -> State:
    return State(*(part.copy() for part in state))


def _reset_motion(state: State, mu: Array, D: Array, model: FilterModel) -> State:
    """Prior state with given parameters, and with slow noise factors of at most one."""
    statistics, at, ny = state.statistics.copy(), model.at, model.sizes.outputs
    total = slice(at.noise_sum, at.noise_sum + ny)
    statistics[at.fast_factor : at.fast_factor + ny] = 1.0
    weight = statistics[at.noise_weight : at.noise_weight + ny]
    statistics[total] = np.minimum(statistics[total], weight)
    return initial_state(model)._replace(
        mu=mu.copy(), D=D.copy(), statistics=statistics, snapshots=_snapshots(mu, D)
    )


def _log_volume(state: State) -> float:
    """Half the log-determinant of the parameters' covariance."""
    return float(np.sum(np.log(np.abs(np.diag(state.D)))))


def _is_valid(state: State) -> bool:
    """Whether all numbers are finite and no variance is negative."""
    finite = all(np.all(np.isfinite(part)) for part in state)
    return finite and bool(np.all(np.diag(state.Pi) >= 0.0)) and not math.isnan(_log_volume(state))


def _compiled(
    first: int,
    fixed: bool,
    state: State,
    model: FilterModel,
    settings: FilterSettings,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    return run_compiled(model.sizes, first, fixed, state, model.arrays, settings, steps, out)


def _reference(
    first: int,
    fixed: bool,
    state: State,
    model: FilterModel,
    settings: FilterSettings,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    from bayes_asv.tracking.reference_ukf import run as run_reference

    return run_reference(first, fixed, state, model, settings, steps, out)


ENGINES: dict[str, Engine] = {"compiled": _compiled, "filterpy": _reference}


@dataclass
class OnlineFilter:
    """Joint filter of states and parameters.

    Parameters
    ----------
    model : FilterModel
        Car and sensors.
    engine : str
        One of :data:`ENGINES`.
    settings : FilterSettings
        Thresholds.

    Attributes
    ----------
    state : State
        Distribution after the last step.
    relinearizing : bool
        Whether the parameters are still so uncertain that the recent window is kept.
    resets : list of float
        Times at which the motion was reset, s after the first step.
    time : float
        Sum of all steps, s.
    """

    model: FilterModel
    engine: str = "compiled"
    settings: FilterSettings = DEFAULT_SETTINGS
    state: State = field(init=False)
    relinearizing: bool = field(init=False, default=True)
    resets: list[float] = field(init=False, default_factory=list)
    time: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.state = initial_state(self.model)
        self._start_window()
        self._fault_duration = self.settings.fault_duration
        self._settled_passes = self._passes = 0

    def advance(self, steps: Steps) -> Array:
        """Process steps; return the results after each one, see ``ukf_state.Columns``."""
        out = np.zeros((len(steps.step), self.model.into.width))
        at = 0
        long_gaps = np.flatnonzero(steps.restart & (steps.step > _LONG_GAP)).tolist()
        ends = iter([*long_gaps, len(steps.step)])
        end = next(ends)
        while at < len(steps.step):
            if at == end:
                self.start_recording()
                end = next(ends)
            first = at
            event, at = ENGINES[self.engine](
                at, False, self.state, self._current_model(), self._current_settings(),
                slice_steps(steps, 0, end), out,
            )  # fmt: skip
            done = slice_steps(steps, first, at)
            self.time += float(done.step.sum())
            if not _is_valid(self.state):
                self._restart()
                out[first:at] = 0.0
                self._write_parameters(out[first:at])
                continue
            if self.relinearizing:
                self._window_steps.append(done)
            if event == RELINEARIZE:
                self._relinearize()
                self._write_parameters(out[at - 1 : at])
            elif event == RESET:
                self._reset()
            elif event == REVIEW:
                self._review_window()
        return out

    def start_recording(self) -> None:
        """Begin another recording of the same car: motion and biases return to their priors."""
        self.state = _reset_motion(self.state, self.state.mu, self.state.D, self.model)
        if self.relinearizing:
            self._start_window()

    def _write_parameters(self, out: Array) -> None:
        """Fill means and standard deviations of the parameters of interest in rows of results."""
        na = self.model.sizes.estimands
        out[:, :na], out[:, na : 2 * na] = self.state.mu[:na], self._parameter_sd()

    def _parameter_sd(self) -> Array:
        na = self.model.sizes.estimands
        return np.asarray(np.sqrt(np.sum(self.state.D[:, :na] ** 2, axis=0)))

    def _current_model(self) -> FilterModel:
        """Model without a random walk while relinearising, which assumes constant parameters."""
        if not self.relinearizing:
            return self.model
        return self.model.with_constant_parameters()

    def _current_settings(self) -> FilterSettings:
        settings = self.settings._replace(fault_duration=self._fault_duration)
        if self.relinearizing:
            return settings
        return settings._replace(information_gain=math.inf, review_interval=math.inf)

    def _start_window(self) -> None:
        statistics, at = self.state.statistics, self.model.at
        statistics[at.information_gain] = statistics[at.review_time] = 0.0
        self._window_start = _copy(self.state)
        self._window_steps: list[Steps] = []

    def _restart(self) -> None:
        """Return to the prior after an overflow."""
        self.state = initial_state(self.model)
        self.relinearizing = True
        self._start_window()
        self.resets.append(self.time)

    def _relinearize(self) -> None:
        """Filter the window again at the estimate; discard it once the estimate has converged."""
        window = Window(self._window_start, concatenate_steps(self._window_steps))
        try:
            state, moved = relinearize(window, self.state, self.model, self.settings)
        except np.linalg.LinAlgError:  # a covariance that rounding has made singular
            self._start_window()
            return
        self._window_steps = [window.steps]
        self.state.statistics[self.model.at.information_gain] = 0.0
        self._settled_passes = self._settled_passes + 1 if moved < _SETTLED else 0
        if _is_valid(state):
            self.state = state
        na = len(self.model.coordinates.estimands)
        widest = np.max(self._parameter_sd()[:na] * self.model.arrays.scale[:na])
        self._passes = self._passes + 1 if widest < _KNOWN else 0
        if self._passes and (
            self._settled_passes >= _SETTLED_PASSES or self._passes >= _MAX_PASSES
        ):
            self.relinearizing = False
            self._window_steps = []
            if self.model.arrays.parameter_noise.any():  # the random walk over the window
                noise = self.model.arrays.parameter_noise * float(window.steps.step.sum())
                state, ns = self.state, self.model.sizes.states
                add_parameter_noise(ns, state.D, state.J, state.Pi, noise)

    def _review_window(self) -> None:
        """Drop a window that has little information, or is too long."""
        self.state.statistics[self.model.at.review_time] = 0.0
        seconds = sum(float(part.step.sum()) for part in self._window_steps)
        if _log_volume(self._window_start) - _log_volume(self.state) < _MIN_GAIN:
            self._start_window()
        elif seconds > _MAX_WINDOW:
            self._relinearize()
            if self.relinearizing:
                self._start_window()

    def _reset(self) -> None:
        """Reset motion and biases, and return the parameters to the older snapshot.

        After a lasting fault, the parameters of interest become as uncertain as their priors, and
        are estimated again.
        """
        snapshot = self.state.snapshots[0]
        self.state = _reset_motion(
            self.state, snapshot[:, 0], np.ascontiguousarray(snapshot[:, 1:]), self.model
        )
        if self._fault_duration >= _LASTING_FAULT:
            prior = np.zeros(len(self.state.mu))
            prior[: len(self.model.coordinates.estimands)] = 1.0
            state = self.state
            add_parameter_noise(self.model.sizes.states, state.D, state.J, state.Pi, prior)
            state.snapshots[:] = _snapshots(state.mu, state.D)
            self.relinearizing = True
            self._settled_passes = self._passes = 0
        self.state.statistics[self.model.at.fault_time] = 0.0
        since = self.time - self.resets[-1] if self.resets else math.inf
        self._fault_duration = (
            min(2.0 * self._fault_duration, _MAX_FAULT_DURATION)
            if since < 4.0 * self._fault_duration + 1.0
            else self.settings.fault_duration
        )
        self.resets.append(self.time)
        if self.relinearizing:
            self._start_window()
