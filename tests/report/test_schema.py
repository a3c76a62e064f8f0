"""The schema: documents of earlier versions, published JSON Schema, and mutated documents."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from bayes_asv.cli import cli
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.models.effects import EFFECTS
from bayes_asv.report.page import limits, report_page
from bayes_asv.report.render import write_report
from bayes_asv.report.schema import (
    DOCUMENTS,
    CompareDocument,
    DiagnoseDocument,
    EstimateDocument,
    ReportDocument,
    TrackDocument,
    read_saved,
)
from bayes_asv.report.schema.__main__ import json_schemas
from bayes_asv.report.schema.parts import ByName, Parameter
from bayes_asv.report.sections.compare import compare_headline, compare_lines
from bayes_asv.report.sections.diagnosis import (
    diagnosis_headline,
    diagnosis_lines,
    diagnosis_steps,
)
from bayes_asv.report.sections.verdict import track_lines, track_steps, verdict_lines
from tests.report.conftest import DATA, Data, data, sections_of, without_pictures

ROOT = Path(__file__).parents[2]
EARLIER = sorted(DATA.glob("commit_*/*.json"))
KEPT = [file for file in EARLIER if file.stem != "estimate_roll"]
ROLL = "bayes_asv/estimate_roll/1"  # is read and no longer written
REPORTED = (
    "bayes_asv/estimate/1", "bayes_asv/diagnose/1", "bayes_asv/track/1", "bayes_asv/compare/1",
)  # fmt: skip


@pytest.mark.parametrize("file", KEPT, ids=lambda file: file.stem)
def test_documents_of_earlier_versions_load_and_are_kept(file: Path) -> None:
    saved: Data = json.loads(file.read_text(encoding="utf-8"))
    document = DOCUMENTS[saved["schema"]].model_validate(saved)
    assert document.to_dict() == saved
    assert not _unknown(document), "keys without a field"
    if saved["schema"] in REPORTED:
        reported = read_saved(file)
        assert reported.to_dict() == saved
        with without_pictures():
            page, _ = report_page(reported)
        assert page["headline"]


def test_an_estimate_of_the_roll_car_of_an_earlier_version_becomes_one_of_any_car() -> None:
    file = DATA / "commit_3f70d75" / "estimate_roll.json"
    saved: Data = json.loads(file.read_text(encoding="utf-8"))
    read = read_saved(file)
    assert isinstance(read, EstimateDocument)
    assert (read.schema_name, read.car) == ("bayes_asv/estimate/1", "roll")
    assert [e.damping for e in read.elements.values()] == ["c_fl", "c_fr", "c_rl", "c_rr"]
    kept = read.to_dict()
    for key in ("parameters", "left_over_right", "fit_by_run", "vehicle", "seed"):
        assert kept[key] == saved[key]
    assert read.provenance.recordings[0].sha256 == saved["recordings"][0]["sha256"]
    with without_pictures():
        page, _ = report_page(read)
    assert page["headline"] == ["All four dampers agree with nominal."]
    titles = [section["title"] for section in sections_of(page)]
    assert titles[:2] == ["Parameters", "Left and right dampers"]
    assert "Fit of the simulation" in titles


def _unknown(value: Any) -> list[str]:
    """List the keys that no field of the schema takes."""
    if isinstance(value, BaseModel):
        names = list(type(value).model_fields)
        inside = [key for name in names for key in _unknown(getattr(value, name))]
        extra = value.model_extra or {}
        return [*inside, *(_unknown(extra) if isinstance(value, ByName) else extra)]
    if isinstance(value, dict):
        return [key for one in value.values() for key in _unknown(one)]
    if isinstance(value, list):
        return [key for one in value for key in _unknown(one)]
    return []


def test_every_schema_is_among_the_earlier_documents() -> None:
    names = {json.loads(file.read_text(encoding="utf-8"))["schema"] for file in EARLIER}
    assert names == {*DOCUMENTS, ROLL}


def test_the_published_json_schema_is_that_of_the_classes() -> None:
    published = {f.name: f.read_text(encoding="utf-8") for f in (ROOT / "docs/schema").iterdir()}
    assert published == json_schemas(), "run: python -m bayes_asv.report.schema"


def test_the_command_writes_the_json_schema(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "bayes_asv.report.schema", str(tmp_path / "schema")]
    subprocess.run(words, check=True, cwd=ROOT)
    names = {f"{name.split('/')[1]}-1.json" for name in DOCUMENTS}
    assert {file.name for file in (tmp_path / "schema").iterdir()} == names


def test_keys_of_later_versions_are_kept(tmp_path: Path) -> None:
    later = data("us")
    later["later"] = {"value": 1}
    later["parameters"]["c_f"]["later"] = [1, 2]
    file = tmp_path / "saved.json"
    file.write_text(json.dumps(later), encoding="utf-8")
    assert read_saved(file).to_dict() == later


def test_numbers_that_do_not_exist_are_null() -> None:
    p = Parameter(unit="", mean=1.0, sd=0.1, eti95=[0.8, 1.2], nominal=float("nan"))
    assert p.to_dict()["nominal"] is None
    with pytest.raises(ValueError, match="finite number"):
        Parameter(unit="", mean=float("inf"), sd=0.1, eti95=[0.8, 1.2])


@st.composite
def mutated(draw: st.DrawFn) -> Data:
    """A document with some of its values replaced."""
    document: Data = json.loads(draw(st.sampled_from(EARLIER)).read_text(encoding="utf-8"))
    for _ in range(draw(st.integers(1, 3))):
        part: Any = document
        while True:
            keys = sorted(part) if isinstance(part, dict) else list(range(len(part)))
            key = draw(st.sampled_from(keys))
            inside = part[key]
            if not isinstance(inside, dict | list) or not inside or draw(st.integers(0, 9)) == 0:
                break
            part = inside
        part[key] = draw(
            st.none() | st.booleans() | st.integers(-3, 10**13) | st.text(max_size=5)
            | st.floats(allow_nan=False, allow_infinity=False)
            | st.sampled_from(([], {}, [0.0, 1.0], "\x1b[31m", -1.0, 0.0, 1e15))
        )  # fmt: skip
    return document


def _read(document: Data) -> ReportDocument | None:
    """Read a document back; None where it is refused, which takes one line."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "saved.json"
        file.write_text(json.dumps(document), encoding="utf-8")
        try:
            return read_saved(file)
        except InputError as refusal:
            _check_one_line(refusal)
            return None


