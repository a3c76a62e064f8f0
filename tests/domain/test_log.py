"""Logs: bounds, read-only arrays, names that repeat."""

import numpy as np
import pytest

from bayes_asv.domain import log as module
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.log import Log, LoggedChannel, check_size, utc

TIME = np.arange(5) / 100


def test_arrays_are_read_only_and_their_own() -> None:
    values = np.ones(5)
    channel = LoggedChannel("a", "g", TIME, values)
    values[0] = 7
    assert channel.values[0] == 1
    assert not channel.time.flags.writeable
    assert not channel.values.flags.writeable
    assert channel.rate == pytest.approx(100)


def test_read_only_stamps_are_shared() -> None:
    time = TIME.copy()
    time.flags.writeable = False
    assert LoggedChannel("a", "", time, np.ones(5)).time is time


@pytest.mark.parametrize(
    ("time", "values", "words"),
    [
        (TIME, np.ones(4), "do not match"), (np.ones((0,)), np.ones((0,)), "do not match"),
        (TIME[::-1], np.ones(5), "does not increase"), (TIME * 0, np.ones(5), "does not increase"),
        (TIME, np.full(5, np.nan), "not finite"), (np.array([0, np.inf]), np.ones(2), "not finite"),
        (np.array([0, 4e7]), np.ones(2), "check the unit of the stamps"),
        (np.array([1e15, 1e15 + 1]), np.ones(2), "check the unit of the stamps"),
    ],
)  # fmt: skip
def test_bad_channels_are_refused(time: np.ndarray, values: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        LoggedChannel("a", "", time, values)


def test_channels_by_name_and_source() -> None:
    one, two = (
        LoggedChannel("speed", "m/s", TIME, np.full(5, v), s) for v, s in ((1, "gps"), (2, "obd"))
    )
    log = Log((one, two), "RaceChrono CSV")
    assert log.names == ("speed", "speed")
    assert log.channel("speed") is one
    assert log.channel("speed", "obd") is two
    with pytest.raises(KeyError):
        log.channel("speed", "can")


def test_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="without a channel"):
        Log((), "CSV", "file")
    with pytest.raises(InputError, match=r"file: has 10001 channels; export less than 10000"):
        check_size(0, 10_001, "file")
    monkeypatch.setattr(module, "MAX_SAMPLES", 9)
    channel = LoggedChannel("a", "", TIME, np.ones(5))
    with pytest.raises(InputError, match=r"file: has 10 readings; split it"):
        Log((channel, channel), "CSV", "file")


def test_date_of_a_stamp() -> None:
    assert utc(1767150797.44) == "2025-12-31T03:13:17.440+00:00"
    assert utc(5.0) is None
    assert utc(1e12) is None
