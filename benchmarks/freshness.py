"""Which published results belong to the present code, and one command that renews the others.

A result names the commit that it was computed with.  It is of the present code if no statement of
the files that its benchmark imports, directly or not, has changed since; comments, docstrings and
the layout of lines compute nothing.  ``python -m benchmarks.freshness``
writes two pages from the results, ``docs/evidence.md``, which says so for each, and
``benchmarks/README.md``, and the passages of other pages that begin with a comment
``figures of NAME``; with ``--renew`` it first runs the benchmarks whose results are older, one
after the other, shortest first.  All that take long resume where they
were stopped, and so does this: ``benchmarks/unfinished.txt`` names what was begun.
"""

from __future__ import annotations

import argparse
import ast
import gzip
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from bayes_asv.domain.files import write_atomically

__all__ = [
    "PAGES",
    "RESULTS",
    "Result",
    "commits",
    "page",
    "passages",
    "renew",
    "sources",
    "status",
]

ROOT = Path(__file__).parents[1]
PAGES = {
    ROOT / "docs" / "evidence.md": Path(__file__).parent / "evidence_page.md.in",
    ROOT / "benchmarks" / "README.md": Path(__file__).parent / "table.md.in",
}
"""Pages that are written from the results, and their templates."""
PASSAGE = re.compile(
    r"(?P<head><!-- figures of (?P<name>[^\n]+)\n(?P<template>.+?)-->\n)"
    r".*?(?P<end><!-- end figures -->)",
    re.DOTALL,
)
"""A passage of a page: a comment with its template, and what was written from it."""
UNFINISHED = Path(__file__).parent / "unfinished.txt"
DATA = ROOT.parent / "shared" / "data"


class Result(NamedTuple):
    """A published result.

    Parameters
    ----------
    path : str
        Below ``benchmarks/results``.
    minutes : int
        Of one processor.
    commands : tuple of str
        That compute it and write its page, behind ``python -m`` unless they begin with ``make``;
        ``{data}`` is the folder of recordings that the project does not ship, ``{scratch}`` one
        that is removed.
    """

    path: str
    minutes: int
    commands: tuple[str, ...]

    @property
    def where(self) -> Path:
        """The file or folder that holds it."""
        return ROOT / "benchmarks" / "results" / self.path

    @property
    def files(self) -> list[Path]:
        """The files that have it."""
        return [self.where] if self.where.is_file() else sorted(self.where.rglob("*.jsonl.gz"))

    @property
    def modules(self) -> list[str]:
        """Modules that its commands run."""
        return [words.split()[0] for words in self.commands if not words.startswith("make ")]


