"""Track and watch doubt a broken channel as estimate does; short form of the benchmark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.analysis import input_mistakes
from bayes_asv.analysis.nominal_values import implausible_values
from bayes_asv.analysis.screening_fit import holds_throughout, screening_fit
from bayes_asv.domain.recording import Recording
from bayes_asv.library.live import watch
from bayes_asv.library.tracks import track
from bayes_asv.models.cars import car_model
from benchmarks.broken_channels import KINDS, ask, draw_case
from tests.posterior.cases import DECLARED, case, vehicle
from tests.tracking.drives import tracked

SEED = 5


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the search for the name of a mistake: it takes no doubt away."""
    monkeypatch.setattr(input_mistakes, "likely_mistakes", lambda *_, **__: [])


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("number", range(1, 2 * len(KINDS), 2))
def test_no_command_answers_ok_about_a_broken_channel(number: int) -> None:
    broken = draw_case(SEED, number)
    assert broken.kind == list(KINDS)[number // 2]
    for command in ("estimate", "track", "watch"):
        assert ask(command, broken)["answer"] != "ok", (command, broken.words)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("number", [0, 8, 16])
def test_no_command_doubts_a_sound_drive(number: int) -> None:
    for command in ("estimate", "track", "watch"):
        found = ask(command, draw_case(SEED, number))
        assert found["answer"] == "ok", (command, found["words"])


def _late(seconds: float) -> Recording:
    recording = case("rough", 3, DECLARED, seconds=1.5)[2]
    values = recording.values.copy()
    values[3] = np.interp(recording.time - seconds, recording.time, values[3])
    return replace(recording, values=values)


def test_a_track_says_which_channel_is_late_and_compares_no_damper() -> None:
    result = track(_late(0.012), vehicle(DECLARED), progress=False)
    assert "rear chassis is 12" in result.document.doubt
    assert all(p.withheld for p in result.document.parameters.values())
    assert "rear chassis is 12" in result.lines()[0]


def test_a_watch_with_a_mistaken_input_raises_no_alarm() -> None:
    """The front wheel holds a copy of the rear one."""
    recording = case("rough", 3, DECLARED, seconds=2.5)[2]
    values = recording.values.copy()
    values[0] = values[2]
    result = watch(replace(recording, values=values), vehicle(DECLARED), below=95.0)
    assert result is not None
    assert result.verdict == "refused"
    assert result.document.alarm is None
    assert "hold the same readings" in result.lines()[1]


def test_the_last_active_rows_of_a_stream_are_checked_too() -> None:
    """A sensor that drops out 20 s after the most active stretch."""
    calm = case("rough", 4, DECLARED, seconds=25.0)[2]
    values = calm.values.copy()
    values[:, : len(calm.time) // 4] *= 1.5
    values[3, 7000:] += 400.0 * np.sin(3.0 * calm.time[7000:])
    tracker, _ = tracked(replace(calm, values=values))
    kept = tracker._active_blocks.recordings("x.csv")
    assert len(kept) == 2
    assert kept[1].time[-1] > 17.5


def test_a_fit_to_the_most_active_stretch_has_to_hold_in_the_others() -> None:
    recording, car = case("rough", 6, DECLARED, seconds=6.0)[2], vehicle(DECLARED)
    fit = screening_fit([replace_rows(recording, 1000)], car)
    assert fit is not None
    assert holds_throughout(fit, recording, car, "half", 2.5)
    values = recording.values.copy()
    values[1, 1600:] *= 0.8
    broken = replace(recording, values=values)
    assert not holds_throughout(fit, broken, car, "half", 2.5)


def replace_rows(recording: Recording, rows: int) -> Recording:
    """The first rows of a recording."""
    return replace(recording, time=recording.time[:rows], values=recording.values[:, :rows])


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [("c_f", 8.0, "a damping ratio of"), ("c_r", 1e-3, "damping ratio"), ("k_r", 60.0, "Hz")],
)
def test_a_car_that_nobody_builds_is_doubted(name: str, factor: float, words: str) -> None:
    model = car_model("half", vehicle(DECLARED))
    values = {parameter.name: parameter.nominal for parameter in model.parameters}
    assert implausible_values(model, values) == []
    values[name] *= factor
    (found,) = implausible_values(model, values)
    assert words in found.words
    assert "as no car has" in found.words
