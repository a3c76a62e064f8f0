"""The pages in a browser: accessibility by axe-core, the appendix, print, the interactive page."""

from __future__ import annotations

import importlib.resources
import json
import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.report.render import html_report, interactive_report, write_report
from bayes_asv.report.schema import DiagnoseDocument, TrackDocument
from tests.report.conftest import DATA, HOSTILE, load

DIAGNOSIS = DATA / "diagnosis.json"
TRACK = DATA / "commit_3f70d75" / "track.json"
CSS = importlib.resources.files("bayes_asv.report").joinpath("templates/report.css")


@pytest.fixture(scope="module")
def axe() -> str:
    return importlib.resources.files("axe_core_python").joinpath("axe.min.js").read_text("utf-8")


@pytest.fixture(scope="module")
def written(pages: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Files of all kinds of pages."""
    folder = tmp_path_factory.mktemp("pages")
    made = {kind: pages[kind] for kind in ("us", "refused", "budget")}
    made["diagnosis"] = html_report(DiagnoseDocument.model_validate_json(DIAGNOSIS.read_bytes()))
    made["track"] = html_report(TrackDocument.model_validate_json(TRACK.read_bytes()))
    made["interactive"] = interactive_report(load("two_runs"))
    files = {}
    for kind, text in made.items():
        files[kind] = folder / f"{kind}.html"
        files[kind].write_text(text, encoding="utf-8")
    return files


def show(browser: Any, file: Path, width: int = 1280, scheme: str = "light") -> None:
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500},
    )
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": features})
    browser.get(file.as_uri())


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", ["us", "budget", "refused", "diagnosis", "track", "interactive"])
def test_no_page_has_a_violation(
    browser: Any, written: dict[str, Path], axe: str, kind: str, scheme: str
) -> None:
    show(browser, written[kind], 390 if scheme == "dark" else 1280, scheme)
    browser.execute_script("for (const d of document.querySelectorAll('details')) d.open = true")
    # The driver's scripts are not bound by the policy of the page.
    browser.execute_script(axe)
    found = browser.execute_async_script(
        "axe.run(document, {resultTypes: ['violations']}).then(arguments[arguments.length - 1])"
    )
    assert [
        (v["id"], [node["html"][:200] for node in v["nodes"]]) for v in found["violations"]
    ] == []


def test_the_appendix_is_folded_and_its_links_open_it(
    browser: Any, written: dict[str, Path]
) -> None:
    show(browser, written["us"])
    details = "[...document.querySelectorAll('details')].map(d => d.open)"
    assert not any(browser.execute_script(f"return {details}"))
    links = browser.execute_script(
        "return [...document.querySelectorAll('nav a')].map(a => a.getAttribute('href'))"
    )
    assert len(links) == len(set(links)) > 3
    browser.execute_script("document.querySelectorAll('nav a')[1].click()")
    opened = browser.execute_script(f"return {details}")
    assert opened == [n == 1 for n in range(len(opened))]


def test_all_of_the_appendix_is_printed(browser: Any, written: dict[str, Path]) -> None:
    show(browser, written["us"])
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    heights = browser.execute_script(
        "return [...document.querySelectorAll('details > div')].map(d => d.offsetHeight)"
    )
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert min(heights) > 10


def test_the_interactive_page_zooms_and_reads_two_cursors(
    browser: Any, written: dict[str, Path]
) -> None:
    show(browser, written["interactive"], 1280)
    assert browser.get_log("browser") == []
    assert written["interactive"].stat().st_size < 3_000_000
    assert browser.execute_script("return performance.getEntriesByType('resource').length") == 0
    charts = browser.execute_script("return document.querySelectorAll('.u-over').length")
    assert charts == 5
    document = load("two_runs")
    run = document.runs[0]

    def values() -> dict[str, list[str]]:
        rows: list[list[str]] = browser.execute_script(
            "return [...document.querySelectorAll('#values tbody tr')]"
            ".map(r => [...r.cells].map(c => c.textContent))"
        )
        return {row[0]: row[1:] for row in rows}

    # Cursors by their fields: the values are those of the document.
    first, second = len(run.time) // 3, 2 * len(run.time) // 3
    at = {"a": run.time[first], "b": run.time[second]}
    for name, time in at.items():
        browser.execute_script(
            f"const f = document.getElementById('{name}'); f.value = arguments[0];"
            "f.dispatchEvent(new Event('input'))",
            time,
        )
    shown = values()["front travel [in]"]
    deflection = run.travel.entries["front"].deflection
    a, b = deflection[first], deflection[second]
    assert a is not None
    assert b is not None
    got = [float(text.replace("\u2212", "-")) for text in shown[1:]]
    assert got == pytest.approx([a, b, b - a], rel=2e-3, abs=1e-4)
    # A drag over one chart zooms all; the pointer is read in all.
    browser.execute_script("scrollTo(0, 0)")
    left, top, wide = browser.execute_script(
        "const r = document.querySelector('.u-over').getBoundingClientRect();"
        "return [r.left, r.top + r.height / 2, r.width]"
    )
    for kind, share in (
        ("mouseMoved", 0.3), ("mousePressed", 0.3), ("mouseMoved", 0.5), ("mouseReleased", 0.5),
        ("mouseMoved", 0.5),
    ):  # fmt: skip
        browser.execute_cdp_cmd(
            "Input.dispatchMouseEvent",
            {"type": kind, "x": left + share * wide, "y": top, "button": "left",
             "buttons": 1, "clickCount": 1},
        )  # fmt: skip
    ticks = browser.execute_script("return document.querySelector('#values thead').innerText")
    assert " s" in ticks  # the time under the pointer
    assert all(row[0] != "–" for row in values().values())
    # The second recording takes its place.
    browser.execute_script(
        "const s = document.getElementById('run'); s.value = '1';"
        "s.dispatchEvent(new Event('change'))"
    )
    assert all(row[1] == "–" for row in values().values())
    assert browser.get_log("browser") == []


def test_hostile_text_is_no_script_of_the_interactive_page(browser: Any, tmp_path: Path) -> None:
    text = interactive_report(load("hostile"))
    data = re.search(r'id="data">(.*?)</script>', text, flags=re.DOTALL)
    assert data is not None
    runs = json.loads(data[1])["runs"]
    assert runs[0]["name"].startswith("0<script>")
    assert "<" not in data[1]
    assert HOSTILE[:8] not in text.partition("<main>")[0]
    file = tmp_path / "x.html"
    file.write_text(text, encoding="utf-8")
    show(browser, file)
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.querySelector('#run').options.length") == 2


def test_only_an_estimate_is_interactive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"end the name in \.html"):
        write_report(load("us"), tmp_path / "x.pdf", interactive=True)
    with pytest.raises(InputError, match="there is none"):
        write_report(load("refused"), tmp_path / "x.html", interactive=True)
    assert list(tmp_path.iterdir()) == []


# Machado, Oliveira & Fernandes, A physiologically-based model for simulation of color vision
# deficiency, IEEE Transactions on Visualization and Computer Graphics 15 (2009), severity 1.0.
DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
TOGETHER = (("front", "rear"), ("front", "muted"), ("rear", "muted"), ("below", "good"))
"""Colours that tell curves or verdicts apart; every other pair also differs in its words."""


def lab(colour: str, deficiency: np.ndarray[Any, Any]) -> Any:
    """CIELAB of an sRGB colour as it is seen."""
    srgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ) @ np.clip(deficiency @ linear, 0.0, 1.0)
    t = xyz / np.array([0.9505, 1.0, 1.089])
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
@pytest.mark.parametrize("scheme", [0, 1])
def test_colours_can_be_told_apart(deficiency: str, scheme: int) -> None:
    css = CSS.read_text("utf-8")
    block = re.findall(r":root \{(.*?)\}", css, flags=re.DOTALL)[scheme]
    colours = dict(re.findall(r"--(\w+): (#\w{6})", block))
    seen = {name: lab(colours[name], DEFICIENCIES[deficiency]) for name in colours}
    for one, other in TOGETHER:
        assert np.linalg.norm(seen[one] - seen[other]) > 15.0, (one, other)
    assert len({colours[n] for n, _ in combinations(colours, 2)}) > 5