RESULTS = {
    "accuracy": Result("accuracy.json", 5, ("benchmarks.accuracy --seed 21",)),
    "agreement": Result("agreement.json", 15, ("benchmarks.agreement --cars 40",)),
    "attack": Result("attack.json", 90, ("benchmarks.attack --inputs 300000 --minutes 60",)),
    "battery": Result(
        "battery",
        300,
        ("benchmarks.battery --seed 102", "benchmarks.battery --seed 102 --report"),
    ),
    "blind": Result("blind", 280, ("benchmarks.blind", "benchmarks.blind --report")),
    "broken channels": Result(
        "broken_channels.json", 40, ("benchmarks.broken_channels --quick --cases 200",)
    ),
    "calibration": Result(
        "calibration", 60, ("benchmarks.calibration", "benchmarks.calibration --report")
    ),
    "change points": Result("change_points.json", 5, ("benchmarks.change_points",)),
    "clocks": Result("clocks.json", 30, ("benchmarks.clocks",)),
    "compare": Result("compare.json", 30, ("benchmarks.compare",)),
    "fleet": Result("fleet.json", 15, ("benchmarks.fleet",)),
    "growth": Result("growth.json", 15, ("benchmarks.growth",)),
    "law forms": Result("law_forms.json", 1, ("benchmarks.law_forms",)),
    "live": Result("live.json", 5, ("benchmarks.live",)),
    "logger": Result("logger.json", 10, ("benchmarks.logger --seed 41 --transfers 100",)),
    "long logs": Result("long_logs.json", 5, ("benchmarks.long_logs",)),
    "online": Result("online.json", 60, ("benchmarks.online",)),
    "other sensors": Result("other_sensors.json", 20, ("benchmarks.other_sensors --runs 100",)),
    "plan": Result("plan.json", 20, ("benchmarks.plan --each 1",)),
    "predicted biases": Result("predicted_biases.json", 10, ("benchmarks.predicted_biases",)),
    "real cars": Result(
        "real_cars.json", 60, ("benchmarks.real_cars --size 0.25 --size 0.5 --size 1 --seed 8000",)
    ),
    "real dampers": Result("real_dampers.json", 180, ("benchmarks.real_dampers {data}/dyno",)),
    "resampled exports": Result("resampled_exports.json", 40, ("benchmarks.resampled_exports",)),
    "roll car": Result("rolling.json", 60, ("benchmarks.rolling", "benchmarks.rolling worn 4")),
    "roomster": Result("roomster.json", 60, ("benchmarks.roomster {data}/roomster",)),
    "scatter": Result("scatter.json", 30, ("benchmarks.scatter",)),
    "speed beside peers": Result(
        "peers.json",
        15,
        (
            "make .venv/peers/.installed",
            "benchmarks.peers --python .venv/peers/bin/python",
        ),
    ),
    "wrong inputs": Result(
        "mistaken_inputs.json",
        60,
        (
            "benchmarks.mistaken_inputs.cases {scratch}/cases --seed 26",
            "benchmarks.mistaken_inputs.score {scratch}/cases"
            " --out benchmarks/results/mistaken_inputs.json",
        ),
    ),
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
    names it, as the words of a command do, all commands.  Modules of benchmarks that are
    named ``page`` write what a result looks like and compute nothing of it; they do not count.
    """
    found: set[str] = set()
    left = [module]
    while left:
        path = _path_of(left.pop())
        if path is None or re.fullmatch(r"benchmarks/(\w+/)?(\w+_)?page\.py", path):
            continue
        if path not in found:
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
    files = sorted(frozenset[str]().union(*(sources(module) for module in result.modules)))
    changed = [_statements_changed(commit, files) for commit in named]
    return f"{text}, {'older than the code' if any(changed) else 'of the present code'}"


def _statements_changed(commit: str, files: list[str]) -> bool:
    """Whether files of the tree differ from those of a commit in more than comments."""
    names = _git("diff", "--name-only", commit, "--", *files).stdout.splitlines()
    return any(
        not name.endswith(".py")
        or _statements(_git("show", f"{commit}:{name}").stdout)
        != _statements((ROOT / name).read_text("utf-8"))
        for name in names
    )


def _statements(code: str) -> str:
    """Return a module without comments, docstrings and layout."""
    tree = ast.parse(code)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [
                one
                for one in node.body
                if not (
                    isinstance(one, ast.Expr)
                    and isinstance(one.value, ast.Constant)
                    and isinstance(one.value.value, str)
                )
            ]
    return ast.dump(tree)


class Published:
    """A result within a template.

    ``{name}`` is its status, ``{name[a][b]}`` what its document has there, ``{name.how}`` the
    commands and the time that they take, ``{name.location}`` where it is, and ``{name.count}`` the
    number of its runs, where a result is a folder.
    """

    def __init__(self, result: Result) -> None:
        self._result = result

    def __str__(self) -> str:
        return status(self._result)

    def __getitem__(self, key: str) -> Any:
        return self.document[key]

    @cached_property
    def document(self) -> dict[str, Any]:
        """What its file has."""
        document: dict[str, Any] = json.loads(self._result.where.read_text("utf-8"))
        return document

    @property
    def how(self) -> str:
        """Commands and minutes."""
        words = [
            f"`{'' if words.startswith('make ') else 'python -m '}{words}`"
            for words in self._result.commands
        ]
        minutes = self._result.minutes
        span = f"{minutes} minute{'s' * (minutes > 1)} of one processor"
        return f"{', then '.join(words)} ({span})".format(data="DATA", scratch="DIR")

    @property
    def location(self) -> str:
        """Path beside the table of results."""
        return f"`results/{self._result.path}`"

    @property
    def count(self) -> int:
        """Cases in a folder of results, a line each of the file of its runs."""
        runs = (path for path in self._result.files if path.name.startswith("runs"))
        return sum(len(gzip.decompress(path.read_bytes()).splitlines()) for path in runs)


def page(template: Path) -> str:
    """Return a page of all results, from its template and what the results say."""
    names = {name: Published(result) for name, result in RESULTS.items()}
    return _filled(template.read_text("utf-8"), names)


def passages(text: str) -> str:
    """Return the text of a page with its passages written anew.

    In the template of a passage ``{status}`` is that of its result, ``{a[b]}`` what its document
    has there.
    """

    def written(found: re.Match[str]) -> str:
        result = Published(RESULTS[found["name"]])
        filled = _filled(found["template"], {"status": result, **result.document})
        return f"{found['head']}{filled}{found['end']}"

    return PASSAGE.sub(written, text)


def _filled(template: str, names: Mapping[str, Any]) -> str:
    # A space belongs between a number and a per cent sign, and Python sets none.
    return re.sub(r"(?<=\d)%", " %", template.format_map(names))


def renew(result: Result, data: Path) -> None:
    """Run the commands of a result, one after the other."""
    with tempfile.TemporaryDirectory() as scratch:
        for words in result.commands:
            filled = shlex.split(words.format(data=data, scratch=scratch))
            start = filled if filled[0] == "make" else [sys.executable, "-m", *filled]
            subprocess.run(start, cwd=ROOT, check=True)


def _unfinished() -> list[str]:
    """Names of results whose renewal was begun and did not end."""
    return UNFINISHED.read_text("utf-8").split("\n") if UNFINISHED.exists() else []


def _set_unfinished(names: list[str]) -> None:
    if names:
        UNFINISHED.write_text("\n".join(names), "utf-8")
    else:
        UNFINISHED.unlink(missing_ok=True)


def main() -> None:
    """Renew older results, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--renew", action="store_true", help="run the benchmarks of older results")
    parser.add_argument("--only", action="append", choices=RESULTS, help="one of the results")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of other recordings")
    options = parser.parse_args()
    begun = _unfinished()
    older = {
        name: result
        for name, result in RESULTS.items()
        if name in (options.only or RESULTS)
        and (name in begun or not status(result).endswith("of the present code"))
    }
    by_time = sorted(older, key=lambda name: (name not in begun, RESULTS[name].minutes))
    for name in by_time:
        result = older[name]
        print(f"{name}: {status(result)}; {'; '.join(result.commands)} ({result.minutes} min)")
    hours = sum(result.minutes for result in older.values()) / 60.0
    print(f"{len(older)} of {len(RESULTS)} results are older; {hours:.1f} h of one processor")
    for name in by_time if options.renew else []:
        result = older[name]
        if name not in begun:  # a benchmark resumes; what older code left does not belong to it
            shutil.rmtree(result.where, ignore_errors=True)
            result.where.unlink(missing_ok=True)
            _set_unfinished([*_unfinished(), name])
        renew(result, options.data)
        _set_unfinished([other for other in _unfinished() if other != name])
    written = {where: page(template) for where, template in PAGES.items()}
    for where in sorted((ROOT / "docs").glob("*.md")):
        written.setdefault(where, passages(where.read_text("utf-8")))
    for where, text in written.items():
        write_atomically(str(where), text.encode("utf-8"))


if __name__ == "__main__":
    main()
