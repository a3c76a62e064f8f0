"""The clock that all viewers share."""

from __future__ import annotations

import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.live.clock import Clock
from bayes_asv.live.metadata import scene
from bayes_asv.live.session import Show
from tests.live.made_up import BAJA, Time, at, frames, recording


def _show(seconds: float = 4.0, **how: float) -> tuple[Show, Time]:
    time = Time()
    show = Show(scene(BAJA, "x", seconds), 100.0, clock=time, **how)  # type: ignore[arg-type]
    run = recording(seconds, 100.0, start=7.0)
    show.history.append(frames(BAJA, run.time, run.values.T))
    show.finish()
    return show, time


def _later(show: Show, time: Time, seconds: float) -> float:
    """Position after so many seconds in steps of a frame."""
    show.moment()
    for _ in range(round(seconds / 0.04)):
        time.now += 0.04
        show.moment()
    return show.moment().position


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0])
def test_time_goes_by_at_the_speed_asked_for(speed: float) -> None:
    show, time = _show(speed=speed)
    assert show.moment().position == 0.0
    assert _later(show, time, 0.2) == pytest.approx(0.2 * speed)
    show.ask("speed", 2.0)
    assert _later(show, time, 0.2) == pytest.approx(0.2 * speed + 0.4)


def test_pause_play_seek_and_restart() -> None:
    show, time = _show()
    assert _later(show, time, 1.0) == pytest.approx(1.0)
    show.ask("pause")
    assert show.moment().state == "paused"
    assert _later(show, time, 1.0) == pytest.approx(1.0)
    show.ask("seek", 2.5)
    assert show.moment().position == 2.5
    assert show.moment().state == "paused"
    show.ask("play")
    assert _later(show, time, 0.4) == pytest.approx(2.9)
    show.ask("pause")
    show.ask("restart")
    moment = show.moment()
    assert (moment.position, moment.state, moment.rows) == (0.0, "playing", 1)


def test_the_end_is_the_end_until_one_goes_back() -> None:
    show, time = _show()
    assert _later(show, time, 5.0) == pytest.approx(3.99)
    moment = show.moment()
    assert (moment.state, moment.rows) == ("ended", 400)
    show.ask("seek", 1.0)
    assert show.moment().state == "playing"


def test_the_recording_waits_while_nobody_looks() -> None:
    show, time = _show()
    show.moment()
    time.now += 3600.0
    assert show.moment().position <= 0.25


def test_time_waits_for_a_slow_filter_and_does_not_jump_when_it_comes() -> None:
    time = Time()
    show = Show(scene(BAJA, "x", 4.0), 100.0, clock=time)
    assert show.moment().state == "waiting"
    run = recording(4.0, 100.0)
    show.history.append(frames(BAJA, run.time[:50], run.values.T[:50]))
    assert _later(show, time, 2.0) == pytest.approx(0.49)
    assert show.moment().state == "playing"
    show.history.append(frames(BAJA, run.time[50:], run.values.T[50:]))
    time.now += 0.04
    assert show.moment().position == pytest.approx(0.53)


def test_a_port_is_followed_and_a_pause_holds_it() -> None:
    time = Time()
    show = Show(scene(BAJA, "port", None, live=True), 100.0, clock=time)
    show.history.append(at(BAJA, 3.0))
    show.history.append(at(BAJA, 3.4))
    assert show.moment().position == pytest.approx(0.4)
    show.ask("pause")
    show.history.append(at(BAJA, 4.0))
    assert show.moment().position == pytest.approx(0.4)
    show.ask("play")
    assert show.moment().position == pytest.approx(1.0)
    for action in ("restart", "seek", "speed"):
        with pytest.raises(InputError, match="no other time than now"):
            show.ask(action, 1.0)


@pytest.mark.parametrize(
    ("action", "value", "words"),
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
def test_nonsense_is_refused_and_changes_nothing(action: str, value: object, words: str) -> None:
    show, _ = _show()
    before = show.moment()
    with pytest.raises(InputError, match=words):
        show.ask(action, value)
    after = show.moment()
    assert (before.position, before.state, before.speed) == (
        after.position, after.state, after.speed,
    )  # fmt: skip


def test_a_fault_is_told_first() -> None:
    show, _ = _show()
    show.note("ten lines were not readable")
    show.finish("the cable broke")
    moment = show.moment()
    assert moment.state == "failed"
    assert moment.notes == ("the cable broke", "ten lines were not readable")


def test_a_clock_that_goes_back_does_not_move_it_back() -> None:
    clock = Clock()
    clock.advance(10.0, 5.0)
    clock.advance(10.1, 5.0)
    assert clock.advance(9.0, 5.0) == pytest.approx(0.1)
