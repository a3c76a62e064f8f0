"""The car's quantities under what was found: draws from each explanation by its share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.tolerance_prior import ModelEvidence
from bayes_asv.posterior.fitted_model import FittedModel

__all__ = ["Told", "draws", "effect_draws", "told_by"]

Array = NDArray[np.float64]

_DRAWS = 4000
_NEGLIGIBLE = 0.005  # share of an explanation that is left out of the parameters

Told = tuple[float, FittedModel, Array, Array]
"""A share, and a Gaussian in a stage's coordinates."""


def told_by(stage: FittedModel, granted: ModelEvidence, share: float = 1.0) -> list[Told]:
    """Return what one explanation says of the car; nothing when it has no share."""
    if share < _NEGLIGIBLE:
        return []
    return [(share, stage, stage.mode.z + granted.shift, granted.covariance)]


def draws(told: list[Told], seed: int) -> dict[str, Array]:
    """Draw the car's quantities from explanations in proportion to their shares (Laplace)."""
    rng = np.random.default_rng([seed, 51])
    shares = np.array([t[0] for t in told])
    counts = rng.multinomial(_DRAWS, shares / shares.sum())
    parts = [
        stage.space.quantities(rng.multivariate_normal(z, covariance, n, method="eigh"), seed)
        for n, (_, stage, z, covariance) in zip(counts, told, strict=True)
        if n > 1
    ]
    names = set.intersection(*(set(p) for p in parts))
    return {n: np.concatenate([p[n] for p in parts]) for n in sorted(names)}


def effect_draws(
    stage: FittedModel, granted: ModelEvidence, seed: int
) -> dict[str, dict[str, Array]]:
    """Draw the parameters of every effect that was named, a little of everything else beside it."""
    rng = np.random.default_rng([seed, 52])
    mean = stage.mode.z + granted.shift
    z = rng.multivariate_normal(mean, granted.covariance, _DRAWS, method="eigh")
    return {str(site): values for site, values in stage.space.effect_draws(z).items()}
