"""The animation, as a viewer of pictures reads it."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bayes_asv.domain.errors import InputError
from bayes_asv.live.animation import animation, write_animation
from bayes_asv.live.history import History
from bayes_asv.live.metadata import scene
from tests.live.made_up import BAJA, shown


@pytest.fixture(scope="module")
def made() -> bytes:
    show = shown(1.0)
    return animation(show.scene, show.history.snapshot(), 1.0)


def test_it_lasts_as_long_as_the_recording_and_then_stays(made: bytes) -> None:
    with Image.open(io.BytesIO(made)) as picture:
        assert picture.format == "GIF"
        assert picture.size == (768, 432)
        lasting = []
        for n in range(picture.n_frames):  # type: ignore[attr-defined]
            picture.seek(n)
            lasting.append(picture.info["duration"])
    assert sum(lasting[:-1]) / 1000.0 == pytest.approx(1.0, abs=0.1)  # as long as asked for
    assert lasting[-1] >= 2000
    assert len(made) < 1_500_000


def test_curves_grow_from_left_to_right(made: bytes) -> None:
    with Image.open(io.BytesIO(made)) as picture:
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


def test_same_history_same_bytes(made: bytes) -> None:
    show = shown(1.0)
    assert animation(show.scene, show.history.snapshot(), 1.0) == made


def test_what_cannot_be_drawn_is_refused(tmp_path: Path) -> None:
    show = shown(5.0, 50.0)
    with pytest.raises(InputError, match=r"gives 6\d\d pictures at ×0.1; give a greater --speed"):
        write_animation(show.scene, show.history.snapshot(), tmp_path / "a.gif", 0.1)
    with pytest.raises(InputError, match="no rows to draw"):
        write_animation(show.scene, History(show.scene).snapshot(), tmp_path / "a.gif")
    with pytest.raises(InputError, match="folder does not exist"):
        write_animation(
            scene(BAJA, "x", 1.0), show.history.snapshot(), tmp_path / "no" / "a.gif", 50.0
        )
    assert list(tmp_path.iterdir()) == []
