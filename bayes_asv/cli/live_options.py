"""What ``bayes-asv track`` shows while it runs: its options, and the way to the live view."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.live.sources import About
    from bayes_asv.live.worker import Filter
    from bayes_asv.tracking.frames import Frames

__all__ = ["Wishes", "followed", "live_options", "wishes"]

_SPEED = 1.0
_BAUD = 115_200


@dataclass(frozen=True)
class Wishes:
    """What is to be followed, and where it is shown.

    Parameters
    ----------
    page, terminal : bool
        In a browser, in the terminal.
    gif : str or None
        File for an animation.
    port : str or None
        Serial port instead of a recording.
    speed : float or None
        Recording seconds a second; None as usual.
    browser : bool
        Whether a browser is opened.
    baud : int
        Bits a second of the port.
    keep : str or None
        File for what the port sends.
    """

    page: bool
    terminal: bool
    gif: str | None
    port: str | None
    speed: float | None
    browser: bool
    baud: int
    keep: str | None

    @property
    def shown(self) -> bool:
        """Whether somebody looks."""
        return self.page or self.terminal


def live_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that `wishes` takes."""
    for option in reversed(
        (
            click.option("--live", is_flag=True, help="Show it in a browser, on this machine."),
            click.option("--tui", is_flag=True, help="Show it in this terminal."),
            click.option("--gif", metavar="FILE", help="Draw it as an animation, for a README."),
            click.option(
                "--speed", type=click.FloatRange(0.01, 100.0), metavar="X",
                help="Recording seconds a second, for the three above.  [default: 1]",
            ),
            click.option("--no-browser", is_flag=True, help="With --live: open no browser."),
            click.option("--port", metavar="P", help="A serial port instead of a recording."),
            click.option(
                "--baud", type=click.IntRange(300, 4_000_000), metavar="N",
                help=f"Bits a second of the port.  [default: {_BAUD}]",
            ),
            click.option(
                "--keep", metavar="FILE",
                help="Where every byte of the port is kept.  [default: run-DATE-TIME.txt]",
            ),
        )
    ):  # fmt: skip
        command = option(command)
    return command


def wishes(
    recording: str | None,
    *,
    live: bool,
    tui: bool,
    gif: str | None,
    speed: float | None,
    no_browser: bool,
    port: str | None,
    baud: int | None,
    keep: str | None,
) -> Wishes:
    """Put the options together, and refuse what does not fit.

    Raises
    ------
    click.UsageError
        In one sentence.
    """
    if (recording is None) == (port is None):
        raise click.UsageError("give either a recording or --port")
    if port is None and (baud is not None or keep is not None):
        raise click.UsageError("--baud and --keep belong to --port")
    if port is not None and (gif is not None or speed is not None):
        raise click.UsageError("--gif and --speed need a recording: a port has its own pace")
    if speed is not None and not (live or tui or gif is not None):
        raise click.UsageError("--speed belongs to --live, --tui or --gif")
    if no_browser and not live:
        raise click.UsageError("--no-browser belongs to --live")
    if tui and not sys.stderr.isatty():
        raise click.UsageError("--tui needs a terminal; use --live")
    if port is not None and keep is None:
        keep = time.strftime("run-%Y%m%d-%H%M%S.txt")
    return Wishes(live, tui, gif, port, speed, not no_browser, baud or _BAUD, keep)


def followed(
    wanted: Wishes,
    recording: Recording | None,
    vehicle: Vehicle,
    make: Callable[[About], Filter],
    sink: Callable[[Frames], None],
    rate: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Run the filter over the recording or the port, show it as wished, and draw the animation.

    Parameters
    ----------
    wanted : Wishes
        From `wishes`.
    recording : Recording or None
        None where a port is followed.
    vehicle : Vehicle
        The car.
    make : callable
        Makes the filter, once rate and metadata are known.
    sink : callable
        Is given all frames.
    rate : float or None
        Rows a second, Hz, of a port that sends no stamps.
    progress : callable, optional
        Told a share and words while the animation is drawn.

    Raises
    ------
    InputError
        If the port cannot be opened or sends no recording, or a file cannot be written.
    """
    from bayes_asv.live.metadata import scene
    from bayes_asv.live.run import follow
    from bayes_asv.live.sources import PortSource, RecordingSource, Source

    def say(text: str) -> None:
        click.echo(text, err=True)

    source: Source
    if recording is not None:
        source = replayed = RecordingSource(recording, vehicle)
        view = scene(vehicle, recording.source, replayed.duration)
    else:
        from bayes_asv.live.port import PortReader

        assert wanted.port is not None
        assert wanted.keep is not None
        source = PortSource(
            PortReader(wanted.port, wanted.keep, wanted.baud), wanted.port, vehicle, rate
        )
        view = scene(vehicle, wanted.port, None, live=True)
        say(f"Every byte of {wanted.port} is kept in {wanted.keep}; Ctrl-C ends it")
    show = follow(
        source,
        view,
        make,
        page=wanted.page,
        terminal=wanted.terminal,
        browser=wanted.browser,
        speed=wanted.speed or _SPEED,
        sink=sink,
        say=say,
    )
    if wanted.gif is not None:
        from bayes_asv.live.animation import write_animation

        write_animation(show.scene, show.history.snapshot(), wanted.gif, wanted.speed, progress)
