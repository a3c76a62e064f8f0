"""``report --from``: a saved document is checked before it is told."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.report.schema import read_saved
from tests.cli.conftest import Check, Command, Said, Saved

Document = dict[str, Any]

GARBAGE: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "empty": (b"", ("is empty",)),
    "text": (b"hello", (":1", "is not JSON")),
    "HTML": (b"<html></html>", ("is not JSON",)),
    "binary": (b"\x00\x01", ("is not a text file",)),
    "list": (b"[1, 2]", ("is no estimate",)),
    "number": (b"1", ("is no estimate",)),
    "null": (b"null", ("is no estimate",)),
    "no schema": (b"{}", ("is no estimate",)),
    "another schema": (b'{"schema": "bayes_asv/simulate/1"}', ("bayes_asv/simulate/1",)),
    "a later schema": (b'{"schema": "bayes_asv/estimate/2"}', ("bayes_asv/estimate/2",)),
    "schema as a list": (b'{"schema": [1]}', ("is of schema",)),
    "deep": (b"[" * 100_000, ("is not JSON",)),
    "digits": (b'{"schema": ' + b"9" * 5000 + b"}", ("is not JSON",)),
    "NaN": (b'{"schema": NaN}', ("is not JSON",)),
    "only the schema": (b'{"schema": "bayes_asv/estimate/1"}', ("verdict", "field required")),
}


@pytest.mark.parametrize("kind", GARBAGE)
def test_garbage(invoke: Command, refuse: Check, tmp_path: Path, kind: str) -> None:
    data, expected = GARBAGE[kind]
    file = tmp_path / "saved.json"
    file.write_bytes(data)
    said = invoke("report", "--from", file, "-o", tmp_path / "x.html")
    assert refuse(
        said, "saved.json", "bayes-asv estimate --json" if data[:1] not in b"\0" else "", *expected
    )
    assert not (tmp_path / "x.html").exists()


def _set(*path: str | int, to: Any) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        inside: Any = document
        for key in path[:-1]:
            inside = inside[key]
        if to is KeyError:
            del inside[path[-1]]
        else:
            inside[path[-1]] = to

    return change


HOSTILE: dict[str, tuple[Callable[[Document], None], str]] = {
    "unknown verdict": (_set("verdict", to="great"), "verdict"),
    "verdict as a list": (_set("verdict", to=["ok"]), "verdict"),
    "parameters as a list": (_set("parameters", to=[]), "parameters"),
    "no parameters": (_set("parameters", to={}), "no parameter c_f"),
    "no front damper": (_set("parameters", "c_f", to=KeyError), "no parameter c_f"),
    "unknown parameter": (_set("parameters", "q", to={}), "parameters.q"),
    "mean as a text": (_set("parameters", "c_f", "mean", to="7.2"), "parameters.c_f.mean"),
    "mean missing": (_set("parameters", "c_f", "mean", to=None), "parameters.c_f.mean"),
    "mean as a truth": (_set("parameters", "c_f", "mean", to=True), "parameters.c_f.mean"),
    "mean beyond everything": (_set("parameters", "c_f", "mean", to=1e300), "parameters.c_f.mean"),
    "negative sd": (_set("parameters", "c_f", "sd", to=-1.0), "parameters.c_f.sd"),
    "three ends": (_set("parameters", "c_f", "eti95", to=[1.0, 2.0, 3.0]), "c_f.eti95"),
    "ends swapped": (_set("parameters", "c_f", "eti95", to=[2.0, 1.0]), "parameters.c_f"),
    "probability of 2": (_set("parameters", "c_f", "p_below_nominal", to=2.0), "p_below_nominal"),
    "unit as a number": (_set("parameters", "c_f", "unit", to=3), "parameters.c_f.unit"),
    "endless unit": (_set("parameters", "c_f", "unit", to="m" * 10**6), "parameters.c_f.unit"),
    "reasons as a text": (_set("reasons", to="none"), "reasons"),
    "refused without a reason": (_set("verdict", to="refused"), "without a reason"),
    "runs as a number": (_set("runs", to=3), "runs"),
    "curve too short": (_set("runs", 0, "time", to=[0.0, 1.0]), "runs.0"),
    "curve of texts": (_set("runs", 0, "time", 3, to="x"), "runs.0.time.3"),
    "half a band": (
        _set("runs", 0, "chassis", "front_chassis", "band95", to=[[1.0]]),
        "runs.0.chassis.front_chassis.band95",
    ),
    "chassis of a lorry": (_set("runs", 0, "chassis", "middle", to={}), "runs.0.chassis.middle"),
    "draws that differ": (_set("draws", "c_f", to=[1.0]), "differ in length"),
    "prior without width": (_set("prior", "c_f", "log_sd", to=0.0), "prior.c_f.log_sd"),
    "prior below zero": (_set("prior", "c_f", "median", to=-1.0), "prior.c_f.median"),
    "seed of a text": (_set("seed", to="0"), "seed"),
    "units of nowhere": (_set("vehicle", "units", to="XX"), "vehicle.units"),
    "no diagnostics": (_set("diagnostics", to=KeyError), "diagnostics"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_document(
    invoke: Command, refuse: Check, saved: Saved, tmp_path: Path, kind: str
) -> None:
    change, expected = HOSTILE[kind]
    document = copy.deepcopy(saved.document)
    change(document)
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    said = invoke("report", "--from", file, "-o", tmp_path / "x.pdf")
    assert refuse(said, "saved.json", expected, "bayes-asv estimate --json")
    assert not (tmp_path / "x.pdf").exists()


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.9999])
def test_a_truncated_document(
    invoke: Command, refuse: Check, saved: Saved, tmp_path: Path, share: float
) -> None:
    data = saved.json_file.read_bytes()
    file = tmp_path / "saved.json"
    file.write_bytes(data[: max(1, int(share * len(data)))])
    assert refuse(
        invoke("report", "--from", file, "-o", tmp_path / "x.html"), "saved.json", "cut off"
    )


def test_what_was_saved_is_read_back_as_it_was(saved: Saved) -> None:
    assert read_saved(saved.json_file).to_dict() == saved.document


@pytest.mark.parametrize("kind", ["us", "si", "two_runs", "refused"])
def test_sample_documents_are_sound(kind: str) -> None:
    folder = Path(__file__).parents[1] / "report" / "data"
    assert read_saved(folder / f"{kind}.json").schema_name == "bayes_asv/estimate/1"


@pytest.mark.parametrize("suffix", ["HTM", "pdf"])
def test_a_report_of_a_saved_estimate(
    invoke: Command, saved: Saved, tmp_path: Path, suffix: str
) -> None:
    output = tmp_path / f"x.{suffix}"
    said: Said = invoke("report", "--from", saved.json_file, "-o", output)
    assert said.status == 0
    assert said.err == ""
    assert said.out.splitlines()[-1] == str(output)
    data = output.read_bytes()
    assert data.startswith(b"%PDF" if suffix == "pdf" else b"<!DOCTYPE html>")


def test_a_text_with_markup_stays_text(invoke: Command, saved: Saved, tmp_path: Path) -> None:
    document = copy.deepcopy(saved.document)
    evil = '<script>alert(1)</script> #panic("x") \u202e\x1b[31m'
    document["vehicle"]["name"] = evil
    document["warnings"] = [evil]
    document["runs"][0]["source"] = evil
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    for name in ("x.html", "x.pdf"):
        said: Said = invoke("report", "--from", file, "-o", tmp_path / name)
        assert said.status == 0, said.err
        assert "\x1b" not in said.out
    assert "<script" not in (tmp_path / "x.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("curve", ["median", "band95"])
def test_a_track_without_values_is_refused(
    invoke: Command, refuse: Check, stops: Path, baja: Path, tmp_path: Path, curve: str
) -> None:
    file = tmp_path / "track.json"
    assert invoke("track", stops, "-v", baja, "--json", file).status == 0
    document = json.loads(file.read_text(encoding="utf-8"))
    nothing = [None] * len(document["track"]["time"])
    document["track"]["parameters"]["c_f"][curve] = nothing if curve == "median" else [nothing] * 2
    file.write_text(json.dumps(document), encoding="utf-8")
    said = invoke("report", "--from", file, "-o", tmp_path / "x.html")
    assert refuse(said, "track.json: track", "a curve has no values")
