"""A fake filter whose frames are formulas, with which the views can be compared."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.session import Session
from bayes_asv.live.sources import RecordingSource, StreamInfo
from bayes_asv.live.worker import Worker
from bayes_asv.tracking.frames import Frames, empty_frames

__all__ = [
    "BAJA", "CurveBuffer", "FakeClock", "FakeFilter", "at", "finished_session", "frames",
    "new_session", "recording", "wait_for",
]  # fmt: skip

Array = NDArray[np.float64]

BAJA = read_vehicle(Path(__file__).parents[2] / "data" / "vehicles" / "baja2008.toml")
TRUTH = (0.8, 1.0, 1.1)  # of nominal: limits of the medians
INCONSISTENT = (6.0, 8.0)  # s


def frames(car: Vehicle, times: Array, acc: Array) -> Frames:
    """Frames of given times: medians move from nominal to `TRUTH`, and so on.

    Nothing depends on earlier rows, so that chunks give the same as the whole.
    """
    t = times
    progress = 1.0 - np.exp(-t / 0.5)
    nominal = np.array([car.c_f.value, car.c_r.value, car.i.value])
    median = nominal * (1.0 + progress[:, None] * (np.array(TRUTH) - 1.0))
    log_sd = np.array([1.1, 1.1, 0.7]) * (0.01 + 0.99 * np.exp(-t / 0.4))[:, None]
    phase = 2.0 * np.pi * np.column_stack((1.7 * t, 2.1 * t + 0.1))
    deflection = 0.05 * np.sin(phase)
    measured = acc[:, (1, 3)]
    inconsistent = (t >= INCONSISTENT[0]) & (t < INCONSISTENT[1])
    mean = np.where(inconsistent, 2.5, 1.0 + 0.1 * np.sin(3.0 * t))
    one = np.ones_like(t)
    return Frames(
        time=t,
        median=median,
        log_sd=log_sd,
        effect=np.zeros((len(t), 0)),
        effect_sd=np.zeros((len(t), 0)),
        deflection=deflection,
        deflection_sd=0.002 + 0.05 * np.exp(-t / 0.2)[:, None] * np.ones(2),
        measured=measured,
        predicted=measured + 0.3 * np.sin(11.0 * phase),
        predicted_sd=np.full_like(measured, 0.5),
        nis=2.0 * mean,
        readings=2.0 * one,
        nis_mean=np.where(t < 0.25, np.nan, mean),
        nis_low=np.where(t < 0.25, np.nan, 0.8),
        nis_high=np.where(t < 0.25, np.nan, 1.2),
        consistent=~inconsistent,
        inflation=np.where(inconsistent, 1.6, 1.0),
    )


def at(car: Vehicle, t: float) -> Frames:
    """Frames of one moment."""
    return frames(car, np.array([t]), np.zeros((1, 4)))


@dataclass
class FakeFilter:
    """Holds back the two newest rows, like a filter with lookahead."""

    car: Vehicle = BAJA
    pause: float = 0.0  # s per call of feed
    fails_after: float = np.inf  # s of the recording
    _held: list[tuple[Array, Array]] = field(default_factory=list)

    def feed(self, times: Array, acc: Array) -> Frames:
        time.sleep(self.pause)
        if times[-1] > self.fails_after:
            raise ArithmeticError("a covariance lost its sign")
        held = [*self._held, (times, acc)]
        times, acc = (np.concatenate([part[k] for part in held]) for k in (0, 1))
        self._held = [(times[-2:], acc[-2:])]
        return frames(self.car, times[:-2], acc[:-2])

    def finish(self) -> Frames:
        held, self._held = self._held, []
        return frames(self.car, *held[0]) if held else empty_frames()


class FakeClock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class CurveBuffer:
    """What link.js does with a part of a message, without its limit on the length."""

    def __init__(self) -> None:
        self.base = 0
        self.time: list[float] = []
        self.columns: list[list[float | None]] = []

    def take(self, part: dict[str, Any]) -> None:
        if part["fresh"]:
            self.base, self.time, self.columns = part["at"], part["time"], part["columns"]
            return
        begin = part["at"] - self.base
        assert 0 <= begin <= len(self.time), "a gap"
        self.time[begin:] = part["time"]
        for column, new in zip(self.columns, part["columns"], strict=True):
            column[begin:] = new


def recording(seconds: float, rate: float = 800.0, seed: int = 0, start: float = 0.0) -> Recording:
    """Four noisy tones, m/s²."""
    time = start + np.arange(round(seconds * rate)) / rate
    rng = np.random.default_rng(seed)
    tones = np.array([[4.0], [2.0], [5.0], [3.0]]) * np.sin(2.0 * np.pi * 1.9 * time)
    values = tones + rng.normal(0.0, 0.3, (4, len(time)))
    return Recording(time, values, ("m/s^2",) * 4, (), "synthetic.csv")


def new_session(
    seconds: float, rate: float = 800.0, *, speed: float = 1.0, fake: FakeFilter | None = None
) -> tuple[Session, Worker]:
    """Set up a session of a synthetic recording; its worker is not started."""
    source = RecordingSource(recording(seconds, rate), BAJA)
    session = Session(view_metadata(BAJA, "synthetic.csv", source.duration), rate, speed=speed)

    def make(info: StreamInfo) -> FakeFilter:
        return fake or FakeFilter()

    return session, Worker(source, make, session)


def finished_session(seconds: float, rate: float = 800.0, **how: float) -> Session:
    """Set up a session whose worker has finished."""
    session, worker = new_session(seconds, rate, **how)  # type: ignore[arg-type]
    worker.start()
    assert worker.wait(30.0)
    assert worker.error is None
    return session


def wait_for(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    """Wait until something holds."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "timed out"
        time.sleep(0.01)
