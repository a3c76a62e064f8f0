"""Playback and controls of a session."""

from __future__ import annotations

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.session import PlaybackClock, Session
from tests.live.synthetic import BAJA, FakeClock, at, frames, recording


def _session(seconds: float = 4.0, **how: float) -> tuple[Session, FakeClock]:
    time = FakeClock()
    session = Session(view_metadata(BAJA, "x", seconds), 100.0, clock=time, **how)  # type: ignore[arg-type]
    run = recording(seconds, 100.0, start=7.0)
    session.history.append(frames(BAJA, run.time, run.values.T))
    session.finish()
    return session, time


def _position_after(session: Session, time: FakeClock, seconds: float) -> float:
    """Position after a time, in steps of a frame."""
    session.playback()
    for _ in range(round(seconds / 0.04)):
        time.now += 0.04
        session.playback()
    return session.playback().position


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0])
def test_playback_advances_at_the_chosen_speed(speed: float) -> None:
    session, time = _session(speed=speed)
    assert session.playback().position == 0.0
    assert _position_after(session, time, 0.2) == pytest.approx(0.2 * speed)
    session.control("speed", 2.0)
    assert _position_after(session, time, 0.2) == pytest.approx(0.2 * speed + 0.4)


def test_pause_play_seek_and_restart() -> None:
    session, time = _session()
    assert _position_after(session, time, 1.0) == pytest.approx(1.0)
    session.control("pause")
    assert session.playback().state == "paused"
    assert _position_after(session, time, 1.0) == pytest.approx(1.0)
    session.control("seek", 2.5)
    assert session.playback().position == 2.5
    assert session.playback().state == "paused"
    session.control("play")
    assert _position_after(session, time, 0.4) == pytest.approx(2.9)
    session.control("pause")
    session.control("restart")
    playback = session.playback()
    assert (playback.position, playback.state, playback.rows) == (0.0, "playing", 1)


def test_playback_ends_and_can_seek_back() -> None:
    session, time = _session()
    assert _position_after(session, time, 5.0) == pytest.approx(3.99)
    playback = session.playback()
    assert (playback.state, playback.rows) == ("ended", 400)
    session.control("seek", 1.0)
    assert session.playback().state == "playing"


def test_playback_waits_without_viewers() -> None:
    session, time = _session()
    session.playback()
    time.now += 3600.0
    assert session.playback().position <= 0.25


def test_playback_waits_for_a_slow_filter() -> None:
    time = FakeClock()
    session = Session(view_metadata(BAJA, "x", 4.0), 100.0, clock=time)
    assert session.playback().state == "waiting"
    run = recording(4.0, 100.0)
    session.history.append(frames(BAJA, run.time[:50], run.values.T[:50]))
    assert _position_after(session, time, 2.0) == pytest.approx(0.49)
    assert session.playback().state == "playing"
    session.history.append(frames(BAJA, run.time[50:], run.values.T[50:]))
    time.now += 0.04
    assert session.playback().position == pytest.approx(0.53)


def test_playback_follows_a_live_port() -> None:
    time = FakeClock()
    session = Session(view_metadata(BAJA, "port", None, live=True), 100.0, clock=time)
    session.history.append(at(BAJA, 3.0))
    session.history.append(at(BAJA, 3.4))
    assert session.playback().position == pytest.approx(0.4)
    session.control("pause")
    session.history.append(at(BAJA, 4.0))
    assert session.playback().position == pytest.approx(0.4)
    session.control("play")
    assert session.playback().position == pytest.approx(1.0)
    for action in ("restart", "seek", "speed"):
        with pytest.raises(InputError, match="not possible with a live port"):
            session.control(action, 1.0)


@pytest.mark.parametrize(
    ("action", "value", "message"),
    [
        ("stop", None, "no such action"),
        ("", None, "no such action"),
        ("speed", None, "needs a number"),
        ("speed", "fast", "needs a number"),
        ("speed", True, "needs a number"),
        ("speed", 0.0, "between 0.01 and 100"),
        ("speed", float("nan"), "between 0.01 and 100"),
        ("speed", -1.0, "between 0.01 and 100"),
        ("seek", [1], "needs a number"),
        ("seek", float("inf"), "a number of seconds"),
    ],
)
def test_invalid_controls_change_nothing(action: str, value: object, message: str) -> None:
    session, _ = _session()
    before = session.playback()
    with pytest.raises(InputError, match=message):
        session.control(action, value)
    after = session.playback()
    assert (before.position, before.state, before.speed) == (
        after.position, after.state, after.speed,
    )  # fmt: skip


def test_an_error_is_the_first_note() -> None:
    session, _ = _session()
    session.set_notes("ten lines were not readable")
    session.finish("the cable broke")
    playback = session.playback()
    assert playback.state == "failed"
    assert playback.notes == ("the cable broke", "ten lines were not readable")


def test_position_never_follows_a_clock_backwards() -> None:
    clock = PlaybackClock()
    clock.advance(10.0, 5.0)
    clock.advance(10.1, 5.0)
    assert clock.advance(9.0, 5.0) == pytest.approx(0.1)
