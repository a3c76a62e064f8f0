"""The mode in a band, where what is left over is the car's own doing and not the sensors'.

On the road a half car leaves ten or a hundred times more than its sensors' noise: the other
side of the road, friction, the body.  A filter that takes all of it for noise of the wheels
lets the spectrum of what is left speak about dampers, which it knows nothing of.  So where the
sensors do not explain what is left, the wheels are taken as they are read, what is left is an
autoregression of its own (its coefficients plugged in, of low order: a high one follows every
dip of the spectrum and puts all its trust there), and the parts of each recording say how much
of it counts.

Where a car does what no half car does, what is left over is no steady noise: it swells and
changes with the road, and the curvature of the likelihood claims too much.  The score of each
part of a recording, its pull on the parameters, shows how much: the parts' scores vary by F,
the information, if the likelihood is right, and by K if it is not.  The likelihood is then
raised to the power tr(F Σ) / tr(K Σ), with Σ the posterior's covariance, so that on the whole
the posterior is as wide as the estimate varies: the magnitude adjustment of a composite
likelihood (Pauli, Racugno & Ventura 2011, Statistica Sinica 21) with Takeuchi's trace.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.modes import nominal_modes
from bayes_asv.posterior.fit_checks import excess_noise_sentence
from bayes_asv.posterior.likelihood import WHITE, Posterior, ResidualAR, shared_work
from bayes_asv.posterior.newton import PosteriorMode, find_mode
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.posterior.residual_ar import fit_residual_ar
from bayes_asv.preprocessing.events import FEWEST_PARTS, PART_PERIODS
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "FEWEST_PARTS",
    "PART_PERIODS",
    "BandFit",
    "composite_likelihood_power",
    "find_mode_threaded",
    "fit_in_band",
    "likelihood_weight",
    "notes",
]

_STEP = 0.1  # of a posterior deviation, for derivatives of what is all but linear


def composite_likelihood_power(scores: Array, information: Array, covariance: Array) -> float:
    """Power of a likelihood whose parts' scores vary more than its information says.

    Parameters
    ----------
    scores : (B, d) array
        Gradient of each part's log-likelihood.
    information : (d, d) array
        F, what the whole claims to know.
    covariance : (d, d) array
        Σ, of the posterior.

    Returns
    -------
    float
        tr(F Σ) / tr(K Σ) with K the B parts' sum of squares about their mean, times
        B / (B − 1); near 1 if the likelihood is right, with a relative deviation of about
        √(2 / (B p)) where p parameters are measured.  Never above 1.
    """
    count = len(scores)
    about = scores - scores.mean(axis=0)
    varied = float(np.sum((about @ covariance) * about)) * count / (count - 1)
    claimed = float(np.sum(information * covariance))
    return min(1.0, claimed / varied) if varied > 0.0 else 1.0


def likelihood_weight(
    posterior: Posterior, mode: PosteriorMode, run: int, slowest: float
) -> float | None:
    """Share of its readings for which a run should count.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    mode : Mode
        Its mode.
    run : int
        Which recording.
    slowest : float
        Natural frequency of the car's slowest mode, Hz.

    Returns
    -------
    float or None
        None when the recording has not :data:`FEWEST_PARTS` parts of :data:`PART_PERIODS` periods.
    """
    recording = posterior.space.recordings[run]
    time = recording.instants[recording.group_instants.max(axis=1)]
    span = float(time[-1] - time[0])
    count = int(span * slowest / PART_PERIODS)
    if count < FEWEST_PARTS:
        return None
    n = posterior.space.car_dimension
    sd = mode.sd[:n]

    steps = _STEP * np.eye(n, len(mode.z)) * mode.sd
    points = mode.z + np.concatenate([np.zeros((1, len(mode.z))), steps, -steps])
    found = [np.nan_to_num(recording.paired(one)) for one in posterior.innovations(points, run)]
    # in units of the posterior's deviations
    slope = np.stack([(found[1 + k] - found[1 + n + k]) / (2.0 * _STEP) for k in range(n)], axis=2)
    information = np.einsum("tak,tal->kl", slope, slope)
    pull = -np.einsum("tak,ta->tk", slope, found[0])
    part = np.minimum(((time - time[0]) / span * count).astype(int), count - 1)
    scores = np.zeros((count, n))
    np.add.at(scores, part, pull)
    covariance = np.linalg.inv(information + np.diag(sd**2))  # the prior is a standard normal
    return composite_likelihood_power(scores, information, covariance)


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
    posterior : Posterior
        The posterior; its likelihood is ``innovations`` where the sensors' noise explains what
        is left, ``coloured`` where it does not.
    shares : tuple of float or None
        Share of its readings that each run counts for; None where it is too short to tell.
        Empty where the sensors explain what is left.
    """

    mode: PosteriorMode
    posterior: Posterior
    shares: tuple[float | None, ...] = ()


