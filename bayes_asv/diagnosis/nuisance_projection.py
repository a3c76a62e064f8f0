"""What a model can imitate by what it estimates anyway, and what is left of a signature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.fisher_scoring import ScoreAndInformation

__all__ = ["NuisanceProjection", "imitation"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NuisanceProjection:
    """A model's own coordinates, and others that are granted to it, at its mode.

    Parameters
    ----------
    rows : (G, N) array
        Changes of the predictions along each, in deviations.
    precision : (G, G) array
        Of the posterior.
    slope : (G,) array
        Of the log-posterior.
    nu : (N,) array
        Innovations.
    """

    rows: Array
    precision: Array
    slope: Array
    nu: Array

    def beyond(self, rows: Array) -> tuple[Array, Array]:
        """Pull (K,) and Gram matrix (K, K) of signatures (K, N), what is imitated left out.

        The mode is that of all readings, and found to a few thousandths of a nat: for a signature
        that the model can all but imitate, what a step of its own would still gain is not nothing.
        """
        cross = self.rows @ rows.T
        solved = np.linalg.solve(self.precision, np.column_stack([self.slope, cross]))
        pull = rows @ self.nu - cross.T @ solved[:, 0]
        return pull, rows @ rows.T - cross.T @ solved[:, 1:]


def imitation(
    own: ScoreAndInformation, z: Array, granted: Array, at: Array | None = None
) -> NuisanceProjection:
    """Say what a stage can imitate.

    Parameters
    ----------
    own : ScoreAndInformation
        The stage's innovations, and what its coordinates change on quiet wheels.
    z : (D,) array
        Its mode.
    granted : (G, N) array
        Signatures of standard normal coordinates that the stage does not have.
    at : (G,) array, optional
        Where they are in the stage's innovations; at zero when left out.
    """
    rows = np.concatenate([own.means, granted])
    precision = rows @ rows.T + np.eye(len(rows))
    d = len(own.means)
    precision[:d, :d] = own.precision()
    there = np.zeros(len(granted)) if at is None else at
    slope = np.concatenate([own.gradient(z), granted @ own.nu - there])
    return NuisanceProjection(rows, precision, slope, own.nu)
