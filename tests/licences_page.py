"""Write ``docs/sbom.json`` and ``docs/licences.md``: ``python -m tests.licences_page``.

Run it where the versions of ``requirements-dev.txt`` are installed (``make lock`` does).  The bill
of materials is that of cyclonedx-py, an established tool; this module adds what it cannot know: the
code that the package brings with it, who needs a package, and a licence of free text only.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from importlib.metadata import Distribution, distribution, distributions
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

__all__ = ["BILL", "BUNDLED", "LOCK", "PAGE", "SCOPES", "licence", "locked", "page"]

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements-dev.txt"
BILL = ROOT / "docs" / "sbom.json"
PAGE = ROOT / "docs" / "licences.md"

# Scopes of CycloneDX, and what they mean here.
SCOPES = {
    "required": "Every installation",
    "optional": "The extras notebook, formats, aim, fleet and dask",
    "excluded": "Development, tests and the site only",
}

# Code of others inside the package: name to (folder, what reads the version, licence).
BUNDLED = {
    "uPlot": (ROOT / "bayes_asv" / "live" / "static" / "uplot", r"uPlot \(v([\d.]+)\)", "MIT"),
}


def locked() -> dict[str, str]:
    """Name and version of every package of the lock that this interpreter and system need."""
    versions: dict[str, str] = {}
    for line in LOCK.read_text("utf-8").splitlines():
        if line and line[0] not in " #":
            asked = Requirement(line.removesuffix("\\"))
            if asked.marker is None or asked.marker.evaluate():
                (version,) = asked.specifier
                versions[str(canonicalize_name(asked.name))] = version.version
    return versions


def _needed(name: str, extras: frozenset[str], found: set[str]) -> set[str]:
    """Names of the packages that an installation of ``name`` with ``extras`` brings."""
    for text in distribution(name).requires or []:
        asked = Requirement(text)
        needed = asked.marker is None or any(
            asked.marker.evaluate({"extra": extra}) for extra in extras or {""}
        )
        child = canonicalize_name(asked.name)
        if needed and (child not in found or asked.extras):
            found.add(child)
            _needed(child, frozenset(asked.extras), found)
    return found


def _named(component: dict[str, Any], package: Distribution) -> list[dict[str, Any]]:
    """The licences of a component; that of the metadata's free text where there is no other."""
    licences: list[dict[str, Any]] = component.get("licenses", [])
    text = (package.metadata["License"] or "").strip().splitlines()
    if not licences and text:
        licences = [{"license": {"name": text[0]}}]
    return licences


def _bill() -> dict[str, Any]:
    project = str(ROOT / "pyproject.toml")
    options = ("--output-reproducible", "--mc-type", "library", "--pyproject", project)
    document: dict[str, Any] = json.loads(
        subprocess.run(
            [sys.executable, "-m", "cyclonedx_py", "environment", sys.executable, *options],
            capture_output=True,
            check=True,
        ).stdout
    )
    required = _needed("bayes-asv", frozenset(), set())
    optional = _needed("bayes-asv", frozenset({"all"}), set())
    installed = {str(canonicalize_name(d.metadata["Name"])): d for d in distributions()}
    versions = locked()
    components = []
    for component in document["components"]:
        name = str(canonicalize_name(component["name"]))
        if versions.get(name) != component["version"]:
            continue
        component.pop("externalReferences", None)
        component.pop("description", None)
        component["licenses"] = _named(component, installed[name])
        component["scope"] = (
            "required" if name in required else "optional" if name in optional else "excluded"
        )
        components.append(component)
    for name, (folder, pattern, identifier) in BUNDLED.items():
        code = "".join(path.read_text("utf-8") for path in sorted(folder.glob("*.js")))
        found = re.search(pattern, code)
        assert found is not None, f"no version of {name} in {folder}"
        reference = f"{name}=={found[1]}"
        components.append(
            {
                "bom-ref": reference,
                "description": "In the package itself: charts of the live view and of reports",
                "licenses": [{"license": {"acknowledgement": "declared", "id": identifier}}],
                "name": name,
                "purl": f"pkg:npm/{name.lower()}@{found[1]}",
                "scope": "required",
                "type": "library",
                "version": found[1],
            }
        )
    references = {c["bom-ref"] for c in components} | {"root-component"}
    dependencies = [d for d in document["dependencies"] if d["ref"] in references]
    for entry in dependencies:
        if "dependsOn" in entry:
            entry["dependsOn"] = [r for r in entry["dependsOn"] if r in references]
    document["metadata"].pop("tools", None)
    document["components"] = components
    document["dependencies"] = dependencies
    return document


def licence(component: dict[str, Any]) -> str:
    """The licence of a component in one expression, as its author declares it."""
    names: list[str] = []
    for entry in component["licenses"]:
        one = entry.get("license", {})
        name = entry.get("expression") or one.get("id") or one["name"]
        names.append(name.removeprefix("License :: ").removeprefix("OSI Approved :: "))
    exact = [
        e
        for e, n in zip(component["licenses"], names, strict=True)
        if "name" not in e.get("license", {})
    ]
    if exact:  # an SPDX identifier says the same as the classifier beside it
        names = [n for e, n in zip(component["licenses"], names, strict=True) if e in exact]
    return ", ".join(dict.fromkeys(names)) or "not declared"


def page(document: dict[str, Any]) -> str:
    """The table of licences, of a bill of materials."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    lines = [
        "# Licences of what is installed",
        "",
        f"bayes_asv itself is under the {project['license']} licence. This page lists the versions"
        " of `requirements-dev.txt`, which development and every check use, as Linux and"
        " Python 3.11 install them. [sbom.json](sbom.json) has the same as a software bill of"
        " materials (CycloneDX), with what depends on what. `make lock` renews all three.",
        "",
        "An installation of the package alone takes the newest versions that `pyproject.toml`"
        " admits, so that its versions may differ from these.",
    ]
    for scope, heading in SCOPES.items():
        chosen = [c for c in document["components"] if c["scope"] == scope]
        lines += ["", f"## {heading}", "", "| package | version | licence |", "|---|---|---|"]
        lines += [
            f"| {c['name']} | {c['version']} | {licence(c)} |"
            for c in sorted(chosen, key=lambda c: c["name"].lower())
        ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    bill = _bill()
    BILL.write_text(json.dumps(bill, indent=1, ensure_ascii=False) + "\n", "utf-8")
    PAGE.write_text(page(bill), "utf-8")
