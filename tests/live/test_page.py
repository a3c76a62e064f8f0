"""The page in a browser: numbers, bands, buttons and keys."""

from __future__ import annotations

import importlib.resources
import itertools
import json
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.server import LiveServer
from bayes_asv.live.session import Session
from bayes_asv.live.sources import RecordingSource
from bayes_asv.live.worker import Worker
from tests.live.synthetic import BAJA, FakeFilter, at, frames, new_session, recording, wait_for


class Page:
    """The page, and what a user reads from it."""

    def __init__(self, driver: Any, server: LiveServer, width: int = 1280) -> None:
        self.driver, self.server = driver, server
        self.resize(width)
        self.dark(False)
        driver.get_log("performance")
        driver.get(server.address)
        wait_for(lambda: self.text("c_f .value") not in ("", "–"))

    def resize(self, width: int) -> None:
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500},
        )

    def dark(self, wanted: bool) -> None:
        feature = {"name": "prefers-color-scheme", "value": "dark" if wanted else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def run(self, script: str, *words: object) -> Any:
        return self.driver.execute_script(script, *words)

    def text(self, name: str) -> str:
        selector = f"#card-{name}" if name.split()[0] in ("c_f", "c_r", "i") else name
        text = self.run("return document.querySelector(arguments[0])?.textContent ?? ''", selector)
        assert isinstance(text, str)
        return text

    def half_width(self, name: str) -> float:
        """Half the interval on a card, in percent."""
        words = self.text(f"{name} .width").split()
        if words[0] == "within":
            factor = float(words[-1])
            return 50.0 * (factor - 1.0 / factor)
        return float(words[1])

    def position(self) -> float:
        return float(self.text("#clock").split()[0])

    def press(self, button: str) -> None:
        self.run("document.querySelector(arguments[0]).click()", button)

    def key(self, key: str) -> None:
        self.run("document.body.dispatchEvent(new KeyboardEvent('keydown', "
                 "{key: arguments[0], bubbles: true}))", key)  # fmt: skip

    def wait(self, place: str, *words: str) -> None:
        wait_for(lambda: any(word in self.text(place) for word in words))


@pytest.fixture
def page(browser: Any) -> Iterator[Page]:
    """A recording of a minute at a tenth of its speed."""
    source = RecordingSource(recording(60.0, 400.0), BAJA)
    session = Session(view_metadata(BAJA, "stops.csv", source.duration), 400.0, speed=0.1)
    worker = Worker(source, lambda _: FakeFilter(BAJA), session)
    server = LiveServer(session)
    server.start()
    worker.start()
    assert worker.wait(20.0)
    made = Page(browser, server)
    yield made
    errors = [entry for entry in browser.get_log("browser") if entry["level"] != "INFO"]
    browser.get("about:blank")
    server.stop()
    assert errors == []


def test_numbers_appear_and_bands_narrow(page: Page) -> None:
    assert page.text("#vehicle") == BAJA.name
    wait_for(lambda: page.position() > 0.05)
    page.press("#play")
    page.wait("#clock", "paused")
    early, wide = page.position(), page.half_width("c_f")
    time.sleep(0.3)
    assert page.position() == early
    page.press("#play")
    page.press('[data-speed="10"]')
    wait_for(lambda: page.position() > early + 2.0)
    assert page.half_width("c_f") < 0.2 * wide
    page.press("#play")
    page.wait("#clock", "paused")
    # the numbers are those of the filter at that position
    expected = at(BAJA, page.position())
    median, log_sd = expected.median[0], expected.log_sd[0]
    for n, name in enumerate(("c_f", "c_r", "i")):
        nominal = getattr(BAJA, name).value
        value = float(page.text(f"{name} .value").split()[0])
        ratio = value / page.server.session.metadata.parameters[n].nominal
        assert ratio == pytest.approx(median[n] / nominal, rel=2.0 * log_sd[n] / 10 + 0.01)
        half = 100.0 * math.sinh(1.96 * log_sd[n])
        assert page.half_width(name) == pytest.approx(half, rel=0.05, abs=0.06)
    paused = page.position()
    page.press("#restart")
    wait_for(lambda: page.position() < paused)


def test_charts_follow_the_numbers(page: Page) -> None:
    """Pixels of the band of c_f: high at first, later low, and further to the right."""
    script = """
        const canvas = document.querySelector('#card-c_f canvas');
        const {width, height} = canvas;
        const often = {willReadFrequently: true};
        const copy = new OffscreenCanvas(width, height).getContext('2d', often);
        copy.drawImage(canvas, 0, 0);
        const data = copy.getImageData(0, 0, width, height).data;
        const tall = new Array(width).fill(0);
        for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
            const n = 4 * (y * width + x);
            if (data[n + 3] > 20 && data[n + 2] > data[n] + 25) tall[x] += 1;
        }
        return tall;
    """

    def column() -> list[int]:
        tall = page.run(script)
        return [n for n in tall if n > 2]

    page.server.session.control("pause")
    page.server.session.control("seek", 1.0)
    wait_for(lambda: page.position() == 1.0)
    wait_for(lambda: len(column()) > 5)
    before = column()
    page.server.session.control("seek", 11.0)
    wait_for(lambda: page.position() == 11.0)
    wait_for(lambda: len(column()) > 5 * len(before))
    after = column()
    assert np.median(after[-20:]) < 0.5 * np.median(before)


def test_histograms_and_forces_are_drawn(page: Page) -> None:
    """Travel, damper speed and damper force of either axle have ink in the colour of the axle."""
    script = """
        return [...document.querySelectorAll('.trio canvas')].map((canvas) => {
            const {width, height} = canvas;
            const often = {willReadFrequently: true};
            const copy = new OffscreenCanvas(width, height).getContext('2d', often);
            copy.drawImage(canvas, 0, 0);
            const data = copy.getImageData(0, 0, width, height).data;
            let coloured = 0;
            for (let n = 0; n < data.length; n += 4) {
                const far = Math.max(data[n], data[n + 1], data[n + 2])
                    - Math.min(data[n], data[n + 1], data[n + 2]);
                if (data[n + 3] > 20 && far > 25) coloured += 1;
            }
            return coloured;
        });
    """
    page.server.session.control("pause")
    page.server.session.control("seek", 5.0)
    wait_for(lambda: page.position() == 5.0)
    titles = page.run("return [...document.querySelectorAll('.trio h2')].map(e => e.textContent)")
    assert titles == 2 * ["Travel", "Damper speed", "Damper force"]
    page.run("document.querySelector('.trio').scrollIntoView()")
    wait_for(lambda: min(page.run(script)) > 30)


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_the_page_has_no_violation_of_accessibility(page: Page, width: int, dark: bool) -> None:
    page.resize(width)
    page.dark(dark)
    page.server.session.control("pause")
    page.run(importlib.resources.files("axe_core_python").joinpath("axe.min.js").read_text("utf-8"))
    found = page.driver.execute_async_script(
        "axe.run(document, {resultTypes: ['violations']}).then(arguments[arguments.length - 1])"
    )
    assert [
        (v["id"], [node["html"][:200] for node in v["nodes"]]) for v in found["violations"]
    ] == []


def test_verdict_texts(page: Page) -> None:
    page.server.session.control("pause")
    for position, words, tone in (
        (0.1, "settling", "muted"), (3.0, "as large as the filter expects", "good"),
        (7.0, "widens its noise 1.6 times", "below"), (11.0, "as large", "good"),
    ):  # fmt: skip
        page.server.session.control("seek", position)
        wait_for(lambda: page.position() == position)  # noqa: B023 # called in this iteration
        page.wait("#verdict", words, words.capitalize())
        assert f"tone-{tone}" in page.run("return document.querySelector('#verdict').className")
    assert page.text("c_f .sense") == "20 % softer than nominal"
    assert page.text("i .sense") == "10 % larger than nominal"
    assert page.text("c_r .sense") == "Agrees with nominal"
    assert page.text("#reach-rear") == "so far −2.0 to 2.0 in"


def test_keys(page: Page) -> None:
    page.key(" ")
    page.wait("#clock", "paused")
    page.key(" ")
    page.key("0")
    wait_for(lambda: page.server.session.playback().speed == 10.0)
    page.key(".")
    wait_for(lambda: page.server.session.playback().speed == 0.1)
    pressed = "return document.querySelector('[data-speed=\"0.1\"]').getAttribute('aria-pressed')"
    wait_for(lambda: page.run(pressed) == "true")
    page.server.session.control("seek", 57.0)
    wait_for(lambda: page.position() > 56.0)
    page.key("r")
    wait_for(lambda: page.position() < 10.0)
    page.server.session.control("seek", 59.9)
    page.key("0")
    page.wait("#clock", "ended")
    assert page.text("#play") == "Again"
    page.key(" ")
    wait_for(lambda: page.position() < 50.0)


def test_window_and_slider(page: Page) -> None:
    page.run(
        "const s = document.querySelector('#window'); s.value = '2'; "
        "s.dispatchEvent(new Event('change'))"
    )
    page.run(
        "const s = document.querySelector('#seek'); s.value = 500; "
        "s.dispatchEvent(new Event('input'))"
    )
    wait_for(lambda: page.position() > 29.0)
    assert page.position() < 50.0
    begin = "return Number(document.querySelector('#window').value)"
    assert page.run(begin) == 2


def test_layout_colours_and_no_external_requests(page: Page) -> None:
    page.server.session.control("pause")
    for n, (width, dark) in enumerate(itertools.product((360, 768, 1280), (False, True))):
        page.resize(width)
        page.dark(dark)
        page.server.session.control("seek", 5.5 + n)
        wait_for(lambda: page.position() == 5.5 + n)  # noqa: B023 # called in this iteration
        _fits(page, width)
        # light text on a dark background or the other way round
        ink, paper = page.run(
            "const c = getComputedStyle(document.body); return [c.color, c.backgroundColor]"
            ".map(t => t.match(/[0-9]+/g).slice(0, 3).reduce((a, b) => a + Number(b), 0))"
        )
        assert (ink - paper) * (1 if dark else -1) > 500
    urls = set()
    for entry in page.driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            urls.add(message["params"]["request"]["url"])
    assert len(urls) > 5
    assert all(url.startswith((page.server.address, "data:")) for url in urls)


def _fits(page: Page, width: int) -> None:
    inner, scroll = page.run(
        "return [document.documentElement.clientWidth, document.documentElement.scrollWidth]"
    )
    assert width - 20 <= inner <= width
    assert scroll <= inner
    beyond = page.run(
        "return [...document.querySelectorAll('body *')].filter(e => "
        "e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
    )
    assert beyond == []
    cut = page.run(
        "return [...document.querySelectorAll('button, .value, h2, h1')]"
        ".filter(e => e.scrollWidth > e.clientWidth + 1 && e.clientWidth).map(e => e.outerHTML)"
    )
    assert cut == []


def test_live_port_has_no_playback_controls(browser: Any) -> None:
    session = Session(view_metadata(BAJA, "/dev/ttyUSB0", None, live=True), 100.0)
    server = LiveServer(session)
    server.start()
    run = recording(3.0, 100.0)
    session.history.append(frames(BAJA, run.time[:100], run.values.T[:100]))
    session.set_notes("Every byte is saved in run.csv.")
    page = Page(browser, server)
    visible = "return document.querySelector(arguments[0]).offsetParent !== null"
    assert not page.run(visible, "#restart")
    assert not page.run(visible, "#seek")
    assert page.run(visible, "#play")
    assert page.text("#source") == "live from /dev/ttyUSB0"
    assert "saved in run.csv" in page.text("#notes")
    wait_for(lambda: page.position() == pytest.approx(0.99))
    page.press("#play")
    page.wait("#clock", "paused")
    session.history.append(frames(BAJA, run.time[100:], run.values.T[100:]))
    time.sleep(0.2)
    assert page.position() == pytest.approx(0.99)
    page.press("#play")
    wait_for(lambda: page.position() == pytest.approx(2.99))
    session.finish("the cable broke")
    page.wait("#banner", "the cable broke")
    server.stop()
    page.wait("#banner", "has ended")
    browser.get("about:blank")


def test_names_are_not_interpreted_as_html(browser: Any) -> None:
    evil = '<img src=x onerror="document.title=1"><b>evil</b>'
    session, worker = new_session(2.0)
    object.__setattr__(session.metadata, "vehicle", evil)
    session.set_notes(evil)
    server = LiveServer(session)
    server.start()
    session.history.append(at(BAJA, 0.0))
    page = Page(browser, server)
    assert page.text("#vehicle") == evil
    assert page.run("return document.querySelectorAll('b, img').length") == 0
    browser.get("about:blank")
    server.stop()
    assert not worker.running
