"""Simulation error: measured minus simulated outputs, and its floor due to sensor noise.

The model is simulated from the wheel accelerations.  On a recording to which it was not fitted, all
parameters are fixed except biases, initial state and noise levels.  Outputs of one quantity are
compared in its unit, those of several quantities relative to the standard deviation of each
channel.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from bayes_asv.domain.errors import FitError
from bayes_asv.filters.kalman import VALUE
from bayes_asv.filters.noise_simulation import normals_needed, simulate_noise
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, update_corrections_at
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Posterior

__all__ = [
    "ErrorChange",
    "SimulationResiduals",
    "compare_errors",
    "error_increased",
    "simulation_residuals",
    "transfer_frozen",
]

Array = NDArray[np.float64]

_NOISE_RUNS = 24  # simulations of sensor noise for the floor
_NOISE_ROUNDS = 4  # Fisher-scoring iterations for the noise levels
_BLOCK = 0.25  # bootstrap block, s: longer than the correlation time of the body's motion
_BOOTSTRAP_DRAWS = 4999


@dataclass(frozen=True)
class SimulationResiduals:
    """Measured minus simulated outputs of each run.

    Parameters
    ----------
    residuals : tuple of (R, ny) arrays
        Residuals in the unit of ``dimension``; nan where there is no reading.
    times : tuple of (R,) arrays
        Times, s.
    floors : tuple of float
        Root-mean-square residual due to sensor noise alone, for each run.
    dimension : str
        Physical dimension of the residuals; ``dimensionless`` if outputs have several.
    """

    residuals: tuple[Array, ...]
    times: tuple[Array, ...]
    floors: tuple[float, ...]
    dimension: str = "acceleration"

    @property
    def rms(self) -> float:
        """Root-mean-square over all runs and outputs."""
        return float(np.sqrt(np.nanmean(np.concatenate([r.ravel() for r in self.residuals]) ** 2)))

    @property
    def floor(self) -> float:
        """Root-mean-square residual due to noise alone, over all runs."""
        weight = np.array([np.count_nonzero(np.isfinite(r)) for r in self.residuals])
        return float(np.sqrt(weight @ np.array(self.floors) ** 2 / weight.sum()))


@dataclass(frozen=True)
class ErrorChange:
    """Simulation error before and after effects were added.

    Parameters
    ----------
    before, after, floor : float
        Root-mean-squares, SI units.
    worse : bool
        Whether the error increased significantly, by the bootstrap.
    dimension : str
        As in :class:`SimulationResiduals`.
    """

    before: float
    after: float
    floor: float
    worse: bool
    dimension: str = "acceleration"

    @property
    def closed(self) -> float | None:
        """Share of the squared error above the floor that was removed; None at the floor."""
        above = self.before**2 - self.floor**2
        return 1.0 - (self.after**2 - self.floor**2) / above if above > 0.0 else None


def transfer_frozen(
    dataset: Dataset, model: FittedModel, same_runs: bool
) -> tuple[Posterior, Array]:
    """Transfer a model's car and effects to recordings.

    Effects of a single run are transferred only with ``same_runs``, that is, to the recordings to
    which the model was fitted.
    """
    placed_effects: tuple[PlacedEffect, ...] = tuple(
        s for s in model.placed_effects if same_runs or s.run is None
    )
    posterior = dataset.posterior(placed_effects)
    z = model.transfer(posterior.space)
    if any(
        s.effect.acts == "reading" for s in placed_effects
    ):  # sensor corrections depend on the predicted signal
        with contextlib.suppress(FitError):  # the simulation that follows diverges as well
            posterior = update_corrections_at(dataset, posterior, z).posterior(placed_effects)
    return posterior, _fit_noise(posterior, z)


def _fit_noise(posterior: Posterior, z: Array) -> Array:
    """Estimate the noise levels again, with all other coordinates fixed."""
    first = posterior.space.shared_dimension
    z = z.copy()
    z[first:] = 0.0
    for _ in range(_NOISE_ROUNDS):
        at = slopes(posterior, z, first=first)
        step = np.linalg.solve(at.precision()[first:, first:], at.gradient(z)[first:])
        z[first:] += np.clip(step, -1.0, 1.0)
    return z


def simulation_residuals(
    dataset: Dataset, model: FittedModel, seed: int, *, same_runs: bool = False
) -> SimulationResiduals:
    """Simulate recordings by a frozen model and subtract the simulation from the measurement.

    Parameters
    ----------
    dataset : Dataset
        Recordings; the model need not have been fitted to them.
    model : FittedModel
        The model.
    seed : int
        Seed of the simulated noise of the floor.
    same_runs : bool
        Whether the model was fitted to these recordings, so that effects of a single run apply.
    """
    posterior, z = transfer_frozen(dataset, model, same_runs)
    dimension, scales = _scales(dataset)
    residuals, times, floors = [], [], []
    for run, recording in enumerate(dataset.recordings):
        output = free_run(posterior, z, run).output
        valid = recording.kind == VALUE
        scale = np.array([scales[recording.channels[c].name] for c in recording.outputs])
        residual_readings = np.where(valid, (recording.reading - output) / scale, np.nan)
        residuals.append(recording.paired(residual_readings))
        times.append(recording.instants[recording.group_instants.max(axis=1)])
        rng = np.random.default_rng([seed, run, 31])
        needed = normals_needed(len(recording.wheels), recording.kind.shape[1])
        out = simulate_noise(
            posterior.space.state_space(z[None], run),
            posterior.space.noises(z[None], run),
            recording.measurements._replace(process_noise=recording.noise_spread),
            rng.standard_normal((len(recording.step), _NOISE_RUNS, needed)),
        )
        noise = out.transpose(0, 2, 1) / scale[:, None]
        floors.append(float(np.sqrt(np.mean(noise[valid] ** 2))))
    return SimulationResiduals(tuple(residuals), tuple(times), tuple(floors), dimension)


def _scales(dataset: Dataset) -> tuple[str, dict[str, float]]:
    """Dimension of the residuals, and the scale by which those of each output are divided."""
    outputs = [channel for channel in dataset.channels if not channel.is_input]
    dimensions = {channel.dimension for channel in outputs}
    if len(dimensions) == 1:
        return dimensions.pop(), {channel.name: 1.0 for channel in outputs}
    readings: dict[str, list[Array]] = {}
    for recording in dataset.recordings:
        for y, c in enumerate(recording.outputs):
            values = recording.reading[recording.kind[:, y] == VALUE, y]
            readings.setdefault(recording.channels[c].name, []).append(values)
    scales = {name: float(np.std(np.concatenate(values))) for name, values in readings.items()}
    return "dimensionless", {name: scale or 1.0 for name, scale in scales.items()}


def error_increased(before: SimulationResiduals, after: SimulationResiduals, seed: int) -> bool:
    """Whether the error increased beyond the 95 % interval of a block bootstrap (Künsch 1989).

    The percentile interval of few blocks is too narrow; it is expanded by the ratio of Student's t
    to a normal (Hesterberg 2015, Am. Stat. 69:371).
    """
    by_block = []
    for one, two, time in zip(before.residuals, after.residuals, before.times, strict=True):
        if np.any(np.isfinite(one) & ~np.isfinite(two)):
            return True  # the simulation diverged
        block = ((time - time[0]) / _BLOCK).astype(int)
        increase = np.nansum(two**2 - one**2, axis=1)
        by_block += [float(increase[block == k].sum()) for k in range(int(block.max()) + 1)]
    increases = np.array(by_block)
    n = len(increases)
    if n < 3:
        return bool(increases.sum() > 0.0)
    level = norm.cdf(-math.sqrt(n / (n - 1)) * t.isf(0.025, n - 1))
    rng = np.random.default_rng([seed, 41])
    drawn = rng.choice(increases, (_BOOTSTRAP_DRAWS, n)).sum(axis=1)
    return bool(np.quantile(drawn, level) > 0.0)


def compare_errors(
    dataset: Dataset,
    before: FittedModel,
    after: FittedModel,
    seed: int,
    *,
    same_runs: bool = False,
    perturbed: Dataset | None = None,
) -> ErrorChange:
    """Compare the simulation errors of two frozen models.

    The floor is the smaller one of the two: the noise level of a wrong model absorbs its misfit.

    Parameters
    ----------
    before, after : FittedModel
        Models before and after the change.
    dataset, seed, same_runs
        As in :func:`simulation_residuals`; the seed is also that of the bootstrap.
    perturbed : Dataset, optional
        The same recordings with an unlisted fault, for the model ``after``.
    """
    one = simulation_residuals(dataset, before, seed, same_runs=same_runs)
    two = simulation_residuals(
        dataset if perturbed is None else perturbed, after, seed, same_runs=same_runs
    )
    floor, worse = min(one.floor, two.floor), error_increased(one, two, seed)
    return ErrorChange(one.rms, two.rms, floor, worse, one.dimension)
