"""The site of the documentation is whole, and what it says of the package is so."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

import bayes_asv as asv
from bayes_asv.models.effects import EFFECTS
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from tests import gallery_page

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site with warnings as errors; only the notebooks are not run."""
    if importlib.util.find_spec("sphinx") is None:
        pytest.skip("Sphinx is not installed: pip install -e '.[docs]'")
    folder = tmp_path_factory.mktemp("site") / "html"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"),
            *("-D", "nb_execution_mode=off", str(DOCS), str(folder)),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def _pages(site: Path) -> dict[Path, str]:
    pages = (page for page in site.rglob("*.html") if "_static" not in page.parts)
    return {page: page.read_text("utf-8") for page in pages}


def test_no_link_of_the_site_is_broken(site: Path) -> None:
    pages = _pages(site)
    ids = {page: set(re.findall(r'\bid="([^"]+)"', text)) for page, text in pages.items()}
    links = 0
    for page, text in pages.items():
        for target in re.findall(r'<(?:a|img|link|script)[^>]*?(?:href|src)="([^"]+)"', text):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = unquote(target).partition("#")
            to = (page.parent / path.partition("?")[0]).resolve() if path else page
            assert to.exists(), f"{page.name}: {target}"
            if anchor and to in ids and page.name not in ("genindex.html", "search.html"):
                assert anchor in ids[to], f"{page.name}: {target}"
                links += 1
    assert links > 500


def test_no_page_loads_anything_from_another_server(site: Path) -> None:
    for page, text in _pages(site).items():
        loads = r'<(?:script|img|iframe)[^>]*?src="https?:[^"]+|<link[^>]*?href="https?:[^"]+'
        assert re.findall(loads, text) == [], page.name


def test_the_reference_has_every_public_name(site: Path) -> None:
    text = (site / "api.html").read_text("utf-8")
    for name in set(asv.__all__) - {"__version__"}:
        assert f'id="bayes_asv.{name}"' in text, name


def test_the_gallery_is_made_of_the_registry() -> None:
    assert set(gallery_page.SIGNATURES) == set(EFFECTS)
    written = gallery_page.PAGE.read_text("utf-8")
    assert written == gallery_page.page(), "run: python -m tests.gallery_page"


def test_the_gallery_draws_every_effect_and_its_linear_car_is_that_of_the_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("IPython")
    monkeypatch.syspath_prepend(str(DOCS))
    drawn = importlib.import_module("effect_drawings")
    assert set(drawn.EXAMPLES) == set(EFFECTS)
    assert np.isfinite(drawn._run("damper_curve", True).time).all()
    run = drawn._run("bound_rebound", False)
    example = drawn.EXAMPLES["bound_rebound"]
    course = road(example.road, np.random.default_rng(1), example.speed)
    vehicle = replace(asv.read_vehicle(asv.example("baja2008.toml")), sensors={})
    drive = simulate(vehicle, course, seconds=run.time[-1])
    for axle, channel in enumerate((1, 3)):  # front and rear chassis
        linear = np.interp(run.time, drive.time, drive.truth[channel])
        assert run.body[:, axle] == pytest.approx(linear, abs=0.01 * np.max(np.abs(linear)))
    assert np.max(np.abs(drawn._run("bound_rebound", True).body - run.body)) > 1.0  # m/s²


def _sentences() -> str:
    """Every text of the package, with … in place of what is put in."""
    found = []
    for path in (ROOT / "bayes_asv").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = (p.value if isinstance(p, ast.Constant) else "…" for p in node.values)
                found.append("".join(str(part) for part in parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return "\n".join(found)


def test_the_messages_explained_are_those_of_the_package() -> None:
    page = (DOCS / "messages.md").read_text("utf-8")
    shown = re.findall(r"^\| `([^`]+)` \|", page, re.MULTILINE)
    assert len(shown) > 20
    said = _sentences()
    for message in shown:
        assert message in said, message


def test_the_map_of_the_code_is_that_of_the_package() -> None:
    """Every module that it names is there, and its folders are the layers of the contract."""
    text = (DOCS / "architecture.md").read_text("utf-8")
    named = re.findall(r"`((?:\w+/)*\w+\.py)`", text)
    assert len(named) > 30
    assert [path for path in named if not (ROOT / "bayes_asv" / path).is_file()] == []
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    layers = re.findall(r"bayes_asv\.(\w+)", " ".join(contracts["contracts"][0]["layers"]))
    folders = text.partition("## Folders")[2].partition("## Names")[0]
    assert re.findall(r"^\| `(\w+)` \|", folders, re.MULTILINE) == layers


def test_conventions_agree_with_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    supported = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    workflow = (ROOT / ".github" / "workflows" / "checks.yml").read_text("utf-8")
    matrix = re.search(r"python: \[(.*)\]", workflow)
    assert matrix is not None
    assert re.findall(r'"([\d.]+)"', matrix[1]) == supported
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {asv.__version__}\n" in citation
    assert f"\nlicense: {project['license']}\n" in citation
