"""The mode in a band, where residuals are motion of the car and not sensor noise.

On the road, the residuals of a half car are ten or a hundred times larger than the noise of its
sensors: the other side of the road, friction, motion of the body.  If the filter took all of this
for noise of the wheel sensors, the spectrum of the residuals would inform the dampers, about which
it says nothing.  Where sensor noise does not explain the residuals, the wheel readings are
therefore used as they are, and the residuals are modelled as an autoregression with plugged-in
coefficients.  Its order is low: a higher one would follow every dip of the spectrum and give those
frequencies all the weight.

The residuals are not stationary: they change with the road, and the curvature of the likelihood
overstates the information.  The scores of the parts of a recording show by how much: their variance
is F, the information, if the likelihood is right, and K otherwise.  The likelihood is raised to the
power tr(F Σ) / tr(K Σ), with Σ the covariance of the posterior, so that overall the width of the
posterior matches the variation of the estimate: the magnitude adjustment of a composite likelihood
(Pauli, Racugno & Ventura 2011, Statistica Sinica 21) with Takeuchi's trace.
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

_STEP = 0.1  # step of finite differences, posterior sd; innovations are nearly linear in it


def composite_likelihood_power(scores: Array, information: Array, covariance: Array) -> float:
    """Power of a likelihood whose scores vary more than its information says.

    Parameters
    ----------
    scores : (B, d) array
        Gradient of each part's log-likelihood.
    information : (d, d) array
        F, the information of the whole recording.
    covariance : (d, d) array
        Σ, the covariance of the posterior.

    Returns
    -------
    float
        tr(F Σ) / tr(K Σ), at most 1, with K the sum of squares of the B scores about their mean
        times B / (B − 1).  It is near 1 if the likelihood is right, with a relative standard
        deviation of about √(2 / (B p)) for p measured parameters.
    """
    count = len(scores)
    deviations = scores - scores.mean(axis=0)
    observed = float(np.sum((deviations @ covariance) * deviations)) * count / (count - 1)
    expected = float(np.sum(information * covariance))
    return min(1.0, expected / observed) if observed > 0.0 else 1.0


def likelihood_weight(
    posterior: Posterior, mode: PosteriorMode, run: int, slowest: float
) -> float | None:
    """Power to which the likelihood of a run should be raised.

    Parameters
    ----------
    posterior : Posterior
        The posterior.
    mode : PosteriorMode
        Its mode.
    run : int
        Which recording.
    slowest : float
        Natural frequency of the car's slowest mode, Hz.

    Returns
    -------
    float or None
        None if the recording is shorter than :data:`FEWEST_PARTS` parts of :data:`PART_PERIODS`
        periods.
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
    innovations = [
        np.nan_to_num(recording.paired(one)) for one in posterior.innovations(points, run)
    ]
    # in units of the posterior standard deviations
    slope = np.stack(
        [(innovations[1 + k] - innovations[1 + n + k]) / (2.0 * _STEP) for k in range(n)], axis=2
    )
    information = np.einsum("tak,tal->kl", slope, slope)
    pull = -np.einsum("tak,ta->tk", slope, innovations[0])
    part = np.minimum(((time - time[0]) / span * count).astype(int), count - 1)
    scores = np.zeros((count, n))
    np.add.at(scores, part, pull)
    covariance = np.linalg.inv(information + np.diag(sd**2))  # the prior is a standard normal
    return composite_likelihood_power(scores, information, covariance)


Array = NDArray[np.float64]

_ROUNDS = 3  # alternations between autoregression and mode
_MAX_ORDER = 4  # highest order of the autoregression
_REPORTED_WEIGHT = 0.8  # likelihood weight of a run below which a note is given


class BandFit(NamedTuple):
    """A mode in a band.

    Parameters
    ----------
    mode : PosteriorMode
        Mode and curvature.
    posterior : Posterior
        The posterior; its likelihood is ``innovations`` if sensor noise explains the residuals,
        and ``coloured`` otherwise.
    shares : tuple of float or None
        Likelihood weight of each run; None if the run is too short to estimate it.  Empty if sensor
        noise explains the residuals.
    """

    mode: PosteriorMode
    posterior: Posterior
    shares: tuple[float | None, ...] = ()


