"""The main job from the shell: what it prints, what it writes, and that it stays the same."""

from __future__ import annotations

import json
import math
import os
import pty
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayes_asv import __version__
from bayes_asv.library.progress import part_of
from tests.cli.conftest import ROOT, Command, Saved

UNITS = {"c_f": "lbf*s/in", "c_r": "lbf*s/in", "i": "lbf*s^2*in", "k_g": "in"}
NOMINAL = {"c_f": 7.2, "c_r": 10.0, "i": 626.0}


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        for inside in value.values():
            yield from _numbers(inside)
    elif isinstance(value, list):
        for inside in value:
            yield from _numbers(inside)
    elif isinstance(value, float):
        yield value


def test_it_says_the_verdict_and_nothing_else(saved: Saved) -> None:
    assert saved.said.status == 0
    assert saved.said.err == ""
    first, head, *others = saved.said.sentences
    assert first.startswith("Front damper: 2")
    assert "softer than nominal" in first
    assert head.split("  ")[0] == "parameter"
    labels = ("Front damping ", "Rear damping ", "Pitch inertia ", "Radius of gyration ")
    assert all(line.startswith(label) for line, label in zip(others, labels, strict=False))
    assert all(line.startswith(("The ", "Note: ", "Next: ")) for line in others[len(labels) :])
    assert max(map(len, saved.said.out.splitlines())) <= 80
    assert "\x1b" not in saved.said.out


def test_the_document_keeps_its_promised_keys(saved: Saved) -> None:
    d = saved.document
    assert d["schema"] == "bayes_asv/estimate/1"
    assert d["verdict"] == "ok"
    assert d["reasons"] == []
    assert isinstance(d["warnings"], list)
    for name, unit in UNITS.items():
        p = d["parameters"][name]
        assert p["unit"] == unit
        low, high = p["eti95"]
        assert low < p["median"] < high
        assert low < p["mean"] < high
        assert 0.0 < p["sd"] < 0.2 * p["mean"]
        assert 0.0 <= p["p_below_nominal"] <= 1.0
    for name, nominal in NOMINAL.items():
        assert math.isclose(d["parameters"][name]["nominal"], nominal)
    diagnostics = d["diagnostics"]
    assert diagnostics["likelihood"] == "innovations"
    assert 0.99 < diagnostics["rhat_max"] < 1.01
    assert diagnostics["ess_bulk_min"] >= 1000
    assert diagnostics["ess_tail_min"] >= 1000
    assert diagnostics["sampler"] == "weighted draws"  # so that every one counts
    assert diagnostics["draws"] <= min(diagnostics["ess_bulk_min"], diagnostics["ess_tail_min"])
    for channel in ("front_chassis", "rear_chassis"):
        assert 0.0 < d["fit"][channel]["nrmse_percent"] < 100.0
    assert d["seconds"] > 0.0
    assert d["version"] == __version__
    assert d["seed"] == 7


def test_every_number_in_it_is_one(saved: Saved) -> None:
    assert all(math.isfinite(x) for x in _numbers(saved.document))
    assert "NaN" not in saved.json_file.read_text(encoding="utf-8")


def test_the_truth_of_the_shipped_drive_is_found(saved: Saved, stops: Path) -> None:
    truth = json.loads(stops.with_suffix(".truth.json").read_text(encoding="utf-8"))
    assert truth["parameters"]["US"]["c_f"] == pytest.approx(5.76)
    front = saved.document["parameters"]["c_f"]
    assert front["p_below_nominal"] > 0.999
    assert front["mean"] == pytest.approx(5.76, rel=0.05)


