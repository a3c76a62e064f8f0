"""A browser without a window, for tests of pages."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

__all__ = ["CHROMIUM", "browsing"]

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)


def browsing(profile: Path, logs: Sequence[str] = ("browser",)) -> Iterator[Any]:
    """Yield a driver that keeps some logs, and quit it; skip where there is no browser."""
    driver_path = shutil.which("chromedriver")
    if CHROMIUM is None or driver_path is None:
        if os.environ.get("CI") == "true":
            pytest.fail("CI needs chromium and chromedriver")
        pytest.skip("chromium or chromedriver is not installed")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (
        "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={profile}",
    ):  # fmt: skip
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", dict.fromkeys(logs, "ALL"))
    driver = webdriver.Chrome(options=options, service=Service(driver_path))
    yield driver
    driver.quit()
