"""Units of time stamps, and what is done where stamps do not increase."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.stamps import (
    clock_seconds,
    is_clock,
    plausible_unit,
    repair,
    time_factor,
)


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("s", 1), ("sec", 1), ("Seconds", 1), ("unix time", 1), ("ms", 1e-3), ("us", 1e-6),
        ("µs", 1e-6), ("μs", 1e-6), ("ns", 1e-9), ("min", 60), ("g", None), ("", None),
        ("m/s", None),
    ],
)  # fmt: skip
def test_unit_of_time(text: str, factor: float | None) -> None:
    assert time_factor(text) == factor


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("time_ms", 1e-3), ("timeMS", 1e-3), ("TimeMillis", 1e-3), ("micros", 1e-6), ("t_us", 1e-6),
        ("Time-s", 1), ("time", None), ("timestamp", None), ("min_time", None), ("TS", None),
    ],
)  # fmt: skip
def test_unit_in_the_name(name: str, factor: float | None) -> None:
    assert time_factor(name, in_name=True) == factor


@given(st.floats(8.01, 7999.0), st.sampled_from([("s", 1.0), ("ms", 1e-3), ("us", 1e-6)]))
def test_plausible_unit_is_the_one_of_a_rate_from_8_to_8000_hz(
    rate: float, unit: tuple[str, float]
) -> None:
    assert plausible_unit(1.0 / rate / unit[1]) == unit


def test_stamps_count_from_the_first_and_decimals_beyond_their_precision_go() -> None:
    epoch = 1767150797.44 + np.arange(5) / 50
    repaired = repair(epoch, 1.0, "file")
    np.testing.assert_array_equal(repaired.time, [0, 0.02, 0.04, 0.06, 0.08])
    assert repaired.warnings == ()


def test_a_row_that_is_written_twice_is_left_out() -> None:
    stamps = np.sort(np.append(np.arange(200.0), [50.0]))
    same = np.zeros(201, dtype=bool)
    same[51] = True
    repaired = repair(stamps, 0.01, "file", same)
    assert 51 not in repaired.rows
    np.testing.assert_allclose(repaired.time, np.arange(200) / 100)
    assert repaired.warnings == ("1 rows that repeat the row before were left out",)


def test_a_stamp_that_repeats_once_keeps_its_first_row() -> None:
    stamps = np.sort(np.append(np.arange(200.0), [50.0]))
    repaired = repair(stamps, 0.01, "file", np.zeros(201, dtype=bool))
    assert 50 in repaired.rows
    assert 51 not in repaired.rows
    assert repaired.warnings == ("1 rows that repeat a stamp were left out",)


@pytest.mark.parametrize("rate", [1500.0, 2000.0, 3333.0])
def test_a_clock_coarser_than_the_sampling_is_spread(rate: float) -> None:
    true = np.arange(3000) / rate
    repaired = repair(np.floor(true * 1000), 1e-3, "file")
    assert repaired.rows.size == 3000
    assert np.abs(repaired.time - true).max() < 1e-3  # the resolution of the clock
    assert "spread evenly" in repaired.warnings[0]


def test_rows_after_a_gap_are_not_spread_into_it() -> None:
    stamps = np.array([0.0, 0, 1, 1, 2, 2, 100, 100, 101, 101])
    repaired = repair(stamps, 1.0, "file")
    np.testing.assert_allclose(repaired.time, [0, 0.5, 1, 1.5, 2, 2.5, 100, 100.5, 101, 101.5])


def test_a_few_rows_out_of_order_are_left_out() -> None:
    stamps = np.arange(1000.0) / 100
    stamps[400] = stamps[380]  # 0.2 s late
    stamps[700] = 1e9  # one stamp is nonsense
    repaired = repair(stamps, 1.0, "file")
    assert repaired.warnings == ("2 rows out of order in time were left out",)
    np.testing.assert_array_equal(repaired.rows, np.delete(np.arange(1000), [400, 700]))


def test_a_second_run_in_the_file_is_refused() -> None:
    stamps = np.concatenate([np.arange(100), np.arange(100)]) * 10.0
    with pytest.raises(InputError, match=r"goes back from 0.99 s to 0 s after 100 rows; split it"):
        repair(stamps, 1e-3, "file")


def test_a_counter_that_overflows_goes_on() -> None:
    true = 2**32 - 50_000 + 1000 * np.arange(100)
    repaired = repair((true % 2**32).astype(float), 1e-6, "file")
    np.testing.assert_allclose(repaired.time, np.arange(100) / 1000, atol=1e-9)
    assert "overflows" in repaired.warnings[0]


def test_rows_without_a_stamp() -> None:
    stamps = np.arange(100.0)
    stamps[7] = np.nan
    assert repair(stamps, 1.0, "file").rows.size == 99
    stamps[:20] = np.nan
    with pytest.raises(InputError, match="has no time in 20 of 100 rows"):
        repair(stamps, 1.0, "file")


@pytest.mark.parametrize("stamps", [[1.0] * 9, [0.0, 1e300], [0.0, 1e12], [-1e308, 1e308]])
def test_hostile_stamps_are_refused(stamps: list[float]) -> None:
    with pytest.raises(InputError, match=r"does not advance|lasts|no time in"):
        repair(np.array(stamps), 1.0, "file")


@given(
    st.lists(
        st.floats(allow_nan=True, allow_infinity=True) | st.integers(-5, 5).map(float),
        min_size=1, max_size=60,
    ),
    st.sampled_from([None, 1.0, 1e-3]),
)  # fmt: skip
def test_any_stamps_give_increasing_ones_or_an_error(
    stamps: list[float], factor: float | None
) -> None:
    try:
        repaired = repair(np.array(stamps), factor, "file")
    except InputError:
        return
    assert repaired.time.size == repaired.rows.size
    assert (np.diff(repaired.time) > 0).all()
    assert (np.diff(repaired.rows) > 0).all()


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("12:34:56.5", 45296.5), ("2025-06-01 12:34:56.5", 45296.5), ("2025-06-01T00:00:01Z", 1.0),
        ("01/06/2025 00:00:02", 2.0), ("3:25.125", 205.125), ("0:00:01,5", 1.5),
    ],
)  # fmt: skip
def test_time_of_day(cell: str, seconds: float) -> None:
    assert is_clock(cell)
    assert clock_seconds(cell) == pytest.approx(seconds)


@pytest.mark.parametrize("cell", ["12", "a:b", "1:2:3:4", "", "12:34:56" * 9])
def test_other_cells_are_no_time_of_day(cell: str) -> None:
    assert not is_clock(cell)
