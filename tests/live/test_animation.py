"""The animation as an image viewer reads it."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bayes_asv.domain.errors import InputError
from bayes_asv.live.animation import animation, write_animation
from bayes_asv.live.history import History
from bayes_asv.live.metadata import view_metadata
from tests.live.synthetic import BAJA, finished_session


@pytest.fixture(scope="module")
def gif() -> bytes:
    session = finished_session(1.0)
    return animation(session.metadata, session.history.snapshot(), 1.0)


def test_duration_of_the_frames(gif: bytes) -> None:
    with Image.open(io.BytesIO(gif)) as picture:
        assert picture.format == "GIF"
        assert picture.size == (768, 432)
        durations = []
        for n in range(picture.n_frames):  # type: ignore[attr-defined]
            picture.seek(n)
            durations.append(picture.info["duration"])
    assert sum(durations[:-1]) / 1000.0 == pytest.approx(1.0, abs=0.1)  # at the chosen speed
    assert durations[-1] >= 2000
    assert len(gif) < 1_500_000


def test_curves_grow_from_left_to_right(gif: bytes) -> None:
    with Image.open(io.BytesIO(gif)) as picture:
        reached = []
        for n in range(picture.n_frames):  # type: ignore[attr-defined]
            picture.seek(n)
            pixels = np.asarray(picture.convert("RGB")).astype(int)[330:390, 70:370]  # front travel
            blue = (pixels[..., 2] > pixels[..., 0] + 60).any(axis=0)
            reached.append(int(np.flatnonzero(blue).max()))
    assert (np.diff(reached) >= 0).all()
    assert len(set(reached)) > 9
    assert reached[-1] > 290
    assert reached[0] < 40


def test_animation_is_reproducible(gif: bytes) -> None:
    session = finished_session(1.0)
    assert animation(session.metadata, session.history.snapshot(), 1.0) == gif


def test_impossible_animations_are_refused(tmp_path: Path) -> None:
    session = finished_session(5.0, 50.0)
    with pytest.raises(InputError, match=r"gives 6\d\d pictures at ×0.1; give a greater --speed"):
        write_animation(session.metadata, session.history.snapshot(), tmp_path / "a.gif", 0.1)
    with pytest.raises(InputError, match="no rows to draw"):
        write_animation(session.metadata, History(session.metadata).snapshot(), tmp_path / "a.gif")
    with pytest.raises(InputError, match="folder does not exist"):
        write_animation(
            view_metadata(BAJA, "x", 1.0),
            session.history.snapshot(),
            tmp_path / "no" / "a.gif",
            50.0,
        )
    assert list(tmp_path.iterdir()) == []
