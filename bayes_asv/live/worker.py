"""The thread that moves rows from a source through the filter into a show."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import BayesAsvError
from bayes_asv.live.session import Show
from bayes_asv.live.sources import About, Source
from bayes_asv.tracking.frames import Frames

__all__ = ["Filter", "Pump"]

Array = NDArray[np.float64]


class Filter(Protocol):
    """What is wanted of an online filter."""

    def feed(self, times: Array, acc: Array) -> Frames:
        """Take rows, (n,) s and (n, 4) m/s²; tell of those that are settled."""

    def finish(self) -> Frames:
        """Tell of the rows that were held back."""


class Pump:
    """Runs a filter over a source, ahead of whoever looks, and never waits for them.

    Parameters
    ----------
    source : Source
        Gives the rows.
    make : callable
        Makes the filter, once the source knows its rate.
    show : Show
        Takes what the filter says.
    sink : callable or None
        Is given the frames as well.
    """

    def __init__(
        self,
        source: Source,
        make: Callable[[About], Filter],
        show: Show,
        sink: Callable[[Frames], None] | None = None,
    ) -> None:
        self.fault: Exception | None = None
        self._source, self._make, self._show = source, make, show
        self._sink = sink
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="filter", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether rows may still come."""
        return self._thread.is_alive()

    def stop(self, patience: float = 10.0) -> None:
        """Take no more rows, and wait for those under way.

        Parameters
        ----------
        patience : float
            s to wait at most.
        """
        self._stop.set()
        self._source.close()
        self._thread.join(patience)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for the end of the source; whether it came."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            about = self._source.begin(self._stop)
            if about is not None:
                self._show.rate = about.rate
                engine = self._make(about)
                for rows in self._source.rows(self._stop):
                    if len(rows.time):
                        self._give(engine.feed(rows.time, rows.acceleration))
                    self._show.note(*self._source.notes())
                self._give(engine.finish())
            self._show.finish()
        except BayesAsvError as fault:
            self.fault = fault
            self._show.finish(str(fault))
        except Exception as fault:  # told to those who look now, raised by the main thread later
            self.fault = fault
            self._show.finish(f"The filter failed: {fault}")

    def _give(self, frames: Frames) -> None:
        self._show.history.append(frames)
        if self._sink is not None and len(frames):
            self._sink(frames)
