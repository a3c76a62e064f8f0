"""What may be wished together, and what a recording followed without anybody looking gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from PIL import Image

from bayes_asv.cli.live_options import followed, live_options, wishes
from bayes_asv.tracking.frames import Frames, joined
from tests.live.made_up import BAJA, MadeUp, frames, recording

NOTHING: dict[str, Any] = {
    "live": False, "tui": False, "gif": None, "speed": None, "no_browser": False, "port": None,
    "baud": None, "keep": None,
}  # fmt: skip


@pytest.mark.parametrize(
    ("recording_file", "changes", "words"),
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
def test_what_does_not_fit_is_refused(
    recording_file: str | None, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(click.UsageError, match=words):
        wishes(recording_file, **{**NOTHING, **changes})


def test_what_a_port_sends_is_kept_in_a_file_with_the_time_in_its_name() -> None:
    wanted = wishes(None, **{**NOTHING, "port": "COM3"})
    assert wanted.keep is not None
    assert wanted.keep.startswith("run-20")
    assert wanted.baud == 115_200
    assert not wanted.shown


def test_every_option_is_a_wish() -> None:
    @live_options
    @click.command()
    def command(**options: object) -> None:
        """Take them."""
        assert set(options) == set(NOTHING)
        assert wishes("r.csv", **options).page  # type: ignore[arg-type]

    assert isinstance(command, click.Command)
    command.main(["--live"], standalone_mode=False)


def test_all_frames_and_an_animation(tmp_path: Path) -> None:
    run = recording(0.6, 200.0)
    got: list[Frames] = []
    file = tmp_path / "a.gif"
    wanted = wishes("r.csv", **{**NOTHING, "gif": str(file), "speed": 0.5})
    followed(wanted, run, BAJA, lambda _: MadeUp(), got.append)
    np.testing.assert_allclose(joined(got).median, frames(BAJA, run.time, run.values.T).median)
    with Image.open(file) as picture:
        assert picture.n_frames == 15  # type: ignore[attr-defined]
