"""Help: complete, written down, and quick."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys

import click
import pytest

from bayes_asv import __version__
from bayes_asv.cli import COMMANDS
from tests.cli.conftest import ROOT, Command
from tests.cli.help_pages import PAGE, page

HEAVY = ("numpy", "scipy", "pydantic", "pint", "matplotlib", "numba", "rich", "emcee", "jinja2")
QUICK = 0.3  # s of one core


def test_the_page_is_what_the_commands_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run: python -m tests.cli.help_pages"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_module_a_help_and_its_page(name: str, invoke: Command) -> None:
    command = importlib.import_module(f"bayes_asv.cli.{name}_command").command
    assert isinstance(command, click.Command)
    assert command.name == name
    assert command.help
    assert all(p.help for p in command.params if isinstance(p, click.Option)), name
    assert f"## bayes-asv {name}\n" in PAGE.read_text(encoding="utf-8")
    said = invoke(name, "--help")
    assert (said.status, said.err) == (0, "")
    assert said.out.startswith(f"Usage: bayes-asv {name}")
    assert invoke(name, "-h") == said


def test_no_command_is_left_out() -> None:
    folder = ROOT / "bayes_asv" / "cli"
    assert {p.stem.removesuffix("_command") for p in folder.glob("*_command.py")} == set(COMMANDS)


def test_the_newcomers_page_names_the_two_commands_and_real_ones() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for words in ("make demo", "make test", "pip install .", "bayes-asv estimate"):
        assert words in readme
    named = {
        line.split()[1]
        for line in readme.splitlines()
        if line.strip().startswith("bayes-asv ") and not line.split()[1].startswith("-")
    }
    assert named <= set(COMMANDS)
    for link in ("docs/recording.md", "docs/vehicle.md", "docs/method.md", "docs/commands.md"):
        assert link in readme
        assert (ROOT / link).exists()


def test_the_version(invoke: Command) -> None:
    assert invoke("--version").out.split()[-1] == __version__


def test_the_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\n"
        "sys.argv = ['bayes-asv', *sys.argv[1:]]\n"
        "from bayes_asv.cli import main\n"
        "try:\n"
        "    main()\n"
        "except SystemExit:\n"
        f"    print([m for m in {HEAVY!r} if m in sys.modules], file=sys.stderr)\n"
    )
    for words in (["--help"], *([name, "--help"] for name in COMMANDS)):
        done = subprocess.run(
            [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
        )
        assert done.stderr.strip() == "[]", words


@pytest.mark.parametrize("words", [(), *((name,) for name in COMMANDS)], ids=" ".join)
def test_the_help_takes_next_to_no_work(words: tuple[str, ...]) -> None:
    best = 1e9
    for _ in range(12):  # other tests run beside this one
        running = subprocess.Popen(
            [sys.executable, "-m", "bayes_asv", *words, "--help"],
            stdout=subprocess.DEVNULL,
            cwd=ROOT,
        )
        _, status, used = os.wait4(running.pid, 0)
        running.returncode = os.waitstatus_to_exitcode(status)
        assert running.returncode == 0
        best = min(best, used.ru_utime + used.ru_stime)
        if best < QUICK:
            break
    assert best < QUICK
