"""The mode in a band, where what is left over is the car's own doing and not the sensors'.

On the road a half car leaves ten or a hundred times more than its sensors' noise: the other
side of the road, friction, the body.  A filter that takes all of it for noise of the wheels
lets the spectrum of what is left speak about dampers, which it knows nothing of.  So where the
sensors do not explain what is left, the wheels are taken as they are read, what is left is an
autoregression of its own (its coefficients plugged in, of low order: a high one follows every
dip of the spectrum and puts all its trust there), and the parts of each recording say how much
of it counts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.modes import nominal_modes
from bayes_asv.posterior.composite_likelihood import FEWEST_PARTS, PERIODS, share
from bayes_asv.posterior.fit_checks import excess_noise_sentence
from bayes_asv.posterior.likelihood import WHITE, Posterior, ResidualAR, shared_work
from bayes_asv.posterior.newton import Mode, find_mode
from bayes_asv.posterior.parameters import space
from bayes_asv.posterior.residual_ar import fit_residual_ar
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["BandFit", "fit_in_band", "notes"]

Array = NDArray[np.float64]

_ROUNDS = 3
_MOST_LAGS = 4
_TOLD = 0.8  # share below which it is worth a word


class BandFit(NamedTuple):
    """A mode in a band.

    Parameters
    ----------
    mode : Mode
        Mode and curvature.
    target : Posterior
        The posterior; its likelihood is ``innovations`` where the sensors' noise explains what
        is left, ``coloured`` where it does not.
    shares : tuple of float or None
        Share of its readings that each run counts for; None where it is too short to tell.
        Empty where the sensors explain what is left.
    """

    mode: Mode
    target: Posterior
    shares: tuple[float | None, ...] = ()


def fit_in_band(lines: tuple[PreparedRecording, ...], vehicle: Vehicle) -> BandFit:
    """Climb to the mode of recordings of which a band is left.

    Parameters
    ----------
    lines : tuple of PreparedRecording
        From :func:`bayes_asv.preprocessing.band.low_pass_recording`.
    vehicle : Vehicle
        Gives the priors.

    Returns
    -------
    BandFit
    """
    if all(noise is not None for line in lines for noise in line.noise):
        mode, target = _climb(Posterior(space(vehicle, lines), (WHITE,) * len(lines)), None)
        if _sensors_explain(target, mode):
            return BandFit(mode, target)
    mode, target = _climb(Posterior(space(vehicle, lines, "coloured"), (WHITE,) * len(lines)), None)
    # The colour has the scale of what is left, so that the noise levels are but units.
    where = space(vehicle, lines, "coloured", frozenset(range(len(lines))))
    for _ in range(_ROUNDS):
        colours = tuple(_colour(target, mode.z, run) for run in range(len(lines)))
        start = where.origin
        start[: where.car_dimension] = mode.z[: where.car_dimension]
        mode, target = _climb(Posterior(where, colours), start)
    slowest = _slowest(lines[0])
    shares = tuple(share(target, mode, run, slowest) for run in range(len(lines)))
    counted = tuple(
        colour._replace(root=colour.root * math.sqrt(1.0 if part is None else part))
        for colour, part in zip(target.colours, shares, strict=True)
    )
    mode, target = _climb(Posterior(where, counted), mode.z)
    return BandFit(mode, target, shares)


def notes(line: PreparedRecording, part: float | None) -> list[str]:
    """Say how much wider the intervals are for what the parts of a recording say.

    Parameters
    ----------
    line : PreparedRecording
        The recording.
    part : float or None
        Its share.

    Returns
    -------
    list of str
    """
    if part is None:
        needed = FEWEST_PARTS * PERIODS / _slowest(line)
        return [
            f"what is left over in {line.source} is not the sensors' noise, and the recording is "
            f"too short to tell from its parts whether the intervals are wide enough; that takes "
            f"{math.ceil(needed)} s"
        ]
    if part >= _TOLD:
        return []
    return [
        f"the parts of {line.source} differ {1.0 / math.sqrt(part):.1f} times as much as what is "
        "left over lets expect, and the intervals are wider by as much"
    ]


def _climb(target: Posterior, start: Array | None) -> tuple[Mode, Posterior]:
    with shared_work(target) as shared:
        return find_mode(shared, start), replace(target, pool=None)


def _sensors_explain(target: Posterior, mode: Mode) -> bool:
    """Whether what is left is as white and as small as the sensors' noise that was given."""
    noise = {n: float(x[0]) for n, x in target.space.nuisance(mode.z[None]).items()}
    for run, line in enumerate(target.space.timelines):
        nu = line.paired(target.innovations(mode.z, run))
        if excess_noise_sentence(line, noise, run) or fit_residual_ar(nu).order > 0:
            return False
    return mode.converged


def _colour(target: Posterior, z: Array, run: int) -> ResidualAR:
    """Colour and scale of what one run leaves."""
    line = target.space.timelines[run]
    nu = line.paired(target.innovations(z, run, WHITE))
    found = fit_residual_ar(nu, 1, _MOST_LAGS)
    if found.order > 0:
        return found
    whole = nu[np.isfinite(nu).all(axis=1)]
    root = np.linalg.inv(np.linalg.cholesky(whole.T @ whole / len(whole)))
    return ResidualAR(np.zeros((1, nu.shape[1], nu.shape[1])), np.ascontiguousarray(root))


def _slowest(line: PreparedRecording) -> float:
    """Natural frequency of the slowest nominal mode, Hz."""
    return nominal_modes(line.car)[0].natural
