"""A filter that knows nothing of cars: its frames are formulas, so that what is shown can be held
against them."""

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
from bayes_asv.live.metadata import scene
from bayes_asv.live.session import Show
from bayes_asv.live.sources import About, RecordingSource
from bayes_asv.live.worker import Pump
from bayes_asv.tracking.frames import Frames, nothing

__all__ = [
    "BAJA", "Curves", "MadeUp", "Time", "at", "frames", "recording", "show", "shown", "wait_for",
]  # fmt: skip

Array = NDArray[np.float64]

BAJA = read_vehicle(Path(__file__).parents[2] / "data" / "vehicles" / "baja2008.toml")
TRUTH = (0.8, 1.0, 1.1)  # of nominal: where the made-up medians go
STRANGE = (6.0, 8.0)  # s: the made-up filter is not consistent there


def frames(car: Vehicle, times: Array, acc: Array) -> Frames:
    """Medians that move from nominal to `TRUTH` while their deviations fall, and so on.

    Nothing depends on earlier rows: any piece of a recording gives the same as all of it.
    """
    t = times
    gone = 1.0 - np.exp(-t / 0.5)
    nominal = np.array([car.c_f.value, car.c_r.value, car.i.value])
    median = nominal * (1.0 + gone[:, None] * (np.array(TRUTH) - 1.0))
    log_sd = np.array([1.1, 1.1, 0.7]) * (0.01 + 0.99 * np.exp(-t / 0.4))[:, None]
    phase = 2.0 * np.pi * np.column_stack((1.7 * t, 2.1 * t + 0.1))
    deflection = 0.05 * np.sin(phase)
    measured = acc[:, (1, 3)]
    strange = (t >= STRANGE[0]) & (t < STRANGE[1])
    mean = np.where(strange, 2.5, 1.0 + 0.1 * np.sin(3.0 * t))
    one = np.ones_like(t)
    return Frames(
        time=t,
        median=median,
        log_sd=log_sd,
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
        consistent=~strange,
        inflation=np.where(strange, 1.6, 1.0),
    )


def at(car: Vehicle, t: float) -> Frames:
    """Frames of one moment."""
    return frames(car, np.array([t]), np.zeros((1, 4)))


@dataclass
class MadeUp:
    """Holds back the two newest rows, as a filter that looks ahead does."""

    car: Vehicle = BAJA
    pause: float = 0.0  # s for every call of feed
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
        return frames(self.car, *held[0]) if held else nothing()


class Time:
    """A clock that a test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Curves:
    """What link.js does with a part of a message, without its limit of length."""

    def __init__(self) -> None:
        self.base = 0
        self.time: list[float] = []
        self.columns: list[list[float | None]] = []

    def take(self, part: dict[str, Any]) -> None:
        if part["fresh"]:
            self.base, self.time, self.columns = part["at"], part["time"], part["columns"]
            return
        begin = part["at"] - self.base
        assert 0 <= begin <= len(self.time), "a hole"
        self.time[begin:] = part["time"]
        for mine, new in zip(self.columns, part["columns"], strict=True):
            mine[begin:] = new


def recording(seconds: float, rate: float = 800.0, seed: int = 0, start: float = 0.0) -> Recording:
    """Four noisy tones, m/s²."""
    time = start + np.arange(round(seconds * rate)) / rate
    rng = np.random.default_rng(seed)
    tones = np.array([[4.0], [2.0], [5.0], [3.0]]) * np.sin(2.0 * np.pi * 1.9 * time)
    values = tones + rng.normal(0.0, 0.3, (4, len(time)))
    return Recording(time, values, ("m/s^2",) * 4, (), "made-up.csv")


def show(
    seconds: float, rate: float = 800.0, *, speed: float = 1.0, made: MadeUp | None = None
) -> tuple[Show, Pump]:
    """Set up a show of a made-up recording; the pump is not started."""
    source = RecordingSource(recording(seconds, rate), BAJA)
    watched = Show(scene(BAJA, "made-up.csv", source.duration), rate, speed=speed)

    def make(about: About) -> MadeUp:
        return made or MadeUp()

    return watched, Pump(source, make, watched)


def shown(seconds: float, rate: float = 800.0, **how: float) -> Show:
    """Set up a show all of whose rows have come."""
    watched, pump = show(seconds, rate, **how)  # type: ignore[arg-type]
    pump.start()
    assert pump.wait(30.0)
    assert pump.fault is None
    return watched


def wait_for(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    """Wait until something holds."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.01)
