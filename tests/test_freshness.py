"""The page of evidence says by itself which results are older than the code."""

import gzip
import json
import subprocess
from pathlib import Path

import pytest

from benchmarks import freshness
from benchmarks.freshness import RESULTS, Result, commits, page, passages, sources, status

ROOT = Path(__file__).parents[1]
# A shallow clone, or a copy of the files alone, cannot tell what has changed since.
HISTORY = all(
    freshness._git("cat-file", "-e", f"{commit}^{{commit}}").returncode == 0
    for name in ("accuracy", "speed beside peers", "wrong inputs")
    for commit in commits(RESULTS[name])
)

needs_history = pytest.mark.skipif(not HISTORY, reason="the history of the repository is not here")


def test_every_result_is_on_the_page() -> None:
    published = {path.name for path in (ROOT / "benchmarks" / "results").iterdir()}
    assert {result.path for result in RESULTS.values()} == published
    for template in freshness.PAGES.values():
        text = template.read_text("utf-8")
        for name in RESULTS:
            assert text.count(f"{{{name}}}") == 1


@needs_history
@pytest.mark.parametrize("where", freshness.PAGES, ids=lambda path: path.name)
def test_the_pages_are_those_of_the_results_and_the_code(where: Path) -> None:
    found = page(freshness.PAGES[where])
    assert where.read_text("utf-8") == found, "run python -m benchmarks.freshness"


@needs_history
@pytest.mark.parametrize("where", sorted((ROOT / "docs").glob("*.md")), ids=lambda path: path.name)
def test_passages_are_those_of_the_results(where: Path) -> None:
    text = where.read_text("utf-8")
    assert text == passages(text), "run python -m benchmarks.freshness"
    assert text.count("<!-- figures of ") == len(freshness.PASSAGE.findall(text))


def test_a_passage_is_written_anew_from_its_comment() -> None:
    template = "<!-- figures of law forms\nIn {runs} laws ({status}).\n-->\n"
    runs = json.loads((ROOT / "benchmarks" / "results" / "law_forms.json").read_text())["runs"]
    said = status(RESULTS["law forms"])
    new = f"Before.\n\n{template}In {runs} laws ({said}).\n<!-- end figures -->\nAfter.\n"
    old = f"Before.\n\n{template}In 0 laws.\n<!-- end figures -->\nAfter.\n"
    assert passages(old) == passages(new) == new


def test_figures_of_a_page_come_from_the_results(tmp_path: Path) -> None:
    template = tmp_path / "page.md.in"
    template.write_text(
        "{accuracy[summary][runs]} of {battery.count}: {real cars[summary][0.5][c_f][share]:.0%}"
    )
    folder = ROOT / "benchmarks" / "results"
    runs = json.loads((folder / "accuracy.json").read_text())["summary"]["runs"]
    share = json.loads((folder / "real_cars.json").read_text())["summary"]["0.5"]["c_f"]["share"]
    packed = (folder / "battery" / "test" / "runs.jsonl.gz").read_bytes()
    cases = len(gzip.decompress(packed).splitlines())
    assert page(template) == f"{runs} of {cases}: {100.0 * share:.0f} %"


def test_what_a_benchmark_depends_on_is_found() -> None:
    found = sources("benchmarks.accuracy")  # which runs the command
    assert {"bayes_asv/cli/estimate_command.py", "bayes_asv/filters/kalman.py"} <= found
    assert "tests/rig/terrain.py" in found
    found = sources("benchmarks.blind")
    assert "benchmarks/blind/cases.py" in found
    assert "benchmarks/blind/page.py" not in found  # it only shows what was found
    assert "bayes_asv/filters/kalman.py" in sources("benchmarks.compare")
    assert not any(
        path.startswith("bayes_asv/live") for path in sources("benchmarks.resampled_exports")
    )


@needs_history
def test_a_result_is_older_once_a_file_behind_it_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = freshness._git("rev-parse", "HEAD").stdout.strip()
    path = tmp_path / "one.json"
    path.write_text(json.dumps({"parts": [{"commit": head}]}))
    result = Result(str(path), 1, ("benchmarks.provenance",))
    changed = freshness._git("status", "--porcelain", "benchmarks", "bayes_asv", "tests").stdout
    if not changed:
        assert status(result) == f"commit {head}, of the present code"
    monkeypatch.setattr(freshness, "sources", lambda module: ["CHANGELOG.md"])
    last = freshness._git("log", "-1", "--format=%H", "--", "CHANGELOG.md").stdout.strip()
    path.write_text(json.dumps({"commit": f"{last}~1"}))
    assert status(result).endswith("older than the code")
    path.write_text(json.dumps({"commit": "0123abc"}))
    assert status(result).endswith("not all are in the history of this branch")
    path.write_text("{}")
    assert status(result) == "commit unknown"


def test_comments_and_docstrings_are_no_code() -> None:
    old = 'def f(x):\n    """Twice."""\n    return 2 * x  # here\n'
    same = 'def f(\n    x,\n):\n    """Twice\n\n    x."""\n    return 2 * x\n'
    assert freshness._statements(old) == freshness._statements(same)
    assert freshness._statements(old) != freshness._statements(old.replace("2 *", "3 *"))
    assert freshness._statements("x = 'a'") != freshness._statements("x = 'b'")


def test_a_renewal_that_is_stopped_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Results of older code go first; what a stopped benchmark has done stays."""
    old = tmp_path / "one.json"
    old.write_text(json.dumps({"commit": "0123abc"}))
    result = Result(str(old), 1, ("benchmarks.provenance --of {data}",))
    monkeypatch.setattr(freshness, "RESULTS", {"one": result})
    monkeypatch.setattr(freshness, "UNFINISHED", tmp_path / "unfinished.txt")
    monkeypatch.setattr(freshness, "PAGES", {})
    monkeypatch.setattr(freshness, "passages", str)
    monkeypatch.setattr("sys.argv", ["freshness", "--renew", "--data", "/elsewhere"])
    seen: list[tuple[list[str], bool]] = []

    def stopped(words: list[str], **_: object) -> None:
        seen.append((words[2:], old.exists()))
        old.write_text(json.dumps({"commit": head}))
        raise KeyboardInterrupt

    head = freshness._git("rev-parse", "HEAD").stdout.strip()
    run = subprocess.run
    monkeypatch.setattr(
        subprocess, "run", lambda *a, **k: (run if a[0][0] == "git" else stopped)(*a, **k)
    )
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            freshness.main()
    words = ["benchmarks.provenance", "--of", "/elsewhere"]
    assert seen == [(words, False), (words, True)]
    assert (tmp_path / "unfinished.txt").read_text() == "one"


def test_the_commands_that_renew_are_commands() -> None:
    for result in RESULTS.values():
        for module in result.modules:
            assert sources(module), module
