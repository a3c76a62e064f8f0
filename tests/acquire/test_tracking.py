"""The online filter fed by a transfer compared with tracking the whole recording."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.acquire.acquisition import acquire
from bayes_asv.acquire.tracking import TransferOnlineFilter
from bayes_asv.acquire.transfer import RunRequest
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.shipped import shipped
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from bayes_asv.tracking.track import track
from tests.acquire.fake_logger import FakeLogger
from tests.acquire.synthetic import SyntheticBlock
from tests.firmware.scenarios import counts_of


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return read_vehicle(shipped("vehicles", "baja2008.toml"))


@pytest.fixture(scope="module")
def blocks(vehicle: Vehicle) -> tuple[SyntheticBlock, SyntheticBlock]:
    """A drive over two parking stops in the memory of the two boards."""
    ground = road("stops", np.random.default_rng(2))
    drive = simulate(vehicle, ground, rate=400, seconds=2.0, seed=2).recording
    counts = np.rint(counts_of(drive, vehicle)).astype(np.int64).clip(0, 1023).T
    return SyntheticBlock(1, counts[:800, :2]), SyntheticBlock(2, counts[:800, 2:], ppm=30.0)


@pytest.mark.usefixtures("without_input_search")
def test_rows_are_tracked_during_the_transfer(
    vehicle: Vehicle, blocks: tuple[SyntheticBlock, SyntheticBlock]
) -> None:
    messages: list[str] = []
    tracker = TransferOnlineFilter(vehicle, messages.append)
    outcome = acquire(FakeLogger(*blocks), RunRequest(start=True), on_block=tracker.on_block)
    assert outcome.recording is not None
    assert tracker.rows == 800
    assert [text.split(":")[0] for text in messages] == [
        f"after {n} rows" for n in (200, 400, 600, 800)
    ]
    assert "lbf" in messages[-1]
    live = tracker.finish(outcome.recording)
    whole = track(outcome.recording, vehicle)
    assert np.array_equal(live.frames.time, whole.frames.time)
    assert np.allclose(live.mean, whole.mean, rtol=0, atol=1e-9)
    assert live.verdict == whole.verdict == "ok"


@pytest.mark.usefixtures("without_input_search")
def test_gaps_are_processed_at_the_end(
    vehicle: Vehicle, blocks: tuple[SyntheticBlock, SyntheticBlock]
) -> None:
    tracker = TransferOnlineFilter(vehicle, lambda text: None)
    logger = FakeLogger(*blocks)
    lost = blocks[1].frames[40][1:-1]  # this frame never arrives

    def corrupt(data: bytes) -> bytes:
        return b"" if lost in data else data

    logger.corrupt = corrupt
    outcome = acquire(logger, RunRequest(start=True), on_block=tracker.on_block, patience=5.0)
    assert outcome.verdict == "incomplete"
    assert outcome.recording is not None
    assert tracker.rows == 370
    live = tracker.finish(outcome.recording)
    assert len(live.frames) == 800
    assert np.allclose(live.mean, track(outcome.recording, vehicle).mean, rtol=0, atol=1e-9)


def test_sensor_without_scale_is_refused_before_the_run() -> None:
    with pytest.raises(InputError, match="zero_counts"):
        TransferOnlineFilter(
            read_vehicle(shipped("vehicles", "thesis_simulation.toml")), lambda text: None
        )
