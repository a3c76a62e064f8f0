"""The comparison of a page with what its examples print."""

from __future__ import annotations

import pytest

from tests.page_examples import assert_shown


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("", ""),
        ("c_f 1003 N*s/m", "c_f  1050  N*s/m"),  # within a tenth; the width of columns is free
        ("p = 0.03", "p = 0.08"),  # within five units of the last place
        ("first\n…\nlast 2", "first\nsecond\nthird\nlast 2"),
        ("first\n…", "first\nsecond"),
        ("…\nlast", "first\nlast\nlast"),
    ],
)
def test_what_agrees_passes(shown: str, printed: str) -> None:
    assert_shown(shown, printed)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("", "a line"),
        ("a line", ""),
        ("1.003 7680", "1.003 1020"),
        ("p = 0.03", "p = 0.09"),
        ("c_f 1003", "c_r 1003"),
        ("first", "first\nsecond"),
        ("second", "first\nsecond"),
        ("first\n…\nlast", "first\nlast\nsecond"),
        ("first\n…\nlast\nfirst", "first\nlast"),
    ],
)
def test_what_differs_fails(shown: str, printed: str) -> None:
    with pytest.raises(AssertionError):
        assert_shown(shown, printed)
