"""Which published results belong to the present code, and one command that renews the others.

A result names the commit that it was computed with.  It is of the present code if none of the files
that its benchmark imports, directly or not, has changed since.  ``python -m benchmarks.freshness``
writes ``docs/evidence.md``, which says so for each; with ``--renew`` it first runs the benchmarks
whose results are older, one after the other, shortest first.  All that take long resume where they
were stopped, and so does this.
"""

from __future__ import annotations

import argparse
import ast
import gzip
import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["PAGE", "RESULTS", "Result", "commits", "page", "sources", "status"]

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence.md"
TEMPLATE = Path(__file__).parent / "evidence_page.md.in"


class Result(NamedTuple):
    """A published result.

    Parameters
    ----------
    path : str
        Below ``benchmarks/results``.
    command : str
        That computes it, behind ``python -m``.
    minutes : int
        Of one processor.
    """

    path: str
    command: str
    minutes: int

    @property
    def files(self) -> list[Path]:
        """The files that have it."""
        where = ROOT / "benchmarks" / "results" / self.path
        return [where] if where.is_file() else sorted(where.rglob("*.jsonl.gz"))


RESULTS = {
    "accuracy": Result("accuracy.json", "benchmarks.accuracy --seed 21", 5),
    "agreement": Result("agreement.json", "benchmarks.agreement", 40),
    "attack": Result("attack.json", "benchmarks.attack --inputs 1000000 --minutes 300", 300),
    "battery": Result("battery", "benchmarks.battery", 1200),
    "broken channels": Result("broken_channels.json", "benchmarks.broken_channels --quick", 60),
    "calibration": Result("calibration", "benchmarks.calibration", 600),
    "change points": Result("change_points.json", "benchmarks.change_points", 5),
    "clocks": Result("clocks.json", "benchmarks.clocks", 30),
    "compare": Result("compare.json", "benchmarks.compare", 30),
    "fleet": Result("fleet.json", "benchmarks.fleet", 15),
    "growth": Result("growth.json", "benchmarks.growth", 15),
    "law forms": Result("law_forms.json", "benchmarks.law_forms", 1),
    "live": Result("live.json", "benchmarks.live", 5),
    "logger": Result("logger.json", "benchmarks.logger --seed 41", 60),
    "long logs": Result("long_logs.json", "benchmarks.long_logs", 5),
    "online": Result("online.json", "benchmarks.online", 60),
    "other sensors": Result("other_sensors.json", "benchmarks.other_sensors", 40),
    "plan": Result("plan.json", "benchmarks.plan", 40),
    "predicted biases": Result("predicted_biases.json", "benchmarks.predicted_biases", 10),
    "real cars": Result(
        "real_cars.json", "benchmarks.real_cars --size 0.25 --size 0.5 --size 1", 60
    ),
    "real dampers": Result("real_dampers.json", "benchmarks.real_dampers DYNO", 240),
    "resampled exports": Result("resampled_exports.json", "benchmarks.resampled_exports", 40),
    "roll car": Result("rolling.json", "benchmarks.rolling", 60),
    "roomster": Result("roomster.json", "benchmarks.roomster", 60),
    "scatter": Result("scatter.json", "benchmarks.scatter", 30),
    "speed beside peers": Result("peers.json", "benchmarks.peers", 30),
    "wrong inputs": Result("mistaken_inputs.json", "benchmarks.mistaken_inputs.score", 60),
}


def commits(result: Result) -> list[str]:
    """Return the commits that a result names, in the order of their names."""
    found: set[str] = set()
    for path in result.files:
        if path.suffix == ".gz":
            with gzip.open(path, "rt", encoding="utf-8") as lines:
                for line in lines:
                    found |= set(_named(json.loads(line)))
        else:
            found |= set(_named(json.loads(path.read_text("utf-8"))))
    return sorted(found)


def _named(document: Any) -> Iterator[str]:
    """Values of all keys ``commit`` of a document, without the mark of a changed tree."""
    if isinstance(document, dict):
        for key, value in document.items():
            if key == "commit" and isinstance(value, str):
                yield value.removesuffix("+")
            else:
                yield from _named(value)
    elif isinstance(document, list):
        for value in document:
            yield from _named(value)


