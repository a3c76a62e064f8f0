"""Whatever the bytes are: an answer or one line, never a traceback."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bayes_asv.estimation as job
from bayes_asv.domain.errors import InputError
from bayes_asv.report.schema import read_saved
from tests.cli.conftest import Command

ROOT = Path(__file__).parents[2]
RECORDING = (ROOT / "data" / "recordings" / "stops-400hz.csv").read_bytes()
COUNTS = (ROOT / "data" / "recordings" / "stops-800hz.csv").read_bytes()
VEHICLE = (ROOT / "data" / "vehicles" / "baja2008.toml").read_bytes()
LOGGER = b"# sample_rate = 400 Hz\n" + b"".join(
    b"%d %d 641 581 636\n" % (n, 570 + n % 7) for n in range(1, 200)
)
REFUSED = (ROOT / "tests" / "report" / "data" / "refused.json").read_bytes()
US = (ROOT / "tests" / "report" / "data" / "us.json").read_bytes()

fuzz = settings(
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

NASTY = (
    b"", b"\n", b"\0", b",", b";", b"\t", b'"', b"#", b"=", b"[", b"]", b"{", b"}", b"nan", b"inf",
    b"-", b"1e308", b"-1e12", b"1e-308", b"99999999999999999999", b"1_0", "٣".encode(), b"\xff",
    b"\xe2\x80\xae", b"\x1b[2J", b"\r", b"\x0c", b"0", b"%", b"lb", b"unit", b"sd = -1", b"true",
)  # fmt: skip


@st.composite
def mutated(draw: st.DrawFn, *originals: bytes) -> bytes:
    """Cut, double, overwrite or sprinkle a file that was right."""
    data = draw(st.sampled_from(originals))
    for _ in range(draw(st.integers(1, 4))):
        # Small places are likelier, and there the header stands.
        at = draw(st.one_of(st.integers(0, 400), st.integers(0, len(data))))
        end = min(len(data), at + draw(st.integers(0, 40)))
        kind = draw(st.sampled_from(("cut", "drop", "insert", "replace", "repeat", "swap")))
        piece = draw(st.one_of(st.sampled_from(NASTY), st.binary(max_size=8)))
        if kind == "cut":
            data = data[: max(at, 1)]
        elif kind == "drop":
            data = data[:at] + data[end:]
        elif kind == "insert":
            data = data[:at] + piece + data[at:]
        elif kind == "replace":
            data = data[:at] + piece + data[end:]
        elif kind == "repeat":
            data = data[:end] + data[at:]
        else:
            lines = data.split(b"\n")
            k = at % len(lines)
            lines[k - 1], lines[k] = lines[k], lines[k - 1]
            data = b"\n".join(lines)
    return data


class _Fitting(Exception):  # noqa: N818
    """The files were read, looked at and found good enough to be fitted."""


@pytest.fixture(autouse=True)
def _stop_before_the_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any) -> None:
        raise _Fitting

    monkeypatch.setattr(job, "best_fit", stop)


def _said(invoke: Command, *words: object) -> int:
    """Exit status of what keeps its promises; 0 where nothing is wrong and a fit would begin."""
    try:
        said = invoke(*words)
    except _Fitting:
        return 0
    assert said.status in (2, 3), said
    assert "Traceback" not in said.err
    if said.status == 2:
        assert said.out == ""
        assert len(said.err.splitlines()) == 1, said.err
        assert said.err.startswith("bayes-asv: ")
        assert len(said.err) < 1500
        assert all(ch.isprintable() for ch in said.err.rstrip("\n")), said.err
    else:
        assert said.err == ""
        assert "Why: " in said.out
    return said.status


@fuzz
@given(st.one_of(st.binary(max_size=300), mutated(RECORDING, COUNTS, LOGGER)))
def test_any_recording(invoke: Command, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file, car = Path(folder) / "run.csv", Path(folder) / "car.toml"
        file.write_bytes(data)
        car.write_bytes(VEHICLE)
        assert _said(invoke, "estimate", file, "-v", car) in (0, 2, 3)


@fuzz
@given(st.one_of(st.binary(max_size=300), mutated(VEHICLE)))
def test_any_vehicle(invoke: Command, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file, car = Path(folder) / "run.csv", Path(folder) / "car.toml"
        file.write_bytes(COUNTS)
        car.write_bytes(data)
        assert _said(invoke, "estimate", file, "-v", car) in (0, 2, 3)


@fuzz
@given(st.one_of(st.binary(max_size=300), mutated(REFUSED, US[:4000], US)))
def test_any_saved_document_is_refused_in_one_line_or_well_formed(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "estimate.json"
        file.write_bytes(data)
        try:
            document = read_saved(file)
        except InputError:
            return
        assert document.verdict in ("ok", "refused", "not_converged")
