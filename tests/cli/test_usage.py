"""Wrong usage: status 2 and one line that names the fault and the fix."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayes_asv.cli import COMMANDS
from tests.cli.conftest import Check, Command


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("estimat",), ("no command 'estimat'", "did you mean 'estimate'?")),
        (("Demo",), ("did you mean 'demo'?",)),
        (("zzz",), ("no command 'zzz'", "there are", *COMMANDS)),
        (("",), ("no command ''",)),
        (("--verbose",), ("--verbose", "bayes-asv --help")),
        (("estimate",), ("REC", "bayes-asv estimate --help")),
        (("estimate", "{rec}"), ("--vehicle", "bayes-asv estimate --help")),
        (("estimate", "-v", "{car}"), ("REC", "bayes-asv estimate --help")),
        (("estimate", "{rec}", "-v", "{car}", "--sed", "1"), ("--sed", "--seed")),
        (("estimate", "{rec}", "-v", "{car}", "--seed", "-1"), ("--seed", "-1")),
        (("estimate", "{rec}", "-v", "{car}", "--seed", "x"), ("--seed", "'x'")),
        (("estimate", "{rec}", "-v", "{car}", "--seed", "4294967296"), ("--seed",)),
        (("estimate", "{rec}", "-v", "{car}", "--seed"), ("--seed",)),
        (("estimate", "{rec}", "-v", "{car}", "--likelihood", "white"), ("output-error",)),
        (("estimate", "{rec}", "-v", "{car}", "--rate", "fast"), ("--rate", "'fast'")),
        (("estimate", "{rec}", "-v", "{car}", "--rate", "0"), ("rate", "400 Hz")),
        (("estimate", "{rec}", "-v", "{car}", "--rate", "nan"), ("rate", "400 Hz")),
        (("estimate", "{rec}", "-v", "{car}", "--rate=-400"), ("rate", "400 Hz")),
        (("estimate", "{rec}", "{rec}", "-v", "{car}"), ("give each recording once",)),
        (("estimate", "{rec}", "-v", "{rec}"), ("stops", "is not TOML")),
        (("estimate", "{car}", "-v", "{car}"), ("baja2008.toml:", "not the header of a recording")),
        (("report", "{rec}", "-v", "{car}"), ("-o", "bayes-asv report --help")),
        (("report", "-o", "{tmp}/x.html"), ("--vehicle", "--from")),
        (("report", "{rec}", "-o", "{tmp}/x.html"), ("--vehicle",)),
        (("report", "{rec}", "-v", "{car}", "-o", "{tmp}/x.doc"), ("x.doc", ".html or .pdf")),
        (("report", "{rec}", "-v", "{car}", "-o", "{tmp}/x"), (".html or .pdf",)),
        (("report", "{rec}", "--from", "{car}", "-o", "{tmp}/x.html"), ("need --vehicle",)),
        (("report", *4 * ("--from", "a"), "-o", "{tmp}/x.html"), ("--from once",)),
        (("report", "--from", "a", "-v", "{car}", "-o", "{tmp}/x.html"), ("needs recordings",)),
        (("simulate", "-v", "{car}"), ("-o",)),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--road", "moon"), ("moon", "rough")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--speed", "8"), ("--speed", "8 mph")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--speed", "8 kg"), ("--speed", "kg")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--speed", "fast"), ("--speed", "fast")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--speed", "900 m/s"), ("--speed", "60")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--rate", "nan"), ("--rate",)),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--rate", "1"), ("--rate",)),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--seconds", "inf"), ("--seconds",)),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--set", "c_r"), ("--set c_r", "=0.8")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--set", "k=2"), ("k=2", "k_f")),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--set", "c_r=0"), ("0.01 and 100",)),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--set", "c_r=nan"), ("0.01 and 100",)),
        (("simulate", "-v", "{car}", "-o", "{tmp}/x.csv", "--set", "wdf=3"), ("wdf",)),
        (("demo", "-o", "{car}"), ("baja2008.toml", "name another folder")),
        (("demo", "extra"), ("extra",)),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, tuple) else None,
)
def test_wrong_usage(
    invoke: Command,
    refuse: Check,
    stops: Path,
    baja: Path,
    tmp_path: Path,
    words: tuple[str, ...],
    expected: tuple[str, ...],
) -> None:
    filled = [w.format(rec=stops, car=baja, tmp=tmp_path) for w in words]
    assert refuse(invoke(*filled), *expected)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("no/such/file{s}", "make the folder first"),
        ("folder{s}", "is a folder"),
        ("plain/file{s}", "make the folder first"),
        ("{long}{s}", "cannot be written"),
    ],
)
@pytest.mark.parametrize("option", ["--json", "--netcdf", "report", "simulate"])
def test_an_output_that_cannot_be_written_is_told_before_the_work(
    invoke: Command,
    refuse: Check,
    stops: Path,
    baja: Path,
    tmp_path: Path,
    output: str,
    expected: str,
    option: str,
) -> None:
    suffix = ".html" if option == "report" else ""
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / "plain").write_text("a file, not a folder", encoding="utf-8")
    target = tmp_path / output.format(s=suffix, long="x" * 300)
    words = {
        "report": ("report", stops, "-v", baja, "-o", target),
        "simulate": ("simulate", "-v", baja, "-o", target),
    }.get(option, ("estimate", stops, "-v", baja, option, target))
    assert refuse(invoke(*words), expected)


def test_an_output_never_replaces_an_input(
    invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path
) -> None:
    own = tmp_path / "run.csv"
    own.write_bytes(stops.read_bytes())
    car = tmp_path / "car.toml"
    car.write_bytes(baja.read_bytes())
    link = tmp_path / "link.csv"
    link.symlink_to(own)
    before = own.read_bytes(), car.read_bytes()
    assert refuse(invoke("estimate", own, "-v", car, "--json", own), "is read by this command")
    assert refuse(invoke("estimate", own, "-v", car, "--netcdf", link), "is read by this command")
    assert refuse(invoke("simulate", "-v", car, "-o", car), "is read by this command")
    both = tmp_path / "both"
    assert refuse(
        invoke("estimate", own, "-v", car, "--json", both, "--netcdf", both),
        "is written twice by this command",
    )
    assert before == (own.read_bytes(), car.read_bytes())


def test_nothing_asked_for_shows_the_help(invoke: Command) -> None:
    said = invoke()
    assert said.status == 2
    assert "Usage: bayes-asv" in said.err
    assert said.out == ""