def sources(module: str) -> frozenset[str]:
    """Return the files that a module imports, directly or not, of this repository; relative paths.

    An import within a function counts, and so does a name that a package fetches when it is asked
    for: whoever imports ``bayes_asv`` itself may use all of ``bayes_asv.library``, and whoever
    names it, as the words of a command do, all commands.
    """
    found: set[str] = set()
    left = [module]
    while left:
        path = _path_of(left.pop())
        if path is not None and path not in found:
            found.add(path)
            left += _imports(path)
    return frozenset(found)


@cache
def _path_of(module: str) -> str | None:
    """Return the file of a module of this repository; None where there is none."""
    where = Path(*module.split("."))
    if where.parts[0] not in ("bayes_asv", "tests", "benchmarks"):
        return None
    for path in (where.with_suffix(".py"), where / "__main__.py", where / "__init__.py"):
        if (ROOT / path).is_file():
            return str(path)
    return None


@cache
def _imports(path: str) -> tuple[str, ...]:
    """Modules that a file of this repository imports."""
    own = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    out: list[str] = []
    for node in ast.walk(ast.parse((ROOT / path).read_text("utf-8"))):
        if isinstance(node, ast.Constant) and node.value in ("bayes_asv", "bayes-asv"):
            commands = sorted((ROOT / "bayes_asv" / "cli").glob("*_command.py"))
            out += [f"bayes_asv.cli.{command.stem}" for command in commands]
        elif isinstance(node, ast.Import):
            out += [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = own.split(".")[: -node.level] if node.level else []
            if path.endswith("__init__.py") and node.level:
                above = own.split(".")[: len(own.split(".")) - node.level + 1]
            base = ".".join([*above, *([node.module] if node.module else [])])
            out += [base, *(f"{base}.{name.name}" for name in node.names)]
    if "bayes_asv" in out and path != "bayes_asv/__init__.py":
        out.append("bayes_asv.library")
    return tuple(out)


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
    )  # fmt: skip


def status(result: Result) -> str:
    """Say of which commit a result is, and whether the code has changed since.

    Returns
    -------
    str
        For example ``commit 1fe8039, older than the code``; what is not committed counts as code.
    """
    named = commits(result)
    if not named:
        return "commit unknown"
    text = f"commit{'s' * (len(named) > 1)} {', '.join(named)}"
    # A commit that only another branch has is not in a clone of this one.
    known = [_git("merge-base", "--is-ancestor", one, "HEAD").returncode == 0 for one in named]
    if not all(known):
        return f"{text}, of which not all are in the history of this branch"
    files = sorted(sources(result.command.split()[0]))
    changed = [_git("diff", "--quiet", commit, "--", *files).returncode != 0 for commit in named]
    return f"{text}, {'older than the code' if any(changed) else 'of the present code'}"


def page() -> str:
    """Return the page of all results, from its template and what the results say."""
    text = TEMPLATE.read_text("utf-8")
    for name, result in RESULTS.items():
        text = text.replace(f"{{{name}}}", status(result))
    return text


def main() -> None:
    """Renew older results, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--renew", action="store_true", help="run the benchmarks of older results")
    parser.add_argument("--only", action="append", choices=RESULTS, help="one of the results")
    options = parser.parse_args()
    chosen = {name: RESULTS[name] for name in options.only or RESULTS}
    stale = {n: r for n, r in chosen.items() if not status(r).endswith("of the present code")}
    minutes = sum(result.minutes for result in stale.values())
    for name, result in sorted(stale.items(), key=lambda pair: pair[1].minutes):
        print(f"{name}: {status(result)}; python -m {result.command} ({result.minutes} min)")
    print(f"{len(stale)} of {len(chosen)} results are older; {minutes / 60:.1f} h of one processor")
    if options.renew:
        for _, result in sorted(stale.items(), key=lambda pair: pair[1].minutes):
            subprocess.run(
                [sys.executable, "-m", *shlex.split(result.command)], cwd=ROOT, check=True
            )
    PAGE.write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
