"""An acquisition from its port, or from the bytes of an earlier one, to its outcome."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from bayes_asv.acquire.blocks import Block
from bayes_asv.acquire.frames import Address, Kind
from bayes_asv.acquire.laptop import Laptop, Port, SilentError
from bayes_asv.acquire.messages import Event
from bayes_asv.acquire.outcome import Outcome, concluded
from bayes_asv.acquire.port import GoneError
from bayes_asv.acquire.run import Request, bring
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, read_bytes

__all__ = ["acquire", "replayed"]

_LARGEST_RAW = 50_000_000  # bytes: half a day of a line that never rests
_FIRST = 0.25  # share of the patience for the first answer, which may be nobody's


def acquire(
    port: Port,
    request: Request,
    *,
    patience: float = 60.0,
    held: bytes = b"",
    source: str = "",
    rate: float | None = None,
    say: Callable[[str], None] = lambda text: None,
    grown: Callable[[Block], None] | None = None,
    seq: int | None = None,
) -> Outcome:
    """Bring one run over a port; whatever stops it, what has come is in the outcome.

    Parameters
    ----------
    port : Port
        Open; the caller closes it.
    request : Request
        What is wanted of the logger.
    patience : float
        s without an answer after which one gives up; a quarter of it for the first.
    held : bytes
        What came in an earlier session of the same run.
    source : str
        Name of the recording.
    rate : float or None
        Rows a second, Hz, of a text dump that does not say it.
    say : callable
        Told what happens, a sentence at a time.
    grown : callable, optional
        Told a block whenever a frame of it has come.
    seq : int, optional
        Number before the first command's; at random without it.
    """

    def heard(event: Event) -> None:
        say(event.said)

    laptop = Laptop(port, heard, grown, patience=_FIRST * patience, seq=seq)
    laptop.replay(held)
    laptop.events[:] = [event for event in laptop.events if not event.ends_run]
    faults: tuple[str, ...] = ()
    try:
        _greet(laptop)
        laptop.patience = patience
        faults = bring(laptop, request, say)
    except (SilentError, GoneError, InputError) as fault:  # the last: the disk is full
        faults = (str(fault),)
    except KeyboardInterrupt:
        faults = ("interrupted",)
    warnings = _noticed(port, laptop, request)
    outcome = concluded(laptop, faults, rate=rate, source=source, warnings=warnings)
    if request.text and outcome.verdict == "ok":
        # Nobody acknowledges a text: the logger would go on to hold the run.
        with contextlib.suppress(SilentError, GoneError, InputError):
            laptop.order(Kind.STOP)
    return outcome


def replayed(path: PathLike, rate: float | None = None, source: str = "") -> Outcome:
    """Read again what an earlier acquisition kept.

    Parameters
    ----------
    path : str or os.PathLike
        The file of raw bytes.
    rate : float or None
        Rows a second, Hz, of a text dump that does not say it.
    source : str
        Name of the recording.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    laptop = Laptop(_NoPort())
    laptop.replay(read_bytes(path, _LARGEST_RAW))
    return concluded(laptop, rate=rate, source=source)


def _noticed(port: Port, laptop: Laptop, request: Request) -> tuple[str, ...]:
    """Say what happened besides, and where the run is not what was asked for."""
    said = []
    losses = getattr(port, "losses", 0)
    if losses:
        times = "once" if losses == 1 else f"{losses} times"
        said.append(f"the port went away {times}; the transfer went on where it was")
    head = laptop.blocks[Address.SLAVE_1].head
    wanted = request.settings.rate if request.settings is not None else 0
    if head is not None and wanted and head.rate != wanted:
        said.append(f"{wanted} Hz were asked for, but the run was taken at {head.rate} Hz")
    return tuple(said)


def _greet(laptop: Laptop) -> None:
    """Find out who is at the other end.

    Raises
    ------
    SilentError
        In one sentence with the mend.
    """
    try:
        laptop.hello()
    except SilentError:
        try:
            laptop.hello(Address.MASTER)
        except SilentError:
            raise SilentError(
                "no logger answers at this port; is it on, in range, and is this its port?"
            ) from None
        raise SilentError(
            "the Master answers, but the front board (Slave 1) does not; is it on and in range?"
        ) from None


class _NoPort:
    """Where nothing comes from and nothing goes."""

    timeout = 0.0
    in_waiting = 0

    def read(self, size: int = 1) -> bytes:
        return b""

    def write(self, data: bytes) -> int:
        return len(data)

    def clock(self) -> float:
        return 0.0
