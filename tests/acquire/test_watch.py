"""The online filter fed by a transfer says what it says of the whole recording."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.acquire.job import acquire
from bayes_asv.acquire.run import Request
from bayes_asv.acquire.watch import Watch
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.shipped import shipped
from bayes_asv.simulation.roads import road
from bayes_asv.simulation.simulate import simulate
from bayes_asv.tracking.track import track
from tests.acquire.fake import FakeLogger
from tests.acquire.made import Made
from tests.firmware.scenarios import counts_of


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return read_vehicle(shipped("vehicles", "baja2008.toml"))


@pytest.fixture(scope="module")
def blocks(vehicle: Vehicle) -> tuple[Made, Made]:
    """A drive over two parking stops as the two boards hold it."""
    where = road("stops", np.random.default_rng(2))
    drive = simulate(vehicle, where, rate=400, seconds=2.0, seed=2).recording
    counts = np.rint(counts_of(drive, vehicle)).astype(np.int64).clip(0, 1023).T
    return Made(1, counts[:800, :2]), Made(2, counts[:800, 2:], ppm=30.0)


def test_rows_are_tracked_as_they_come(vehicle: Vehicle, blocks: tuple[Made, Made]) -> None:
    said: list[str] = []
    watch = Watch(vehicle, said.append)
    outcome = acquire(FakeLogger(*blocks), Request(start=True), grown=watch.grown)
    assert outcome.recording is not None
    assert watch.rows == 800
    assert [text.split(":")[0] for text in said] == [
        f"after {n} rows" for n in (200, 400, 600, 800)
    ]
    assert "lbf" in said[-1]
    live = watch.finish(outcome.recording)
    whole = track(outcome.recording, vehicle)
    assert np.array_equal(live.frames.time, whole.frames.time)
    assert np.allclose(live.mean, whole.mean, rtol=0, atol=1e-9)
    assert live.verdict == whole.verdict == "ok"


def test_gaps_wait_for_the_end(vehicle: Vehicle, blocks: tuple[Made, Made]) -> None:
    watch = Watch(vehicle, lambda text: None)
    logger = FakeLogger(*blocks)
    lost = blocks[1].frames[40][1:-1]  # this one never comes

    def spoil(data: bytes) -> bytes:
        return b"" if lost in data else data

    logger.spoil = spoil
    outcome = acquire(logger, Request(start=True), grown=watch.grown, patience=5.0)
    assert outcome.verdict == "incomplete"
    assert outcome.recording is not None
    assert watch.rows == 370
    live = watch.finish(outcome.recording)
    assert len(live.frames) == 800
    assert np.allclose(live.mean, track(outcome.recording, vehicle).mean, rtol=0, atol=1e-9)


def test_a_sensor_without_scale_is_refused_before_the_run() -> None:
    with pytest.raises(InputError, match="zero_counts"):
        Watch(read_vehicle(shipped("vehicles", "thesis_simulation.toml")), lambda text: None)
