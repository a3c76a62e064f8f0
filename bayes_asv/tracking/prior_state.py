"""What the filter knows: where it begins, and the same told in other ways."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.ukf_state import LAGS, MEMORY, QUICK, SUM, WEIGHT, Model, Rules, State
from bayes_asv.tracking.parameters import Coordinates

__all__ = [
    "RULES", "START", "beginning", "car_covariance", "copied", "forget_everything_but",
    "model_of", "sound", "volume",
]  # fmt: skip

Array = NDArray[np.float64]

# What the state may be when a record begins, as in inference.timeline: 0.1 m, 1 m/s, and 1 m/s²
# for the bias of a chassis channel against its wheel channel.
START = np.array([0.1, 1.0, 0.1, 1.0, 1.0, 1.0]) ** 2

RULES = Rules(
    gate=16.0,  # one reading in 16,000 lies beyond by chance
    trust=40.0,  # a declared noise is good to 11 %
    window=500.0,
    quick=32.0,
    sudden=2.5,
    broken=9.0,
    patience=0.25,
    coloured=2.5,
    learned=2.0,
    look=0.25,
)


_DOUBTED = 20.0  # s, see `Coordinates.walk`: how parameters may wander that do not stay put


def model_of(where: Coordinates, noise: Array, forget: float | None = None) -> Model:
    """Car and sensors as the kernels take them.

    Parameters
    ----------
    where : Coordinates
        What is learnt of the car.
    noise : (12,) array
        As in ``Sensing.kernel_noise``.
    forget : float, optional
        Seconds, see ``Coordinates.walk``.
    """
    return Model(
        where.base, where.which, where.log, where.centre, where.scale, noise, START,
        where.walk(forget), where.walk(_DOUBTED),
    )  # fmt: skip


def beginning(model: Model) -> State:
    """Make what is known before the first reading."""
    p = len(model.which)
    memory = np.zeros(MEMORY)
    memory[QUICK : QUICK + 2] = 1.0
    mu, D = np.zeros(p), np.eye(p)
    return State(
        mu=mu,
        D=D,
        x=np.zeros(10),
        J=np.zeros((p, 10)),
        m=np.zeros(p),
        F=np.eye(p),
        Pi=np.diag(np.concatenate([model.start, model.noise[4:8]])),
        memory=memory,
        safe=np.stack([np.column_stack([mu, D])] * 2),
        echo=_silent(),
    )


def _silent() -> Array:
    echo = np.zeros((2, 2, 1 + LAGS))
    echo[:, 1, 0] = 1.0
    return echo


def copied(state: State) -> State:
    """Copy every array."""
    return State(*(part.copy() for part in state))


def forget_everything_but(state: State, mu: Array, D: Array, model: Model) -> State:
    """Keep what is known of the car; motion and biases are as at the beginning."""
    fresh = beginning(model)
    memory = state.memory.copy()
    memory[QUICK : QUICK + 2] = 1.0
    memory[SUM : SUM + 2] = np.minimum(memory[SUM : SUM + 2], memory[WEIGHT : WEIGHT + 2])
    return fresh._replace(
        mu=mu.copy(), D=D.copy(), memory=memory, safe=np.stack([np.column_stack([mu, D])] * 2)
    )


def volume(state: State) -> float:
    """Logarithm of the volume that the parameters may be in, reference at the estimate."""
    return float(np.sum(np.log(np.abs(np.diag(state.D)))))


def car_covariance(state: State) -> Array:
    """Covariance (p, p) of the coordinates, reference at the estimate."""
    return np.asarray(state.D.T @ state.D)


def sound(state: State) -> bool:
    """Whether every number in it is a number, and no variance is below zero."""
    finite = all(np.all(np.isfinite(part)) for part in state)
    return finite and bool(np.all(np.diag(state.Pi) >= 0.0)) and not math.isnan(volume(state))
