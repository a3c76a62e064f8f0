"""Alarm for a damper that is softer than a chosen share of its nominal rate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_asv.domain.quantities import NORMAL_975
from bayes_asv.models.car_model import CarModel
from bayes_asv.tracking.frames import Frames

__all__ = ["Alarm", "AlarmMonitor"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Alarm:
    """A damper that has been too soft for the required time.

    Parameters
    ----------
    axle : str
        Place of the damper: ``front``, ``rear_left``, ….
    time : float
        Stamp of the row at which the alarm was raised, s.
    since : float
        Stamp of the first row from which on the probability exceeded the threshold, s.
    probability : float
        Probability that the rate is below the share.
    median : float
        Median of the rate over its nominal value.
    low, high : float
        95 % interval of that ratio.
    """

    axle: str
    time: float
    since: float
    probability: float
    median: float
    low: float
    high: float


class AlarmMonitor:
    """Tests every row for a damper below a share of its nominal rate.

    Parameters
    ----------
    car : CarModel
        Gives the nominal damping rates of its elements.
    share : float
        Share of the nominal rate below which a damper counts as worn.
    threshold : float
        Probability of a worn damper that has to be exceeded.
    hold : float
        Time (s) for which it has to be exceeded without interruption, so that one unusual stretch
        of road raises no alarm.

    Notes
    -----
    A row at which the filter is not consistent restarts the hold time: its intervals cannot be
    trusted there, and a sensor is as likely at fault as a damper.
    """

    def __init__(self, car: CarModel, share: float, threshold: float, hold: float) -> None:
        self.share, self.threshold, self.hold = share, threshold, hold
        # A damper whose rate is given exactly cannot wear.
        dampers = [e for e in car.elements if e.damping in car.estimated]
        self.places = tuple(element.name for element in dampers)
        self._columns = [car.estimated.index(element.damping) for element in dampers]
        self._nominal = np.array([float(car.nominal[e.damping][0]) for e in dampers])
        self._since = np.full(len(dampers), math.inf)
        self.probability = np.full(len(dampers), math.nan)
        self.rows = 0
        self.rows_consistent = 0

    def update(self, frames: Frames) -> Alarm | None:
        """Test frames.

        Parameters
        ----------
        frames : Frames
            They follow those of the call before.

        Returns
        -------
        Alarm or None
            The first alarm in these frames.
        """
        if not len(frames):
            return None
        limit = np.log(self.share * self._nominal)
        median, log_sd = frames.median[:, self._columns], frames.log_sd[:, self._columns]
        p = ndtr((limit - np.log(median)) / log_sd)
        alarm: Alarm | None = None
        for axle in range(len(self.places)):
            exceeds = frames.consistent & (p[:, axle] > self.threshold)
            onset = exceeds & ~np.concatenate([[math.isfinite(self._since[axle])], exceeds[:-1]])
            # the latest onset up to each row, or the one that is held from the call before
            latest = np.maximum.accumulate(np.where(onset, np.arange(len(frames)), -1))
            since = np.where(latest >= 0, frames.time[latest], self._since[axle])
            due = exceeds & (frames.time - since >= self.hold)
            if due.any():
                k = int(np.argmax(due))
                if alarm is None or frames.time[k] < alarm.time:
                    alarm = self._alarm(frames, k, axle, float(since[k]), float(p[k, axle]))
            self._since[axle] = since[-1] if exceeds[-1] else math.inf
        self.probability = p[-1]
        self.rows += len(frames)
        self.rows_consistent += int(frames.consistent.sum())
        return alarm

    def _alarm(self, frames: Frames, k: int, axle: int, since: float, p: float) -> Alarm:
        column = self._columns[axle]
        ratio = float(frames.median[k, column] / self._nominal[axle])
        factor = math.exp(NORMAL_975 * float(frames.log_sd[k, column]))
        return Alarm(
            self.places[axle],
            float(frames.time[k]),
            since,
            p,
            ratio,
            ratio / factor,
            ratio * factor,
        )