slow = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


@settings(max_examples=300, deadline=None, suppress_health_check=slow)
@given(mutated())
def test_a_mutated_document_is_refused_in_one_line_or_has_sentences(document: Data) -> None:
    saved = _read(document)
    if isinstance(saved, EstimateDocument):
        lines = [*verdict_lines(saved), *limits(saved)]
    elif isinstance(saved, DiagnoseDocument):
        lines = [*diagnosis_lines(saved), diagnosis_headline(saved), *diagnosis_steps(saved)]
    elif isinstance(saved, TrackDocument):
        lines = [*track_lines(saved), *track_steps(saved)]
    elif isinstance(saved, CompareDocument):
        lines = [*compare_lines(saved), compare_headline(saved)]
    else:
        return
    assert all(line.isprintable() for line in lines)


@settings(max_examples=4, deadline=None, suppress_health_check=slow)
@given(mutated())
def test_a_mutated_document_is_drawn_or_refused_in_one_line(document: Data) -> None:
    saved = _read(document)
    assume(saved is not None)
    assert saved is not None
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            write_report(saved, Path(folder) / "x.html")
        except InputError as refusal:
            _check_one_line(refusal)


def _check_one_line(refusal: InputError) -> None:
    assert str(refusal).isprintable()


def test_the_page_of_interfaces_names_what_there_is() -> None:
    text = (ROOT / "docs" / "interfaces.md").read_text(encoding="utf-8")
    quoted = [f"`{name}`" for name in (*QUANTITIES, *CHANNELS, *EFFECTS)]
    commands = [f"`bayes-asv {command}" for command in cli.commands]
    schemas = [f"(schema/{name.split('/')[1]}-1.json)" for name in DOCUMENTS]
    assert [name for name in (*quoted, *commands, *schemas) if name not in text] == []
    examples = [json.loads(x) for x in re.findall(r"```json\n(.*?)```", text, re.DOTALL)]
    for example, kind in zip(examples, ("estimate", "diagnose"), strict=True):
        document = DOCUMENTS[example["schema"]]
        assert example["schema"] == f"bayes_asv/{kind}/1"
        assert set(example) - {"schema"} <= set(document.model_fields)
