"""From a shipped recording through the online filter to the words on the page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.io import read_recording
from bayes_asv.live.metadata import scene
from bayes_asv.live.run import follow
from bayes_asv.live.sources import RecordingSource
from bayes_asv.live.stream import Viewer
from bayes_asv.tracking.frames import Frames, joined
from bayes_asv.tracking.tracker import tracker_for
from tests.live.made_up import BAJA

RECORDINGS = Path(__file__).parents[2] / "data" / "recordings"


@pytest.mark.parametrize("name", ["stops-400hz", "bump-400hz"])
def test_the_page_says_what_the_filter_found(name: str) -> None:
    recording = read_recording(RECORDINGS / f"{name}.csv")
    source = RecordingSource(recording, BAJA)
    got: list[Frames] = []
    view = scene(BAJA, recording.source, source.duration)
    show = follow(source, view, lambda about: tracker_for(about.start, BAJA), sink=got.append)
    every = joined(got)
    np.testing.assert_array_equal(every.time, recording.time)
    show.ask("seek", 1e9)
    show.ask("pause")
    show.moment()
    message = Viewer(show, 10.0).message()
    assert message is not None
    text = json.loads(json.dumps(message, allow_nan=False))
    truth = json.loads((RECORDINGS / f"{name}.truth.json").read_text())["car"]
    for n, parameter in enumerate(view.parameters):
        value = text["run"]["columns"][3 * n][-1] * parameter.factor
        assert value == pytest.approx(every.median[-1, n], rel=1e-4)
        low, high = (text["run"]["columns"][3 * n + k][-1] * parameter.factor for k in (1, 2))
        # The truth lies in the band, or no further outside of it than the band is wide.
        assert low - (high - low) < truth[parameter.name] < high + (high - low)
    front = text["now"]["cards"][0]
    assert front["sense"] in [f"{lost} % softer than nominal" for lost in (19, 20, 21)]
    assert text["now"]["consistency"]["short"] == "consistent"
