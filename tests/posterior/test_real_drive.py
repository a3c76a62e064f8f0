"""A real car's road drive, where it lies beside the project; its truth is not known."""

from pathlib import Path

import pytest

from bayes_asv.domain.recording import nominal_rate
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording

DRIVES = Path(__file__).resolve().parents[3] / "shared" / "data" / "roomster"

pytestmark = pytest.mark.skipif(
    not DRIVES.is_dir(), reason="the road drives do not travel with the project"
)


def test_a_real_drive_is_read_as_it_is() -> None:
    recording = read_recording(DRIVES / "drive06_1.csv")
    assert recording.values.shape == (4, 4724)
    assert nominal_rate(recording) == pytest.approx(120.0, rel=1e-3)
    assert recording.warnings == ()


def test_a_real_drive_that_cannot_be_answered_says_what_stops_it() -> None:
    result = estimate(
        [read_recording(DRIVES / "drive06_1.csv")], read_vehicle(DRIVES / "roomster.toml")
    )
    # The linear half car explains next to nothing of this drive's front chassis, and says so.
    assert result.verdict == "refused"
    assert any("explains only" in reason for reason in result.reasons)
