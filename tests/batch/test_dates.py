"""Dates of recordings from metadata and names."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.batch.dates import date_of_metadata, date_of_name

MAY = datetime(2026, 5, 3)
MAY_TIME = datetime(2026, 5, 3, 14, 30)
STAMPS = st.datetimes(datetime(2001, 1, 1), datetime(2099, 1, 1)).map(
    lambda t: t.replace(microsecond=0)
)


@pytest.mark.parametrize(
    ("metadata", "date"),
    [
        ({"date": "2026-05-03"}, MAY),
        ({"start": "2026-05-03T14:30:00.000+00:00"}, MAY_TIME),
        ({"start": "2026-05-03 16:30:00+02:00"}, MAY_TIME),
        ({"date": "03/05/2026", "time": "14:30:00"}, MAY_TIME),
        ({"Date": "Sunday, May 3, 2026", "Time": "2:30 PM"}, MAY_TIME),
        ({"Log Date": "03/05/2026", "Log Time": "14:30"}, MAY_TIME),
        ({"note": "2026-05-03"}, None),
        ({"date": "soon", "created": "3 May 2026"}, MAY),
        ({"date": "3"}, None),
        ({"time": "14:30"}, None),
        ({}, None),
    ],
)
def test_metadata(metadata: dict[str, str], date: datetime | None) -> None:
    assert date_of_metadata(metadata.items()) == date


@pytest.mark.parametrize(
    ("name", "date"),
    [
        ("season/2026-05-03/run1.csv", MAY),
        ("run-20260503-1430.csv", MAY_TIME),
        ("run_2026_05_03_14-30-00.csv", MAY_TIME),
        ("2025/2026/05/03/run.csv", MAY),
        ("03.05.2026 run 2.csv", MAY),
        ("old-2024-01-02/new-2026-05-03.csv", MAY),
        ("run-120260503.csv", None),
        ("run-20260631.csv", None),
        ("run12.csv", None),
        ("2026/run5.csv", None),
    ],
)
def test_names(name: str, date: datetime | None) -> None:
    assert date_of_name(name) == date


@given(stamp=STAMPS, hours=st.integers(-12, 12))
def test_what_is_written_is_read(stamp: datetime, hours: int) -> None:
    zone = timezone(timedelta(hours=hours))
    written = stamp.replace(tzinfo=UTC).astimezone(zone).isoformat()
    assert date_of_metadata([("start", written)]) == stamp
    assert date_of_name(f"a/run-{stamp:%Y%m%d-%H%M%S}.csv") == stamp
    assert date_of_name(f"a/{stamp:%Y-%m-%dT%H:%M}_x.csv") == stamp.replace(second=0)
