"""Is a damper below a chosen share of its nominal rate?  Asked of every row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.tracking.frames import Frames

__all__ = ["AXLES", "Alarm", "AlarmMonitor"]

Array = NDArray[np.float64]

AXLES = ("front", "rear")


@dataclass(frozen=True)
class Alarm:
    """A damper that has been too soft for long enough.

    Parameters
    ----------
    axle : str
        ``front`` or ``rear``.
    time : float
        Stamp of the row at which the alarm was raised, s.
    since : float
        Stamp of the first row at which it would have been, s.
    probability : float
        That the rate is below the share.
    median : float
        Rate over nominal.
    low, high : float
        Its 95 % interval.
    """

    axle: str
    time: float
    since: float
    probability: float
    median: float
    low: float
    high: float


class AlarmMonitor:
    """Looks at frames as they come.

    Parameters
    ----------
    vehicle : Vehicle
        Its nominal damping rates are what a share is of.
    share : float
        Share of nominal below which a damper counts as worn.
    level : float
        Probability that has to be passed.
    hold : float
        Seconds for which it has to be, so that one odd stretch of road raises nothing.

    Notes
    -----
    Rows at which the filter is not consistent start the time anew: its intervals then mean
    nothing, and a sensor is as likely at fault as a damper.
    """

    def __init__(self, vehicle: Vehicle, share: float, level: float, hold: float) -> None:
        self.share, self.level, self.hold = share, level, hold
        self._nominal = np.array([vehicle.c_f.value, vehicle.c_r.value])
        self._since = np.full(2, math.inf)
        self.probability = np.full(2, math.nan)
        self.rows = 0
        self.rows_told = 0

    def look(self, frames: Frames) -> Alarm | None:
        """Take frames; return an alarm if there is one.

        Parameters
        ----------
        frames : Frames
            In order from call to call.

        Returns
        -------
        Alarm or None
            The first; nothing behind it is looked at.
        """
        if not len(frames):
            return None
        edge = np.log(self.share * self._nominal)
        p = ndtr((edge - np.log(frames.median[:, :2])) / frames.log_sd[:, :2])
        told = frames.consistent
        found: Alarm | None = None
        for axle in range(2):
            over = told & (p[:, axle] > self.level)
            begins = over & ~np.concatenate([[math.isfinite(self._since[axle])], over[:-1]])
            # the latest begin up to each row, or the one that is held from before
            began = np.maximum.accumulate(np.where(begins, np.arange(len(frames)), -1))
            since = np.where(began >= 0, frames.time[began], self._since[axle])
            ripe = over & (frames.time - since >= self.hold)
            if ripe.any():
                k = int(np.argmax(ripe))
                if found is None or frames.time[k] < found.time:
                    found = self._alarm(frames, k, axle, float(since[k]), float(p[k, axle]))
            self._since[axle] = since[-1] if over[-1] else math.inf
        self.probability = p[-1]
        self.rows += len(frames)
        self.rows_told += int(told.sum())
        return found

    def _alarm(self, frames: Frames, k: int, axle: int, since: float, p: float) -> Alarm:
        ratio = float(frames.median[k, axle] / self._nominal[axle])
        width = math.exp(1.959964 * float(frames.log_sd[k, axle]))
        return Alarm(
            AXLES[axle], float(frames.time[k]), since, p, ratio, ratio / width, ratio * width
        )  # fmt: skip
