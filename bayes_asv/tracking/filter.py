"""The online filter: its initial state, and the decisions between runs of the compiled recursion.

:func:`bayes_asv.filters.ukf.run` processes steps until it needs a decision.  It then returns one of
three events: the parameters have learnt so much that the recent window has to be relinearized, a
fault has lasted so long that the motion has to be reset, or the window is due for a review.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import add_parameter_noise
from bayes_asv.filters.ukf import RELINEARIZE, RESET, REVIEW, run
from bayes_asv.filters.ukf_state import (
    COLUMNS,
    DRIFT_LAGS,
    FAST_FACTOR,
    FAULT_TIME,
    INFORMATION_GAIN,
    NOISE_SUM,
    NOISE_WEIGHT,
    REVIEW_TIME,
    STATISTICS,
    FilterSettings,
    Model,
    State,
    Steps,
)
from bayes_asv.tracking.parameters import Coordinates
from bayes_asv.tracking.relinearization import Window, concatenate_steps, relinearize, slice_steps

__all__ = [
    "DEFAULT_SETTINGS", "ENGINES", "INITIAL_VARIANCE", "Engine", "OnlineFilter", "filter_model",
    "initial_state", "parameter_covariance",
]  # fmt: skip

Array = NDArray[np.float64]

Engine = Callable[[int, bool, State, Model, FilterSettings, Steps, Array], tuple[int, int]]

INITIAL_VARIANCE = np.array([0.1, 1.0, 0.1, 1.0, 1.0, 1.0]) ** 2
"""Prior variances when a recording begins, as in :mod:`bayes_asv.preprocessing.timeline`:
deflections (0.1 m) and their rates (1 m/s), and biases of the chassis channels against their wheel
channels (1 m/s²)."""

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

_DRIFT_SECONDS = 20.0  # time constant of the random walk while a drift is detected
# Relinearization ends when every parameter's relative standard deviation is below _KNOWN and
# the last _SETTLED_PASSES moved none by more than _SETTLED standard deviations.  A parameter that
# still moves after _MAX_PASSES is not constant, which relinearization cannot correct.
_KNOWN = 0.05
_SETTLED = 0.1
_SETTLED_PASSES = 2
_MAX_PASSES = 5
_MAX_WINDOW = 8.0  # s
_MIN_GAIN = 0.02  # nats: a window with less information about the parameters is dropped
_MAX_FAULT_DURATION = 8.0  # s


def filter_model(coordinates: Coordinates, noise: Array, forget: float | None = None) -> Model:
    """Assemble the model of car and sensors.

    Parameters
    ----------
    coordinates : Coordinates
        Parameters and their priors.
    noise : (12,) array
        From ``SensorModel.noise_parameters``.
    forget : float, optional
        Time constant of the parameters' random walk, s; constant parameters without it.
    """
    return Model(
        coordinates.base, coordinates.element, coordinates.log, coordinates.centre,
        coordinates.scale, noise, INITIAL_VARIANCE, coordinates.parameter_noise(forget),
        coordinates.parameter_noise(_DRIFT_SECONDS),
    )  # fmt: skip


def initial_state(model: Model) -> State:
    """Prior state before the first reading."""
    p = len(model.element)
    statistics = np.zeros(STATISTICS)
    statistics[FAST_FACTOR : FAST_FACTOR + 2] = 1.0
    autocovariance = np.zeros((2, 2, 1 + DRIFT_LAGS))
    autocovariance[:, 1, 0] = 1.0
    mu, D = np.zeros(p), np.eye(p)
    return State(
        mu=mu,
        D=D,
        x=np.zeros(10),
        J=np.zeros((p, 10)),
        m=np.zeros(p),
        F=np.eye(p),
        Pi=np.diag(np.concatenate([model.start, model.noise[4:8]])),
        statistics=statistics,
        snapshots=_snapshots(mu, D),
        autocovariance=autocovariance,
    )


def parameter_covariance(state: State) -> Array:
    """Covariance (p, p) of the coordinates, the reference being at the estimate."""
    return np.asarray(state.D.T @ state.D)


def _snapshots(mu: Array, D: Array) -> Array:
    return np.stack([np.column_stack([mu, D])] * 2)


def _copy(state: State) -> State:
    return State(*(part.copy() for part in state))


def _reset_motion(state: State, mu: Array, D: Array, model: Model) -> State:
    """Prior state with the given parameters, and with slow noise factors of at most one."""
    statistics = state.statistics.copy()
    total = slice(NOISE_SUM, NOISE_SUM + 2)
    statistics[FAST_FACTOR : FAST_FACTOR + 2] = 1.0
    statistics[total] = np.minimum(statistics[total], statistics[NOISE_WEIGHT : NOISE_WEIGHT + 2])
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


def _parameter_columns(state: State) -> Array:
    """First six columns of a row of results: means and standard deviations."""
    return np.concatenate([state.mu[:3], _parameter_sd(state)])


def _parameter_sd(state: State) -> Array:
    return np.asarray(np.sqrt(np.sum(state.D[:, :3] ** 2, axis=0)))


def _reference(
    first: int,
    fixed: bool,
    state: State,
    model: Model,
    settings: FilterSettings,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    from bayes_asv.tracking.reference_ukf import run as run_reference

    return run_reference(first, fixed, state, model, settings, steps, out)


ENGINES: dict[str, Engine] = {"compiled": run, "filterpy": _reference}


@dataclass
class OnlineFilter:
    """Joint filter of states and parameters.

    Parameters
    ----------
    model : Model
        Car and sensors.
    engine : str
        One of :data:`ENGINES`.
    settings : FilterSettings
        Thresholds.

    Attributes
    ----------
    state : State
        Belief after the last step.
    relinearizing : bool
        Whether the parameters are still so uncertain that the recent window is kept.
    resets : list of float
        Times at which the motion was reset, s after the first step.
    time : float
        Sum of all steps, s.
    """

    model: Model
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
        """Process steps; return the results (N, COLUMNS) after each, see ``ukf_state``."""
        out = np.zeros((len(steps.step), COLUMNS))
        at = 0
        while at < len(steps.step):
            first = at
            event, at = ENGINES[self.engine](
                at, False, self.state, self._current_model(), self._current_settings(), steps, out
            )
            done = slice_steps(steps, first, at)
            self.time += float(done.step.sum())
            if not _is_valid(self.state):
                self._restart()
                out[first:at] = 0.0
                out[first:at, :6] = _parameter_columns(self.state)
                continue
            if self.relinearizing:
                self._window_steps.append(done)
            if event == RELINEARIZE:
                self._relinearize()
                out[at - 1, :6] = _parameter_columns(self.state)
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

    def _current_model(self) -> Model:
        """Model without a random walk while relinearizing, which takes parameters for constant."""
        if not self.relinearizing:
            return self.model
        none = np.zeros_like(self.model.parameter_noise)
        return self.model._replace(parameter_noise=none, drift_noise=none)

    def _current_settings(self) -> FilterSettings:
        settings = self.settings._replace(fault_duration=self._fault_duration)
        if self.relinearizing:
            return settings
        return settings._replace(information_gain=math.inf, review_interval=math.inf)

    def _start_window(self) -> None:
        self.state.statistics[INFORMATION_GAIN] = self.state.statistics[REVIEW_TIME] = 0.0
        self._window_start = _copy(self.state)
        self._window_steps: list[Steps] = []

    def _restart(self) -> None:
        """Return to the prior after an overflow."""
        self.state = initial_state(self.model)
        self.relinearizing = True
        self._start_window()
        self.resets.append(self.time)

    def _relinearize(self) -> None:
        """Run the window again at the estimate; stop keeping it once that changes nothing."""
        window = Window(self._window_start, concatenate_steps(self._window_steps))
        state, moved = relinearize(window, self.state, self.model, self.settings)
        self._window_steps = [window.steps]
        self.state.statistics[INFORMATION_GAIN] = 0.0
        self._settled_passes = self._settled_passes + 1 if moved < _SETTLED else 0
        if _is_valid(state):
            self.state = state
        widest = np.max(_parameter_sd(self.state) * self.model.scale[:3])
        self._passes = self._passes + 1 if widest < _KNOWN else 0
        if self._passes and (
            self._settled_passes >= _SETTLED_PASSES or self._passes >= _MAX_PASSES
        ):
            self.relinearizing = False
            self._window_steps = []
            if self.model.parameter_noise.any():  # the random walk over the window
                noise = self.model.parameter_noise * float(window.steps.step.sum())
                add_parameter_noise(self.state.D, self.state.J, self.state.Pi, noise)

    def _review_window(self) -> None:
        """Drop a window that has little information, or is too long."""
        self.state.statistics[REVIEW_TIME] = 0.0
        seconds = sum(float(part.step.sum()) for part in self._window_steps)
        if _log_volume(self._window_start) - _log_volume(self.state) < _MIN_GAIN:
            self._start_window()
        elif seconds > _MAX_WINDOW:
            self._relinearize()
            if self.relinearizing:
                self._start_window()

    def _reset(self) -> None:
        """Reset motion and biases, and return the parameters to the older snapshot."""
        snapshot = self.state.snapshots[0]
        self.state = _reset_motion(
            self.state, snapshot[:, 0], np.ascontiguousarray(snapshot[:, 1:]), self.model
        )
        self.state.statistics[FAULT_TIME] = 0.0
        since = self.time - self.resets[-1] if self.resets else math.inf
        self._fault_duration = (
            min(2.0 * self._fault_duration, _MAX_FAULT_DURATION)
            if since < 4.0 * self._fault_duration + 1.0
            else self.settings.fault_duration
        )
        self.resets.append(self.time)
        if self.relinearizing:
            self._start_window()
