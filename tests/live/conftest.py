"""A headless browser for the tests of the page."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser import browsing


@pytest.fixture(autouse=True, scope="session")
def _restore_ctrl_c() -> None:
    """A shell's background processes ignore Ctrl-C, and so would processes that tests start."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    yield from browsing(tmp_path_factory.mktemp("browser"), ("browser", "performance"))