def fit_in_band(recordings: tuple[PreparedRecording, ...], vehicle: Vehicle) -> BandFit:
    """Find the mode for recordings that were limited to a band.

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
    # the autoregression sets the scale of the residuals, so the noise levels are fixed
    parameter_space = make_parameter_space(
        vehicle, recordings, "coloured", frozenset(range(len(recordings)))
    )
    for _ in range(_ROUNDS):
        residual_ars = tuple(
            _fit_residual_ar(posterior, mode.z, run) for run in range(len(recordings))
        )
        start = parameter_space.origin
        start[: parameter_space.car_dimension] = mode.z[: parameter_space.car_dimension]
        mode, posterior = find_mode_threaded(Posterior(parameter_space, residual_ars), start)
    slowest = _slowest(recordings[0])
    shares = tuple(
        likelihood_weight(posterior, mode, run, slowest) for run in range(len(recordings))
    )
    weighted = tuple(
        residual_ar._replace(root=residual_ar.root * math.sqrt(1.0 if part is None else part))
        for residual_ar, part in zip(posterior.residual_ars, shares, strict=True)
    )
    mode, posterior = find_mode_threaded(Posterior(parameter_space, weighted), mode.z)
    return BandFit(mode, posterior, shares)


def notes(recording: PreparedRecording, part: float | None) -> list[str]:
    """Say by how much the likelihood weight of a recording widens the intervals.

    Parameters
    ----------
    recording : PreparedRecording
        The recording.
    part : float or None
        Its likelihood weight.

    Returns
    -------
    list of str
    """
    if part is None:
        needed = FEWEST_PARTS * PART_PERIODS / _slowest(recording)
        return [
            f"the residuals of {recording.source} are not sensor noise, and the recording is too "
            "short to tell from its parts whether the intervals are wide enough; that takes "
            f"{math.ceil(needed)} s"
        ]
    if part >= _REPORTED_WEIGHT:
        return []
    return [
        f"the parts of {recording.source} differ {1.0 / math.sqrt(part):.1f} times as much as the "
        "residuals predict, and the intervals are wider by as much"
    ]


def find_mode_threaded(
    posterior: Posterior, start: Array | None = None
) -> tuple[PosteriorMode, Posterior]:
    """Find the mode of a posterior with all processors; return it and the posterior."""
    with shared_work(posterior) as shared:
        return find_mode(shared, start), replace(posterior, pool=None)


def _sensors_explain(posterior: Posterior, mode: PosteriorMode) -> bool:
    """Whether the residuals are white and as small as the declared sensor noise."""
    noise = {n: float(x[0]) for n, x in posterior.space.nuisance(mode.z[None]).items()}
    for run, recording in enumerate(posterior.space.recordings):
        nu = recording.paired(posterior.innovations(mode.z, run))
        if excess_noise_sentence(recording, noise, run) or fit_residual_ar(nu).order > 0:
            return False
    return mode.converged


def _fit_residual_ar(posterior: Posterior, z: Array, run: int) -> ResidualAR:
    """Autoregression and scale of one run's residuals."""
    recording = posterior.space.recordings[run]
    nu = recording.paired(posterior.innovations(z, run, WHITE))
    fitted = fit_residual_ar(nu, 1, _MAX_ORDER)
    if fitted.order > 0:
        return fitted
    complete = nu[np.isfinite(nu).all(axis=1)]
    root = np.linalg.inv(np.linalg.cholesky(complete.T @ complete / len(complete)))
    return ResidualAR(np.zeros((1, nu.shape[1], nu.shape[1])), np.ascontiguousarray(root))


def _slowest(recording: PreparedRecording) -> float:
    """Natural frequency of the slowest nominal mode, Hz."""
    return nominal_modes(recording.car)[0].natural
