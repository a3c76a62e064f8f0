"""The main job for a car that rolls: recordings and a vehicle in, a posterior out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.posterior.importance import Weighted, importance
from bayes_asv.posterior.newton import Mode
from bayes_asv.posterior.roll.freerun import left_over
from bayes_asv.posterior.roll.layout import lay_out
from bayes_asv.posterior.roll.posterior import (
    ROLL_ANSWERS,
    RollPosterior,
    climb,
    roll_posterior,
)
from bayes_asv.posterior.roll.preflight import roll_preflight, unexplained, unmeasured

__all__ = ["RollEstimate", "estimate_roll"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

_DRAWS = (1024, 4096)  # of the first try, and where its weights are too uneven
_ENOUGH = 200.0  # effective draws
_SWOLLEN = 3.0  # times the given noise beyond which something else hides in it


@dataclass(frozen=True)
class RollEstimate:
    """What the data say of a car that rolls.

    Parameters
    ----------
    verdict : str
        ``ok``, ``not_converged`` or ``refused``.
    reasons, warnings : tuple of str
        Why it was refused; what to know otherwise.
    vehicle : Vehicle
        As given.
    recordings : tuple of Recording
        As read.
    target : RollPosterior or None
        The posterior; None when refused before the fit.
    weighted : Weighted or None
        Its draws.
    quantities : dict of str to (S,) array
        Fields of :class:`~bayes_asv.models.roll_car.RollCar` at the draws, SI units.
    left : tuple of dict
        Rms of what a free run leaves of each chassis channel over its rms, one a recording.
    seconds : float
        How long it took.
    seed : int
        As given.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    vehicle: Vehicle
    recordings: tuple[Recording, ...]
    target: RollPosterior | None = None
    weighted: Weighted | None = None
    quantities: dict[str, Array] = field(default_factory=dict)
    left: tuple[dict[str, float], ...] = ()
    seconds: float = 0.0
    seed: int = 0


def estimate_roll(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> RollEstimate:
    """Estimate four damping rates and the inertias in pitch and roll.

    The mode comes by Fisher scoring from the nominal car, the posterior by weighted draws of a
    Student t at the mode, which are exact as far as their effective number goes.

    Parameters
    ----------
    recordings : sequence of Recording
        Of seven channels; they share the car.
    vehicle : Vehicle
        With a ``[roll]``.
    seed : int
        Same seed, same answer.
    progress : callable, optional
        Told the share done (0 to 1) and a few words.

    Returns
    -------
    RollEstimate

    Raises
    ------
    InputError
        When the recordings or the vehicle are not of a car that rolls.
    """
    began = time.perf_counter()
    tell = progress or (lambda _share, _words: None)
    runs = tuple(lay_out(recording, vehicle) for recording in recordings)
    target = roll_posterior(vehicle, runs)
    warnings = [w for recording in recordings for w in recording.warnings]
    if any(vehicle.sensor(c).counts_scale_sd for c in recordings[0].channels):
        warnings.append("the sd of counts_scale is not used for a car that rolls")

    reasons = [text for line in runs for text in roll_preflight(target.nominal, line)]
    if reasons:
        return RollEstimate(
            "refused", tuple(reasons), tuple(warnings), vehicle, tuple(recordings),
            seconds=time.perf_counter() - began, seed=seed,
        )  # fmt: skip
    with ThreadPoolExecutor(2) as pool:
        working = replace(target, pool=pool)
        tell(0.1, "climbing to the mode")
        mode = climb(working, np.zeros(len(target.names)))
        tell(0.4, "drawing")
        weighted = importance(working, mode, _DRAWS[0], seed)
        if weighted.effective < _ENOUGH:
            tell(0.6, "drawing again")
            weighted = importance(working, _reshaped(weighted, mode), _DRAWS[1], seed)
    quantities = _quantities(target, weighted)
    log_sd = {name: weighted.sd(np.log(quantities[name])) for name in ROLL_ANSWERS}
    best = target.car(mode.z)
    left = tuple(left_over(best, line) for line in runs)
    reasons = unmeasured(target, log_sd)
    for line, shares in zip(runs, left, strict=True):
        refused, doubts = unexplained(shares, line.source)
        reasons += refused
        warnings += doubts
    warnings += _swollen(target, mode.z)
    converged = mode.converged and weighted.effective >= _ENOUGH
    verdict = "refused" if reasons else "ok" if converged else "not_converged"
    return RollEstimate(
        verdict, tuple(reasons), tuple(warnings), vehicle, tuple(recordings), target, weighted,
        quantities, left, time.perf_counter() - began, seed,
    )  # fmt: skip


def _reshaped(weighted: Weighted, mode: Mode) -> Mode:
    """Take mean and covariance of weighted draws where the curvature at the mode misled."""
    mean = weighted.weight @ weighted.z
    apart = weighted.z - mean
    covariance = (weighted.weight[:, None] * apart).T @ apart
    blend = 0.5 * (covariance + mode.covariance)  # few draws give a ragged covariance
    return Mode(mean, blend, mode.log_posterior, mode.converged)


def _quantities(target: RollPosterior, weighted: Weighted) -> dict[str, Array]:
    cars = np.array([target.car(z) for z in weighted.z])
    return dict(zip(target.nominal._fields, cars.T, strict=True))


def _swollen(target: RollPosterior, z: Array) -> list[str]:
    """Name channels whose noise came out far beyond what is given."""
    said = []
    for name, x in zip(target.names, target.scale * z, strict=True):
        _, channel, run = name.split() if name.startswith("noise") else ("", "", "")
        if not channel or not x > np.log(_SWOLLEN):
            continue
        line = target.runs[int(run)]
        said.append(
            f"the noise of {channel.replace('_', ' ')} in {line.source} came out {np.exp(x):.1f} "
            "times what is given; something that this car does not know hides in it"
        )
    return said
