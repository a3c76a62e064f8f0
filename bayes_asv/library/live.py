"""Tracking and watching while a drive runs: from a recording or a serial port, with a live view."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.library.estimates import car_of, read_effects
from bayes_asv.library.inputs import check_inputs
from bayes_asv.library.progress import Progress, Report, progress_bar
from bayes_asv.library.result import json_text
from bayes_asv.library.tracks import Track, track_of

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.live.sources import Source, StreamInfo
    from bayes_asv.live.worker import StreamFilter
    from bayes_asv.models.effects import PlacedEffect
    from bayes_asv.report.schema import WatchDocument
    from bayes_asv.tracking.alarm import Alarm, AlarmMonitor
    from bayes_asv.tracking.frames import Frames
    from bayes_asv.tracking.tracker import Tracker

__all__ = ["LiveSettings", "SerialPort", "Watch", "check_gif", "follow", "track_live", "watch"]


@dataclass(frozen=True)
class SerialPort:
    """A serial port that rows come from.

    Parameters
    ----------
    name : str
        Such as ``/dev/ttyUSB0``.
    keep : str
        File in which every byte is kept.
    baud : int
        Bits per second.
    """

    name: str
    keep: str
    baud: int = 115_200


@dataclass(frozen=True)
class LiveSettings:
    """What is followed, and where it is shown.

    Parameters
    ----------
    page, terminal : bool
        Show it in a browser, in the terminal.
    gif : str or None
        File for an animation of a recording.
    port : SerialPort or None
        A port in place of a recording.
    speed : float or None
        Seconds of the recording per second; None for real time.
    browser : bool
        Whether a browser is opened.
    """

    page: bool = False
    terminal: bool = False
    gif: str | None = None
    port: SerialPort | None = None
    speed: float | None = None
    browser: bool = True

    @property
    def shown(self) -> bool:
        """Whether there is a view."""
        return self.page or self.terminal


def check_gif(path: PathLike) -> None:
    """Refuse an animation whose file is not called ``.gif``.

    Raises
    ------
    InputError
        If the suffix is another one.
    """
    if not str(path).lower().endswith(".gif"):
        raise InputError(str(path), "an animation is a GIF", "end the name in .gif")


def track_live(
    settings: LiveSettings,
    recording: Recording | None,
    vehicle: Vehicle,
    *,
    car: str | None = None,
    effects: str | Sequence[str] = (),
    rate: float | None = None,
    forget: float | None = None,
    engine: str = "compiled",
    trace: bool = False,
    seed: int = 0,
    say: Callable[[str], None] | None = None,
    progress: Progress = None,
) -> Track | None:
    """Track a recording or a port while it is shown.

    Parameters
    ----------
    settings : LiveSettings
        What is followed, and where it is shown.
    recording : Recording or None
        None where a port is followed.
    vehicle : Vehicle
        The car.
    car : str, optional
        Model of the car; by default that whose wheels the recording has, and of a port the half
        car.
    rate : float, optional
        Sampling rate, Hz, of a port that sends no time stamps.
    effects, forget, engine, seed
        As for :func:`bayes_asv.track`.
    trace : bool
        Keep the state after every row for :meth:`Track.write_trace`.
    say : callable, optional
        Called with what the user has to know while it runs.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`, while an animation is drawn.

    Returns
    -------
    Track or None
        None if no row came.
    """
    from bayes_asv.report.documents.track import Trace
    from bayes_asv.tracking.frames import DecimatedFrames
    from bayes_asv.tracking.track import conclude
    from bayes_asv.tracking.tracker import tracker_for

    name = car or car_of(recording)
    if recording is not None:
        check_inputs("track", recording, vehicle, car=name)
    started = time.perf_counter()
    trackers: list[Tracker] = []
    rows: list[Trace] = []
    placed_effects = read_effects(effects)
    # a recording is kept whole; a drive from a port may last for hours
    kept = DecimatedFrames() if recording is None else DecimatedFrames(len(recording.time))

    def make(stream: StreamInfo) -> Tracker:
        trackers.append(
            tracker_for(
                stream.start, vehicle, car=name, effects=placed_effects, rate=stream.rate,
                forget=forget, engine=engine,
            )
        )  # fmt: skip
        if trace:
            rows.append(Trace(vehicle, trackers[0].coordinates))
        return trackers[0]

    def keep(frames: Frames) -> None:
        kept.append(frames)
        for own in rows:
            own.append(frames)

    # a bar would cover the view, and the length of a port's stream is unknown
    bar = False if settings.shown or settings.port is not None else progress
    with progress_bar(bar) as report:
        follow(
            settings, recording, vehicle, make, keep, car=name, rate=rate, report=report, say=say
        )
    if not trackers:
        return None
    result = conclude(
        trackers[0],
        kept.frames(),
        recording.source if recording is not None else _name(settings),
        recording.sha256 if recording is not None else "",
        recording.warnings if recording is not None else (),
        time.perf_counter() - started,
    )
    return track_of(result, seed, rows[0] if rows else None)


def follow(
    settings: LiveSettings,
    recording: Recording | None,
    vehicle: Vehicle,
    make: Callable[[StreamInfo], StreamFilter],
    sink: Callable[[Frames], None],
    *,
    car: str = "half",
    rate: float | None = None,
    report: Report | None = None,
    say: Callable[[str], None] | None = None,
) -> None:
    """Run a filter over a recording or a port, show it, and draw the animation.

    Parameters
    ----------
    settings, recording, vehicle, rate, say
        As for :func:`track_live`.
    car : str
        Model of the car.
    make : callable
        Makes the filter, once rate and metadata are known.
    sink : callable
        Called with all frames.
    report : callable, optional
        Called with a share and a description while the animation is drawn.

    Raises
    ------
    InputError
        If the port cannot be opened or sends no recording, or a file cannot be written.
    """
    from bayes_asv.live.metadata import view_metadata
    from bayes_asv.live.run import follow as run
    from bayes_asv.live.sources import RecordingSource

    say = say or (lambda text: None)
    source: Source
    if recording is not None:
        source = replayed = RecordingSource(recording, vehicle)
        view = view_metadata(
            vehicle, recording.source, replayed.duration, car=car, channels=recording.channels
        )
    else:
        source = _port_source(settings.port, vehicle, rate, say)
        view = view_metadata(vehicle, _name(settings), None, car=car, live=True)
    shown = run(
        source,
        view,
        make,
        page=settings.page,
        terminal=settings.terminal,
        browser=settings.browser,
        speed=settings.speed or 1.0,
        sink=sink,
        say=say,
    )
    if settings.gif is not None:
        from bayes_asv.live.animation import write_animation

        check_gif(settings.gif)
        history = shown.history.snapshot()
        write_animation(shown.metadata, history, settings.gif, settings.speed, report)


class Watch:
    """A drive watched until an alarm or its end.

    Parameters
    ----------
    document : WatchDocument
        The typed document.
    """

    def __init__(self, document: WatchDocument):
        self.document = document

    @property
    def verdict(self) -> str:
        """``"alarm"``, ``"ok"`` or ``"refused"``."""
        return str(self.document.verdict)

    def to_json(self) -> str:
        """Return the document that ``bayes-asv watch --json`` writes."""
        return json_text(self.document.to_dict())

    def lines(self) -> list[str]:
        """State the result in sentences."""
        from bayes_asv.report.sections.online_filter import watch_lines

        return watch_lines(self.document)


def watch(
    recording: Recording | None,
    vehicle: Vehicle,
    *,
    car: str | None = None,
    effects: str | Sequence[str] = (),
    port: SerialPort | None = None,
    below: float = 80.0,
    probability: float = 99.0,
    hold: float = 1.0,
    forget: float = 60.0,
    engine: str = "compiled",
    rate: float | None = None,
    seed: int = 0,
    say: Callable[[str], None] | None = None,
) -> Watch | None:
    """Track a recording or a port until a damper has become too soft.

    Parameters
    ----------
    recording : Recording or None
        None where a port is watched.
    vehicle : Vehicle
        The car.
    car, effects
        As for :func:`track_live`.
    port : SerialPort, optional
        In place of a recording.
    below : float
        Percentage of its nominal rate below which a damper counts as worn.
    probability : float
        Percentage that the probability of that must exceed.
    hold : float
        Time for which it must, s.
    forget, engine, rate, seed, say
        As for :func:`track_live`.

    Returns
    -------
    Watch or None
        None if no row came.
    """
    from bayes_asv.live.sources import RecordingSource
    from bayes_asv.models.cars import car_model
    from bayes_asv.report.documents.track import watch_document
    from bayes_asv.tracking.alarm import AlarmMonitor

    source: Source
    model = car or car_of(recording)
    if recording is not None:
        check_inputs("watch", recording, vehicle, car=model)
        source, name = RecordingSource(recording, vehicle), recording.source
    else:
        source = _port_source(port, vehicle, rate, say or (lambda text: None))
        name = port.name if port is not None else ""
    monitor = AlarmMonitor(car_model(model, vehicle), below / 100.0, probability / 100.0, hold)
    tracker, alarm = _until_alarm(
        source, monitor, vehicle, model, read_effects(effects), forget, engine
    )
    if tracker is None:
        return None
    return Watch(watch_document(tracker, monitor, alarm, name, seed))


def _until_alarm(
    source: Source,
    monitor: AlarmMonitor,
    vehicle: Vehicle,
    car: str,
    effects: Sequence[PlacedEffect],
    forget: float,
    engine: str,
) -> tuple[Tracker | None, Alarm | None]:
    """Follow a source until an alarm, its end, or Ctrl-C."""
    from bayes_asv.tracking.tracker import tracker_for

    stop = threading.Event()
    tracker: Tracker | None = None
    alarm: Alarm | None = None
    try:
        stream = source.begin(stop)
        if stream is None:
            return None, None
        tracker = tracker_for(
            stream.start, vehicle, car=car, effects=effects, rate=stream.rate, forget=forget,
            engine=engine,
        )  # fmt: skip
        for rows in source.rows(stop):
            alarm = monitor.update(tracker.feed(rows.time, rows.acceleration))
            if alarm is not None:
                return tracker, alarm
        alarm = monitor.update(tracker.finish())
    except KeyboardInterrupt:
        pass  # the state until then is reported
    finally:
        stop.set()
        source.close()
    return tracker, alarm


def _port_source(
    port: SerialPort | None, vehicle: Vehicle, rate: float | None, say: Callable[[str], None]
) -> Source:
    from bayes_asv.live.port import PortReader
    from bayes_asv.live.sources import PortSource

    if port is None:
        raise InputError("live", "there is neither a recording nor a port", "give one of them")
    source = PortSource(PortReader(port.name, port.keep, port.baud), port.name, vehicle, rate)
    say(f"Every byte of {port.name} is kept in {port.keep}; stop with Ctrl-C")
    return source


def _name(settings: LiveSettings) -> str:
    return settings.port.name if settings.port is not None else ""
