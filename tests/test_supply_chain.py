"""What is installed is what is locked, its licences are known, and a wheel can be made again."""

import hashlib
import json
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.licences_page import BILL, BUNDLED, PAGE, licence, locked, page

ROOT = Path(__file__).parents[1]

# Words of licences whose terms reach a program that only imports the package.
STRICT = re.compile(r"GPL|GENERAL PUBLIC|AFFERO|EUPL|SSPL|not declared", re.IGNORECASE)
# LGPL admits the import of an unchanged library, which an extra asks its user to install.
LESSER = re.compile(r"LGPL", re.IGNORECASE)


def test_what_is_installed_is_what_is_locked() -> None:
    installed = {str(canonicalize_name(d.metadata["Name"])): d.version for d in distributions()}
    other = {
        name: (version, installed.get(name))
        for name, version in locked().items()
        if installed.get(name) != version
    }
    assert not other, "make test installs the versions of requirements-dev.txt"


def test_the_lock_has_all_that_the_project_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    versions = locked()
    asked = [
        *project["project"]["dependencies"],
        *(text for extra in project["project"]["optional-dependencies"].values() for text in extra),
        *project["build-system"]["requires"],
    ]
    for requirement in map(Requirement, asked):
        name = canonicalize_name(requirement.name)
        if name != "bayes-asv":
            assert requirement.specifier.contains(versions[name]), requirement


def test_every_locked_file_has_a_hash() -> None:
    entries = re.split(r"\n(?=\S)", (ROOT / "requirements-dev.txt").read_text("utf-8").strip())
    assert len(entries) > 150
    for entry in entries:
        assert re.search(r"^\S+==\S+ .*\\\n +--hash=sha256:[0-9a-f]{64}", entry), entry


@pytest.mark.skipif(
    (sys.platform, sys.version_info[:2]) != ("linux", (3, 11)),
    reason="the bill of materials is that of Linux and Python 3.11",
)
def test_the_bill_of_materials_is_that_of_the_lock() -> None:
    components = json.loads(BILL.read_text("utf-8"))["components"]
    listed = {canonicalize_name(c["name"]): c["version"] for c in components}
    for name, (folder, pattern, _) in BUNDLED.items():
        code = next(iter(folder.glob("*.js"))).read_text("utf-8")
        found = re.search(pattern, code)
        assert found is not None
        assert listed.pop(canonicalize_name(name)) == found[1]
        assert (folder / "LICENSE").is_file()
    assert listed == locked()
    assert PAGE.read_text("utf-8") == page(json.loads(BILL.read_text("utf-8")))


def test_every_bundled_file_of_others_is_in_the_bill() -> None:
    minified = {p.parent for p in (ROOT / "bayes_asv").rglob("*.min.*")}
    assert minified == {folder for folder, _, _ in BUNDLED.values()}


def test_no_licence_binds_who_installs_the_package() -> None:
    components = json.loads(BILL.read_text("utf-8"))["components"]
    for component in components:
        name = licence(component)
        if component["scope"] == "required":
            assert not STRICT.search(name), component
        elif component["scope"] == "optional":
            assert not STRICT.search(LESSER.sub("", name)), component


def _wheel(folder: Path) -> Path:
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_a_wheel_can_be_made_again_byte_for_byte(tmp_path: Path) -> None:
    first, second = _wheel(tmp_path / "a"), _wheel(tmp_path / "b")
    assert (
        hashlib.sha256(first.read_bytes()).digest() == hashlib.sha256(second.read_bytes()).digest()
    )
    names = zipfile.ZipFile(first).namelist()
    assert "bayes_asv/__main__.py" in names
    assert "bayes_asv/data/vehicles/baja2008.toml" in names or any("baja2008" in n for n in names)
    assert not [n for n in names if n.endswith((".pyc", ".nbi", ".nbc"))]
    dates = {info.date_time for info in zipfile.ZipFile(first).infolist()}
    assert len(dates) == 1  # not when a file was written
