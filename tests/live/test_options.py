"""Combinations of options, and the frames of a recording without a view."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from PIL import Image

from bayes_asv.cli.live_options import live_options, live_settings
from bayes_asv.domain.errors import InputError
from bayes_asv.library.live import LiveSettings, follow
from bayes_asv.tracking.frames import Frames, concatenate
from tests.live.synthetic import BAJA, FakeFilter, frames, recording

NOTHING: dict[str, Any] = {
    "live": False, "tui": False, "gif": None, "speed": None, "no_browser": False, "port": None,
    "baud": None, "keep": None,
}  # fmt: skip


@pytest.mark.parametrize(
    ("recording_file", "changes", "message"),
    [
        (None, {}, "either a recording or --port"),
        ("r.csv", {"port": "COM3"}, "either a recording or --port"),
        ("r.csv", {"baud": 9600}, "belong to --port"),
        ("r.csv", {"keep": "x"}, "belong to --port"),
        (None, {"port": "COM3", "gif": "a.gif"}, "need a recording"),
        (None, {"port": "COM3", "live": True, "speed": 2.0}, "need a recording"),
        ("r.csv", {"speed": 2.0}, "--speed belongs to"),
        ("r.csv", {"no_browser": True}, "--no-browser belongs to --live"),
        ("r.csv", {"tui": True}, "needs a terminal"),
    ],
)
def test_invalid_combinations_are_refused(
    recording_file: str | None, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(click.UsageError, match=message):
        live_settings(recording_file, **{**NOTHING, **changes})


def test_an_animation_is_a_gif() -> None:
    assert live_settings("r.csv", **{**NOTHING, "gif": "a.GIF"}).gif == "a.GIF"
    with pytest.raises(InputError, match=r"end the name in \.gif"):
        live_settings("r.csv", **{**NOTHING, "gif": "a.mp4"})


def test_default_name_of_the_file_of_a_port() -> None:
    settings = live_settings(None, **{**NOTHING, "port": "COM3"})
    assert settings.port is not None
    assert settings.port.keep.startswith("run-20")
    assert settings.port.baud == 115_200
    assert not settings.shown


def test_every_option_is_passed_on() -> None:
    @live_options
    @click.command()
    def command(**options: object) -> None:
        """Accept the options."""
        assert set(options) == set(NOTHING)
        assert live_settings("r.csv", **options).page  # type: ignore[arg-type]

    assert isinstance(command, click.Command)
    command.main(["--live"], standalone_mode=False)


def test_all_frames_and_an_animation(tmp_path: Path) -> None:
    run = recording(0.6, 200.0)
    parts: list[Frames] = []
    file = tmp_path / "a.gif"
    settings = LiveSettings(gif=str(file), speed=0.5)
    follow(settings, run, BAJA, lambda _: FakeFilter(), parts.append)
    np.testing.assert_allclose(
        concatenate(parts).median, frames(BAJA, run.time, run.values.T).median
    )
    with Image.open(file) as picture:
        assert picture.n_frames == 15  # type: ignore[attr-defined]
