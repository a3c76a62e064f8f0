"""What a change of the model changes in the innovations, by a filter that stays as it is.

A coordinate of the car changes the simulation, and with it the filter: how loud its innovations
should be, and how much of one belongs into the next.  The second part tells the coordinate by the
noise alone.  On noise as believed that is a little more knowledge; on any other it is a bias that
no drive averages out, and what the car is off by shows as a fault of something else: an
over-damped car with quiet sensors had a wheel sensor that was late by 0.8 ms, eight deviations,
with twice the noise that there was believed fifteen, and none with the simulation alone.  So the
test looks at what changes in the free run, above the wheels, and how the filter as it stands sees
that: an estimating equation that is unbiased whatever the noise (Godambe 1960, Ann. Math. Stat. 31,
1208; Liang & Zeger 1986, Biometrika 73, 13), its weights those of the noise that is believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.free_simulation import free_run, simulated
from bayes_asv.posterior.likelihood import Perturbation, Posterior, shared_work

__all__ = ["FixedGainFilter", "along", "steady"]

Array = NDArray[np.float64]

_STEP = 1e-4  # of a prior deviation
_SMALL = 0.1  # deviations that readings are changed by: a law is drawn as a line there


@dataclass(frozen=True)
class FixedGainFilter:
    """A filter as it stands on one run.

    Parameters
    ----------
    target : Posterior
        Posterior of the model.
    z : (D,) array
        Where it stands.
    run : int
        Which recording.
    begin : (6,) array
        Where the free run begins, as :func:`free_run` has it.
    left : (E, 2) array
        Readings, as sensors as declared would have given them, less the free run, m/s².
    nu, logs : (E, 2) arrays
        Innovations and the logarithms of their variances.
    """

    target: Posterior
    z: Array
    run: int
    begin: Array
    left: Array
    nu: Array
    logs: Array

    @property
    def there(self) -> NDArray[np.bool_]:
        """Where there is a reading (E, 2)."""
        return np.asarray(self.logs != 0.0)

    def row(self, target: Posterior, z: Array) -> Array:
        """Change of the predictions (N,) towards another model, in deviations.

        Parameters
        ----------
        target, z : Posterior, (D',) array
            The other model, on the same recordings.
        """
        change = _left(target, z, self.run, self.begin) - self.left
        largest = float(np.max(np.abs(change)[self.there] * np.exp(-0.5 * self.logs[self.there])))
        if not 0.0 < largest < np.inf:
            return np.full(np.count_nonzero(self.there), 0.0 if largest == 0.0 else np.nan)
        small = _SMALL / largest
        moments = self.target.space.timelines[self.run].moments
        nudge = Perturbation(np.zeros_like(moments), small * change, np.zeros_like(change))
        return self.nudged(nudge) / small

    def nudged(self, nudge: Perturbation) -> Array:
        """Change of the predictions (N,) by a nudge of the run, in deviations."""
        return np.asarray((self.nu - self.target.scored(self.z, self.run, nudge)[0])[self.there])


def steady(target: Posterior, z: Array, run: int) -> FixedGainFilter:
    """Let a filter stand on a run."""
    begin = free_run(target, z, run)[2]
    nu, logs, _ = target.scored(z, run)
    return FixedGainFilter(target, z, run, begin, _left(target, z, run, begin), nu, logs)


def along(stands: Sequence[FixedGainFilter], first: int) -> Array:
    """Work out how the predictions of all runs change along a model's own coordinates.

    Parameters
    ----------
    stands : sequence of FixedGainFilter
        One a run.
    first : int
        How many coordinates: those before the first of noise, which changes no prediction.

    Returns
    -------
    (first, N) array
        In deviations.
    """
    return np.concatenate([_run_along(here, first) for here in stands], axis=1)


def _run_along(here: FixedGainFilter, first: int) -> Array:
    rows = np.zeros((first, np.count_nonzero(here.there)))
    own = [k for k in here.target.space.seen_by(here.run) if k < first]

    def one(k: int) -> Array:
        return here.row(here.target, here.z + _STEP * np.eye(len(here.z))[k]) / _STEP

    with shared_work(here.target) as shared:
        assert shared.pool is not None
        rows[own] = list(shared.pool.map(one, own))
    return rows


def _left(target: Posterior, z: Array, run: int, begin: Array) -> Array:
    inputs = target.as_declared(z, run)
    return np.asarray(inputs.reading - simulated(target, z, run, inputs, begin)[0])