def fit_in_band(recordings: tuple[PreparedRecording, ...], vehicle: Vehicle) -> BandFit:
    """Climb to the mode of recordings of which a band is left.

    Parameters
    ----------
    recordings : tuple of PreparedRecording
        From :func:`bayes_asv.preprocessing.band.low_pass_recording`.
    vehicle : Vehicle
        Gives the priors.

    Returns
    -------
    BandFit
    """
    if all(noise is not None for recording in recordings for noise in recording.noise):
        mode, posterior = find_mode_threaded(
            Posterior(make_parameter_space(vehicle, recordings), (WHITE,) * len(recordings)), None
        )
        if _sensors_explain(posterior, mode):
            return BandFit(mode, posterior)
    mode, posterior = find_mode_threaded(
        Posterior(
            make_parameter_space(vehicle, recordings, "coloured"), (WHITE,) * len(recordings)
        ),
        None,
    )
    # The colour has the scale of what is left, so that the noise levels are but units.
    parameter_space = make_parameter_space(
        vehicle, recordings, "coloured", frozenset(range(len(recordings)))
    )
    for _ in range(_ROUNDS):
        colours = tuple(_colour(posterior, mode.z, run) for run in range(len(recordings)))
        start = parameter_space.origin
        start[: parameter_space.car_dimension] = mode.z[: parameter_space.car_dimension]
        mode, posterior = find_mode_threaded(Posterior(parameter_space, colours), start)
    slowest = _slowest(recordings[0])
    shares = tuple(
        likelihood_weight(posterior, mode, run, slowest) for run in range(len(recordings))
    )
    counted = tuple(
        colour._replace(root=colour.root * math.sqrt(1.0 if part is None else part))
        for colour, part in zip(posterior.residual_ars, shares, strict=True)
    )
    mode, posterior = find_mode_threaded(Posterior(parameter_space, counted), mode.z)
    return BandFit(mode, posterior, shares)


def notes(recording: PreparedRecording, part: float | None) -> list[str]:
    """Say how much wider the intervals are for what the parts of a recording say.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    part : float or None
        Its share.

    Returns
    -------
    list of str
    """
    if part is None:
        needed = FEWEST_PARTS * PART_PERIODS / _slowest(recording)
        return [
            f"what is left over in {recording.source} is not the sensors' noise, and the recording "
            f"is too short to tell from its parts whether the intervals are wide enough; that "
            f"takes {math.ceil(needed)} s"
        ]
    if part >= _TOLD:
        return []
    return [
        f"the parts of {recording.source} differ {1.0 / math.sqrt(part):.1f} times as much as what "
        "is left over lets expect, and the intervals are wider by as much"
    ]


def find_mode_threaded(
    posterior: Posterior, start: Array | None = None
) -> tuple[PosteriorMode, Posterior]:
    """Find the mode of a posterior with all processors; return it and the posterior."""
    with shared_work(posterior) as shared:
        return find_mode(shared, start), replace(posterior, pool=None)


def _sensors_explain(posterior: Posterior, mode: PosteriorMode) -> bool:
    """Whether what is left is as white and as small as the sensors' noise that was given."""
    noise = {n: float(x[0]) for n, x in posterior.space.nuisance(mode.z[None]).items()}
    for run, recording in enumerate(posterior.space.recordings):
        nu = recording.paired(posterior.innovations(mode.z, run))
        if excess_noise_sentence(recording, noise, run) or fit_residual_ar(nu).order > 0:
            return False
    return mode.converged


def _colour(posterior: Posterior, z: Array, run: int) -> ResidualAR:
    """Colour and scale of what one run leaves."""
    recording = posterior.space.recordings[run]
    nu = recording.paired(posterior.innovations(z, run, WHITE))
    found = fit_residual_ar(nu, 1, _MOST_LAGS)
    if found.order > 0:
        return found
    whole = nu[np.isfinite(nu).all(axis=1)]
    root = np.linalg.inv(np.linalg.cholesky(whole.T @ whole / len(whole)))
    return ResidualAR(np.zeros((1, nu.shape[1], nu.shape[1])), np.ascontiguousarray(root))


def _slowest(recording: PreparedRecording) -> float:
    """Natural frequency of the slowest nominal mode, Hz."""
    return nominal_modes(recording.car)[0].natural
