"""From a shipped recording through the online filter to the texts of the page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.io import read_recording
from bayes_asv.live.metadata import view_metadata
from bayes_asv.live.run import follow
from bayes_asv.live.sources import RecordingSource
from bayes_asv.live.viewer import Viewer
from bayes_asv.tracking.frames import Frames, concatenate
from bayes_asv.tracking.tracker import tracker_for
from tests.live.synthetic import BAJA

RECORDINGS = Path(__file__).parents[2] / "data" / "recordings"


@pytest.mark.parametrize("name", ["stops-400hz", "bump-400hz"])
def test_page_shows_the_estimates(name: str) -> None:
    recording = read_recording(RECORDINGS / f"{name}.csv")
    source = RecordingSource(recording, BAJA)
    parts: list[Frames] = []
    metadata = view_metadata(BAJA, recording.source, source.duration)
    session = follow(
        source, metadata, lambda info: tracker_for(info.start, BAJA), sink=parts.append
    )
    all_frames = concatenate(parts)
    np.testing.assert_array_equal(all_frames.time, recording.time)
    session.control("seek", 1e9)
    session.control("pause")
    session.playback()
    message = Viewer(session, 10.0).message()
    assert message is not None
    text = json.loads(json.dumps(message, allow_nan=False))
    truth = json.loads((RECORDINGS / f"{name}.truth.json").read_text())["car"]
    for n, parameter in enumerate(metadata.parameters):
        value = text["run"]["columns"][3 * n][-1] * parameter.factor
        assert value == pytest.approx(all_frames.median[-1, n], rel=1e-4)
        low, high = (text["run"]["columns"][3 * n + k][-1] * parameter.factor for k in (1, 2))
        # The truth is in the band, or no further outside than the width of the band.
        assert low - (high - low) < truth[parameter.name] < high + (high - low)
    front = text["now"]["cards"][0]
    assert front["sense"] in [f"{lost} % softer than nominal" for lost in (19, 20, 21)]
    assert text["now"]["consistency"]["short"] == "consistent"
