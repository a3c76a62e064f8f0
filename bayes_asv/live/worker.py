"""Thread that passes rows from a source through the filter into a session."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import BayesAsvError
from bayes_asv.live.session import Session
from bayes_asv.live.sources import Source, StreamInfo
from bayes_asv.tracking.frames import Frames

__all__ = ["StreamFilter", "Worker"]

Array = NDArray[np.float64]


class StreamFilter(Protocol):
    """Interface of an online filter."""

    def feed(self, times: Array, acc: Array) -> Frames:
        """Process rows, (n,) s and (n, C) m/s²; return the frames that are complete."""

    def finish(self) -> Frames:
        """Process the rows that were held back."""


class Worker:
    """Runs a filter over a source, ahead of the viewers, and never waits for them.

    Parameters
    ----------
    source : Source
        Yields the rows.
    make : callable
        Makes the filter, once the rate of the source is known.
    session : Session
        Receives the frames.
    sink : callable or None
        Receives the frames as well.

    Attributes
    ----------
    error : Exception or None
        What ended the thread early.
    """

    def __init__(
        self,
        source: Source,
        make: Callable[[StreamInfo], StreamFilter],
        session: Session,
        sink: Callable[[Frames], None] | None = None,
    ) -> None:
        self.error: Exception | None = None
        self._source, self._make, self._session = source, make, session
        self._sink = sink
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="filter", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether rows may still come."""
        return self._thread.is_alive()

    def stop(self, timeout: float = 10.0) -> None:
        """Stop reading rows, and wait for those in progress.

        Parameters
        ----------
        timeout : float
            Longest time to wait, s.
        """
        self._stop.set()
        self._source.close()
        self._thread.join(timeout)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for the end of the source; return whether it came."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            info = self._source.begin(self._stop)
            if info is not None:
                self._session.rate = info.rate
                online_filter = self._make(info)
                for rows in self._source.rows(self._stop):
                    if len(rows.time):
                        self._append(online_filter.feed(rows.time, rows.acceleration))
                    self._session.set_notes(*self._source.notes())
                self._append(online_filter.finish())
            self._session.finish()
        except BayesAsvError as error:
            self.error = error
            self._session.finish(str(error))
        except Exception as error:  # shown to the viewers now, raised by the main thread later
            self.error = error
            self._session.finish(f"The filter failed: {error}")

    def _append(self, frames: Frames) -> None:
        self._session.history.append(frames)
        if self._sink is not None and len(frames):
            self._sink(frames)
