"""Examples in the documentation work as they stand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording
from benchmarks.online import RESULTS
from benchmarks.online_page import page
from benchmarks.roomster import tables as real_car

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def _blocks(page: Path, language: str) -> list[str]:
    text = page.read_text(encoding="utf-8")
    found = re.findall(rf"^ *```{language}\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)
    return [re.sub(r"^   ", "", block, flags=re.MULTILINE) for block in found]


def test_recordings_shown_can_be_read(tmp_path: Path) -> None:
    shown = [
        block
        for page in PAGES
        for block in _blocks(page, "text")
        if "front_wheel [" in block or block.startswith("# sample_rate")
    ]
    assert len(shown) == 3
    for number, block in enumerate(shown):
        file = tmp_path / f"{number}.csv"
        file.write_text(block, encoding="utf-8")
        recording = read_recording(file)
        assert recording.time.tolist() == pytest.approx([0.0, 0.0025])
        assert recording.warnings == ()


def test_the_vehicle_shown_can_be_read(tmp_path: Path) -> None:
    blocks = _blocks(ROOT / "docs" / "vehicle.md", "toml")
    file = tmp_path / "car.toml"
    file.write_text("\n".join(blocks), encoding="utf-8")
    car = read_vehicle(file)
    baja = read_vehicle(ROOT / "data" / "vehicles" / "baja2008.toml")
    for name in ("m", "l", "wdf", "k_f", "k_r", "c_f", "c_r", "i"):
        assert getattr(car, name).value == pytest.approx(getattr(baja, name).value, rel=0.01)
    assert car.sensor("front_wheel").zero_counts == 569.5
    assert car.channel("body_vertical").position == pytest.approx(0.9)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+?)\)", text):
        if not target.startswith("https://"):
            assert (page.parent / target).exists(), target


def test_the_page_of_the_online_filter_is_made_of_its_results() -> None:
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert (ROOT / "docs" / "online.md").read_text(encoding="utf-8") == page(kept)


def test_the_page_of_the_real_car_holds_the_tables_of_its_results() -> None:
    kept = json.loads((RESULTS.parent / "roomster.json").read_text(encoding="utf-8"))
    text = real_car.PAGE.read_text(encoding="utf-8")
    for name, table in real_car.tables(kept).items():
        assert table.count("\n") > 2
        assert f"<!-- {name} -->\n{table}<!-- end {name} -->" in text, name