def test_same_seed_same_answer_and_json_on_standard_output(
    run: Command,
    saved: Saved,
    stops: Path,
    baja: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With more threads and everything compiled anew, too."""
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    said = run("estimate", stops, "--vehicle", baja, "--json", "-", "--seed", 7)
    assert list(tmp_path.rglob("*.nbi"))
    assert said.status == 0
    document = json.loads(said.out)  # pure JSON: nothing before, nothing after
    assert said.out.endswith("}\n")
    assert said.err.splitlines() == saved.said.out.splitlines()
    seconds = document.pop("seconds"), dict(saved.document).pop("seconds")
    assert all(s > 0.0 for s in seconds)
    assert document == {k: v for k, v in saved.document.items() if k != "seconds"}


def test_the_draws_open_in_arviz(saved: Saved) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz as az

        data: Any = az.from_netcdf(str(saved.netcdf))
    posterior, stats = data["posterior"], data["sample_stats"]
    count = saved.document["diagnostics"]["draws"]
    for name in ("c_f", "c_r", "i", "k_g"):
        assert dict(posterior[name].sizes) == {"chain": 4, "draw": count // 4}
        assert posterior[name].attrs["units"]
        told = saved.document["parameters"][name]["si"]
        assert float(posterior[name].mean()) == pytest.approx(told["mean"], rel=1e-9)
        low, high = np.quantile(posterior[name].values, [0.025, 0.975])
        assert [low, high] == pytest.approx(told["eti95"], rel=1e-9)
    assert dict(stats["lp"].sizes) == {"chain": 4, "draw": count // 4}
    assert np.isfinite(stats["lp"].values).all()


def test_a_json_file_is_whole_or_as_it_was(
    invoke: Command, stops: Path, baja: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "x.json"
    target.write_text("what was there before", encoding="utf-8")

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    short = tmp_path / "short.csv"
    lines = stops.read_text(encoding="utf-8").splitlines()[:80]
    short.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        said = invoke("estimate", short, "-v", baja, "--json", target)
    assert said.status == 2
    assert "No space left on device" in said.err
    assert target.read_text(encoding="utf-8") == "what was there before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["short.csv", "x.json"]
    assert invoke("estimate", short, "-v", baja, "--json", target).status == 3
    assert json.loads(target.read_text(encoding="utf-8"))["verdict"] == "refused"


def test_not_converged_is_status_4(
    invoke: Command, stops: Path, baja: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import bayes_asv.posterior.sampler as sampler

    whole = sampler.sample_mcmc
    monkeypatch.setattr(
        sampler, "sample_mcmc", lambda target, mode, seed, *_: whole(target, mode, seed, most=30)
    )
    monkeypatch.setattr(sampler, "ESS_WANTED", 1e9)
    said = invoke("estimate", stops, "-v", baja, "--json", tmp_path / "x.json")
    assert said.status == 4
    assert said.err == ""
    parameters = ("Front damping", "Rear damping", "Pitch inertia", "Radius of gyration")
    rows = [line for line in said.out.splitlines() if line.startswith(parameters)]
    assert len(rows) == 4
    assert all(row.endswith("not to be relied on") for row in rows)
    assert "certain" not in said.out
    document = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert document["verdict"] == "not_converged"
    assert invoke("report", "--from", tmp_path / "x.json", "-o", tmp_path / "x.html").status == 4


def test_a_part_of_a_work_counts_as_a_part() -> None:
    told: list[tuple[float, str]] = []
    tell = part_of(lambda share, words: told.append((share, words)), 0.3, 0.8)
    assert tell is not None
    for share in (0.0, 0.5, 1.0):
        tell(share, "naming")
    assert told == [(0.3, "naming"), (pytest.approx(0.55), "naming"), (0.8, "naming")]
    assert part_of(None, 0.3, 0.8) is None


def test_progress_shows_on_a_terminal_only(stops: Path, baja: Path) -> None:
    ours, theirs = pty.openpty()
    words = [sys.executable, "-m", "bayes_asv", "estimate", str(stops), "-v", str(baja)]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=theirs, cwd=ROOT, env={**os.environ, "TERM": "xterm"}
    ) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the other end was closed
                break
            if not piece:
                break
            shown += piece
        assert process.stdout is not None
        out = process.stdout.read()
    os.close(ours)
    assert process.returncode == 0
    assert b"%" in shown
    assert b"sampling" in shown or b"effective draws" in shown
    assert b"Traceback" not in shown
    assert out.startswith(b"Front damper")
    assert b"\x1b" not in out


def test_a_reader_that_leaves_is_no_fault(stops: Path, baja: Path) -> None:
    short = [sys.executable, "-m", "bayes_asv", "--help"]
    with subprocess.Popen(
        short, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        err = process.stderr.read()
    assert err == b""
    assert process.returncode in (0, 1)
    with open("/dev/full", "wb") as full:
        done = subprocess.run(short, stdout=full, stderr=subprocess.PIPE, cwd=ROOT, check=False)
    assert done.returncode == 2
    assert done.stderr.decode().startswith("bayes-asv: output cannot be written")
    assert done.stderr.count(b"\n") == 1


def test_simulate_then_estimate_finds_the_car(run: Command, baja: Path, tmp_path: Path) -> None:
    recording = tmp_path / "drive.csv"
    made = run(
        "simulate", "-v", baja, "-o", recording, "--set", "c_r=0.8", "--seed", 3,
        "--json", tmp_path / "truth.json",
    )  # fmt: skip
    assert (made.status, made.err) == (0, "")
    assert made.out == f"{recording}\n"
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    said = run("estimate", recording, "-v", baja, "--json", tmp_path / "x.json")
    assert said.status == 0, said.err
    p = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))["parameters"]
    for name in ("c_f", "c_r", "i"):
        low, high = p[name]["si"]["eti95"]
        # a bit beyond the 95 %: with three parameters one in seven would otherwise be outside
        slack = 0.5 * (high - low)
        assert low - slack < truth["truth"][name] < high + slack
    low, high = p["c_r"]["eti95"]
    assert low < 8.0 < high
    assert p["c_r"]["p_below_nominal"] > 0.99
    assert "Rear damper" in said.out.splitlines()[0]


def test_simulate_is_the_same_for_the_same_seed(
    invoke: Command, baja: Path, tmp_path: Path
) -> None:
    first, again, other = (tmp_path / name for name in ("a.csv", "b.csv", "c.csv"))
    for file, seed in ((first, 1), (again, 1), (other, 2)):
        said = invoke("simulate", "-v", baja, "-o", file, "--road", "rough", "--seed", seed)
        assert said.status == 0
    assert first.read_bytes() == again.read_bytes()
    assert first.read_bytes() != other.read_bytes()


@pytest.mark.parametrize("road", ["bump", "stops", "rough", "rollers", "noise"])
def test_every_road_makes_a_recording_that_can_be_read(
    invoke: Command, baja: Path, tmp_path: Path, road: str
) -> None:
    from bayes_asv.domain.recording import nominal_rate
    from bayes_asv.io import read_recording

    file = tmp_path / "x.csv"
    said = invoke(
        "simulate", "-v", baja, "-o", file, "--road", road, "--rate", "200", "--json", "-"
    )
    assert said.status == 0
    assert json.loads(said.out)["road"] == road
    assert nominal_rate(read_recording(file)) == pytest.approx(200.0)


def test_the_demo_names_the_report_it_wrote(run: Command, tmp_path: Path) -> None:
    said = run("demo", "-o", "here", cwd=tmp_path)
    assert (said.status, said.err) == (0, "")
    html, pdf = Path("here") / "demo.html", Path("here") / "demo.pdf"
    assert str(html) in said.out
    assert str(pdf) in said.out
    assert (tmp_path / html).read_bytes().startswith(b"<!DOCTYPE html>")
    assert (tmp_path / pdf).read_bytes().startswith(b"%PDF")
    assert "Front damper: " in said.out
    truth = next(line for line in said.sentences if line.startswith("True values "))
    assert "front damping rate 5.76 lbf·s/in (" in truth
    assert truth.count("side its interval)") == 3
