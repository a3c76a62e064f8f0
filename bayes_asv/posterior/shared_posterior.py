"""Posterior of the coordinates that runs share, with those of single runs integrated out.

Each run has its own noise levels, filtered share, biases and clock errors, and emcee needs more
steps the more coordinates there are.  Given the shared coordinates x, the coordinates η of the runs
are nearly normal: noise levels are known to 1/√(2 N), and biases are linear.  Laplace's
approximation integrates them out (Tierney & Kadane 1986, J. Am. Stat. Assoc. 81, 82–86)::

    log p(x | data) ≈ log p(x, η̂(x) | data) + constant,     η̂(x) = η̂ − H⁻¹ H_x (x − x̂),

with the curvatures H in η and H_x in η and x at the joint mode.  Replacing the conditional mode by
the line η̂(x) makes an error of second order in their distance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.newton import PosteriorMode

__all__ = ["SharedPosterior"]

Array = NDArray[np.float64]


class SharedPosterior:
    """Log density of the coordinates that all runs share.

    Parameters
    ----------
    posterior : Posterior
        Posterior of all coordinates.
    mode : PosteriorMode
        Its mode.

    Attributes
    ----------
    mode : PosteriorMode
        Mode and covariance of the shared coordinates.
    """

    def __init__(self, posterior: Posterior, mode: PosteriorMode) -> None:
        of_runs = np.array([c.run is not None for c in posterior.space.coordinates])
        self._posterior, self._all = posterior, mode
        self._shared, self._own = np.flatnonzero(~of_runs), np.flatnonzero(of_runs)
        precision = np.linalg.inv(mode.covariance)
        within = precision[np.ix_(self._own, self._own)]
        across = precision[np.ix_(self._own, self._shared)]
        self._follow = -np.linalg.solve(within, across)
        self._root = np.linalg.inv(np.linalg.cholesky(within)).T
        self.mode = PosteriorMode(
            mode.z[self._shared], mode.covariance[np.ix_(self._shared, self._shared)],
            mode.log_posterior, mode.converged,
        )  # fmt: skip

    def _along(self, x: Array) -> Array:
        """Coordinates (W, D) with shared part x (W, d) and those of the runs at η̂(x)."""
        z = np.empty((len(x), len(self._all.z)))
        z[:, self._shared] = x
        z[:, self._own] = self._all.z[self._own] + (x - self.mode.z) @ self._follow.T
        return z

    def log_posterior(self, x: Array) -> Array:
        """Log density (W,), not normalised, at shared coordinates (W, d)."""
        return self._posterior.log_posterior(self._along(x))

    def completed(self, x: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Draw the coordinates of the runs for draws of the shared ones.

        Parameters
        ----------
        x : (S, d) array
            Draws of the shared coordinates.
        rng : numpy.random.Generator
            Source of random numbers.

        Returns
        -------
        z : (S, D) array
            All coordinates.
        change : (S,) array
            Contribution of the coordinates of the runs to the log density.
        """
        z, normals = self._along(x), rng.standard_normal((len(x), len(self._own)))
        z[:, self._own] += normals @ self._root.T
        return z, -0.5 * np.sum(normals**2, axis=1)
