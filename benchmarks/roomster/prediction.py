"""One drive predicted from another: a posterior's cars over wheels that they never saw.

The prediction of a chassis reading is the free-running car of each draw, with the drive's own
start and biases, plus what the drive it was learnt from left over, taken as a normal of the
same size.  It is held against three others that learnt from the same drive: *nothing moves*
(the chassis' own spread), *stiff* (the chassis does what its wheel does), and a *filter*, the
best linear relation of either chassis channel with 15 readings of both wheels before, at and
after its time, 60 coefficients that need not make a car.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.free_simulation import simulate_free
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = ["Learnt", "Reference", "learn", "learn_reference", "predict"]

Array = NDArray[np.float64]
Row = dict[str, Any]

CARS = 48  # draws that predict
_BEFORE, _AFTER = 10, 4  # readings of the filter
_ENDS = 3.0  # s at either end of a drive that are not scored
_SHARES = (0.50, 0.95)
_HALF = {0.50: 0.6745, 0.95: 1.9600}


@dataclass(frozen=True)
class Learnt:
    """What one drive taught.

    Parameters
    ----------
    cars : (S, 8) array
        Cars of its posterior.
    left : (2,) array
        Deviation of what its best car left of each chassis channel, m/s².
    """

    cars: Array
    left: Array


@dataclass(frozen=True)
class Reference:
    """What predictors that know no car learnt from one drive.

    Parameters
    ----------
    weights : (2, 30) array
        The filter's, front and rear.
    left : dict of str to (2,) array
        Deviations of what ``nothing``, ``stiff`` and ``filter`` left, m/s².
    """

    weights: Array
    left: dict[str, Array]


def _scored(recording: PreparedRecording) -> NDArray[np.int64]:
    """Instants (R,) of the pairs of readings that every predictor can tell.

    The filter needs readings before and after; and at its ends a drive has the transients of
    the filters that it went through before it was published.
    """
    both = recording.group_instants[np.all(recording.group_instants >= 0, axis=1), 0]
    both = both[np.all(recording.kind[both] == VALUE, axis=1)]
    ends = max(round(_ENDS / recording.reading_step), _BEFORE, _AFTER)
    return np.asarray(both[ends : len(both) - ends], np.int64)


def _wheels(recording: PreparedRecording, shift: float = 0.0) -> Array:
    """Both wheels (R, 2) at the scored instants, or so much (s) before them."""
    time = recording.instants[_scored(recording)] - shift
    return np.stack([wheel.spline(time) for wheel in recording.wheels], axis=1)


def _taps(recording: PreparedRecording) -> Array:
    """Wheels around each scored reading (R, 30)."""
    shifts = range(-_AFTER, _BEFORE + 1)
    return np.concatenate([_wheels(recording, k * recording.reading_step) for k in shifts], axis=1)


def learn(recording: PreparedRecording, cars: Array, best: Array) -> Learnt:
    """Take cars of a drive's posterior, and the size of what its best car left."""
    picked = cars[np.linspace(0, len(cars) - 1, CARS).astype(int)]
    error = (recording.reading - simulate_free(recording, best).output)[_scored(recording)]
    return Learnt(picked, np.asarray(error.std(axis=0), np.float64))


def learn_reference(recording: PreparedRecording) -> Reference:
    """Fit the predictors that know no car to a drive."""
    y, taps = recording.reading[_scored(recording)], _taps(recording)
    weights, *_ = np.linalg.lstsq(taps, y, rcond=None)
    spare = len(taps) - taps.shape[1]
    filtered = np.sqrt(np.sum((y - taps @ weights) ** 2, axis=0) / spare)
    stiff = (y - _wheels(recording)).std(axis=0)
    left = {"nothing": y.std(axis=0), "stiff": stiff, "filter": filtered}
    return Reference(np.asarray(weights.T, np.float64), left)


def predict(recording: PreparedRecording, learnt: Learnt, reference: Reference) -> Row:
    """Score the prediction of a drive.

    Parameters
    ----------
    line : PreparedRecording
        The drive.
    learnt, reference : Learnt and Reference
        From another one.

    Returns
    -------
    dict
        For front and rear: ``nrmse`` of the mean prediction and of each reference, ``cover50``
        and ``cover95`` of the predictive bands, ``gain`` in log predictive density a reading
        over each reference, nats.
    """
    rows = _scored(recording)
    outputs = np.stack([simulate_free(recording, car).output[rows] for car in learnt.cars])
    plain = {
        "nothing": np.zeros((len(rows), 2)),
        "stiff": _wheels(recording),
        "filter": _taps(recording) @ reference.weights.T,
    }
    row: Row = {"nrmse": [], "cover50": [], "cover95": [], "gain": {n: [] for n in plain}}
    row |= {f"nrmse_{name}": [] for name in plain}
    for axle in range(2):
        y = recording.reading[rows, axle]
        made = outputs[:, :, axle]
        error = y - made.mean(axis=0)
        spread = np.sqrt(made.var(axis=0) + learnt.left[axle] ** 2)
        row["nrmse"].append(float(np.sqrt(np.mean(error**2) / np.var(y))))
        for share in _SHARES:
            inside = float(np.mean(np.abs(error) < _HALF[share] * spread))
            row[f"cover{100 * share:.0f}"].append(inside)
        score = float(np.mean(_log_mixture(y, made, float(learnt.left[axle]))))
        for name, guess in plain.items():
            left = y - guess[:, axle]
            row[f"nrmse_{name}"].append(float(np.sqrt(np.mean(left**2) / np.var(y))))
            other = _log_normal(left, float(reference.left[name][axle]))
            row["gain"][name].append(score - float(np.mean(other)))
    return row


def _log_normal(left: Array, sd: float) -> Array:
    return np.asarray(-0.5 * (left / sd) ** 2 - np.log(sd) - 0.5 * np.log(2.0 * np.pi))


def _log_mixture(y: Array, made: Array, sd: float) -> Array:
    """Log density (M,) of readings under draws (S, M) with normal remainders."""
    return np.asarray(logsumexp(_log_normal(y - made, sd), axis=0) - np.log(len(made)))
