"""How the innovations of a run answer to the car's parameters.

The innovations ν are linear in the readings, and to first order in the parameters near the
mode.  With J = ∂ν/∂θ the data's information is F = JᵀJ (Gauss–Newton, the expected information
of the mean), which needs no second derivatives and is never negative.  On the rig it gives the
deviations of the mode's own curvature within a percent; a test holds it to that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.parameters import CAR

__all__ = ["in_logs", "information", "jacobian", "moved", "parameters", "prior_sd"]

Array = NDArray[np.float64]

_LOGS = tuple(name for name in CAR if name != "wdf")  # the order of a space's logarithms
_PLACES = [(*_LOGS, "wdf").index(name) for name in CAR]  # of each parameter in such a point
_MOVED = ("c_f", "c_r", "i", "k_f", "k_r", "wdf")  # what is differentiated; m and l follow
_STEP = 1e-5  # relative: one-sided differences are good to about as much


def in_logs(target: Posterior, z: Array) -> tuple[Posterior, Array]:
    """Return the same target with the car's own logarithms for coordinates.

    Parameters
    ----------
    target : Posterior
        In whitened coordinates, where a value given as exact has none.
    z : (D,) array
        Where the logarithms are to be zero.

    Returns
    -------
    target : Posterior
        Its first seven coordinates are log(θ/θ₀) of c_f, c_r, i, m, l, k_f, k_r, the next is
        the weight share, and the others are as they were.  Its prior means nothing.
    z : (D',) array
        The same point there.
    """
    space = target.space
    car = dict(zip(CAR, space.cars(z[None])[0], strict=True))
    other = [k for k, n in enumerate(space.names) if n != "wdf" and not n.startswith("car-")]
    gains = len(parameters(target)) - len(CAR)  # they come first, and in logarithms themselves
    scale, start = space.scale[other], z[other]
    start[:gains] *= scale[:gains]
    scale[:gains] = 1.0
    turned = replace(
        space,
        names=(*(f"car-{k}" for k in range(len(_LOGS))), "wdf", *(space.names[k] for k in other)),
        centre=np.concatenate([np.zeros(len(_LOGS)), [car["wdf"]], space.centre[other]]),
        scale=np.concatenate([np.ones(len(_LOGS)), [car["wdf"]], scale]),
        log_mean=np.log([car[name] for name in _LOGS]),
        log_sd=np.ones(len(_LOGS)),
        seen=np.eye(len(_LOGS)),
        unseen=np.zeros((len(_LOGS), 0)),
    )
    return replace(target, space=turned), np.concatenate([np.zeros(len(CAR)), start])


def parameters(target: Posterior) -> tuple[str, ...]:
    """Names of what an answer may depend on: CAR, and the gains that are uncertain."""
    return (*CAR, *(name for name in target.space.names if name.startswith("gain ")))


def jacobian(target: Posterior, z: Array, run: int) -> Array:
    """Relative derivatives of one run's normalised innovations.

    Parameters
    ----------
    target, z : Posterior, (D,) array
        From :func:`in_logs`.
    run : int
        Which run.

    Returns
    -------
    (2 E, 8) array
        ∂ν/∂log θ in the order of :data:`~bayes_asv.posterior.parameters.CAR`.  The columns of
        m and l follow from those of the others: scaling m, i, every c and every k by one
        factor changes no acceleration, nor does i in proportion to l².
    """
    middle = target.innovations(z, run).ravel()
    names = parameters(target)
    out = np.zeros((len(middle), len(names)))
    for name in (*_MOVED, *names[len(CAR) :]):
        away = np.zeros(len(names))
        away[names.index(name)] = _STEP
        beyond = target.innovations(moved(z, away), run).ravel()
        out[:, names.index(name)] = (beyond - middle) / _STEP
    scaled = [CAR.index(name) for name in ("c_f", "c_r", "i", "k_f", "k_r")]
    out[:, CAR.index("m")] = -out[:, scaled].sum(axis=1)
    out[:, CAR.index("l")] = -2.0 * out[:, CAR.index("i")]
    return out


def moved(z: Array, away: Array) -> Array:
    """Move a point of :func:`in_logs` by relative changes (P,) of :func:`parameters`."""
    out = z.copy()
    out[[*_PLACES, *range(len(CAR), len(away))]] += away
    return out


def information(slopes: Sequence[Array]) -> Array:
    """Information (8, 8) of all runs from their Jacobians."""
    return np.asarray(np.sum([j.T @ j for j in slopes], axis=0))


def prior_sd(target: Posterior, z: Array) -> Array:
    """Relative deviation (8,) of each parameter beforehand, zero where it is exact.

    Parameters
    ----------
    target, z : Posterior, (D,) array
        In whitened coordinates, at the mode.
    """
    space = target.space
    logs = dict(zip(_LOGS, space.log_sd, strict=True))
    share = 0.0
    if "wdf" in space.names:
        value = space.cars(z[None])[0][CAR.index("wdf")]
        share = float(space.scale[space.names.index("wdf")] / value)
    gains = [space.scale[space.names.index(name)] for name in parameters(target)[len(CAR) :]]
    return np.array([*(share if name == "wdf" else float(logs[name]) for name in CAR), *gains])
