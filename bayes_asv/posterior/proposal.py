"""Split Student t distribution: proposal of the ensembles and of importance sampling."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.newton import Mode

__all__ = ["DEGREES_OF_FREEDOM", "Proposal"]

Array = NDArray[np.float64]

DEGREES_OF_FREEDOM = 20.0  # of the Student t: a little wider in the tails than a normal


class Proposal:
    """Independence proposal: a multivariate t, bent to the skew of each coordinate.

    A point z is bent to y = (z − m)/s with one scale s left and another right of m; y is a
    Student t with the given covariance.  Callable as emcee's MHMove wants it.
    """

    def __init__(self, middle: Array, left: Array, right: Array, covariance: Array) -> None:
        self.middle, self.left, self.right = middle, left, right
        self.root = np.linalg.cholesky(covariance)
        self.inverse = np.linalg.inv(self.root)
        d = len(middle)
        self._log_constant = (
            math.lgamma(0.5 * (DEGREES_OF_FREEDOM + d))
            - math.lgamma(0.5 * DEGREES_OF_FREEDOM)
            - 0.5 * d * math.log(DEGREES_OF_FREEDOM * math.pi)
            - float(np.sum(np.log(np.diag(self.root))))
        )

    @classmethod
    def around(cls, mode: Mode, inflation: float) -> Proposal:
        """From the curvature at the mode."""
        one = mode.sd
        return cls(mode.z, one, one, inflation * mode.covariance / np.outer(one, one))

    @classmethod
    def through(cls, points: Array, inflation: float) -> Proposal:
        """From draws (N, D)."""
        # Scales from the tails: a walker in a tail that is never proposed again gets stuck.
        low, middle, high = np.quantile(points, [0.05, 0.5, 0.95], axis=0)
        left = np.maximum(middle - low, 1e-12) / 1.645
        right = np.maximum(high - middle, 1e-12) / 1.645
        skewed = (points - middle) / np.where(points < middle, left, right)
        d = points.shape[1]
        spread = skewed.T @ skewed / len(skewed) + 1e-6 * np.eye(d)
        return cls(middle, left, right, inflation * spread)

    def log_density(self, z: Array) -> Array:
        """Log density (N,) at points (N, D)."""
        scale = np.where(z < self.middle, self.left, self.right)
        u = ((z - self.middle) / scale) @ self.inverse.T
        power = 0.5 * (DEGREES_OF_FREEDOM + z.shape[1])
        radial = -power * np.log1p(np.sum(u**2, axis=1) / DEGREES_OF_FREEDOM)
        return np.asarray(self._log_constant + radial - np.sum(np.log(scale), axis=1))

    def draw(self, count: int, random: np.random.RandomState) -> Array:
        """Draw (count, D) points."""
        stretch = np.sqrt(
            DEGREES_OF_FREEDOM / random.chisquare(DEGREES_OF_FREEDOM, size=(count, 1))
        )
        return self.skewed(random.normal(size=(count, len(self.middle))) * stretch)

    def skewed(self, t: Array) -> Array:
        """Points (N, D) from standard Student t variables (N, D)."""
        y = t @ self.root.T
        return np.asarray(self.middle + y * np.where(y < 0.0, self.left, self.right))

    def __call__(self, z: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose (N, D) points and the logarithms (N,) of their Metropolis–Hastings factors."""
        q = self.draw(len(z), random)
        return q, self.log_density(z) - self.log_density(q)
